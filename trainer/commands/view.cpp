#include "trainer/commands/commands.h"
#include "viewer/viewer.h"

namespace doppel {

void runView(const ViewOptions& options) {
    Viewer({.device = options.common.deviceOptions(),
            .avatar = options.avatar,
            .motion = options.motion,
            .pose = options.pose,
            .frames = options.frames,
            .width = options.width,
            .height = options.height})
        .run();
}

}  // namespace doppel
