#include "trainer/stages/stage_loop.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <optional>

#include "nn/core/profile.h"
#include "trainer/avatar/checkpoint.h"

namespace doppel {

namespace {

double secondsNow() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

// True every so many seconds; never for 0.
class PictureClock {
public:
    explicit PictureClock(double seconds) : seconds_(seconds), last_(secondsNow()) {}
    bool due() {
        if (seconds_ <= 0 || secondsNow() - last_ < seconds_) return false;
        last_ = secondsNow();
        return true;
    }

private:
    double seconds_;
    double last_;
};

// The record of the stage, as long as its steps are taken.
class ShownStage {
public:
    ShownStage(std::filesystem::path out, const StageRecord& record) : out_(std::move(out)) {
        writeStageRecord(out_, record);
    }
    ~ShownStage() { removeStageRecord(out_); }
    ShownStage(const ShownStage&) = delete;
    ShownStage& operator=(const ShownStage&) = delete;

private:
    std::filesystem::path out_;
};

// Memory before the first step, on stdout.
void printPlan(const StageLoop& loop) {
    auto mib = [](uint64_t bytes) { return static_cast<double>(bytes) / (1 << 20); };
    uint64_t elements = 0;
    for (const auto& [name, parameters] : loop.trained) elements += parameters->elements();
    fmt::print(
        "stage {}: {} steps; {} dispatches; parameters with gradients and moments {:.3f} MiB, "
        "activations {:.1f} MiB planned ({:.1f} MiB without reuse)\n",
        loop.stage, loop.steps, loop.graph->dispatchCount(),
        mib(elements * 4 * Parameters::kSectionCount), mib(loop.graph->temporaryBytes()),
        mib(loop.graph->unsharedBytes()));
}

void average(Ranks& ranks, std::vector<double>& values) {
    std::vector<float> floats(values.begin(), values.end());
    ranks.average(floats);
    std::ranges::copy(floats, values.begin());
}

// What one of them says holds for all.
bool anyRank(Ranks* ranks, bool says) {
    if (!ranks) return says;
    float told = says ? 1.0f : 0.0f;
    ranks->average({&told, 1});
    return told > 0;
}

// Losses in the progress line, which has to fit in a terminal's.
constexpr size_t kShownLosses = 5;

}  // namespace

std::map<std::string, std::string> stageIdentity(const Avatar& avatar, const std::string& stage) {
    std::map<std::string, std::string> identity;
    identity["vertices"] = fmt::format("{}", avatar.body.vertexCount);
    for (const auto& [name, value] : presetValues(avatar.preset))
        if (name.starts_with(stage + ".")) identity[name] = value;
    return identity;
}

void StageLoop::follow(Graph& stepGraph, const Losses& losses) {
    graph = &stepGraph;
    columns = losses.names();
    values = [&losses](int64_t, int back) { return losses.read(back); };
}

void StageLoop::checkFinite(int64_t step, const std::vector<double>& found,
                            const std::vector<size_t>& drawn) const {
    if (std::ranges::all_of(found, [](double value) { return std::isfinite(value); })) return;
    // The sum, which comes first, is the last to blame.
    size_t bad = 0;
    for (size_t c = found.size(); c-- > 1;)
        if (!std::isfinite(found[c])) bad = c;
    std::string frames;
    for (size_t frame : drawn)
        if (frameName) frames += (frames.empty() ? " (frames: " : ", ") + frameName(frame);
    throwMachine("stage {}: loss \"{}\" became {} at step {}{}; a lower learning rate may help",
                 stage, columns[bad], found[bad], step + 1, frames.empty() ? "" : frames + ")");
}

Ranks* LoopSettings::sharing(int batch) const {
    return ranks && batch % ranks->size() == 0 ? ranks : nullptr;
}

std::vector<int32_t> wordsOf(const StepParams& params) {
    std::vector<int32_t> words(sizeof(StepParams) / 4);
    std::memcpy(words.data(), &params, sizeof(params));
    return words;
}

// Steps that a checkpoint has, which all ranks go on from.
int64_t StageLoop::start(const LoopSettings& settings, Checkpoint& checkpoint) const {
    int64_t first = settings.keeps() && settings.resume ? checkpoint.restore() : 0;
    if (first > steps)
        throwInput("{}: steps_done: expected {} at most, found {}", checkpoint.path().string(),
                   steps, first);
    if (!settings.ranks) return first;
    settings.ranks->broadcast(reinterpret_cast<std::byte*>(&first), sizeof(first));
    for (const auto* all : {&trained, &statistics})
        for (const auto& [name, parameters] : *all) parameters->broadcast(*settings.ranks);
    return first;
}

bool StageLoop::run(const LoopSettings& settings) {
    bool profiles = settings.profileSteps > 0;
    std::map<std::string, std::string> mustAgree = identity;
    mustAgree["seed"] = fmt::format("{}", settings.seed);
    mustAgree["steps"] = fmt::format("{}", steps);
    Checkpoint checkpoint(settings.out / "checkpoints", stage, std::move(mustAgree));
    for (const auto& [name, parameters] : trained) checkpoint.keepTrained(name, *parameters);
    for (const auto& [name, parameters] : statistics) checkpoint.keepStatistics(name, *parameters);

    const int64_t first = start(settings, checkpoint);
    for (int64_t i = 0; i < first; ++i) draw();

    CHECK(!profiles || graph != nullptr, "a stage that profiles follows a graph");
    if (profiles) printPlan(*this);
    Progress progress(stage, profiles ? settings.profileSteps : steps);
    if (settings.ranks && !sharing)
        progress.note(fmt::format(
            "{}: its batches cannot be shared by {} processes, so that each takes every "
            "step whole; --set {}.batch=N with a multiple of them shares",
            stage, settings.ranks->size(), stage));
    if (first > 0)
        progress.note(fmt::format("{}: going on after step {} of {}", stage, first, steps));
    std::optional<LossLog> log;
    std::optional<ShownStage> record;
    if (settings.keeps()) {
        log.emplace(settings.out / "log", stage, columns, first);
        record.emplace(settings.out, StageRecord{.stage = stage,
                                                 .device = graph ? graph->device().info().name : "",
                                                 .steps = steps,
                                                 .first = first,
                                                 .began = secondsSince1970()});
    }
    const uint64_t sentBefore = sharing ? sharing->bytesSent() : 0;
    PictureClock pictures(settings.keeps() ? settings.pictureSeconds : 0);
    std::array<std::vector<size_t>, 2> drawn;  // by the even and the odd steps under way
    // Reported: all steps before this one. One more at most is under way.
    int64_t reported = first;
    auto reportUntil = [&](int64_t end, int64_t submitted) {
        for (; reported < end; ++reported) {
            std::vector<double> given =
                values(reported, static_cast<int>(submitted - 1 - reported));
            if (sharing) average(*sharing, given);
            checkFinite(reported, given, drawn[static_cast<size_t>(reported % 2)]);
            Progress::Values shown;
            for (size_t c = 0; c < std::min(kShownLosses, given.size()); ++c)
                shown.emplace_back(columns[c], given[c]);
            progress.update(reported + 1, shown);
            if (log) log->add(reported, given);
            if (settings.afterStep) settings.afterStep(stage, reported + 1);
        }
    };
    for (int64_t i = first; i < steps; ++i) {
        std::vector<size_t>& frames = drawn[static_cast<size_t>(i % 2)];
        frames = draw();
        submit(i, frames);
        reportUntil(i, i + 1);  // the step before, while the device works on this one
        if (profiles) {
            if (i + 1 < settings.profileSteps) continue;
            reportUntil(i + 1, i + 1);
            fmt::print("{}", profileTable(*graph, "stage " + stage));
            return false;
        }
        // What is kept or shown is the state after step i, whose losses must be finite.
        bool draws = picture && pictures.due();
        // What follows the last step takes its time as well.
        bool saves =
            settings.keeps() && (i + 1 == steps || checkpoint.due(settings.checkpointSeconds));
        const bool pauses = anyRank(settings.ranks, draws || saves || interrupted());
        if (!pauses && i + 1 < steps) continue;
        reportUntil(i + 1, i + 1);
        if (draws) picture();
        if (anyRank(settings.ranks, interrupted())) {
            if (!settings.keeps()) throw Interrupted{};
            checkpoint.save(i + 1);
            throw Interrupted{fmt::format("checkpoint {}, from which the same command goes on",
                                          checkpoint.path().string())};
        }
        if (saves) checkpoint.save(i + 1);
    }
    if (sharing && steps > first)
        progress.note(fmt::format("{}: process 0 of {} sent {:.1f} KiB to the others in each step",
                                  stage, sharing->size(),
                                  static_cast<double>(sharing->bytesSent() - sentBefore) / 1024 /
                                      static_cast<double>(steps - first)));
    return !profiles;
}

}  // namespace doppel
