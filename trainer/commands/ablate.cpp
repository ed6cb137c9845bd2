// The paper's ablations on one capture: each variant trained and measured, in a table like the
// paper's table 2.
#include "trainer/commands/ablate.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <iostream>
#include <iterator>

#include "engine/files/atomic_file.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/commands/command.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/eval/results.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Trains variants into folders of one folder. What is there already from the same request is taken
// as it is; an unfinished run goes on.
class Workshop {
public:
    Workshop(Device& device, const AblateOptions& options) : device_(device), options_(options) {}

    // capture: with the fitted poses, once stage "fit" is done.
    TrainResult train(const std::string& name, Avatar avatar, Capture capture,
                      const std::vector<std::string>& stages) {
        TrainSettings settings;
        settings.stages = stages;
        settings.out = options_.out / name;
        settings.seed = options_.common.seed;
        settings.pictureSeconds = 0;
        settings.memoryBudget = options_.memoryBudget;
        fmt::print(stderr, "ablate: {}: {}\n", name, fmt::join(stages, ", "));
        const fs::path request = settings.out / "ablation.txt", poses = settings.out / "poses.npz";
        const std::string asked = requestOf(avatar.preset, stages);
        avatar.provenance["capture"] = capture.name;
        avatar.provenance["command"] = options_.common.commandLine;
        avatar.provenance["seed"] = fmt::format("{}", settings.seed);
        claimAvatar(settings.out);
        claimFiles(settings.out, kAvatarKind, {"ablation.txt", "poses.npz"});
        // poses.npz comes last: where it is, the run that was asked for is done.
        if (read(request) != asked) {
            removeTrainingState(settings.out);
            fs::remove(poses);
            AtomicFile file(request);
            file.write(asked);
            file.commit();
        } else if (fs::exists(poses)) {
            takePoses(poses, capture);
            return {readAvatar(settings.out), std::move(capture), std::nullopt};
        }
        settings.resume = readRunRecord(settings.out).has_value();
        if (settings.resume) avatar = unfinished(settings.out, std::move(avatar));
        TrainResult result = trainAvatar(device_, std::move(avatar), std::move(capture), settings);
        writeNpz(poses, posesOf(result.capture), false);
        result.avatar = readAvatar(settings.out);  // as the next run will find it
        return result;
    }

private:
    // All that the result depends on: stages that come later do not count.
    std::string requestOf(const Preset& preset, const std::vector<std::string>& stages) const {
        std::string text =
            fmt::format("capture = {}\nframes = {}\nbody = {}\nseed = {}\nstages = {}\n",
                        fs::absolute(options_.capture).lexically_normal().string(), options_.frames,
                        options_.body, options_.common.seed, fmt::join(stages, ","));
        const std::vector<std::string>& order = presetSections();
        const auto last = std::ranges::find(order, stages.back());
        for (const auto& [name, value] : presetValues(preset))
            if (std::ranges::find(order, name.substr(0, name.find('.'))) <= last)
                text += fmt::format("{} = {}\n", name, value);
        return text;
    }
    static std::string read(const fs::path& path) {
        std::ifstream file(path, std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }
    // The networks that a stopped run has finished, with this run's numbers.
    static Avatar unfinished(const fs::path& folder, Avatar avatar) {
        if (readRunRecord(folder)->done.empty()) return avatar;
        Avatar there = readAvatar(folder);
        there.preset = avatar.preset;
        there.provenance = avatar.provenance;
        return there;
    }
    Device& device_;
    const AblateOptions& options_;
};

}  // namespace

const std::vector<std::string>& ablationVariants() {
    static const std::vector<std::string> names{"no-refine", "no-clamp", "complete", "no-gan",
                                                "no-face"};
    return names;
}

void runAblate(const AblateOptions& options) {
    auto wanted = [&](const char* name) {
        return options.variants.empty() || std::ranges::count(options.variants, name) > 0;
    };
    for (const std::string& name : options.variants)
        if (std::ranges::count(ablationVariants(), name) == 0)
            throwInput("--variants: expected some of {}, found \"{}\"",
                       fmt::join(ablationVariants(), ","), name);
    catchInterrupts();
    for (const fs::path& out : {options.out, options.pictures})
        requireApart(out, {options.capture, bodyFile(options.body)});
    const Capture whole = readCapture(options.capture);
    const Capture training = whole.subset(selectFrames(options.frames, whole.size()));
    const bool heldOut = !options.testFrames.empty();
    Capture test =
        heldOut ? whole.subset(selectFrames(options.testFrames, whole.size(), "--test-frames"))
                : training;
    training.requireMasks();
    test.requireMasks();
    claimResults(options.out, "ablation");
    const FolderLock lock(options.out);
    if (!options.pictures.empty())
        for (const std::string& name : ablationVariants())
            if (wanted(name.c_str())) claimFiles(options.pictures / name, "eval", {});
    Device device(options.common.deviceOptions());
    Measures measures(device, options.measures);

    Avatar fresh;
    fresh.bodyArrays = readBodyArrays(options.body);
    fresh.body = bodyFromNpz(fresh.bodyArrays);
    fresh.preset = options.preset;
    fresh.betas = training.betas;

    // A stage sees nothing but what those before it made, the numbers and the seed. So the poses
    // are fitted once, and what only refines differently starts from one mesh and coarse texture.
    Workshop workshop(device, options);
    TrainResult fitted = workshop.train("fit", fresh, training, {"fit"});
    fitted.avatar.preset = options.preset;
    std::vector<std::pair<std::string, Avatar>> avatars;
    auto add = [&](const char* name, TrainResult result) {
        avatars.emplace_back(name, std::move(result.avatar));
    };
    std::optional<Avatar> coarse;
    if (wanted("no-refine") || wanted("complete") || wanted("no-gan") || wanted("no-face"))
        coarse =
            workshop.train("no-refine", fitted.avatar, fitted.capture, {"mesh", "texture"}).avatar;
    if (wanted("no-refine")) avatars.emplace_back("no-refine", *coarse);
    if (wanted("no-clamp")) {
        Avatar avatar = fitted.avatar;
        avatar.preset = options.preset;
        avatar.preset.mesh.clamps = ClampBounds::None;
        add("no-clamp",
            workshop.train("no-clamp", avatar, fitted.capture, {"mesh", "texture", "refine"}));
    }
    for (const char* name : {"complete", "no-gan", "no-face"}) {
        if (!wanted(name)) continue;
        Avatar avatar = *coarse;
        avatar.preset = options.preset;  // it may have been trained for another refinement
        RefinePreset& refine = avatar.preset.refine;
        if (std::string_view(name) != "complete") refine.faceDiscriminator = false;
        if (std::string_view(name) == "no-gan") refine.imageDiscriminator = false;
        add(name, workshop.train(name, avatar, fitted.capture, {"refine"}));
    }

    // The test poses are fitted with the bare body, which all variants share.
    if (!heldOut) {
        test = fitted.capture;
    } else if (options.fitTestPoses) {
        test.betas = fitted.avatar.betas;
        fitCapture(device, fresh.body, test,
                   {.preset = options.preset.fit,
                    .fitShape = false,
                    .loop = {.seed = options.common.seed}});
    }
    std::vector<ResultRow> rows;
    size_t clips = 0;
    for (const auto& [name, avatar] : avatars) {
        fmt::print(stderr, "ablate: {}: measured\n", name);
        EvaluatedCapture evaluated;
        EvaluateSettings settings;
        settings.plateOf = whole.hasMasks() ? &whole : nullptr;
        settings.texture = TextureKind::Best;
        settings.background = options.scene;
        settings.lpips = measures.lpips.get();
        settings.videoFeatures = measures.videoFeatures.get();
        if (!options.pictures.empty()) settings.pictures = options.pictures / name;
        evaluated.evaluation = evaluateCapture(device, avatar, test, settings);
        clips = evaluated.evaluation.realClips.size();
        const EvaluatedCapture* one = &evaluated;
        rows.push_back({"variant", name, figuresOf(std::span(&one, 1)), paperAblation(name)});
    }
    Settings settings{{"capture", options.capture.string()},
                      {"frames", options.frames.empty() ? "all" : options.frames},
                      {"test_frames", heldOut ? options.testFrames : "those of the training"},
                      {"test_poses", !heldOut               ? "fitted in training"
                                     : options.fitTestPoses ? "fitted to their masks"
                                                            : "as given"},
                      {"preset", options.preset.name},
                      {"seed", fmt::format("{}", options.common.seed)},
                      {"scene", options.scene},
                      {"device", device.info().name}};
    for (const auto& [name, value] : presetValues(options.preset))
        settings.emplace_back(name, value);
    std::vector<std::string> remarks = measures.remarks(clips);
    if (!heldOut)
        remarks.push_back("measured on the training frames; --test-frames holds some out");
    writeResults(options.out, "ablation", rows, settings, remarks);
    if (options.common.json)
        std::cout << resultsJson(rows, settings, remarks) << "\n";
    else
        std::cout << resultsMarkdown(rows, remarks);
}

namespace {

void declareFlags(CommandFlags& flags, AblateOptions& o) {
    flags.precision();
    flags.path("CAPTURE", o.capture, "Capture to read; it needs masks")->required();
    flags.path("--out", o.out, "Folder to write")->required();
    flags.frames(o.frames, "Frames to learn from");
    flags->add_option("--test-frames", o.testFrames,
                      "Frames to measure on; without it, those of the training");
    flags->add_flag("--fit-test-poses", o.fitTestPoses,
                    "Fit poses and positions (not shape) to the test frames first");
    flags
        ->add_option("--variants", o.variants, "Some of no-refine,no-clamp,complete,no-gan,no-face")
        ->delimiter(',');
    flags.body(o.body);
    flags.preset("small");
    flags.scene(o.scene);
    flags.measures(o.measures);
    flags.path("--pictures", o.pictures, "Folder for render, frame and difference side by side");
    flags.memory(o.memoryBudget);
}

const Command<AblateOptions> kAblate{{
    .name = "ablate",
    .place = 70,
    .summary = "Train the paper's ablations on one capture and compare them",
    .description =
        "Trains the variants of the paper's ablation study and prints its table 2 with our "
        "figures:\nno-refine (coarse texture), no-clamp (unbounded offsets), complete, and "
        "no-gan, no-face\n(without discriminators, without the face's). What variants have in "
        "common is trained once.\nThe same command goes on where it was stopped. Avatars and "
        "ablation.json, .csv, .md are left\nin the folder.",
    .example = "doppel ablate capture --frames 0:90 --test-frames 90:120 "
               "--fit-test-poses --out ablation",
    .flags = declareFlags,
    .run = runAblate,
}};

}  // namespace

}  // namespace doppel
