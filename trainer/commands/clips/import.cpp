#include "trainer/commands/clips/import.h"

#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "engine/device.h"
#include "engine/io/image.h"
#include "trainer/avatar/avatar.h"
#include "trainer/commands/command.h"
#include "trainer/commands/manual/choices.h"
#include "trainer/data/body_render.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/data/version.h"
#include "trainer/import/import.h"

namespace doppel {

std::vector<std::filesystem::path> inputsOf(const ImportOptions& options) {
    const ImportRequest& request = options.settings.request;
    return {request.source,  request.poses, request.plate,
            request.matting, request.masks, bodyFile(options.body)};
}

std::string workOf(const ImportOptions& options) {
    const ImportRequest& r = options.settings.request;
    const ClipOptions& clip = r.clip;
    std::error_code ignored;
    // Files by their places from the root, for the command may be given again in another folder.
    const auto place = [](const std::filesystem::path& path) {
        return path.empty() ? std::string()
                            : std::filesystem::absolute(path).lexically_normal().string();
    };
    return fmt::format(
        "source = {}\nbytes = {}\nkey = {}\nfps = {}\nframes = {}\nfrom = {}\nto = {}\nevery = {}\n"
        "rows = {}\nkeep_similar = {}\npose = {}\nperson = {}\nfov = {}\nheight = {}\nbody = {}\n"
        "plate = {}\nmatting = {}\nmatting_kind = {}\nposes = {}\n{}",
        place(r.source),
        std::filesystem::is_regular_file(r.source, ignored)
            ? std::filesystem::file_size(r.source, ignored)
            : 0,
        r.key, r.fps, r.frames, clip.from, clip.to, clip.every, clip.rows, clip.keepSimilar,
        options.net, r.person, r.fov, r.height, options.body, place(r.plate), place(r.matting),
        r.mattingKind, place(r.poses),
        // Later ones, which requests that were kept before do not have.
        (r.masks.empty() ? "" : fmt::format("masks = {}\n", place(r.masks))) +
            (r.givenHeads ? "given_heads = true\n" : "") +
            (options.cutOut == "all" ? "" : fmt::format("cut_out = {}\n", options.cutOut)));
}

ImportResult bringIn(const ImportOptions& options) {
    requireApart(options.settings.out, inputsOf(options));
    const BodyModel body = bodyFromNpz(readBodyArrays(options.body));
    Device device(options.common.deviceOptions());
    BodyPoser poser(device, body);
    MeshDrawer drawer(device, body);
    ImportSettings settings = options.settings;
    settings.commandLine = options.common.commandLine;
    settings.work = fmt::format("doppel {}\n{}", kVersion, workOf(options));
    // Files may have changed since; of folders each picture is looked at.
    for (const std::filesystem::path& input : inputsOf(options)) {
        std::error_code ignored;
        if (std::filesystem::is_regular_file(input, ignored))
            settings.work += fmt::format(
                "{} of {} bytes, written at {}\n", input.filename().string(),
                std::filesystem::file_size(input, ignored),
                std::filesystem::last_write_time(input, ignored).time_since_epoch().count());
    }
    settings.request.device = &device;
    settings.request.body = &body;
    settings.request.net = poseNetByName(options.net, "--pose");
    settings.request.cutOutBy = cutOutByName(options.cutOut);
    return importCapture(settings, [&](const Camera& camera, const Theta& theta, const Trans& trans,
                                       const Betas& betas) {
        Drawing drawing = drawer.drawShaded(poser.pose(theta, trans, betas).verts, camera);
        BodyPicture picture{std::move(drawing.mask), {}};
        // Shades of grey: one channel tells all.
        for (size_t i = 0; i < drawing.rgb.size(); i += 3) {
            picture.shade.push_back(drawing.rgb[i]);
        }
        return picture;
    });
}

namespace {

// What a capture says of how it was made that is told when it is, and the words for it.
constexpr std::pair<const char*, const char*> kSaid[] = {
    {"left_out", "left out"}, {"ends", "the file ends"}, {"range", "range"},
    {"cuts", "cuts at"},      {"swaps", "swaps"},        {"people", "people"},
    {"hidden", "hidden"},     {"cut_off", "cut off"},    {"heads", "heads"},
    {"quality", "quality"},   {"camera", "camera"}};

}  // namespace

void tellFindings(const Capture& capture, nlohmann::ordered_json& json) {
    const auto tell = [&](const char* said) {
        if (const auto at = capture.source.find(said); at != capture.source.end())
            json[said] = at->second;
    };
    tell("masks");
    for (const auto& said : kSaid) tell(said.first);
}

nlohmann::ordered_json importJson(const ImportOptions& options, const ImportResult& result) {
    const Capture& capture = result.capture;
    // Of a clip Doppel may have found them before they were taken over.
    const auto masks = capture.source.find("masks");
    const bool found = masks != capture.source.end() && masks->second.starts_with("found");
    nlohmann::ordered_json json{{"out", options.settings.out.string()},
                                {"layout", result.layout},
                                {"frames", capture.size()},
                                {"masks_given", found ? 0 : result.givenMasks},
                                {"masks_found", found ? result.givenMasks : 0},
                                {"masks_keyed", result.keyedMasks}};
    if (capture.keypoints) json["keypoints"] = capture.keypoints->scheme;
    if (result.givenMasks + result.keyedMasks > 0) json["iou"] = result.meanIou;
    if (!result.iou.empty()) json["iou_of_frames"] = result.iou;
    if (!result.poses.empty()) json["poses"] = result.poses;
    if (!result.posesFilled.empty()) json["poses_filled"] = result.posesFilled;
    json["fps"] = capture.fps;
    tellFindings(capture, json);
    return json;
}

void runImport(const ImportOptions& options) {
    catchInterrupts();
    const ImportResult result = bringIn(options);
    if (options.common.json)
        printJson(importJson(options, result));
    else
        printImport(options, result);
}

void printImport(const ImportOptions& options, const ImportResult& result) {
    const Capture& capture = result.capture;
    const size_t masks = result.givenMasks + result.keyedMasks;
    const Camera& camera = capture.frames[0].camera;
    std::cout << fmt::format("{}: {} frames of {}×{}, {:.4g} a second, from the layout {}\n",
                             options.settings.out.string(), capture.size(), camera.width,
                             camera.height, capture.fps, result.layout);
    for (const auto& [said, what] : kSaid) {
        if (const auto at = capture.source.find(said); at != capture.source.end())
            std::cout << fmt::format("{}: {}\n", what, at->second);
    }
    if (!result.poses.empty()) std::cout << fmt::format("poses: {}\n", result.poses);
    if (!result.posesFilled.empty()) std::cout << fmt::format("poses: {}\n", result.posesFilled);
    if (!result.poses.empty() && !result.iou.empty()) {
        const auto worst = std::ranges::min_element(result.iou);
        std::cout << fmt::format("poses: least IoU {:.3f}, in frame {}\n", *worst,
                                 capture.frames[size_t(worst - result.iou.begin())].name);
    }
    if (masks > 0) {
        std::cout << fmt::format("masks: {}; IoU of the unfitted body with them {:.3f}\n",
                                 capture.source.at("masks"), result.meanIou);
    } else {
        std::cout
            << "masks: none; fit and train need them (--key makes them from a green screen)\n";
    }
    if (options.settings.overlays) {
        std::cout << fmt::format("look at {} before going on\n",
                                 (options.settings.out / "overlay.jpg").string());
    }
}

void declareImportFlags(CommandFlags& flags, ImportOptions& o) {
    flags.path("SRC", o.settings.request.source, "Video or folder to read")->required();
    flags->add_flag("--key", o.settings.request.key,
                    "Make masks from a green screen for frames that have none");
    flags
        ->add_option(
            "--fps", o.settings.request.fps,
            "Of pictures, and of the retargeting dataset: frames per second at which they were "
            "recorded; a video and a capture say it themselves")
        ->capture_default_str()
        ->check(CLI::Range(.01, 1000.));
    flags.frames(o.settings.request.frames, "Frames to take");
    ClipOptions& clip = o.settings.request.clip;
    flags->add_option("--from", clip.from, "Of a clip: seconds at which to begin")
        ->check(CLI::NonNegativeNumber);
    flags->add_option("--to", clip.to, "Of a clip: seconds at which to end")
        ->check(CLI::PositiveNumber);
    flags
        ->add_option("--every", clip.every,
                     fmt::format("Of a clip: take each so many frames; 0: {} at most, evenly",
                                 kEnoughFrames))
        ->capture_default_str()
        ->check(CLI::Range(0, 1000000));
    flags
        ->add_option("--rows", clip.rows,
                     "Of a clip: height to which higher frames are scaled; a frame of 1080 rows "
                     "takes 1 to 3 MB")
        ->capture_default_str()
        ->check(CLI::Range(64, kMaxImageSide));
    flags->add_flag("--keep-similar", clip.keepSimilar,
                    "Of a clip: keep duplicates and blurred frames");
    flags->add_option("--pose", o.net, "Of a clip: network that finds the person")
        ->capture_default_str()
        ->check(showsChoices({"lite", "full", "heavy"}));
    flags
        ->add_option("--person", o.settings.request.person,
                     "Of a clip: which of the people in the first frame, from left to right; 0: "
                     "the largest")
        ->capture_default_str()
        ->check(CLI::Range(0, 100));
    flags
        ->add_option(
            "--fov", o.settings.request.fov,
            "Of a clip: degrees that the camera's longer side sees (a phone's main camera: 60 to "
            "70; 2 atan(18 / f) for a lens of f mm at full frame); without it, as the files say "
            "of their lens, and 60 where they do not")
        ->default_str("")
        ->check(CLI::Range(5., 150.));
    flags
        ->add_option("--height", o.settings.request.height,
                     "Of a clip: the person's height in metres, barefoot")
        ->check(CLI::Range(.5, 2.5));
    flags.path("--poses", o.settings.request.poses,
               "Poses of another program to take: 4D-Humans, WHAM, GVHMR, ROMP, VIBE, SPIN, "
               "EasyMocap, AMASS (docs/formats.md)");
    flags->add_flag(
        "--given-heads", o.settings.request.givenHeads,
        "Of poses that another program found in pictures: leave their heads, which else look "
        "where faces do, where scripts/setup --models has fetched the networks");
    flags.path("--plate", o.settings.request.plate,
               "Of a clip by a camera that stands still: a picture of the scene without the "
               "person, for sharper masks");
    flags.path(
        "--matting", o.settings.request.matting,
        "Of a clip: a network of yours that cuts people out, FILE.onnx: takes RGB [1,3,H,W], "
        "gives [1,1,H,W] from 0 to 1; where Doppel is built with OpenCV's dnn");
    flags
        ->add_option("--matting-kind", o.settings.request.mattingKind,
                     "What it takes: modnet: 512×512, colours from -1 to 1; isnet: 1024×1024, "
                     "colours from -.5 to .5. RVM takes its own last outputs too and cannot be run")
        ->capture_default_str()
        ->check(CLI::IsMember({"modnet", "isnet"}));
    flags
        ->add_option("--cut-out", o.cutOut,
                     "Of a clip: how masks are made where none are given, each further than the "
                     "one before: as the network has them; led along the picture's edges; by the "
                     "colours of the whole clip; and by what is behind the person, or a screen")
        ->capture_default_str()
        ->check(showsChoices({"network", "edges", "colours", "all"}));
    flags.path("--masks", o.settings.request.masks,
               "Of a clip: masks of its pictures in their order, a folder or a video, the person "
               "white (or a cut-out with alpha), from whatever program made them");
    flags.body(o.body);
    flags->add_flag("!--no-overlays", o.settings.overlays, "Leave the overlay pictures out");
}

namespace {

void declareFlags(CommandFlags& flags, ImportOptions& o) {
    flags.path("--out", o.settings.out, "Capture to write")->required();
    declareImportFlags(flags, o);
}

const Command<ImportOptions> kImport{{
    .name = "import",
    .place = 20,
    .summary = "Bring a video or another program's layout into a capture",
    .description =
        "Brings a video, a folder of pictures or another program's layout into a capture. What it\n"
        "is, is detected: a video or its frames, in which the person is found with networks that\n"
        "`scripts/setup --models` fetches; the Human Retargeting dataset's layout (images/,\n"
        "smpl_pose/*_body.pkl, segmentations/ if there are any); a capture of Doppel's own. Draws\n"
        "the pose over each frame (overlay.jpg, overlays/). --poses takes another program's poses\n"
        "of the same pictures in the place of those that Doppel starts from. Stopped or killed in\n"
        "the middle of a clip, it goes on where it was when the same command is given again.",
    .example = "doppel import clip.mp4 --out me --every 3",
    .flags = declareFlags,
    .run = runImport,
}};

}  // namespace

}  // namespace doppel
