// Scenes that the rasteriser's tests draw, and what their plain loops in double precision share.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "nn/ops/raster.h"
#include "tests/op_test.h"

namespace doppel::test {

using Vec2 = std::array<double, 2>;
using Vec3 = std::array<double, 3>;

inline Vec2 operator-(Vec2 a, Vec2 b) { return {a[0] - b[0], a[1] - b[1]}; }
inline double dot(Vec2 a, Vec2 b) { return a[0] * b[0] + a[1] * b[1]; }
inline double cross(Vec2 a, Vec2 b) { return a[0] * b[1] - a[1] * b[0]; }

// ---- plain loops in double precision ------------------------------------------------------------

struct Picture {
    int64_t width, height;
    double fx, fy, cx, cy;
    explicit Picture(const Values& v)
        : width(int64_t(v.at("width").data[0])),
          height(int64_t(v.at("height").data[0])),
          fx(v.at("fx").data[0]),
          fy(v.at("fy").data[0]),
          cx(v.at("cx").data[0]),
          cy(v.at("cy").data[0]) {}
};

inline Vec3 vec3At(const Value& value, int i) {
    const double* p = &value.data[size_t(i) * 3];
    return {p[0], p[1], p[2]};
}

// A face's corners in pixels and its depths; false where it is skipped.
struct Projected {
    Vec2 p[3];
    double z[3];
};
inline bool projectFace(const Values& v, const Picture& picture, size_t face, Projected& out) {
    for (size_t k = 0; k < 3; ++k) {
        Vec3 x = vec3At(v.at("verts"), int(v.at("faces").data[face * 3 + k]));
        if (!(x[2] > 0.001)) return false;
        out.p[k] = {picture.fx * x[0] / x[2] + picture.cx, picture.fy * x[1] / x[2] + picture.cy};
        out.z[k] = x[2];
    }
    return true;
}

// ---- scenes -------------------------------------------------------------------------------------

// Numbers that floats hold exactly, so that a vertex can be put exactly on a pixel's centre.
inline std::map<std::string, double> camera(int64_t width, int64_t height) {
    return {{"fx", 64},
            {"fy", 32},
            {"cx", double(width) * 0.5 + 1.25},
            {"cy", double(height) * 0.5 - 2.25},
            {"width", double(width)},
            {"height", double(height)}};
}

// What any picture has to bear: triangles across the border, off screen, behind the camera, through
// its plane, without area, of one point, with a vertex on a pixel's centre, far larger than the
// picture; and some ordinary ones.
inline void awkwardScene(int64_t width, int64_t height, Values& inputs,
                         std::map<std::string, Value>& integers) {
    std::map<std::string, double> c = camera(width, height);
    std::vector<double> verts;
    auto vertex = [&](double u, double v, double z) {
        verts.push_back((u - c["cx"]) * z / c["fx"]);
        verts.push_back((v - c["cy"]) * z / c["fy"]);
        verts.push_back(z);
    };
    auto w = double(width), h = double(height);
    vertex(0.2 * w, 0.2 * h, 2), vertex(0.7 * w, 0.3 * h, 2.5), vertex(0.4 * w, 0.8 * h, 3);
    vertex(0.5 * w, 0.1 * h, 2.2), vertex(0.9 * w, 0.6 * h, 2.7), vertex(0.3 * w, 0.5 * h, 1.9);
    vertex(-0.3 * w, 0.4 * h, 2), vertex(0.25 * w, 0.55 * h, 4), vertex(0.1 * w, 1.4 * h, 2);
    vertex(-2 * w, -h, 1), vertex(-w, -2 * h, 2), vertex(-3 * w, -3 * h, 1);  // off screen
    vertex(0.3 * w, c["cy"], 3), vertex(0.5 * w, c["cy"], 2), vertex(0.7 * w, c["cy"], 3);  // line
    vertex(std::floor(0.6 * w) + 0.5, std::floor(0.7 * h) + 0.5, 2);  // on a pixel's centre
    vertex(0.62 * w, 0.95 * h, 2), vertex(0.8 * w, 0.75 * h, 2);
    vertex(-9 * w, 0.93 * h, 6), vertex(12 * w, 0.97 * h, 5), vertex(0.5 * w, 9 * h, 7);
    verts.insert(verts.end(), {0.1, 0.1, -2, 0.3, -0.2, 0.0, 0.2, 0.2, 0.0005});  // 21, 22, 23
    inputs["verts"] = {{int64_t(verts.size() / 3), 3}, verts};
    std::vector<int> faces{0,  1,  2,  3,  4,  5,  5,  4,  3,  6,  7, 8, 9,  10, 11,
                           12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 0, 1, 22, 1,  2,
                           23, 3,  4,  2,  2,  2,  0,  3,  0,  7,  1, 5, 21, 22, 23};
    integers["faces"] = indices({int64_t(faces.size() / 3), 3}, faces);
}

inline void addAtlas(int64_t faces, Values& inputs, std::map<std::string, Value>& integers) {
    // Some UVs outside [0,1]: clamped.
    inputs["uvs"] = uniform({faces + 2, 2}, -0.1, 1.1, 5);
    std::vector<int> corners;
    for (int64_t f = 0; f < faces; ++f)
        for (int64_t k = 0; k < 3; ++k) corners.push_back(int((f * 7 + k * 3) % (faces + 2)));
    integers["faces_uv"] = indices({faces, 3}, corners);
}

// A bumpy sphere around (0,0,3), closed, about as fine as asked: rows x 2 rows quads.
inline void sphere(int rows, Values& inputs, std::map<std::string, Value>& integers) {
    std::vector<double> verts;
    std::vector<int> faces;
    int columns = 2 * rows;
    for (int r = 0; r <= rows; ++r)
        for (int k = 0; k < columns; ++k) {
            double theta = M_PI * r / rows, phi = 2 * M_PI * k / columns;
            double radius = 0.9 + 0.08 * std::sin(5 * theta) * std::cos(3 * phi);
            verts.insert(verts.end(),
                         {radius * std::sin(theta) * std::cos(phi), radius * std::cos(theta) * 1.1,
                          3 + radius * std::sin(theta) * std::sin(phi)});
            if (r == rows) continue;
            int a = r * columns + k, b = r * columns + (k + 1) % columns;
            int c = a + columns, d = b + columns;
            if (r > 0) faces.insert(faces.end(), {a, c, b});
            if (r < rows - 1) faces.insert(faces.end(), {b, c, d});
        }
    inputs["verts"] = {{int64_t(verts.size() / 3), 3}, verts};
    integers["faces"] = indices({int64_t(faces.size() / 3), 3}, faces);
}

inline Npz arraysOf(const Values& inputs, const std::map<std::string, Value>& integers,
                    const std::map<std::string, double>& attributes) {
    Npz arrays;
    for (const auto& [name, value] : inputs) arrays.set(name, Array::f64(value.shape, value.data));
    for (const auto& [name, value] : integers) {
        std::vector<int32_t> numbers(value.data.begin(), value.data.end());
        arrays.set(name, Array::i32(value.shape, numbers));
    }
    for (const auto& [name, value] : attributes)
        arrays.set("attr_" + name, Array::scalarF64(value));
    return arrays;
}

inline Npz runOp(const std::string& op, const Npz& arrays) {
    return Op::find(op)->run(testDevice(), arrays, {.reuseMemory = false, .poison = true});
}

}  // namespace doppel::test
