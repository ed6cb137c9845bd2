#include "trainer/data/pictures/crop.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>

#include "engine/error.h"
#include "nn/body/joint.h"

namespace doppel {

namespace {

// One row of the table from output pixels to source pixels along one axis.
struct Taps {
    int first = 0;
    std::vector<double> weights;  // sum 1; empty: nothing of the pixel is inside
    double inside = 0;            // part of the pixel's length that lies inside
};

std::vector<Taps> tapsOf(double begin, double step, int count, int length) {
    std::vector<Taps> taps(static_cast<size_t>(count));
    for (int i = 0; i < count; ++i) {
        Taps& t = taps[size_t(i)];
        const double from = begin + i * step, to = from + step;
        const double low = std::max(from, 0.), high = std::min(to, double(length));
        if (high <= low) continue;
        t.inside = (high - low) / step;
        if (step >= 1) {
            t.first = std::min(int(low), length - 1);
            const int last = std::min(int(std::ceil(high)), length);
            for (int s = t.first; s < last; ++s) {
                const double overlap = std::min(high, s + 1.) - std::max(low, double(s));
                t.weights.push_back(overlap / (high - low));
            }
        } else {
            const double centre = std::clamp((from + to) / 2 - .5, 0., double(length - 1));
            t.first = std::min(int(centre), std::max(length - 2, 0));
            const double part = centre - t.first;
            t.weights = {1 - part};
            if (length > 1) t.weights.push_back(part);
        }
    }
    return taps;
}

// channels interleaved; result [size][size][channels], in [0,1].
std::vector<float> resample(std::span<const uint8_t> source, int width, size_t channels,
                            const std::vector<Taps>& columns, const std::vector<Taps>& rows) {
    const size_t outWidth = columns.size(), rowSize = size_t(width) * channels;
    std::vector<float> result(outWidth * rows.size() * channels, 0.f);
    // Rows of the source, already resampled along x, as they are needed: rows' taps only move down.
    std::map<int, std::vector<double>> ready;
    std::vector<double> sum(outWidth * channels);
    for (size_t y = 0; y < rows.size(); ++y) {
        const Taps& row = rows[y];
        if (row.weights.empty()) continue;
        std::erase_if(ready, [&](const auto& entry) { return entry.first < row.first; });
        std::fill(sum.begin(), sum.end(), 0);
        for (size_t k = 0; k < row.weights.size(); ++k) {
            const int sourceY = row.first + int(k);
            auto& line = ready[sourceY];
            if (line.empty()) {
                line.assign(outWidth * channels, 0);
                const uint8_t* from = source.data() + size_t(sourceY) * rowSize;
                for (size_t x = 0; x < outWidth; ++x) {
                    const Taps& column = columns[x];
                    for (size_t j = 0; j < column.weights.size(); ++j) {
                        const uint8_t* pixel = from + (size_t(column.first) + j) * channels;
                        for (size_t c = 0; c < channels; ++c) {
                            line[x * channels + c] += column.weights[j] * pixel[c];
                        }
                    }
                }
            }
            for (size_t i = 0; i < sum.size(); ++i) sum[i] += row.weights[k] * line[i];
        }
        for (size_t i = 0; i < sum.size(); ++i) {
            result[y * outWidth * channels + i] = static_cast<float>(sum[i] / 255);
        }
    }
    return result;
}

}  // namespace

CropBox cropBox(const Camera& camera, std::span<const std::array<double, 3>> joints,
                std::string_view where) {
    CHECK(joints.size() == joint::kCount, "a body has 24 joints, not {}", joints.size());
    for (size_t j = 0; j < joints.size(); ++j) {
        if (!(joints[j][2] > 1e-3)) {
            throwInput("{}: expected the body before the camera, found joint {} at z = {:.3f} m",
                       where, j, joints[j][2]);
        }
    }
    const auto [u, v] = camera.project(joints[0]);
    double largest = 0;
    for (const auto& joint : joints) {
        const auto [x, y] = camera.project(joint);
        largest = std::max(largest, std::hypot(x - u, y - v));
    }
    if (!(largest > 0) || !std::isfinite(u + v + largest)) {
        throwInput(
            "{}: expected the body before the camera, found it too far off to be seen: "
            "{:.3g} m",
            where, joints[0][2]);
    }
    return {u, v, 1.1 * largest};
}

Camera cropCamera(const Camera& camera, const CropBox& box, int size) {
    const double scale = size / (2 * box.half);
    return {camera.fx * scale,
            camera.fy * scale,
            (camera.cx - box.centreX + box.half) * scale,
            (camera.cy - box.centreY + box.half) * scale,
            size,
            size};
}

Crop crop(const Picture& picture, const Camera& camera, const CropBox& box, int size) {
    CHECK(size > 0 && box.half > 0, "a crop has pixels, not {} of half size {}", size, box.half);
    const double step = 2 * box.half / size;
    const auto columns = tapsOf(box.centreX - box.half, step, size, picture.width);
    const auto rows = tapsOf(box.centreY - box.half, step, size, picture.height);
    Crop result;
    result.camera = cropCamera(camera, box, size);
    if (!picture.rgb.empty())
        result.image = resample(picture.rgb, picture.width, 3, columns, rows);
    result.inside.resize(size_t(size) * size_t(size));
    for (size_t y = 0; y < rows.size(); ++y) {
        for (size_t x = 0; x < columns.size(); ++x) {
            result.inside[y * columns.size() + x] =
                static_cast<float>(rows[y].inside * columns[x].inside);
        }
    }
    if (!picture.mask.empty()) {
        result.mask = resample(picture.mask, picture.width, 1, columns, rows);
        // What lies outside the frame is nobody.
        for (size_t p = 0; p < result.mask.size(); ++p) result.mask[p] *= result.inside[p];
    }
    return result;
}

}  // namespace doppel
