// The body that a motion was made for, as far as a motion tells: the default one in its shape, of
// clay.
#pragma once

#include "trainer/avatar/avatar.h"
#include "viewer/picture/scene.h"

namespace doppel {

class SourceBody {
public:
    // The device outlives it.
    explicit SourceBody(Device& device);

    Scene& scene() { return scene_; }

private:
    Avatar avatar_;
    Scene scene_;  // last: it looks at the avatar
};

}  // namespace doppel
