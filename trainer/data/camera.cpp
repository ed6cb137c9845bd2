#include "trainer/data/camera.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include "engine/error.h"
#include "engine/io/image.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr double kMostPixels = 1e7;  // single precision leaves nothing of more

// One value, or one per frame.
std::vector<int64_t> perFrame(const Array& array, size_t frames, const std::string& what) {
    std::vector<int64_t> values =
        array.isFloat() ? std::vector<int64_t>{array.integer()} : array.toI64();
    if (values.size() == 1) values.resize(frames, values[0]);
    if (values.size() != frames) {
        throwInput("{}: expected one number or one per frame ({}), found {}", what, frames,
                   values.size());
    }
    return values;
}

// Matrices [rows, rows] or [F, rows, rows], as one per frame.
std::vector<std::vector<double>> matrices(const Array& array, int64_t rows, size_t frames,
                                          const std::string& what) {
    if (array.shape.size() == 2) {
        array.requireShape({rows, rows});
    } else {
        array.requireShape({-1, rows, rows});
    }
    const std::vector<double> values = array.toF64();
    const auto size = static_cast<size_t>(rows * rows);
    const size_t count = values.size() / size;
    if (array.shape.size() == 3 && count != frames) {
        throwInput("{}: expected one matrix or one per frame ({}), found {}", what, frames, count);
    }
    for (double value : values) {
        if (!std::isfinite(value)) {
            throwInput("{}: expected finite numbers, found {}", what, value);
        }
    }
    std::vector<std::vector<double>> result(frames);
    for (size_t f = 0; f < frames; ++f) {
        const size_t at = array.shape.size() == 3 ? f * size : 0;
        result[f].assign(values.begin() + std::ptrdiff_t(at),
                         values.begin() + std::ptrdiff_t(at + size));
    }
    return result;
}

RigidMotion rigidMotionOf(const std::vector<double>& m, const std::string& what) {
    RigidMotion rigid;
    for (int i = 0; i < 3; ++i) {
        const double* row = m.data() + 4 * i;
        for (int j = 0; j < 3; ++j) rigid.rotation[j][i] = row[j];
        rigid.translation[i] = row[3];
    }
    double worst = std::abs(m[12]) + std::abs(m[13]) + std::abs(m[14]) + std::abs(m[15] - 1);
    const glm::dmat3 rest =
        glm::transpose(rigid.rotation) * rigid.rotation - glm::dmat3(1);  // 0 for a rotation
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) worst = std::max(worst, std::abs(rest[i][j]));
    }
    if (worst > 1e-3 || glm::determinant(rigid.rotation) < 0) {
        throwInput(
            "{}: expected a rotation and a translation (world to camera), found a matrix "
            "that is none",
            what);
    }
    return rigid;
}

}  // namespace

Cameras readCameras(const fs::path& path, size_t frames) {
    const Npz npz = readNpz(path);
    const std::string file = path.string();
    const auto widths = perFrame(npz.at("width"), frames, file + ": width");
    const auto heights = perFrame(npz.at("height"), frames, file + ": height");
    const auto intrinsics = matrices(npz.at("intrinsic"), 3, frames, file + ": intrinsic");
    Cameras result;
    for (size_t f = 0; f < frames; ++f) {
        const auto& m = intrinsics[f];
        if (widths[f] < 1 || heights[f] < 1 || widths[f] > kMaxImageSide ||
            heights[f] > kMaxImageSide) {
            throwInput("{}: width, height: expected 1 to {} pixels, found {}×{}", file,
                       kMaxImageSide, widths[f], heights[f]);
        }
        if (m[0] <= 0 || m[4] <= 0 || m[1] != 0 || m[3] != 0 || m[6] != 0 || m[7] != 0 ||
            m[8] != 1) {
            throwInput(
                "{}: intrinsic: expected [fx 0 cx; 0 fy cy; 0 0 1] with positive focal "
                "lengths, found [{}; {}; {}]",
                file, fmt::join(m.begin(), m.begin() + 3, " "),
                fmt::join(m.begin() + 3, m.begin() + 6, " "),
                fmt::join(m.begin() + 6, m.end(), " "));
        }
        for (size_t i : {0u, 2u, 4u, 5u}) {
            if (std::abs(m[i]) <= kMostPixels) continue;
            throwInput("{}: intrinsic: expected numbers from {} to {}, found {} in frame {}", file,
                       -kMostPixels, kMostPixels, m[i], f);
        }
        result.cameras.push_back({m[0], m[4], m[2], m[5], int(widths[f]), int(heights[f])});
    }
    result.extrinsics.resize(frames);
    if (const Array* extrinsic = npz.find("extrinsic")) {
        const auto values = matrices(*extrinsic, 4, frames, file + ": extrinsic");
        for (size_t f = 0; f < frames; ++f) {
            result.extrinsics[f] = rigidMotionOf(values[f], file + ": extrinsic");
            for (int i = 0; i < 3; ++i) {
                const double metres = result.extrinsics[f].translation[i];
                if (std::abs(metres) <= kMostMetres) continue;
                throwInput(
                    "{}: extrinsic: expected a translation from {} to {} m, found {} in "
                    "frame {}",
                    file, -kMostMetres, kMostMetres, metres, f);
            }
        }
    }
    return result;
}

Npz camerasArrays(std::span<const Camera> cameras) {
    CHECK(!cameras.empty(), "a cameras.npz has cameras");
    const bool same = std::all_of(cameras.begin(), cameras.end(),
                                  [&](const Camera& c) { return c == cameras[0]; });
    std::vector<double> intrinsic, identity(16, 0.);
    std::vector<int64_t> heights, widths;
    for (const Camera& c : same ? cameras.first(1) : cameras) {
        intrinsic.insert(intrinsic.end(), {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1});
        heights.push_back(c.height);
        widths.push_back(c.width);
    }
    for (size_t i = 0; i < 4; ++i) identity[5 * i] = 1;
    Npz arrays;
    if (same) {
        arrays.set("intrinsic", Array::f64({3, 3}, intrinsic));
        arrays.set("height", Array::scalarI64(heights[0]));
        arrays.set("width", Array::scalarI64(widths[0]));
    } else {
        const auto all = static_cast<int64_t>(cameras.size());
        arrays.set("intrinsic", Array::f64({all, 3, 3}, intrinsic));
        arrays.set("height", Array::i64({all}, heights));
        arrays.set("width", Array::i64({all}, widths));
    }
    arrays.set("extrinsic", Array::f64({4, 4}, identity));
    return arrays;
}

}  // namespace doppel
