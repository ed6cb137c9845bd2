#include "trainer/person/masks/mask_tools.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

namespace doppel {

const std::array<float, 256>& linearTable() {
    static const auto table = [] {
        std::array<float, 256> values{};
        for (size_t i = 0; i < 256; ++i) {
            const double x = double(i) / 255;
            values[i] = float(x <= .04045 ? x / 12.92 : std::pow((x + .055) / 1.055, 2.4));
        }
        return values;
    }();
    return table;
}

std::vector<uint8_t> invertedMask(std::span<const uint8_t> mask) {
    std::vector<uint8_t> result(mask.size());
    std::transform(mask.begin(), mask.end(), result.begin(),
                   [](uint8_t v) { return uint8_t(v > 0 ? 0 : 255); });
    return result;
}

std::vector<float> squareSums(std::span<const float> values, int width, int height, int radius) {
    const auto w = size_t(width);
    std::vector<float> rows(values.size()), sums(values.size());
    for (int y = 0; y < height; ++y) {
        const float* from = values.data() + size_t(y) * w;
        double sum = 0;
        for (int x = 0; x < std::min(radius, width); ++x) sum += double(from[x]);
        for (int x = 0; x < width; ++x) {
            if (x + radius < width) sum += double(from[x + radius]);
            if (x - radius - 1 >= 0) sum -= double(from[x - radius - 1]);
            rows[size_t(y) * w + size_t(x)] = float(sum);
        }
    }
    std::vector<double> column(w, 0.);
    const auto add = [&](int y, double sign) {
        for (size_t x = 0; x < w; ++x) column[x] += sign * double(rows[size_t(y) * w + x]);
    };
    for (int y = 0; y < std::min(radius, height); ++y) add(y, 1);
    for (int y = 0; y < height; ++y) {
        if (y + radius < height) add(y + radius, 1);
        if (y - radius - 1 >= 0) add(y - radius - 1, -1);
        for (size_t x = 0; x < w; ++x) sums[size_t(y) * w + x] = float(column[x]);
    }
    return sums;
}

void refineEdge(std::vector<uint8_t>& mask, std::span<const uint8_t> rgb, int w, int h) {
    constexpr double kMixed = 2.5;  // pixels on both sides of the edge
    constexpr int kLook = 6;
    const auto toInside = distanceTo(mask, w, h);
    const auto toOutside = distanceTo(invertedMask(mask), w, h);
    const auto& linear = linearTable();
    const auto means = [&](const std::vector<float>& distance) {
        std::array<std::vector<float>, 4> sums;
        std::vector<float> values(mask.size());
        for (size_t c = 0; c < 4; ++c) {
            for (size_t p = 0; p < values.size(); ++p) {
                const bool sure = double(distance[p]) > kMixed;
                values[p] = sure ? (c < 3 ? linear[rgb[3 * p + c]] : 1.f) : 0.f;
            }
            sums[c] = squareSums(values, w, h, kLook);
        }
        return sums;
    };
    const auto inner = means(toOutside), outer = means(toInside);
    for (size_t p = 0; p < mask.size(); ++p) {
        if (double(toInside[p]) > kMixed || double(toOutside[p]) > kMixed) continue;
        if (inner[3][p] < 3 || outer[3][p] < 3) continue;
        double along = 0, length = 0;
        for (size_t c = 0; c < 3; ++c) {
            const double out = double(outer[c][p] / outer[3][p]);
            const double axis = double(inner[c][p] / inner[3][p]) - out;
            along += (double(linear[rgb[3 * p + c]]) - out) * axis;
            length += axis * axis;
        }
        if (length > 1e-4) mask[p] = along > .5 * length ? 255 : 0;
    }
}

std::vector<float> distanceTo(std::span<const uint8_t> mask, int width, int height) {
    // Squared distances by lower envelopes of parabolas, columns first (Felzenszwalb and
    // Huttenlocher 2012).
    constexpr double kFar = 1e18;
    const auto w = size_t(width), h = size_t(height);
    CHECK(mask.size() == w * h, "the mask is [{}][{}]", height, width);
    std::vector<double> squares(mask.size());
    std::transform(mask.begin(), mask.end(), squares.begin(),
                   [](uint8_t v) { return v > 0 ? 0 : kFar; });
    const size_t longest = std::max(w, h);
    std::vector<double> line(longest), result(longest), border(longest + 1);
    std::vector<size_t> vertex(longest);
    const auto sweep = [&](size_t count) {
        size_t k = 0;
        vertex[0] = 0;
        border[0] = -kFar, border[1] = kFar;
        for (size_t q = 1; q < count; ++q) {
            const auto crossing = [&](size_t v) {
                return (line[q] + double(q * q) - line[v] - double(v * v)) /
                       (2 * (double(q) - double(v)));
            };
            // Two far parabolas cross anywhere; the first one does for both.
            if (line[q] >= kFar) continue;
            double s = crossing(vertex[k]);
            while (k > 0 && s <= border[k]) s = crossing(vertex[--k]);
            if (s <= border[k]) {
                vertex[k] = q;
            } else {
                ++k;
                vertex[k] = q;
                border[k] = s;
            }
            border[k + 1] = kFar;
        }
        size_t at = 0;
        for (size_t q = 0; q < count; ++q) {
            while (border[at + 1] < double(q)) ++at;
            const double d = double(q) - double(vertex[at]);
            result[q] = std::min(kFar, d * d + line[vertex[at]]);
        }
    };
    for (size_t x = 0; x < w; ++x) {
        for (size_t y = 0; y < h; ++y) line[y] = squares[y * w + x];
        sweep(h);
        for (size_t y = 0; y < h; ++y) squares[y * w + x] = result[y];
    }
    std::vector<float> distance(mask.size());
    for (size_t y = 0; y < h; ++y) {
        std::copy_n(squares.begin() + std::ptrdiff_t(y * w), w, line.begin());
        sweep(w);
        for (size_t x = 0; x < w; ++x) distance[y * w + x] = float(std::sqrt(result[x]));
    }
    return distance;
}

Parts connectedParts(std::span<const uint8_t> mask, bool inside, int width, int height) {
    Parts parts{std::vector<int32_t>(mask.size(), -1), {}};
    std::vector<size_t> open;
    const auto w = size_t(width), h = size_t(height);
    for (size_t start = 0; start < mask.size(); ++start) {
        if ((mask[start] > 0) != inside || parts.part[start] >= 0) continue;
        const auto number = int32_t(parts.sizes.size());
        parts.sizes.push_back(0);
        open.assign(1, start);
        parts.part[start] = number;
        while (!open.empty()) {
            const size_t p = open.back();
            open.pop_back();
            ++parts.sizes.back();
            const auto visit = [&](size_t q) {
                if ((mask[q] > 0) != inside || parts.part[q] >= 0) return;
                parts.part[q] = number;
                open.push_back(q);
            };
            if (p % w > 0) visit(p - 1);
            if (p % w + 1 < w) visit(p + 1);
            if (p / w > 0) visit(p - w);
            if (p / w + 1 < h) visit(p + w);
        }
    }
    return parts;
}

}  // namespace doppel
