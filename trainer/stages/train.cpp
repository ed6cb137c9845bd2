#include "trainer/stages/train.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <span>

#include "nn/body/body_caps.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/rendering.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/data/digest.h"
#include "trainer/data/output_folder.h"
#include "trainer/stages/texture_size.h"

namespace doppel {

namespace {

// What a run is asked for: all that its result depends on, but the pictures themselves.
using Asked = std::map<std::string, std::string>;

Asked askedFor(const TrainSettings& settings, const Avatar& avatar, const Capture& capture,
               Precision precision) {
    Asked asked;
    asked["precision"] = precisionName(precision);
    asked["stages"] = fmt::format("{}", fmt::join(settings.stages, ","));
    asked["seed"] = fmt::format("{}", settings.seed);
    for (const auto& [name, value] : presetValues(avatar.preset))
        for (const std::string& stage : settings.stages)
            if (name.starts_with(stage + ".")) asked[name] = value;
    if (std::ranges::count(settings.stages, "texels") > 0)  // they have the texture's size
        asked["texels.textureSize"] = fmt::format("{}", avatar.preset.texture.textureSize);
    Digest poses, cameras, body;
    for (size_t i = 0; i < capture.size(); ++i) {
        const Camera& camera = capture.frames[i].camera;
        poses.add(std::span<const float>(capture.theta[i]));
        poses.add(std::span<const float>(capture.trans[i]));
        cameras.add(std::span<const char>(capture.frames[i].name));
        cameras.add(std::span<const double>({camera.fx, camera.fy, camera.cx, camera.cy,
                                             double(camera.width), double(camera.height)}));
    }
    poses.add(std::span<const float>(capture.betas));
    // The model's: its cap is a stage's result.
    body.add(std::span(avatar.body.templateVertices)
                 .first(3 * static_cast<size_t>(avatar.body.modelVertices)));
    body.add(std::span(avatar.body.faces).first(3 * static_cast<size_t>(avatar.body.modelFaces)));
    asked["capture"] = capture.name;
    asked["frames"] = fmt::format("{}", capture.size());
    asked["capture_poses"] = poses.text();
    asked["capture_frames"] = cameras.text();
    asked["body"] = body.text();
    if (!settings.known.digest.empty())
        for (const char* stage : {"shape", "texels"})  // which alone they tell
            asked[std::string(stage) + ".prior"] = settings.known.digest;
    return asked;
}

// The part of it that one stage's result depends on.
Asked askedOf(const std::string& stage, const Asked& asked) {
    Asked part;
    for (const auto& [key, value] : asked)
        if (key != "stages" && (key.find('.') == std::string::npos || key.starts_with(stage + ".")))
            part[key] = value;
    return part;
}

std::string valueOf(const Asked& of, const std::string& key) {
    auto found = of.find(key);
    return found == of.end() ? std::string("none") : found->second;
}

// The first key in which the two differ.
std::optional<std::string> difference(const Asked& there, const Asked& here) {
    Asked all = there;
    all.insert(here.begin(), here.end());
    for (const auto& [key, unused] : all)
        if (valueOf(there, key) != valueOf(here, key)) return key;
    return std::nullopt;
}

bool hasStage(const Avatar& avatar, const std::string& name) {
    if (avatar.trained.contains(name)) return true;
    for (const Stage& stage : allStages())
        if (stage.name == name && stage.isIn && stage.isIn(avatar)) return true;
    return false;
}

// What is on disk of a run, between its start and its end.
class Run {
public:
    Run(const TrainSettings& settings, const Avatar& avatar, const Capture& capture,
        Precision precision)
        : settings_(settings) {
        if (!settings.hasFolder()) return;
        // All have read what was there before rank 0 changes it, and what it goes on from before
        // it goes on.
        auto wait = [&] {
            if (settings.ranks) settings.ranks->barrier();
        };
        wait();
        if (settings.keeps()) begin(avatar, capture, precision);
        wait();
        if (!settings.keeps() && settings.resume)
            record_ = readRunRecord(settings.out).value_or(RunRecord());
        wait();
    }

    void begin(const Avatar& avatar, const Capture& capture, Precision precision) {
        const TrainSettings& settings = settings_;
        created_ = !std::filesystem::exists(settings.out);
        createFolders(settings.out);
        lock_.emplace(settings.out);
        Asked asked = askedFor(settings, avatar, capture, precision);
        if (settings.resume) {
            std::optional<RunRecord> there = readRunRecord(settings.out);
            if (!there)
                throwInput("{}: expected an unfinished run to go on with, found none",
                           settings.out.string());
            checkSame(there->asked, asked);
            claimAvatar(settings.out);
            record_ = *there;
            fmt::print(stderr, "{}: going on with the unfinished run (--restart starts over)\n",
                       settings.out.string());
            return;
        }
        record_.asked = asked;
        try {
            claimAvatar(settings.out);
            owns_ = true;
            removeTrainingState(settings.out);
            writeRunRecord(settings.out, record_);
        } catch (...) {
            forgetIfEmpty();
            throw;
        }
    }

    bool wants(const std::string& stage) const {
        return std::ranges::count(settings_.stages, stage) > 0;
    }
    bool isDone(const std::string& stage) const { return record_.isDone(stage); }

    // Result first, then the word that it is there: a run killed between the two takes the stage's
    // last steps again.
    void finish(const std::string& stage, Avatar& avatar) {
        if (!settings_.keeps()) return;
        avatar.trained[stage] = askedOf(stage, record_.asked);
        writeAvatar(settings_.out, avatar);
        record_.done.push_back(stage);
        writeRunRecord(settings_.out, record_);
        std::error_code ignored;
        std::filesystem::remove(folder() / (stage + ".safetensors"), ignored);
    }

    // Nothing is left of a run that failed before it had anything to go on from: a frame that
    // cannot be read, a disk without room for the first checkpoint. What it did not make stays.
    void forgetIfEmpty() const {
        if (!settings_.keeps() || !record_.done.empty()) return;
        if (!owns_) {
            forgetFolder();
            return;
        }
        std::error_code ignored;
        for (const auto& entry : std::filesystem::directory_iterator(folder(), ignored))
            if (entry.path().extension() == ".safetensors") return;
        removeTrainingState(settings_.out);
        forgetFolder();
    }

    // The capture as the stage before leaves it.
    void keepPoses(const Capture& capture) const {
        if (settings_.keeps()) writeNpz(folder() / "poses.npz", posesOf(capture), false);
    }
    void takeKeptPoses(Capture& capture) const { takePoses(folder() / "poses.npz", capture); }

private:
    std::filesystem::path folder() const { return settings_.out / "checkpoints"; }

    void forgetFolder() const {
        if (!created_) return;
        removeFileList(settings_.out);
        std::error_code ignored;
        std::filesystem::remove(settings_.out, ignored);  // unless there is something in it
    }

    void checkSame(const Asked& there, const Asked& here) const {
        if (const auto key = difference(there, here))
            throwInput(
                "{}: an unfinished run is there, with {} = {}, and this one has {}; the same "
                "command goes on with it, --restart starts over",
                settings_.out.string(), *key, valueOf(there, *key), valueOf(here, *key));
    }

    const TrainSettings& settings_;
    std::optional<FolderLock> lock_;
    bool created_ = false;  // the folder
    bool owns_ = false;     // the training state in it
    RunRecord record_;
};

// The stages one after the other.
void trainStages(Device& device, TrainResult& result, const TrainSettings& settings, Run& run) {
    for (const Stage& stage : allStages()) {
        if (!run.wants(stage.name)) continue;
        if (run.isDone(stage.name)) {
            if (stage.movesPoses) run.takeKeptPoses(result.capture);
            continue;
        }
        // The former results of this stage and of all after it play no part any more, whatever
        // becomes of the run.
        for (const Stage* later = &stage; later != &allStages().back() + 1; ++later)
            if (run.wants(later->name)) {
                if (later->clear) later->clear(result.avatar);
                result.avatar.trained.erase(later->name);
            }
        if (!stage.movesPoses) result.capture.betas = result.avatar.betas;
        stage.train(device, result, settings);
        if (stage.movesPoses) run.keepPoses(result.capture);
        run.finish(stage.name, result.avatar);
    }
    result.capture.betas = result.avatar.betas;
    if (settings.keeps()) {
        if (!result.avatar.texture.empty())
            writePreview(device, result.avatar, settings.out / "preview.png");
        removeTrainingState(settings.out);
    }
}

}  // namespace

namespace {

// All that later stages made is of the body with its cap.
void clearCap(Avatar& avatar) {
    if (avatar.body.capVertices() == 0) return;
    avatar.bodyArrays = withoutCap(avatar.bodyArrays);
    avatar.body = bodyFromNpz(avatar.bodyArrays);
}

// What stage "texture" made, and what later stages made of it.
void clearTexture(Avatar& avatar) {
    avatar.textureNet.clear();
    avatar.texture.clear();
    avatar.trained.erase("texture");
    avatar.clearRefinement();
}

}  // namespace

const std::vector<Stage>& allStages() {
    static const std::vector<Stage> stages{
        {.name = "fit", .train = trainFit, .plan = planFit, .movesPoses = true},
        {.name = "caps",
         .train = trainCaps,
         .plan = planCaps,
         .isLeftOut = [](const Preset& preset) { return preset.caps.cell == 0; },
         .optional = true,
         .isIn = [](const Avatar& avatar) { return avatar.body.capVertices() > 0; },
         .clear = clearCap},
        {.name = "shape",
         .train = trainShape,
         .plan = planShape,
         .isLeftOut = [](const Preset& preset) { return preset.shape.steps == 0; },
         .movesPoses = true,
         .optional = true,
         .isIn = [](const Avatar& avatar) { return !avatar.body.offsets.empty(); },
         .clear = [](Avatar& avatar) { setOffsets(avatar, {}); }},
        {.name = "texels",
         .train = trainTexels,
         .plan = planTexels,
         .isLeftOut = [](const Preset& preset) { return preset.texels.steps == 0; },
         .movesPoses = true,
         .optional = true,
         .isIn = [](const Avatar& avatar) { return !avatar.texels.empty(); },
         .clear =
             [](Avatar& avatar) {
                 avatar.texels.clear();
                 avatar.texelsSeen.clear();
                 avatar.light.clear();
                 clearTexture(avatar);  // the network painted over these texels
             }},
        {.name = "mesh",
         .train = trainMesh,
         .plan = planMesh,
         .isIn = [](const Avatar& avatar) { return !avatar.meshNet.empty(); },
         .clear = [](Avatar& avatar) { avatar.meshNet.clear(); }},
        {.name = "texture",
         .train = trainTexture,
         .plan = planTexture,
         .isIn = [](const Avatar& avatar) { return !avatar.textureNet.empty(); },
         .clear = clearTexture},
        {.name = "refine",
         .train = trainRefine,
         .plan = planRefine,
         .optional = true,
         .isIn = [](const Avatar& avatar) { return !avatar.refineNet.empty(); },
         .clear = [](Avatar& avatar) { avatar.clearRefinement(); }},
    };
    return stages;
}

std::vector<std::string> stageNames() {
    std::vector<std::string> names;
    for (const Stage& stage : allStages()) names.push_back(stage.name);
    return names;
}

std::vector<std::string> stagesOf(const Preset& preset, const std::vector<std::string>& asked) {
    std::vector<std::string> names;
    for (const Stage& stage : allStages())
        if (std::ranges::count(asked, stage.name) > 0 &&
            !(stage.isLeftOut && stage.isLeftOut(preset)))
            names.push_back(stage.name);
    return names;
}

bool isTrained(const Avatar& there, const Avatar& asked, const Capture& capture,
               Precision precision, const TrainSettings& settings) {
    std::vector<std::string> has, lacks;
    for (const std::string& stage : settings.stages)
        (hasStage(there, stage) ? has : lacks).push_back(stage);
    if (has.empty()) return false;
    if (!lacks.empty())
        throwInput("{}: it has {} already; --stages {} trains what it lacks, --restart starts over",
                   settings.out.string(), fmt::join(has, ", "), fmt::join(lacks, ","));
    const Asked here = askedFor(settings, asked, capture, precision);
    for (const std::string& stage : has) {
        const auto record = there.trained.find(stage);
        if (record == there.trained.end())
            throwInput(
                "{}: it has {} already, and no record of what from; --restart trains it again, "
                "another --out keeps it",
                settings.out.string(), stage);
        const Asked wanted = askedOf(stage, here);
        if (const auto key = difference(record->second, wanted))
            throwInput(
                "{}: it has {} already, trained with {} = {}, and this run has {}; --restart "
                "trains "
                "it again, another --out keeps it",
                settings.out.string(), stage, *key, valueOf(record->second, *key),
                valueOf(wanted, *key));
    }
    return true;
}

void requireMemory(Device& device, const Avatar& avatar, const Capture& capture,
                   const TrainSettings& settings) {
    if (settings.memoryBudget == 0) return;
    for (const Stage& stage : allStages()) {
        if (std::ranges::count(settings.stages, stage.name) == 0) continue;
        try {
            stage.plan(device, avatar, capture, settings);
        } catch (const InputError& error) {
            throwInput("--memory: stage {}: {}", stage.name, error.what());
        }
    }
}

TrainResult trainAvatar(Device& device, Avatar avatar, Capture capture,
                        const TrainSettings& settings) {
    capture.requireMasks();
    decideTextureSize(avatar, capture, settings);
    requireMemory(device, avatar, capture, settings);
    TrainResult result{std::move(avatar), capture, std::nullopt};
    Run run(settings, result.avatar, result.capture, device.precision());
    // Stages that go on with an avatar go on with the poses that its former ones found.
    if (!run.wants("fit") && settings.hasFolder()) takeTrainingPoses(settings.out, result.capture);
    try {
        if (settings.opened && settings.keeps()) {
            writeLiveAvatar(settings.out, result.avatar);
            settings.opened();
        }
        trainStages(device, result, settings, run);
        if (settings.keeps()) writeTrainingPoses(settings.out, capture, result.capture);
    } catch (...) {
        run.forgetIfEmpty();
        throw;
    }
    return result;
}

}  // namespace doppel
