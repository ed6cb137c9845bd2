#include <fmt/format.h>

#include <cstdio>

#include "trainer/commands/command.h"
#include "viewer/start/start_window.h"
#include "viewer/viewer.h"

namespace doppel {

namespace {

struct ViewOptions {
    CommonOptions common;
    ViewerOptions viewer;  // its device is what `common` says
    double scale = 0;      // 0: not given
    std::string theme;
};

void declareFlags(CommandFlags& flags, ViewOptions& o) {
    flags.precision();
    flags.path(
        "AVATAR", o.viewer.avatar,
        "Avatar's folder, or a clip or pictures to make one of; without: choose in a window");
    flags.path(
        "--motion", o.viewer.motion,
        "A capture, a poses.npz, BVH, FBX, glTF, USD, JSON, AMASS or an estimator's poses to play");
    flags.frames(o.viewer.frames, "Frames of the motion");
    flags.retarget(o.viewer.retarget);
    flags.paths("--beside", o.viewer.beside,
                "Another avatar, to see with this one; may be given several times");
    flags.path("--pose", o.viewer.pose, "A pose to begin with, JSON as the viewer copies it");
    flags->add_option("--camera", o.viewer.camera,
                      "Where to look from, as the viewer copies it (Ctrl + Shift + C)");
    flags
        ->add_option("--scale", o.scale,
                     "Size of letters, panel and handles, besides the monitor's own; without: as "
                     "chosen last")
        ->check(CLI::Range(kSmallestScale, kLargestScale));
    flags->add_option("--theme", o.theme, "dark or light; without: as chosen last")
        ->check(CLI::IsMember({"dark", "light"}));
    flags->add_option("--keys", o.viewer.keys,
                      "gltf or blender, whose habits keys and mouse have, or a file that says what "
                      "they do; without: as chosen last");
    const auto setSize = [&o](const std::string& text) {
        int used = 0;
        if (std::sscanf(text.c_str(), "%dx%d%n", &o.viewer.width, &o.viewer.height, &used) != 2 ||
            static_cast<size_t>(used) != text.size() || o.viewer.width < 200 ||
            o.viewer.height < 150 || o.viewer.width > 8192 || o.viewer.height > 8192)
            throw CLI::ValidationError(
                "--size",
                fmt::format("expected WIDTHxHEIGHT, 200x150 to 8192x8192, found \"{}\"", text));
    };
    flags->add_option_function<std::string>("--size", setSize, "The window's size, WIDTHxHEIGHT")
        ->default_str("1280x800");
}

const Command<ViewOptions> kView{{
    .name = "view",
    .place = 90,
    .summary = "Open a window: drag the joints, turn the camera, play motions",
    .description =
        "Opens a window with the avatar; without one, a window in which one is chosen, or made of "
        "a\n"
        "clip that is dropped there. Drag a joint and the limb follows, turn the camera with the "
        "left\n"
        "or middle button, press H for all keys. While a training runs in the avatar's folder its\n"
        "present state is shown. What Doppel reads may be dropped on the window; a clip becomes "
        "an\n"
        "avatar.",
    .example = "doppel view avatar --motion capture",
    .flags = declareFlags,
    .run =
        [](const ViewOptions& options) {
            ViewerOptions viewer = options.viewer;
            viewer.device = options.common.deviceOptions();
            viewer.state = userStateFolder();
            if (options.scale > 0) viewer.scale = options.scale;
            if (!options.theme.empty())
                viewer.theme = options.theme == "light" ? Theme::Light : Theme::Dark;
            if (!viewer.camera.empty()) readCameraText(viewer.camera);  // before a window opens
            if (!viewer.keys.empty()) Bindings::named(viewer.keys);
            std::unique_ptr<Window> window;
            std::optional<Making> making;  // goes on behind the window
            if (const auto folder = LiveAvatar::at(viewer.avatar)) {
                viewer.avatar = *folder;
            } else if (viewer.avatar.empty() || Making::takes(viewer.avatar)) {
                StartWindow start(viewer);
                while (start.frame()) continue;
                if (!start.chosen()) return;
                viewer.avatar = *start.chosen();
                if (auto begun = start.takeMaking()) making.emplace(std::move(*begun));
                window = start.takeWindow();
            }
            Viewer(viewer, std::move(window), std::move(making)).run();
        },
}};

}  // namespace

}  // namespace doppel
