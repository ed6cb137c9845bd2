#include "trainer/commands/render.h"

#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "trainer/avatar/background.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/picture_sequence.h"
#include "trainer/avatar/rendering.h"
#include "trainer/commands/command.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/motion/smooth.h"
#include "trainer/motion/upright.h"

namespace doppel {

namespace {

// The same view with `size` pixels on the longer side.
Camera scaled(Camera camera, int size) {
    if (size == 0) return camera;
    double scale = static_cast<double>(size) / std::max(camera.width, camera.height);
    camera.width = std::max(1, static_cast<int>(camera.width * scale + 0.5));
    camera.height = std::max(1, static_cast<int>(camera.height * scale + 0.5));
    camera.fx *= scale, camera.fy *= scale, camera.cx *= scale, camera.cy *= scale;
    return camera;
}

}  // namespace

void runRender(const RenderOptions& options) {
    catchInterrupts();
    const auto apart = isFilm(options.out) ? requireFileApart : requireApart;
    apart(options.out, {options.avatar, options.motion, options.camera, options.retarget.contacts});
    Avatar avatar = readAvatar(options.avatar);
    TextureKind texture = textureKind(options.texture);
    requireTexture(avatar, texture, options.avatar);
    Motion motion = readMotion(options.motion);
    if (const std::string taken = takenAs(motion); !taken.empty())
        fmt::print(stderr, "{}: {}\n", options.motion.string(), taken);
    std::vector<size_t> chosen = selectFrames(options.frames, motion.size());
    // Smoothed and retargeted whole, so that a part of a motion moves as it does in the whole.
    const Retargeted retargeted =
        retargetTo(targetOf(avatar), smoothed(std::move(motion), options.smooth), options.retarget);
    if (!retargeted.summary.empty())
        fmt::print(stderr, "{}: {}\n", options.motion.string(), retargeted.summary);
    motion = retargeted.motion.subset(chosen);
    Device device(options.common.deviceOptions());

    std::vector<Shot> shots;
    if (options.camera == "capture") {
        shots = throughOwnCameras(motion);
    } else if (options.camera == "turntable") {
        // The motion goes on, on the spot, while the camera goes round.
        Shot shot = restShot(device, avatar, options.size > 0 ? options.size : 512);
        motion = inCameraSpace(std::move(motion));
        for (size_t i = 0; i < motion.size(); ++i) {
            shot.theta = motion.theta[i];
            shots.push_back(
                turned(shot, static_cast<double>(i) / static_cast<double>(motion.size())));
        }
    } else {
        shots = throughOwnCameras(throughCameras(retargeted.motion, options.camera).subset(chosen));
    }
    for (Shot& shot : shots) shot.camera = scaled(shot.camera, options.size);

    std::function<std::vector<float>(size_t)> background = [&](size_t i) {
        return plainBackground(options.background, shots[i].camera);
    };
    std::optional<Capture> capture;
    std::unique_ptr<FrameCache> frames;
    std::unique_ptr<BackgroundPlate> plate;
    if (options.background == "capture") {
        bool ownCameras = options.camera == "capture" && options.size == 0;
        bool pictures = std::filesystem::is_directory(options.motion / "images");
        if (ownCameras && pictures) capture = readCapture(options.motion);
        if (capture && !capture->hasMasks()) {
            fmt::print(stderr,
                       "{}: it has no masks, which tell what is behind the person; the background "
                       "is grey (--background takes another colour)\n",
                       options.motion.string());
            capture.reset();
        }
        if (!capture) {
            background = [&](size_t i) { return plainBackground("#7f7f7f", shots[i].camera); };
        } else {
            // The plate is of all frames: more of them show what is behind the person.
            frames = std::make_unique<FrameCache>(*capture);
            plate = std::make_unique<BackgroundPlate>(*capture, *frames);
            background = [&](size_t i) { return plate->behind(*frames->load(chosen[i])); };
        }
    }
    double fps = options.fps > 0 ? options.fps : motion.fps > 0 ? motion.fps : 25;
    double change =
        renderShots(device, avatar, shots, background, options.out, fps, "render", texture);
    if (options.common.json) {
        nlohmann::ordered_json json{
            {"frames", shots.size()}, {"out", options.out.string()}, {"mean_change", change}};
        if (retargeted.changed) json["retarget"] = retargetJson(retargeted);
        printJson(json);
    } else {
        fmt::print("{} frames in {}; consecutive pictures differ by {:.2f} (8-bit units)\n",
                   shots.size(), options.out.string(), change);
    }
}

namespace {

void declareFlags(CommandFlags& flags, RenderOptions& o) {
    flags.precision();
    flags.path("AVATAR", o.avatar, "Avatar's folder")->required();
    flags
        .path("--motion", o.motion,
              "A capture, a poses.npz, BVH, glTF, AMASS or an estimator's poses (docs/formats.md)")
        ->required();
    flags.path("--out", o.out, "FILE.mp4, or a folder for PNG pictures")->required();
    flags->add_option("--camera", o.camera, "capture, turntable, or a cameras.npz")
        ->capture_default_str();
    flags->add_option("--background", o.background, "capture, or a colour as \"#rrggbb\"")
        ->capture_default_str();
    flags.texture(o.texture);
    flags
        ->add_option("--smooth", o.smooth,
                     "Smooth the motion: standard deviation in frames of a Gaussian over time, on "
                     "rotations and positions; 0: none")
        ->capture_default_str()
        ->check(CLI::Range(0., 100.));
    flags.retarget(o.retarget);
    flags->add_option("--size", o.size, "Pixels of the picture's longer side; 0: the camera's")
        ->capture_default_str()
        ->check(CLI::Range(0, 8192));
    flags->add_option("--fps", o.fps, "Frames per second of the film; 0: the motion's")
        ->capture_default_str()
        ->check(CLI::Range(0., 1000.));
    flags.frames(o.frames, "Frames of the motion to draw");
}

void checkBackground(RenderOptions& options) {
    const std::string& text = options.background;
    if (text == "capture") return;
    const bool colour = text.size() == 7 && text[0] == '#' &&
                        text.find_first_not_of("0123456789abcdefABCDEF", 1) == std::string::npos;
    if (!colour) {
        throwInput("--background: expected capture or a colour as #rrggbb, found \"{}\"", text);
    }
}

const Command<RenderOptions> kRender{{
    .name = "render",
    .place = 50,
    .summary = "Put the avatar into the poses of a motion and draw it",
    .example = "doppel render avatar --motion box --camera turntable --background \"#ffffff\" "
               "--out dance.mp4",
    .flags = declareFlags,
    .check = checkBackground,
    .run = runRender,
}};

}  // namespace

}  // namespace doppel
