#include "trainer/commands/train.h"

#include <fmt/ranges.h>
#include <spawn.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <iostream>
#include <nlohmann/json.hpp>

#include "nn/body/body_caps.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/commands/command.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/import/coverage.h"
#include "trainer/ranks/launched.h"
#include "trainer/stages/telling_frames.h"
#include "trainer/stages/texture_size.h"
#include "trainer/stages/train.h"

namespace doppel {

namespace {

// A process of its own, so that whatever happens to the window leaves the run alone; and a process
// group of its own, so that Ctrl-C stops the run and not the window.
void openViewer(const TrainOptions& options) {
    std::string program = std::filesystem::read_symlink("/proc/self/exe").string();
    std::vector<std::string> words{program, "view", options.out.string(), "--motion",
                                   options.capture.string()};
    if (!options.common.device.empty())
        words.insert(words.end(), {"--device", options.common.device});
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    pid_t child = 0;
    int error =
        posix_spawn(&child, program.c_str(), nullptr, &attributes, arguments.data(), environ);
    posix_spawnattr_destroy(&attributes);
    if (error != 0) throwMachine("--view: the viewer cannot be started: {}", strerror(error));
}

// Who trains together, and on what.
void sayRanks(LaunchedRanks& ranks, const DeviceInfo& mine) {
    constexpr size_t kName = 128;
    std::vector<char> name(kName), names(kName * static_cast<size_t>(ranks.size()));
    fmt::format_to_n(name.begin(), kName - 1, "{}", mine.name);
    ranks.allGather(std::as_bytes(std::span(name)).data(),
                    std::as_writable_bytes(std::span(names)).data(), kName);
    std::map<std::string, int> counts;
    for (size_t at = 0; at < names.size(); at += kName) ++counts[&names[at]];
    std::vector<std::string> devices;
    for (const auto& [device, count] : counts)
        devices.push_back(fmt::format("{} on {}", count, device));
    fmt::print(stderr, "{} processes train together by {}: {}\n", ranks.size(), ranks.transport(),
               fmt::join(devices, ", "));
    if (devices.size() > 1)
        fmt::print(stderr,
                   "they have different devices: what one process alone would do they do with "
                   "other roundings, and the slowest sets the pace\n");
}

// How evenly they have shared the frames.
void sayDecoded(Ranks& ranks) {
    const uint64_t mine = FrameCache::decoded();
    std::vector<uint64_t> all(static_cast<size_t>(ranks.size()));
    ranks.allGather(std::as_bytes(std::span(&mine, 1)).data(),
                    std::as_writable_bytes(std::span(all)).data(), sizeof(mine));
    const auto [least, most] = std::ranges::minmax(all);
    fmt::print(stderr, "each process decoded {} to {} pictures\n", least, most);
}

}  // namespace

KnownPeople knownPeople(const TrainOptions& options, size_t frames, const BodyModel& body) {
    if (options.prior == std::vector<std::string>{"none"}) return {};
    const bool asks = std::ranges::any_of(options.stages, [](const std::string& stage) {
        return stage == "shape" || stage == "texels";
    });
    if (!options.prior.empty()) {
        if (!asks)
            throwInput("--prior: expected stage shape or texels, which ask others, found {}",
                       fmt::join(options.stages, ","));
        return readPeople(options.prior, body, "--prior", options.out);
    }
    if (!asks || frames > kFewPictures || options.body != "default") return {};
    fmt::print(stderr,
               "from {} frame{}: synthetic people tell what {} not show (--prior none: nobody "
               "does)\n",
               frames, frames == 1 ? "" : "s", frames == 1 ? "it does" : "they do");
    return readPeople({"cast"}, body, "--prior");
}

size_t framesWorthLearning(const Preset& preset) {
    constexpr int64_t kVisits = 40, kFewest = 40;
    const SurfacePreset& texels = preset.texels;
    return static_cast<size_t>(
        texels.steps > 0 ? std::max(kFewest, int64_t{texels.steps} * texels.batch / kVisits)
                         : 1000);
}

std::optional<Learnt> learn(const TrainOptions& options) {
    LaunchedRanks* ranks = launchedRanks();
    requireApart(options.out, {options.capture, bodyFile(options.body)});
    Capture capture = readCapture(options.capture);
    capture = capture.subset(selectFrames(options.frames, capture.size()));
    capture.requireMasks();
    const size_t most = options.mostFrames.value_or(framesWorthLearning(options.preset));
    Learnt learnt;
    if (most > 0 && capture.size() > most) {
        fmt::print(stderr,
                   "{}: of {} frames the {} that tell most are learnt from; --most-frames 0 takes "
                   "all\n",
                   options.capture.string(), capture.size(), most);
        FrameCache cache(capture, size_t{64} << 20);
        capture = capture.subset(tellingFrames(capture, cache, most, ranks));
        capture.source["chosen"] = "for their poses";  // so that they are no video
        for (const Frame& frame : capture.frames) learnt.chosen.push_back(frame.name);
    }

    std::optional<RunRecord> unfinished;
    if (!options.restart && options.profileSteps == 0) unfinished = readRunRecord(options.out);
    if (options.resume && !unfinished)
        throwInput(
            "{}: expected an unfinished run to go on with, found none; without --resume a "
            "new one starts",
            options.out.string());
    auto trains = [&](const Stage& stage) {
        return std::ranges::count(options.stages, stage.name) > 0;
    };

    // Stages build on what is there: training the texture alone takes the avatar's own body and
    // mesh. A run of all stages needs nothing of it, and replaces it whatever it is.
    Avatar avatar, finished;
    bool exists = std::filesystem::exists(options.out / "avatar.toml");
    const bool all = options.replaces || std::ranges::all_of(allStages(), [&](const Stage& stage) {
                         return stage.optional || trains(stage);
                     });
    if ((exists && !all) || (unfinished && !unfinished->done.empty()))
        avatar = readAvatar(options.out);
    else
        avatar.betas = capture.betas;
    if (exists && readAvatar(options.out).provenance.contains("mixed"))
        throwInput(
            "{}: expected a new folder or a trained avatar's, found a mix of avatars; name another "
            "folder",
            options.out.string());
    bool repeats = exists && !unfinished && !options.restart && options.profileSteps == 0;
    if (repeats) finished = all ? readAvatar(options.out) : avatar;
    const bool movesPoses = std::ranges::any_of(
        allStages(), [&](const Stage& stage) { return stage.movesPoses && trains(stage); });
    if (!exists || movesPoses) {
        const Npz arrays = readBodyArrays(options.body);
        const BodyModel asked = bodyFromNpz(arrays);
        const bool same = exists && isModelOf(asked, avatar.body);
        avatar.bodyArrays.remove("betas");  // which are written behind what stages add
        if (!same) {
            avatar.bodyArrays = arrays;
            avatar.body = asked;
            avatar.trained.clear();  // networks of another body are of no use
            for (const Stage& stage : allStages())
                if (stage.clear) stage.clear(avatar);
        }
    }
    // Numbers of stages that are left alone stay with their networks.
    Preset before = avatar.preset;
    avatar.preset = options.preset;
    if (!options.gan) avatar.preset.refine.imageDiscriminator = false;
    if (!options.gan || !options.face) avatar.preset.refine.faceDiscriminator = false;
    if (!options.clamp) avatar.preset.mesh.clamps = ClampBounds::None;
    for (const Stage& stage : allStages())
        if (stage.isIn && stage.isIn(avatar) && !trains(stage))
            copySection(avatar.preset, before, stage.name);
    avatar.provenance["capture"] = capture.name;
    avatar.provenance["capture_folder"] = captureFolder(options.out, capture.folder);
    if (!capture.actor.empty()) avatar.provenance["actor"] = capture.actor;
    avatar.provenance["command"] = options.common.commandLine;
    avatar.provenance["precision"] = options.common.precision;
    avatar.provenance["seed"] = fmt::format("{}", options.common.seed);

    TrainSettings settings;
    settings.stages = options.stages;
    settings.out = options.out;
    settings.seed = options.common.seed;
    settings.resume = unfinished.has_value();
    settings.checkpointSeconds = options.checkpointSeconds;
    settings.pictureSeconds = options.pictureSeconds;
    settings.memoryBudget = options.memoryBudget;
    settings.known = knownPeople(options, capture.size(), avatar.body);
    settings.profileSteps = options.profileSteps;
    if (options.view) {
        constexpr double kSeconds = 8;  // between the states that the window shows
        if (settings.pictureSeconds <= 0 || settings.pictureSeconds > kSeconds)
            settings.pictureSeconds = kSeconds;
        settings.opened = [&] { openViewer(options); };
    }
    decideTextureSize(avatar, capture, settings);  // which its record has
    if (repeats &&
        isTrained(finished, avatar, capture, precisionNamed(options.common.precision), settings))
        return Learnt{.before = true};
    DeviceOptions deviceOptions = options.common.deviceOptions();
    if (ranks) deviceOptions.name = deviceOf(*ranks, deviceOptions.name);
    Device device(deviceOptions);
    if (ranks) {
        if (options.profileSteps > 0)
            throwInput("--profile: expected one process, found {}", ranks->size());
        settings.ranks = ranks;
        sayRanks(*ranks, device.info());
    }
    const bool paints = std::ranges::any_of(options.stages, [](const std::string& stage) {
        return stage == "texels" || stage == "texture";
    });
    if (const std::string lacking = whatIsNotSeen(capture); paints && !lacking.empty())
        fmt::print(stderr, "{}\n", lacking);
    learnt.frames = capture.size();
    if (paints) learnt.unseen = unseenSides(capture);
    TrainResult result = trainAvatar(device, std::move(avatar), std::move(capture), settings);
    if (ranks) sayDecoded(*ranks);
    if (settings.profileSteps > 0) return {};
    learnt.fit = result.fit;
    return learnt;
}

void printLearnt(const TrainOptions& options, const Learnt& learnt) {
    if (learnt.before) {
        fmt::print(
            "avatar in {}: it was finished before, and stays as it is (--restart trains it "
            "again)\n",
            options.out.string());
        return;
    }
    if (learnt.fit)
        fmt::print("silhouette IoU {:.3f} as given, {:.3f} fitted\n", learnt.fit->iouBefore,
                   learnt.fit->iouAfter);
    fmt::print("avatar in {}\n", options.out.string());
}

nlohmann::ordered_json learntJson(const TrainOptions& options, const Learnt& learnt) {
    nlohmann::ordered_json json{{"avatar", options.out.string()}};
    if (learnt.before) {
        json["was_finished"] = true;
        return json;
    }
    json["frames"] = learnt.frames;
    if (!learnt.chosen.empty()) json["chosen"] = learnt.chosen;
    if (!learnt.unseen.empty()) json["unseen"] = learnt.unseen;
    if (learnt.fit) {
        json["iou_before"] = learnt.fit->iouBefore;
        json["iou_after"] = learnt.fit->iouAfter;
    }
    return json;
}

void runTrain(const TrainOptions& options) {
    catchInterrupts();
    const std::optional<Learnt> learnt = learn(options);
    if (!learnt) return;
    if (options.common.json)
        printJson(learntJson(options, *learnt));
    else
        printLearnt(options, *learnt);
}

namespace {

void declareFlags(CommandFlags& flags, TrainOptions& o) {
    flags.precision();
    flags.path("CAPTURE", o.capture, "Capture to read; it needs masks")->required();
    flags.path("--out", o.out, "Avatar's folder to write")->required();
    o.stages = stageNames();
    flags->add_option("--stages", o.stages, fmt::format("Some of {}", fmt::join(stageNames(), ",")))
        ->delimiter(',')
        ->capture_default_str();
    flags->add_flag("!--no-refine", o.refine, "Leave stage refine out: the coarse texture");
    flags->add_flag("!--no-gan", o.gan, "Refine without discriminators");
    flags->add_flag("!--no-face", o.face, "Refine without the face discriminator");
    flags->add_flag("!--no-clamp", o.clamp, "Let the mesh network move vertices freely");
    flags.frames(o.frames, "Frames to learn from");
    flags
        ->add_option(
            "--most-frames", o.mostFrames,
            "Of more frames than that, learn from those that tell most, evenly taken, and by "
            "pose, side and sharpness; 0: from all; without it: as many as stage texels "
            "takes 40 times, and 40 at the least")
        ->default_str("");
    flags.body(o.body);
    flags.prior(o.prior);
    flags.preset("small");
    CLI::Option* resume = flags->add_flag(
        "--resume", o.resume,
        "Only go on with the unfinished run in the avatar's folder, which happens without it "
        "as well; refuse to start one");
    flags
        ->add_flag("--restart", o.restart,
                   "Start over where an unfinished run or a finished training is in the avatar's "
                   "folder; without it a finished one stays as it is")
        ->excludes(resume);
    flags
        ->add_option("--checkpoint-every", o.checkpointSeconds,
                     "Seconds between checkpoints; 0: only when it is stopped")
        ->capture_default_str()
        ->check(CLI::NonNegativeNumber);
    flags
        ->add_option("--picture-every", o.pictureSeconds,
                     "Seconds between pictures of the state; 0: none")
        ->capture_default_str()
        ->check(CLI::NonNegativeNumber);
    flags->add_flag("--view", o.view,
                    "Open a window (`doppel view`) that shows the present state; the result is the "
                    "same, and closing it does not stop the training");
    flags
        ->add_option("--profile", o.profileSteps,
                     "Run so many steps of each stage, print memory and time per op, keep nothing")
        ->check(CLI::Range(1, 1000));
    flags.memory(o.memoryBudget);
}

// Puts the stages into their order.
void checkStages(TrainOptions& options) {
    const std::vector<std::string> all = stageNames();
    for (const std::string& word : options.stages)
        if (std::ranges::count(all, word) == 0)
            throwInput("--stages: expected some of {}, found \"{}\"", fmt::join(all, ","), word);
    std::vector<std::string> stages = stagesOf(options.preset, options.stages);
    if (stages.empty() && options.stages.empty())
        throwInput("--stages: expected some of {}, found none", fmt::join(all, ","));
    if (stages.empty())
        throwInput("--stages: preset {} leaves {} out; --set {}.steps=200 takes it in",
                   options.preset.name, fmt::join(options.stages, ", "), options.stages[0]);
    if (!options.refine) std::erase(stages, "refine");
    if (stages.empty()) throwInput("--no-refine: stage refine is all that --stages asks for");
    options.stages = stages;
}

const Command<TrainOptions> kTrain{{
    .name = "train",
    .place = 40,
    .summary = "Learn an avatar's mesh and texture from a capture; with mpirun on many devices",
    .example = "doppel train fitted --out avatar --preset small --stages mesh,texture",
    .flags = declareFlags,
    .check = checkStages,
    .run = runTrain,
}};

}  // namespace

}  // namespace doppel
