// A picture in memory, and Dear ImGui drawn over it by the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

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

// Blends the triangles over the canvas in their order, with the top-left rule: those that share an
// edge cover each of its pixels once. The atlas is the only texture and is sampled bilinearly.
void drawInterface(const ImDrawData& data, const FontAtlas& font, const Canvas& canvas);

}  // namespace doppel
