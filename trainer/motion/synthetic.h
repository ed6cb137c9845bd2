// Captures of a synthetic actor: frames with known truth.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "engine/device.h"
#include "nn/body/body.h"
#include "trainer/data/capture.h"
#include "trainer/motion/session.h"

namespace doppel {

// A clothed, haired person who is not the body model, on the body model's skeleton.
struct Actor {
    BodyModel body;
    std::vector<float> texture;  // [size,size,3] sRGB-encoded in [0,1]
    int textureSize = 0;
};
// Whom readActor() finds in the folder, sorted; nobody where there is no such folder.
std::vector<std::string> actorNames(const std::filesystem::path& folder);
// From FOLDER/NAME.npz and NAME.png.
Actor readActor(const std::filesystem::path& folder, const std::string& name);

struct SyntheticOptions {
    int size = 256;                  // pixels, square
    double poseNoiseDegrees = 2;     // of every joint, about a random axis
    double transNoiseMetres = 0.01;  // along a random direction
    uint64_t seed = 1;
    int samples = 3;  // per pixel and axis
    // L [8,3] of the light on the actor (nn/steps/light.h); empty: the texture as it is.
    std::vector<float> light = {};
};

// L [8,3] of a warm lamp on the left, above the camera, in a bright room: what faces it is two
// fifths brighter than it would be without, what faces away a tenth darker.
std::vector<float> studioLamp();

// Draws the actor in these poses before a plain studio wall, and writes the capture: frames, masks,
// and the poses as an imperfect tracker would have seen them. The true ones go to truth.npz (as
// poses.npz) in the same folder.
Capture renderActor(Device& device, const Actor& actor, const std::vector<MotionFrame>& motion,
                    const std::filesystem::path& out, const SyntheticOptions& options);

// Where the bodies and actors that come with the program are: DOPPEL_ASSETS, else `assets` of the
// source or, for an installed program, share/doppel.
std::filesystem::path assetFolder();

// The distance at which actorSession() fills the picture of syntheticCamera().
constexpr float kActorDistance = 3.2f;
Camera syntheticCamera(int size);

}  // namespace doppel
