// A layer in memory on which the host draws Dear ImGui, to lie over pictures.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

struct ImDrawData;

namespace doppel {

struct PixelBox {
    int x = 0, y = 0, width = 0, height = 0;

    int64_t area() const { return int64_t{width} * height; }
    bool operator==(const PixelBox&) const = default;
};

// Rows of R, G, B, A from the lowest byte, the colours times their opacity; clear where nothing is
// drawn. It remembers the frame before, so that only what changes has to go anywhere.
class InterfaceLayer {
public:
    // Columns of a row.
    struct Stretch {
        int from = 0, to = 0;
    };

    // Clears it for the next frame.
    void begin(int width, int height);
    int width() const { return width_; }
    int height() const { return height_; }
    std::span<const uint32_t> row(int y) const { return rowOf(now_, y); }
    // Outside of it the row is clear.
    Stretch drawn(int y) const { return now_.drawn[static_cast<size_t>(y)]; }
    // The row, to be drawn on in these columns.
    std::span<uint32_t> draw(int y, Stretch columns);
    // Around all that is not as it was in the frame before; all of it where its size is another.
    PixelBox changed() const;

private:
    struct Frame {
        std::vector<uint32_t> pixels;
        std::vector<Stretch> drawn;  // per row
    };
    std::span<const uint32_t> rowOf(const Frame& frame, int y) const {
        return std::span(frame.pixels)
            .subspan(static_cast<size_t>(y) * static_cast<size_t>(width_),
                     static_cast<size_t>(width_));
    }

    int width_ = 0, height_ = 0;
    bool resized_ = false;
    Frame now_, before_;
};

// The font's atlas: how much of each texel is covered, 255 for all of it. [height,width]
struct FontAtlas {
    int width = 0, height = 0;
    const uint8_t* texels = nullptr;
};

// An opaque picture in the interface, R, G, B, A: ImGui::AddImage takes its address for a texture.
// It lives until the interface is drawn.
struct CanvasImage {
    int width = 0, height = 0;
    std::vector<uint32_t> pixels;
};

// Blends the triangles over the layer in their order, with the top-left rule: those that share an
// edge cover each of its pixels once. The atlas is sampled bilinearly; a CanvasImage fills upright
// rectangles, each pixel with the nearest of it.
void drawInterface(const ImDrawData& data, const FontAtlas& font, InterfaceLayer& layer);

}  // namespace doppel
