// A part of the window that shows the avatar.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "viewer/picture/scene.h"
#include "viewer/window/frame.h"

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

// A pane's picture [height,width], R, G, B, A.
struct PanePicture {
    std::vector<uint32_t> pixels;   // as it was drawn
    std::vector<uint32_t> inFront;  // with a capture's frame in front of it; empty: without
    std::optional<PictureOnDevice> onDevice;  // instead of both, where the device presents it
};
// Adds it to what a window shows. It lives until that is drawn.
void place(const Pane& pane, const PanePicture& picture, std::vector<PlacedPicture>& placed);

// Of the pixels [height,viewWidth] of a whole view those that the pane shows.
std::vector<uint32_t> partOfView(std::span<const uint32_t> view, const Pane& pane);

}  // namespace doppel
