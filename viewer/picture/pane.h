// A part of the window that shows the avatar.
#pragma once

#include "trainer/avatar/avatar.h"
#include "viewer/picture/scene.h"

namespace doppel {

// Framebuffer pixels.
struct Pane {
    int x = 0, y = 0, width = 0, height = 0;
    MeshKind mesh = MeshKind::Refined;
    TextureKind texture = TextureKind::Coarse;
    bool operator==(const Pane&) const = default;
};

}  // namespace doppel
