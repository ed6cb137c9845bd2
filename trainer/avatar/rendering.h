// Avatars in motion: cameras, backgrounds, films.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/device.h"
#include "engine/io/video.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/films/layers.h"
#include "trainer/motion/motion.h"
#include "trainer/motion/retarget/retarget.h"

namespace doppel {

// A motion as the avatar performs it, whole, before frames are chosen of it: a capture's frames
// that it was learnt from in the poses that training found, and those between them likewise
// (trainer/avatar/training_poses.h); smoothed by so many frames; then retargeted. With
// settings.on false it is smoothed alone. folder: the avatar's. The summary says what was done.
Retargeted performed(const Avatar& avatar, const std::filesystem::path& folder, Motion motionAsRead,
                     const RetargetSettings& settings, double smooth = 0);

// One picture to draw: a pose in camera space and the camera.
struct Shot {
    Theta theta;
    Trans trans;
    Camera camera;
};

// A standing pose with the arms away from the body, in front of a camera that sees all of it.
Shot restShot(Device& device, const Avatar& avatar, int size);

// The same with the camera having gone around the body by so many turns.
Shot turned(const Shot& shot, double turns);

// The motion in a camera's space, y down: poses without cameras that were made with y or z up are
// turned about the world's origin (see uprightRotation), the others stay to the last bit. The
// person need not be in front of the camera.
Motion inCameraSpace(Motion motion);

// A motion through its own cameras; its poses are shown by the avatar's body as they are.
// InputError where it has none.
std::vector<Shot> throughOwnCameras(const Motion& motion);

// Draws shots into a film or into a folder of PNGs (films/picture_sequence.h), which appear when
// all is done, with a line of progress that is called `what`; empty: without one. Calls
// interrupted() between pictures.
//
// Returns how much consecutive pictures differ: the mean |difference| in 8-bit units over all
// channels of all pixels and pairs of one size; 0 for a pose held still, since nothing in an avatar
// is random.
double renderShots(Device& device, const Avatar& avatar, const std::vector<Shot>& shots,
                   const Layers& layers, const std::filesystem::path& out, double fps,
                   const std::string& what, TextureKind texture = TextureKind::Best,
                   const std::optional<SoundSource>& sound = {});

// The avatar at rest, from the front and from half aside, as its folder's preview.png.
void writePreview(Device& device, const Avatar& avatar, const std::filesystem::path& path);

// A picture of one colour, "#rrggbb".
std::vector<float> plainBackground(const std::string& colour, const Camera& camera);

}  // namespace doppel
