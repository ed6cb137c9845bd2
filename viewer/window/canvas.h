// A picture in memory, and Dear ImGui drawn over it by the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

struct ImDrawData;

namespace doppel {

// Rows of four bytes per pixel, without gaps; opaque.
struct Canvas {
    int width = 0, height = 0;
    bool blueFirst = false;  // the order of a pixel's bytes: blue, green, red, or red first
    std::span<uint32_t> pixels;

    std::span<uint32_t> row(int y) const {
        return pixels.subspan(static_cast<size_t>(y) * static_cast<size_t>(width),
                              static_cast<size_t>(width));
    }
};

// The font's atlas: how much of each texel is covered, 255 for all of it. [height,width]
struct FontAtlas {
    int width = 0, height = 0;
    const uint8_t* texels = nullptr;
};

// An opaque picture in the interface, in the canvas' order of bytes: ImGui::AddImage takes its
// address for a texture. It lives until the interface is drawn.
struct CanvasImage {
    int width = 0, height = 0;
    std::vector<uint32_t> pixels;
};

// Blends the triangles over the canvas in their order, with the top-left rule: those that share an
// edge cover each of its pixels once. The atlas is sampled bilinearly; a CanvasImage fills upright
// rectangles, each pixel with the nearest of it.
void drawInterface(const ImDrawData& data, const FontAtlas& font, const Canvas& canvas);

}  // namespace doppel
