// What a viewer begins with, and what its panel sets.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/device.h"
#include "trainer/motion/retarget/retarget.h"
#include "viewer/picture/backdrop.h"
#include "viewer/picture/scene.h"
#include "viewer/pose/skeleton.h"
#include "viewer/window/look.h"

namespace doppel {

// What a viewer begins with.
struct ViewerOptions {
    DeviceOptions device;  // that computes the pictures
    std::filesystem::path avatar;
    std::filesystem::path motion;               // a capture, poses.npz or .bvh; may be empty
    std::vector<std::filesystem::path> beside;  // avatars to see with this one
    std::filesystem::path pose;                 // a pose's JSON to begin with; may be empty
    std::string frames;                         // of the motion: selectFrames; empty: all
    RetargetSettings retarget;                  // of all motions that are opened
    int width = 1280, height = 800;             // of the window
    // Where what is not saved is kept for the next start (viewer/recovery.h); empty: nowhere.
    std::filesystem::path state;
    std::optional<double> scale;  // of the interface; without: as it was chosen before, else 1
    std::optional<Theme> theme;
    std::string keys;    // "gltf", "blender" or a file (viewer/keys); empty: as chosen before
    std::string camera;  // as cameraText(); empty: all of the body is seen from the front
    // Milliseconds that a picture may take for its edges to be smooth while something moves;
    // without: 5 on a GPU, and none on a CPU.
    std::optional<double> smoothWithin;
    std::filesystem::path program;  // `doppel`, which makes avatars of clips; empty: this one
};

// What is compared side by side, to the left what is named first: body and refined, coarse and
// refined, what the motion comes from and the avatar, this avatar and others; or all of these in
// one scene.
enum class Split { None, Meshes, Textures, Source, Avatars, Together };

// What the rings of the selected joint turn about: its own axes, its parent's, or the picture's,
// right, down and into it.
enum class RingAxes { Own, Parents, Views };

// What the panel sets.
struct ViewSettings {
    MeshKind mesh = MeshKind::Refined;
    TextureKind texture = TextureKind::Coarse;
    uint32_t paint = kPaintTexture;
    bool wireframe = false, atlas = false;
    uint32_t light = kLightCapture;
    double lampYaw = -0.6, lampPitch = 0.6, ambient = 0.35;  // radians, as seen from the camera
    Split split = Split::None;
    bool divided = false;  // what is compared is one picture with a line, where the divider is
    float divider = .5f;   // part of the picture's width
    double apart = .9;     // of avatars in one scene, metres
    Backdrop backdrop = Backdrop::Colour;
    double frameOpacity = .5;  // of a frame in front
    int differenceTimes = 2;   // as large as it is
    std::array<float, 3> colour{0.20f, 0.22f, 0.25f};
    bool captureCamera = false;
    bool floor = false;
    int ghosts = 0, ghostSpacing = 5;  // to each side; frames
    bool joints = true, limits = true, balance = true;
    bool holdFeet = false;    // the floor holds feet that stand on it while something is dragged
    bool steps = true;        // and step where that is pulled further than the body reaches
    bool aboveFloor = false;  // nothing is dragged below the floor
    RingAxes ringAxes = RingAxes::Own;
    bool symmetric = false;         // what is done to one side is done to the other
    std::array<bool, kLimbs> fk{};  // drags turn one bone of that Limb, and not all of it
    bool panel = true, help = false;
    bool figures = true;   // of speed, in the corner
    bool training = true;  // how far one is that goes on, in the corner
    Theme theme = Theme::Dark;
    bool operator==(const ViewSettings&) const = default;
};

}  // namespace doppel
