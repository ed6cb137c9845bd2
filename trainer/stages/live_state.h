// What a run is at, for whoever looks.
#pragma once

#include <filesystem>

#include "engine/device.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// OUT/progress.png, a few frames with the avatar in its present state over them, and that avatar
// itself in liveFolder(OUT).
void writeState(Device& device, const Avatar& avatar, const Capture& capture, FrameCache& frames,
                const std::filesystem::path& out);

}  // namespace doppel
