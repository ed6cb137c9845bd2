// A part of the window that shows the avatar.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "viewer/picture/scene.h"

namespace doppel {

// Framebuffer pixels.
struct Pane {
    int x = 0, y = 0, width = 0, height = 0;
    // Of the view that it is a part of, from left to right: all of it, but where a line divides
    // one.
    int viewX = 0, viewWidth = 0;
    // The avatar that it shows: the edited one, which of the others from 1 on, or what the motion
    // comes from.
    static constexpr int kSource = -1;
    int other = 0;
    MeshKind mesh = MeshKind::Refined;
    TextureKind texture = TextureKind::Coarse;
    bool operator==(const Pane&) const = default;
};

// Of the pixels [height,viewWidth] of a whole view those that the pane shows.
std::vector<uint32_t> partOfView(std::span<const uint32_t> view, const Pane& pane);

}  // namespace doppel
