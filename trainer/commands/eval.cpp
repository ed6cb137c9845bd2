#include "trainer/commands/eval.h"

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "trainer/avatar/training_poses.h"
#include "trainer/commands/command.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/eval/measures.h"
#include "trainer/eval/results.h"
#include "trainer/stages/surface.h"

namespace doppel {

namespace {

// What is said of one capture's frames beside their figures.
struct Findings {
    std::string poses;  // where they are from
    std::vector<std::string> remarks;
};

// "as given", "as training found them" or "fitted to their masks"; `trained`: those of so many
// frames are training's.
std::string posesFrom(const EvalOptions& options, size_t trained, size_t frames) {
    if (!options.fitTestPoses.empty()) return "fitted to their " + options.fitTestPoses;
    if (trained == 0) return "as given";
    return trained == frames ? "as training found them"
                             : fmt::format("as training found them in {}, as given in {}", trained,
                                           frames - trained);
}

// One capture's frames through one avatar.
Evaluation evaluateOne(Device& device, const std::filesystem::path& avatarFolder,
                       const std::filesystem::path& captureFolder, const EvalOptions& options,
                       const Measures& measures, const std::filesystem::path& pictures,
                       Settings* settings, Findings& findings) {
    Avatar avatar = readAvatar(avatarFolder);
    TextureKind texture = textureKind(options.texture);
    requireTexture(avatar, texture, avatarFolder);
    const Capture whole = readCapture(captureFolder);
    Capture capture = whole.subset(selectFrames(options.frames, whole.size()));
    capture.requireMasks();
    if (settings) settings->insert(settings->end(), {{"preset", avatar.preset.name}});
    const Capture given = capture;
    const size_t seen = takeTrainingPoses(avatarFolder, capture);
    std::vector<std::string>& remarks = findings.remarks;
    if (const std::string whose = whoseFrames(avatar.provenance, capture, seen); !whose.empty())
        remarks.push_back(whose);
    if (options.givenPoses) capture = given;
    findings.poses = posesFrom(options, options.givenPoses ? 0 : seen, capture.size());
    if (seen > 0 && !options.givenPoses && options.fitTestPoses.empty())
        fmt::print(stderr,
                   "{}: the poses that training found for them are taken; --given-poses leaves "
                   "them as the capture has them\n",
                   captureFolder.string());
    if (settings) settings->emplace_back("frames_trained_on", fmt::format("{}", seen));
    if (!options.fitTestPoses.empty()) {
        const FitResult fit = fitPosesToMasks(device, avatar, capture, options.common.seed);
        if (options.fitTestPoses == "pictures")
            fitPosesToPictures(device, avatar, capture, options.common.seed);
        if (settings) {
            settings->emplace_back("body_iou_before_fit", fmt::format("{:.4f}", fit.iouBefore));
            settings->emplace_back("body_iou_after_fit", fmt::format("{:.4f}", fit.iouAfter));
        }
    }
    if (!capture.gains.empty()) {
        Gain least = capture.gains[0], most = least;
        for (const Gain& gain : capture.gains)
            for (size_t c = 0; c < 3; ++c)
                least[c] = std::min(least[c], gain[c]), most[c] = std::max(most[c], gain[c]);
        remarks.push_back(fmt::format("renders have the frames' exposures, {:.2f} to {:.2f}",
                                      std::ranges::min(least), std::ranges::max(most)));
    }
    EvaluateSettings evaluate;
    evaluate.pictures = pictures;
    evaluate.texture = texture;
    evaluate.background = options.scene;
    for (const std::string& region : options.regions)
        evaluate.regions.push_back(atlasRegion(region, "--region"));
    // The plate is of all frames: more of them show what is behind the person.
    evaluate.plateOf = whole.hasMasks() ? &whole : nullptr;
    evaluate.lpips = measures.lpips.get();
    evaluate.videoFeatures = measures.videoFeatures.get();
    return evaluateCapture(device, avatar, capture, evaluate);
}

void printOne(const Evaluation& evaluation, const std::string& poses, const Measures& measures,
              const std::vector<std::string>& remarks) {
    FrameMetrics mean = meanMetrics(evaluation.frames);
    fmt::print("{} frames, poses {}\n", evaluation.frames.size(), poses);
    fmt::print("  silhouette IoU  {:.3f}\n", mean.iou);
    fmt::print("  PSNR            {:.2f} dB over the body, {:.2f} dB over the frame\n",
               mean.psnrBody, mean.psnrFrame);
    fmt::print("  SSIM            {:.3f} over the body, {:.3f} over the frame\n", mean.ssimBody,
               mean.ssimFrame);
    fmt::print("  MSE             {:.1f} over the frame (8-bit units)\n", mean.mseFrame);
    for (const auto& [name, value] : mean.figures) fmt::print("  {:<18}{:.3f}\n", name, value);
    if (mean.lpips)
        fmt::print("  LPIPS           {:.3f} ({})\n", *mean.lpips,
                   lpipsNetName(measures.lpips->net()));
    if (auto fvd = videoDistance(evaluation.realClips, evaluation.renderedClips))
        fmt::print("  FVD             {:.2f} from {} clips\n", *fvd, evaluation.realClips.size());
    fmt::print(
        "  change          {:.3f} from frame to frame, {:.3f} in the frames; {:.3f} with the "
        "pose held still\n",
        evaluation.change, evaluation.changeOfFrames, evaluation.changeHeldStill);
    for (const std::string& remark : remarks) fmt::print("  {}\n", remark);
}

}  // namespace

void runEval(const EvalOptions& options) {
    catchInterrupts();
    for (const std::filesystem::path& out : {options.out, options.pictures})
        requireApart(out, {options.avatar, options.capture});
    for (const std::string& region : options.regions) atlasRegion(region, "--region");
    const std::vector<CollectionEntry> entries = findCaptures(options.capture);
    const bool collection = entries.size() > 1 || entries[0].folder != options.capture;
    for (const CollectionEntry& entry : entries) avatarOf(options.avatar, entry.actor);
    if (!options.out.empty()) claimResults(options.out, "results");
    Device device(options.common.deviceOptions());
    Measures measures(device, options.measures);
    Settings settings{
        {"avatar", options.avatar.string()},
        {"capture", options.capture.string()},
        {"frames", options.frames.empty() ? "all" : options.frames},
        {"fit_test_poses", options.fitTestPoses.empty() ? "no" : options.fitTestPoses},
        {"seed", fmt::format("{}", options.common.seed)},
        {"scene", options.scene},
        {"lpips_net", options.measures.lpips.empty() ? "" : options.measures.lpipsNet},
        {"device", device.info().name}};
    std::vector<EvaluatedCapture> evaluated;
    std::vector<std::string> ownRemarks;  // of single captures
    std::string poses;                    // of the last one
    for (const CollectionEntry& entry : entries) {
        if (collection)
            fmt::print(stderr, "{} of {}: {}, {}\n", evaluated.size() + 1, entries.size(),
                       entry.actor, entry.motion);
        std::filesystem::path pictures = options.pictures;
        if (collection && !pictures.empty()) pictures = pictures / entry.actor / entry.motion;
        Findings own;
        evaluated.push_back({entry, evaluateOne(device, avatarOf(options.avatar, entry.actor),
                                                entry.folder, options, measures, pictures,
                                                collection ? nullptr : &settings, own)});
        poses = own.poses;
        for (const std::string& remark : own.remarks)
            ownRemarks.push_back(
                collection ? fmt::format("{}, {}: {}", entry.actor, entry.motion, remark) : remark);
    }
    const std::vector<ResultRow> rows = groupResults(evaluated);
    size_t clips = 0;
    for (const EvaluatedCapture& capture : evaluated) clips += capture.evaluation.realClips.size();
    std::vector<std::string> remarks = measures.remarks(clips);
    remarks.insert(remarks.end(), ownRemarks.begin(), ownRemarks.end());
    if (!options.out.empty()) writeResults(options.out, "results", rows, settings, remarks);
    if (collection) {
        if (options.common.json)
            std::cout << resultsJson(rows, settings, remarks) << "\n";
        else
            std::cout << resultsMarkdown(rows, remarks);
        return;
    }
    const Evaluation& one = evaluated[0].evaluation;
    if (!options.common.json) {
        printOne(one, poses, measures, remarks);
        return;
    }
    std::cout << metricsJson(one.frames, settings, true,
                             {{"fvd", videoDistance(one.realClips, one.renderedClips)},
                              {"change", one.change},
                              {"change_of_frames", one.changeOfFrames},
                              {"change_held_still", one.changeHeldStill}},
                             remarks)
              << "\n";
}

namespace {

void declareFlags(CommandFlags& flags, EvalOptions& o) {
    flags.precision();
    flags.path("AVATAR", o.avatar, "Avatar's folder, or a folder of avatars by actor")->required();
    flags.path("CAPTURE", o.capture, "Capture with masks, or a folder of captures")->required();
    flags.frames(o.frames, "Frames to compare");
    flags.texture(o.texture);
    flags
        ->add_flag(
            "--fit-test-poses{masks}", o.fitTestPoses,
            "Fit poses and positions (not the avatar) to these frames first: to their masks, "
            "or with =pictures to their colours as well")
        ->check(CLI::IsMember({"masks", "pictures"}));
    flags->add_flag("--given-poses", o.givenPoses,
                    "Of frames that were trained on: the capture's poses, and not those that "
                    "training found");
    flags->add_option("--region", o.regions,
                      "Figures of a rectangle of the atlas as well: NAME=LEFT,TOP,RIGHT,BOTTOM, "
                      "parts of 0 to 1; may be repeated");
    flags.scene(o.scene);
    flags.measures(o.measures);
    flags.path("--out", o.out, "Folder for results.json, results.csv and results.md");
    flags.path(
        "--pictures", o.pictures,
        "Folder for report.html: frame, render and error side by side, heads enlarged, figures");
}

const Command<EvalOptions> kEval{{
    .name = "eval",
    .place = 60,
    .summary = "Compare the avatar with the frames of a capture, or of many",
    .description =
        "Draws the avatar in each frame's pose over the frame's background, and compares it "
        "with\nthe whole frame. Of a folder of captures, FOLDER/ACTOR/MOTION (actor and motion "
        "in\ncapture.toml win over the folders' names), it prints the paper's tables: by "
        "motion, by\nactor, on average, beside the paper's own figures; AVATAR is then one "
        "avatar for all, or a\nfolder of them, AVATAR/ACTOR.",
    .example = "doppel eval avatar capture --frames 90:120 --fit-test-poses --json\n"
               "  doppel eval avatars captures --out results",
    .flags = declareFlags,
    .run = runEval,
}};

}  // namespace

}  // namespace doppel
