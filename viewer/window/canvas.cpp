#include "viewer/window/canvas.h"

#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace doppel {

namespace {

constexpr int64_t kSubpixels = 256;   // positions are rounded to this part of a pixel
constexpr float kFarthest = 1 << 20;  // pixels; products of two positions fit into 64 bits

int64_t floorDivided(int64_t a, int64_t b) { return a / b - (a % b != 0 && (a < 0) != (b < 0)); }

// The colour over the pixel of a layer, both bytes of a pair at once; opacity in [0,255]. The
// pixel's own opacity grows as a colour of 255 does.
uint32_t over(uint32_t pixel, uint32_t colour, uint32_t opacity) {
    auto mixed = [opacity](uint32_t below, uint32_t above) {
        uint32_t sum = (above & 0xff00ff) * opacity + (below & 0xff00ff) * (255 - opacity) +
                       0x800080;  // a half of 255, and now the division by it
        return (sum + (sum >> 8 & 0xff00ff)) >> 8 & 0xff00ff;
    };
    return mixed(pixel, colour) | mixed(pixel >> 8, (colour >> 8 & 0xff) | 0xff0000) << 8;
}

// A corner in framebuffer pixels.
struct Corner {
    float x, y, u, v;
    uint32_t colour;  // R, G, B, opacity
};

class Rasterizer {
public:
    Rasterizer(InterfaceLayer& layer, const FontAtlas& font) : layer_(layer), font_(font) {}

    // What is outside of this rectangle stays as it is.
    void clip(float left, float top, float right, float bottom) {
        left_ = static_cast<int>(std::clamp(left, 0.0f, static_cast<float>(layer_.width())));
        top_ = static_cast<int>(std::clamp(top, 0.0f, static_cast<float>(layer_.height())));
        right_ = static_cast<int>(std::clamp(right, 0.0f, static_cast<float>(layer_.width())));
        bottom_ = static_cast<int>(std::clamp(bottom, 0.0f, static_cast<float>(layer_.height())));
    }

    // Upright, of one colour: letters, and most of what is filled. a: top left, c: bottom right.
    void rectangle(const Corner& a, const Corner& c) {
        int x0 = std::max(left_, firstCentre(a.x)), x1 = std::min(right_, firstCentre(c.x));
        int y0 = std::max(top_, firstCentre(a.y)), y1 = std::min(bottom_, firstCentre(c.y));
        bool flat = a.u == c.u && a.v == c.v;
        uint32_t whole = coverage(a.u, a.v);
        float du = (c.u - a.u) / (c.x - a.x), dv = (c.v - a.v) / (c.y - a.y);
        for (int y = y0; y < y1; ++y) {
            std::span<uint32_t> row = layer_.draw(y, {x0, x1});
            float v = a.v + dv * (static_cast<float>(y) + 0.5f - a.y);
            if (flat) {
                fill(row, x0, x1, a.colour, whole);
                continue;
            }
            for (int x = x0; x < x1; ++x) {
                float u = a.u + du * (static_cast<float>(x) + 0.5f - a.x);
                blend(row[static_cast<size_t>(x)], a.colour, coverage(u, v));
            }
        }
    }

    // The part of the image that the corners say.
    void image(const Corner& a, const Corner& c, const CanvasImage& image) {
        const int x0 = std::max(left_, firstCentre(a.x)), x1 = std::min(right_, firstCentre(c.x));
        const int y0 = std::max(top_, firstCentre(a.y)), y1 = std::min(bottom_, firstCentre(c.y));
        const auto nearest = [](float part, int size) {
            return static_cast<size_t>(
                std::clamp(static_cast<int>(part * static_cast<float>(size)), 0, size - 1));
        };
        for (int y = y0; y < y1; ++y) {
            const std::span<uint32_t> row = layer_.draw(y, {x0, x1});
            const size_t line =
                nearest(std::lerp(a.v, c.v, (static_cast<float>(y) + .5f - a.y) / (c.y - a.y)),
                        image.height) *
                static_cast<size_t>(image.width);
            for (int x = x0; x < x1; ++x) {
                const float u =
                    std::lerp(a.u, c.u, (static_cast<float>(x) + .5f - a.x) / (c.x - a.x));
                blend(row[static_cast<size_t>(x)],
                      (image.pixels[line + nearest(u, image.width)] & 0xffffff) |
                          (a.colour & 0xff000000u),
                      255);
            }
        }
    }

    void triangle(const Corner& a, const Corner& b, const Corner& c) {
        std::array<const Corner*, 3> corners{&a, &b, &c};
        std::array<int64_t, 3> x{}, y{};
        for (size_t i = 0; i < 3; ++i) {
            if (!std::isfinite(corners[i]->x) || !std::isfinite(corners[i]->y)) return;
            x[i] = subpixels(corners[i]->x);
            y[i] = subpixels(corners[i]->y);
        }
        int64_t area = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]);
        if (area == 0) return;
        if (area < 0) {
            std::swap(corners[1], corners[2]);
            std::swap(x[1], x[2]);
            std::swap(y[1], y[2]);
            area = -area;
        }
        bool flat = a.colour == b.colour && a.colour == c.colour && a.u == b.u && a.u == c.u &&
                    a.v == b.v && a.v == c.v;
        uint32_t whole = coverage(a.u, a.v);
        const Gradient gradient = flat ? Gradient{} : gradientOf(corners, x, y, area);
        auto [low, high] = std::ranges::minmax(y);
        int first = std::max(top_, firstRow(low)), last = std::min(bottom_, firstRow(high + 1));
        for (int row = first; row < last; ++row) {
            int64_t from = left_, to = right_;
            for (size_t i = 0; i < 3; ++i) {
                size_t j = (i + 1) % 3;
                int64_t dx = x[j] - x[i], dy = y[j] - y[i];
                // Twice the area between the edge and a pixel's centre, >= 0 where it is inside;
                // centres on an edge count where the edge is at the top or to the left.
                int64_t inside =
                    dx * (row * kSubpixels + kSubpixels / 2 - y[i]) - dy * (kSubpixels / 2 - x[i]);
                if (!(dy < 0 || (dy == 0 && dx > 0))) --inside;
                int64_t step = -dy * kSubpixels;  // per column
                if (step > 0)
                    from = std::max(from, -floorDivided(inside, step));
                else if (step < 0)
                    to = std::min(to, floorDivided(inside, -step) + 1);
                else if (inside < 0)
                    to = from;
            }
            if (from >= to) continue;
            const InterfaceLayer::Stretch columns{static_cast<int>(from), static_cast<int>(to)};
            std::span<uint32_t> pixels = layer_.draw(row, columns);
            if (flat)
                fill(pixels, columns.from, columns.to, a.colour, whole);
            else
                shade(pixels, row, columns.from, columns.to, gradient);
        }
    }

private:
    // Four bytes of colour and the place in the atlas: at the first pixel's centre, per column and
    // per row.
    struct Gradient {
        std::array<double, 6> origin{}, column{}, row{};
    };

    static int64_t subpixels(float position) {
        return std::llround(std::clamp(position, -kFarthest, kFarthest) * float{kSubpixels});
    }
    // The first pixel whose centre is not before the position.
    static int firstCentre(float position) {
        return static_cast<int>(std::ceil(std::clamp(position, -kFarthest, kFarthest) - 0.5f));
    }
    static int firstRow(int64_t y) {
        return static_cast<int>(-floorDivided(kSubpixels / 2 - y, kSubpixels));
    }

    static Gradient gradientOf(const std::array<const Corner*, 3>& corners,
                               const std::array<int64_t, 3>& x, const std::array<int64_t, 3>& y,
                               int64_t area) {
        Gradient gradient;
        for (size_t i = 0; i < 3; ++i) {
            // This corner's weight: the share of the area that the opposite edge spans.
            size_t j = (i + 1) % 3, k = (i + 2) % 3;
            auto dx = static_cast<double>(x[k] - x[j]), dy = static_cast<double>(y[k] - y[j]);
            double scale = 1 / static_cast<double>(area), half = kSubpixels / 2.0;
            double weight = scale * (dx * (half - static_cast<double>(y[j])) -
                                     dy * (half - static_cast<double>(x[j])));
            const Corner& corner = *corners[i];
            const std::array<double, 6> values{double(corner.colour & 0xff),
                                               double(corner.colour >> 8 & 0xff),
                                               double(corner.colour >> 16 & 0xff),
                                               double(corner.colour >> 24),
                                               double{corner.u},
                                               double{corner.v}};
            for (size_t n = 0; n < values.size(); ++n) {
                gradient.origin[n] += weight * values[n];
                gradient.column[n] -= scale * dy * double{kSubpixels} * values[n];
                gradient.row[n] += scale * dx * double{kSubpixels} * values[n];
            }
        }
        return gradient;
    }

    void shade(std::span<uint32_t> row, int y, int from, int to, const Gradient& gradient) {
        for (int x = from; x < to; ++x) {
            std::array<double, 6> at{};
            for (size_t n = 0; n < at.size(); ++n)
                at[n] = gradient.origin[n] + x * gradient.column[n] + y * gradient.row[n];
            uint32_t colour = 0;
            for (size_t n = 0; n < 4; ++n)
                colour |= static_cast<uint32_t>(std::clamp(at[n], 0.0, 255.0) + 0.5) << 8 * n;
            blend(row[static_cast<size_t>(x)], colour,
                  coverage(static_cast<float>(at[4]), static_cast<float>(at[5])));
        }
    }

    static uint32_t opacityOf(uint32_t colour, uint32_t covered) {
        return ((colour >> 24) * covered + 127) / 255;
    }
    static void blend(uint32_t& pixel, uint32_t colour, uint32_t covered) {
        if (uint32_t opacity = opacityOf(colour, covered)) pixel = over(pixel, colour, opacity);
    }
    static void fill(std::span<uint32_t> row, int from, int to, uint32_t colour, uint32_t covered) {
        if (from >= to) return;
        uint32_t opacity = opacityOf(colour, covered);
        for (uint32_t& pixel :
             row.subspan(static_cast<size_t>(from), static_cast<size_t>(to - from)))
            pixel = over(pixel, colour, opacity);
    }

    // Of the four texels around the place, each by its share.
    uint32_t coverage(float u, float v) const {
        auto texel = [](float place, int size) {
            float at = std::clamp(place * static_cast<float>(size) - 0.5f, 0.0f,
                                  static_cast<float>(size - 1));
            return static_cast<int>(at * 256 + 0.5f);
        };
        int x = texel(u, font_.width), y = texel(v, font_.height);
        int right = std::min((x >> 8) + 1, font_.width - 1) - (x >> 8);
        int below = std::min((y >> 8) + 1, font_.height - 1) - (y >> 8);
        const uint8_t* at = font_.texels + static_cast<ptrdiff_t>(y >> 8) * font_.width + (x >> 8);
        const uint8_t* under = at + static_cast<ptrdiff_t>(below) * font_.width;
        int fx = x & 255, fy = y & 255;
        if (fx == 0 && fy == 0) return at[0];  // letters, unless they are scaled
        int upper = at[0] * (256 - fx) + at[right] * fx;
        int lower = under[0] * (256 - fx) + under[right] * fx;
        return static_cast<uint32_t>(upper * (256 - fy) + lower * fy + 32768) >> 16;
    }

    InterfaceLayer& layer_;
    FontAtlas font_;
    int left_ = 0, top_ = 0, right_ = 0, bottom_ = 0;
};

// Whether six indices are a rectangle as Dear ImGui makes them, top left, top right, bottom right,
// bottom left, of one colour.
bool isRectangle(const ImDrawIdx* index, const ImDrawVert* vertex) {
    if (index[3] != index[0] || index[4] != index[2]) return false;
    const ImDrawVert &a = vertex[index[0]], &b = vertex[index[1]], &c = vertex[index[2]],
                     &d = vertex[index[5]];
    return a.pos.y == b.pos.y && b.pos.x == c.pos.x && c.pos.y == d.pos.y && d.pos.x == a.pos.x &&
           a.uv.y == b.uv.y && b.uv.x == c.uv.x && c.uv.y == d.uv.y && d.uv.x == a.uv.x &&
           a.col == b.col && a.col == c.col && a.col == d.col && a.pos.x < c.pos.x &&
           a.pos.y < c.pos.y;
}

}  // namespace

void InterfaceLayer::begin(int width, int height) {
    resized_ = width != width_ || height != height_;
    if (resized_) {
        width_ = width, height_ = height;
        for (Frame* frame : {&now_, &before_}) {
            frame->pixels.assign(static_cast<size_t>(width) * static_cast<size_t>(height), 0);
            frame->drawn.assign(static_cast<size_t>(height), {});
        }
        return;
    }
    std::swap(now_, before_);
    for (int y = 0; y < height_; ++y) {
        const Stretch old = std::exchange(now_.drawn[static_cast<size_t>(y)], {});
        std::fill_n(now_.pixels.begin() + std::ptrdiff_t{y} * width_ + old.from, old.to - old.from,
                    0u);
    }
}

std::span<uint32_t> InterfaceLayer::draw(int y, Stretch columns) {
    Stretch& drawn = now_.drawn[static_cast<size_t>(y)];
    if (columns.from < columns.to)
        drawn = drawn.from == drawn.to
                    ? columns
                    : Stretch{std::min(drawn.from, columns.from), std::max(drawn.to, columns.to)};
    return std::span(now_.pixels)
        .subspan(static_cast<size_t>(y) * static_cast<size_t>(width_), static_cast<size_t>(width_));
}

PixelBox InterfaceLayer::changed() const {
    if (resized_) return {0, 0, width_, height_};
    int left = width_, right = 0, top = height_, bottom = 0;
    for (int y = 0; y < height_; ++y) {
        const Stretch a = drawn(y), b = before_.drawn[static_cast<size_t>(y)];
        // An empty one begins at 0, where nothing differs.
        const int first = std::min(a.from, b.from), last = std::max(a.to, b.to);
        const std::span<const uint32_t> now = row(y), before = rowOf(before_, y);
        const auto differs = [&](int x) {
            return now[static_cast<size_t>(x)] != before[static_cast<size_t>(x)];
        };
        int from = first, to = last;
        while (from < to && !differs(from)) ++from;
        if (from == to) continue;
        while (!differs(to - 1)) --to;
        left = std::min(left, from), right = std::max(right, to);
        top = std::min(top, y), bottom = y + 1;
    }
    return bottom == 0 ? PixelBox{} : PixelBox{left, top, right - left, bottom - top};
}

void drawInterface(const ImDrawData& data, const FontAtlas& font, InterfaceLayer& layer) {
    Rasterizer rasterizer(layer, font);
    const ImVec2 origin = data.DisplayPos, scale = data.FramebufferScale;
    auto corner = [&](const ImDrawVert& vertex) {
        return Corner{(vertex.pos.x - origin.x) * scale.x, (vertex.pos.y - origin.y) * scale.y,
                      vertex.uv.x, vertex.uv.y, vertex.col};
    };
    for (int n = 0; n < data.CmdListsCount; ++n) {
        const ImDrawList& list = *data.CmdLists[n];
        for (const ImDrawCmd& command : list.CmdBuffer) {
            rasterizer.clip((command.ClipRect.x - origin.x) * scale.x,
                            (command.ClipRect.y - origin.y) * scale.y,
                            (command.ClipRect.z - origin.x) * scale.x,
                            (command.ClipRect.w - origin.y) * scale.y);
            const auto* image = static_cast<const CanvasImage*>(command.GetTexID());
            const ImDrawIdx* index = list.IdxBuffer.Data + command.IdxOffset;
            const ImDrawVert* vertex = list.VtxBuffer.Data + command.VtxOffset;
            for (const ImDrawIdx* end = index + command.ElemCount; index < end;) {
                if (end - index >= 6 && isRectangle(index, vertex)) {
                    const Corner a = corner(vertex[index[0]]), c = corner(vertex[index[2]]);
                    if (image)
                        rasterizer.image(a, c, *image);
                    else
                        rasterizer.rectangle(a, c);
                    index += 6;
                } else {
                    rasterizer.triangle(corner(vertex[index[0]]), corner(vertex[index[1]]),
                                        corner(vertex[index[2]]));
                    index += 3;
                }
            }
        }
    }
}

}  // namespace doppel
