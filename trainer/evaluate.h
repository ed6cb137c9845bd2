// How well an avatar shows a capture's frames.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "trainer/avatar.h"
#include "trainer/metrics.h"

namespace doppel {

// Draws the avatar in each frame's pose through the frame's camera, at the frame's resolution, over
// the frame's background (see BackgroundPlate), and compares. pictures: a folder for frame, render
// and error side by side, NAME.png; empty: none.
std::vector<FrameMetrics> evaluateAvatar(Device& device, const Avatar& avatar,
                                         const Capture& capture,
                                         const std::filesystem::path& pictures = {},
                                         TextureKind texture = TextureKind::Best);

// The same for the silhouette alone: IoU per frame, with or without the mesh network.
std::vector<double> avatarIous(Device& device, const Avatar& avatar, const Capture& capture,
                               bool refined);

}  // namespace doppel
