// A part of the window that shows the avatar.
#pragma once

#include "trainer/avatar/avatar.h"
#include "viewer/picture/scene.h"

namespace doppel {

// Framebuffer pixels.
struct Pane {
    int x = 0, y = 0, width = 0, height = 0;
    // Of the view that it is a part of, from left to right: all of it, but where a line divides
    // one.
    int viewX = 0, viewWidth = 0;
    int other = 0;  // the avatar that it shows: the edited one, or which of the others from 1 on
    MeshKind mesh = MeshKind::Refined;
    TextureKind texture = TextureKind::Coarse;
    bool operator==(const Pane&) const = default;
};

}  // namespace doppel
