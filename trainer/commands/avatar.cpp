// `doppel avatar`: from a video to an avatar.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>

#include "engine/files/atomic_file.h"
#include "trainer/commands/clips/import.h"
#include "trainer/commands/command.h"
#include "trainer/commands/train.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/import/clip.h"
#include "trainer/person/body_start.h"
#include "trainer/stages/texture_size.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

struct AvatarOptions {
    CommonOptions common;
    ImportOptions import;
    fs::path out;
    Preset preset;
    std::vector<std::string> prior;
    bool restart = false;
    uint64_t memoryBudget = 0;
};

std::string contentOf(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

bool isImported(const AvatarOptions& options) {
    return fs::exists(options.out / "capture/capture.toml");
}

// The capture in OUT/capture: what an earlier run of the same request left there, or a new one.
// Prints what the import found, or with --json leaves that to whoever prints the rest.
nlohmann::ordered_json bringCaptureIn(const AvatarOptions& options) {
    ImportOptions import = options.import;
    import.common = options.common;
    import.settings.out = options.out / "capture";
    import.settings.startsOver = options.restart;
    const fs::path request = options.out / "request.txt";
    const std::string asked = workOf(import), there = contentOf(request);
    const bool finished = isImported(options);
    if (finished && !options.restart) {
        if (there == asked) {
            fmt::print(stderr, "{}: it is there from an earlier run, and is taken\n",
                       import.settings.out.string());
            const Capture capture = readCapture(import.settings.out);
            nlohmann::ordered_json json{{"out", import.settings.out.string()},
                                        {"was_finished", true},
                                        {"frames", capture.size()},
                                        {"fps", capture.fps}};
            tellFindings(capture, json);
            return json;
        }
        throwInput(
            "{}: expected a capture of the same clip with the same flags, found one of "
            "others (request.txt beside it has them); --restart starts over, another --out keeps "
            "it",
            import.settings.out.string());
    }
    const auto keep = [&](const std::string& text) {
        AtomicFile file(request);
        file.write(text);
        file.commit();
    };
    // Whatever ends this run, no request stands beside a capture that it did not make.
    fs::remove(request);
    std::optional<ImportResult> result;
    try {
        result = bringIn(import);
    } catch (...) {
        if (finished) keep(there);
        throw;
    }
    keep(asked);
    if (!options.common.json) printImport(import, *result);
    return importJson(import, *result);
}

// Networks learn what changes from frame to frame, and of a few pictures the pictures.
void leaveOutNetworks(std::vector<std::string>& stages, size_t frames) {
    if (frames <= kFewPictures && std::ranges::count(stages, "texels") > 0)
        std::erase_if(stages, [](const std::string& stage) {
            return stage == "mesh" || stage == "texture" || stage == "refine";
        });
}

// Refuses --memory that has no room for so many frames at the least, of somebody far away, before a
// clip is looked through for nothing. What is neither a video nor a folder of pictures is read in
// no time, and the training refuses then.
void requireMemoryForClip(const AvatarOptions& options, const TrainOptions& train) {
    const ImportRequest& request = options.import.settings.request;
    const fs::path pictures = clipFolder(request.source);
    std::error_code error;
    const bool isClip = !pictures.empty() || fs::is_regular_file(request.source, error);
    if (train.memoryBudget == 0 || !isClip) return;
    Clip clip(pictures.empty() ? request.source : pictures, request.clip);
    Image picture;
    if (!clip.next(picture)) return;  // the import says why
    // Fewer than these may be left of what is asked for, once duplicates are out: one at the least,
    // and then no networks.
    const ClipOptions& asked = request.clip;
    const bool isWhole =
        request.frames.empty() && asked.from <= 0 && std::isinf(asked.to) && asked.every <= 1;
    const bool isMany = isWhole && clip.expected() > int64_t(2 * kFewPictures);
    Capture least;
    least.frames.resize(isMany ? kFewPictures + 1 : 1);
    for (Frame& frame : least.frames)
        frame.camera = cameraOfAngle(picture.width, picture.height, kGuessedAngle);
    least.theta.resize(least.size());
    least.trans.assign(least.size(), {0, 0, 100});
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays(train.body);
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = train.preset;
    TrainSettings settings;
    settings.stages = train.stages;
    leaveOutNetworks(settings.stages, least.size());
    settings.memoryBudget = train.memoryBudget;
    decideTextureSize(avatar, least, settings);
    Device device(train.common.deviceOptions());
    requireMemory(device, avatar, least, settings);
}

void runAvatar(const AvatarOptions& options) {
    catchInterrupts();
    TrainOptions train;
    train.common = options.common;
    train.capture = options.out / "capture";
    train.out = options.out / "avatar";
    train.body = options.import.body;
    train.stages = stagesOf(options.preset, stageNames());
    train.preset = options.preset;
    train.prior = options.prior;
    train.replaces = true;
    train.restart = options.restart;
    train.memoryBudget = options.memoryBudget;
    if (!train.prior.empty())  // before a clip is looked through for nothing
        knownPeople(train, kFewPictures, bodyFromNpz(readBodyArrays(train.body)));

    requireApart(options.out, inputsOf(options.import));
    if (options.restart || !isImported(options)) requireMemoryForClip(options, train);
    claimFiles(options.out, "person", {"capture", "avatar", "request.txt"});
    const FolderLock lock(options.out);
    const nlohmann::ordered_json import = bringCaptureIn(options);
    leaveOutNetworks(train.stages, readCapture(options.out / "capture").size());
    const Learnt learnt = learn(train).value();
    if (options.common.json) {
        nlohmann::ordered_json json = learntJson(train, learnt);
        json["import"] = import;
        printJson(json);
    } else {
        printLearnt(train, learnt);
    }
}

void declareFlags(CommandFlags& flags, AvatarOptions& o) {
    flags.precision();
    o.import.settings.request.clip.every = 0;
    flags.path("--out", o.out, "Folder for the person: capture/ and avatar/ in it")->required();
    declareImportFlags(flags, o.import);
    flags.prior(o.prior);
    flags.preset("small");
    flags->add_flag("--restart", o.restart, "Start over, also where something is finished");
    flags.memory(o.memoryBudget);
}

const Command<AvatarOptions> kAvatar{{
    .name = "avatar",
    .place = 15,
    .summary = "From a video to an avatar, in one go",
    .description =
        "Finds the person in a video (`doppel import`) and learns an avatar (`doppel train`), and\n"
        "says what the video does not show. Stopped or killed, it goes on where it was when the\n"
        "same command is given again. Of a long video it looks at as many frames as an avatar\n"
        "needs (--every), and learns from those that tell most.",
    .example = "doppel avatar clip.mp4 --out me",
    .flags = declareFlags,
    .run = runAvatar,
}};

}  // namespace

}  // namespace doppel
