// surface_render: the picture against plain loops in double precision, and its gradient against
// differences of what the op declares its derivative to be: colours of the faces that were seen,
// and edges that the near surface carries.
#include <algorithm>
#include <cmath>
#include <memory>

#include "nn/ops/surface.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

using Vec2 = std::array<double, 2>;
using Vec3 = std::array<double, 3>;

double cross(Vec2 a, Vec2 b) { return a[0] * b[1] - a[1] * b[0]; }
Vec2 minus(Vec2 a, Vec2 b) { return {a[0] - b[0], a[1] - b[1]}; }

// The grid of samples and the camera on it.
struct Grid {
    int64_t samples, width, height;  // width and height count samples
    double fx, fy, cx, cy;
    explicit Grid(const Values& v) {
        auto at = [&](const char* name) { return v.at(name).data[0]; };
        samples = int64_t(at("samples"));
        const auto n = double(samples);
        width = int64_t(at("width")) * samples, height = int64_t(at("height")) * samples;
        fx = n * at("fx"), fy = n * at("fy"), cx = n * at("cx"), cy = n * at("cy");
    }
    Vec2 place(Vec3 x) const { return {fx * x[0] / x[2] + cx, fy * x[1] / x[2] + cy}; }
    Vec2 centre(int64_t i) const { return {double(i % width) + .5, double(i / width) + .5}; }
};

Vec3 vertexOf(const Values& v, size_t face, size_t corner) {
    const auto i = size_t(v.at("faces").data[3 * face + corner]);
    const double* p = &v.at("verts").data[3 * i];
    return {p[0], p[1], p[2]};
}

// Perspective-correct barycentrics of a face at a place, and the depth there; false: not covered.
bool surfaceAt(const Values& v, const Grid& grid, size_t face, Vec2 p, Vec3& b, double& depth,
               bool mustCover = true) {
    Vec2 corner[3];
    double z[3], w[3], total = 0, inverse = 0;
    for (size_t k = 0; k < 3; ++k) {
        const Vec3 x = vertexOf(v, face, k);
        if (!(x[2] > 0.001)) return false;
        corner[k] = grid.place(x);
        z[k] = x[2];
    }
    for (size_t k = 0; k < 3; ++k)
        total += w[k] = cross(minus(corner[(k + 1) % 3], p), minus(corner[(k + 2) % 3], p));
    if (total == 0) return false;
    for (size_t k = 0; k < 3; ++k) {
        if (mustCover && w[k] / total < 0) return false;
        inverse += w[k] / total / z[k];
    }
    for (size_t k = 0; k < 3; ++k) b[k] = w[k] / total / z[k] / inverse;
    depth = 1 / inverse;
    return true;
}

Vec3 textureAt(const Values& v, size_t face, Vec3 b) {
    const Value& texture = v.at("texture");
    Vec2 uv{};
    for (size_t k = 0; k < 3; ++k)
        for (size_t c = 0; c < 2; ++c)
            uv[c] += b[k] * v.at("uvs").data[2 * size_t(v.at("faces_uv").data[3 * face + k]) + c];
    double low[2], share[2], high[2];
    for (size_t c = 0; c < 2; ++c) {
        const double count = double(texture.shape[1 - c]);
        const double at = std::clamp(uv[c] * count - .5, 0.0, count - 1);
        low[c] = std::floor(at), high[c] = std::min(low[c] + 1, count - 1), share[c] = at - low[c];
    }
    Vec3 colour{};
    for (int y = 0; y < 2; ++y)
        for (int x = 0; x < 2; ++x) {
            const double weight = (y ? share[1] : 1 - share[1]) * (x ? share[0] : 1 - share[0]);
            const auto texel =
                size_t((y ? high[1] : low[1]) * double(texture.shape[1]) + (x ? high[0] : low[0]));
            for (size_t c = 0; c < 3; ++c) colour[c] += weight * texture.data[3 * texel + c];
        }
    return colour;
}

// What is held fixed once it was found: who is seen where, and the edges between samples.
struct Decided {
    struct Sample {
        int64_t face = -1;
        Vec3 b{};
        double depth = 1e9;
    };
    struct Edge {
        size_t near, far;
        int axis;
        double sign;  // of the direction from near to far
        std::array<double, 4> difference;
        double place;  // of the near surface's point along the axis
    };
    std::vector<Sample> samples;
    std::vector<Edge> edges;
};

using Rgba = std::array<double, 4>;

Rgba shownAt(const Values& v, const Grid& grid, const Decided& decided, size_t i) {
    const bool coloured = v.contains("texture");
    const Decided::Sample& sample = decided.samples[i];
    if (sample.face >= 0) {
        if (!coloured) return {0, 0, 0, 1};
        Vec3 b{};
        double depth;
        surfaceAt(v, grid, size_t(sample.face), grid.centre(int64_t(i)), b, depth, false);
        const Vec3 colour = textureAt(v, size_t(sample.face), b);
        return {colour[0], colour[1], colour[2], 1};
    }
    if (!coloured) return {0, 0, 0, 0};
    const int64_t y = int64_t(i) / grid.width / grid.samples;
    const int64_t x = int64_t(i) % grid.width / grid.samples;
    const auto pixel = size_t(y * (grid.width / grid.samples) + x);
    const double* p = &v.at("background").data[3 * pixel];
    return {p[0], p[1], p[2], 0};
}

double placeOf(const Values& v, const Grid& grid, const Decided::Sample& sample, int axis) {
    Vec3 x{};
    for (size_t k = 0; k < 3; ++k) {
        const Vec3 corner = vertexOf(v, size_t(sample.face), k);
        for (size_t c = 0; c < 3; ++c) x[c] += sample.b[k] * corner[c];
    }
    return grid.place(x)[size_t(axis)];
}

Decided decide(const Values& v, const Grid& grid) {
    Decided decided;
    const size_t faces = v.at("faces").data.size() / 3;
    for (int64_t i = 0; i < grid.width * grid.height; ++i) {
        Decided::Sample best;
        for (size_t face = 0; face < faces; ++face) {
            Vec3 b{};
            double depth;
            if (!surfaceAt(v, grid, face, grid.centre(i), b, depth)) continue;
            if (depth < best.depth * (1 - 1e-9)) best = {int64_t(face), b, depth};
        }
        decided.samples.push_back(best);
    }
    const double jump = v.at("edge_jump").data[0];
    for (int64_t y = 0; y < grid.height; ++y)
        for (int64_t x = 0; x < grid.width; ++x)
            for (int axis = 0; axis < 2; ++axis)
                for (int side : {-1, 1}) {
                    const int64_t u = x + (axis == 0 ? side : 0), w = y + (axis == 1 ? side : 0);
                    if (u < 0 || w < 0 || u >= grid.width || w >= grid.height) continue;
                    const auto near = size_t(y * grid.width + x), far = size_t(w * grid.width + u);
                    const Decided::Sample& sample = decided.samples[near];
                    if (sample.face < 0 || !(decided.samples[far].depth - sample.depth > jump))
                        continue;
                    const Rgba a = shownAt(v, grid, decided, near);
                    const Rgba b = shownAt(v, grid, decided, far);
                    Decided::Edge edge{near, far, axis, double(side), {}, 0};
                    for (size_t c = 0; c < 4; ++c) edge.difference[c] = a[c] - b[c];
                    edge.place = placeOf(v, grid, sample, axis);
                    decided.edges.push_back(edge);
                }
    return decided;
}

Values reference(const Values& v, const Decided& decided) {
    const Grid grid(v);
    std::vector<Rgba> shown;
    for (size_t i = 0; i < decided.samples.size(); ++i)
        shown.push_back(shownAt(v, grid, decided, i));
    for (const Decided::Edge& edge : decided.edges) {
        const double moved = placeOf(v, grid, decided.samples[edge.near], edge.axis) - edge.place;
        for (size_t i : {edge.near, edge.far})
            for (size_t c = 0; c < 4; ++c)
                shown[i][c] += .5 * edge.sign * moved * edge.difference[c];
    }
    const int64_t n = grid.samples, width = grid.width / n, height = grid.height / n;
    Value alpha{{height, width}, std::vector<double>(size_t(height * width))};
    Value image{{height, width, 3}, std::vector<double>(size_t(height * width * 3))};
    for (size_t i = 0; i < shown.size(); ++i) {
        const int64_t y = int64_t(i) / grid.width / n, x = int64_t(i) % grid.width / n;
        const auto pixel = size_t(y * width + x);
        alpha.data[pixel] += shown[i][3] / double(n * n);
        for (size_t c = 0; c < 3; ++c) image.data[3 * pixel + c] += shown[i][c] / double(n * n);
    }
    if (!v.contains("texture")) return {{"alpha", alpha}};
    return {{"alpha", alpha}, {"image", image}};
}

std::function<Values(const Values&)> reference() {
    auto decided = std::make_shared<Decided>();
    return [=](const Values& v) {
        if (decided->samples.empty()) *decided = decide(v, Grid(v));
        return reference(v, *decided);
    };
}

// A bumpy ball at a distance with a small one before it: an outline against the background and one
// against another surface.
void addBall(int rows, Vec3 centre, double radius, std::vector<double>& verts,
             std::vector<int>& faces) {
    const int first = int(verts.size() / 3), columns = 2 * rows;
    for (int r = 0; r <= rows; ++r)
        for (int k = 0; k < columns; ++k) {
            const double theta = M_PI * r / rows, phi = 2 * M_PI * k / columns;
            const double own = radius * (1 + .08 * std::sin(5 * theta) * std::cos(3 * phi + .2));
            verts.insert(verts.end(), {centre[0] + own * std::sin(theta) * std::cos(phi),
                                       centre[1] + own * std::cos(theta) * 1.1,
                                       centre[2] + own * std::sin(theta) * std::sin(phi)});
            if (r == rows) continue;
            const int a = first + r * columns + k, b = first + r * columns + (k + 1) % columns;
            const int c = a + columns, d = b + columns;
            if (r > 0) faces.insert(faces.end(), {a, c, b});
            if (r < rows - 1) faces.insert(faces.end(), {b, c, d});
        }
}

OpCase twoBalls(int rows, int64_t width, int64_t height, int64_t samples, bool coloured) {
    OpCase test;
    std::vector<double> verts;
    std::vector<int> faces;
    addBall(rows, {0, 0, 3}, .9, verts, faces);
    addBall(rows, {.31, .17, 1.6}, .2, verts, faces);
    const auto count = int64_t(faces.size() / 3);
    test.inputs["verts"] = {{int64_t(verts.size() / 3), 3}, verts};
    test.integers["faces"] = indices({count, 3}, faces);
    if (coloured) {
        test.inputs["uvs"] = uniform({count + 2, 2}, -.1, 1.1, 5);  // some outside: clamped
        std::vector<int> corners;
        for (int64_t f = 0; f < count; ++f)
            for (int64_t k = 0; k < 3; ++k) corners.push_back(int((f * 7 + k * 3) % (count + 2)));
        test.integers["faces_uv"] = indices({count, 3}, corners);
        test.inputs["texture"] = uniform({6, 5, 3}, 0, 1, 8);
        test.inputs["background"] = uniform({height, width, 3}, 0, 1, 9);
    }
    test.attributes = {{"fx", double(width)},           {"fy", double(width)},
                       {"cx", double(width) * .5 + .3}, {"cy", double(height) * .5 - .2},
                       {"width", double(width)},        {"height", double(height)},
                       {"samples", double(samples)},    {"edge_jump", .03}};
    test.reference = reference();
    return test;
}

// A case's inputs as the op takes them from a file, without `left`.
Npz arraysOf(const OpCase& test, std::string_view left = "") {
    Npz arrays;
    for (const auto& [name, value] : test.inputs)
        if (name != left) arrays.set(name, Array::f64(value.shape, value.data));
    for (const auto& [name, value] : test.integers) {
        std::vector<int32_t> numbers(value.data.begin(), value.data.end());
        arrays.set(name, Array::i32(value.shape, numbers));
    }
    for (const auto& [name, value] : test.attributes)
        arrays.set("attr_" + name, Array::scalarF64(value));
    return arrays;
}

TEST(SurfaceRender, AgainstPlainLoops) {
    for (bool coloured : {false, true})
        for (int64_t samples : {1, 2, 3})
            for (double largeBox : {0., 6., 1e6}) {
                SCOPED_TRACE(fmt::format("coloured {} samples {} large_box {}", coloured, samples,
                                         largeBox));
                OpCase test = twoBalls(5, 23, 19, samples, coloured);
                test.attributes["large_box"] = largeBox;
                test.directionTolerance = 2e-4;  // slivers' colours change fast
                checkOp("surface_render", test);
            }
}

TEST(SurfaceRender, FacesSmallerThanPixels) {
    OpCase test = twoBalls(14, 17, 16, 1, true);
    test.directionTolerance = 2e-4;
    checkOp("surface_render", test);
}

// The gradient of a covered area is that of the disc's own: what makes a silhouette's loss
// unbiased.
TEST(SurfaceRender, AreaGrowsWithTheOutline) {
    constexpr int64_t kSize = 96;
    OpCase test = twoBalls(40, kSize, kSize, 1, false);
    std::vector<double> verts;
    std::vector<int> faces;
    addBall(40, {0, 0, 3}, .9, verts, faces);
    test.inputs["verts"] = {{int64_t(verts.size() / 3), 3}, verts};
    test.integers["faces"] = indices({int64_t(faces.size() / 3), 3}, faces);
    Npz arrays = arraysOf(test);
    arrays.set("grad_alpha", Array::f64({kSize, kSize}, std::vector<double>(kSize * kSize, 1)));
    const Npz out = Op::find("surface_render")->run(testDevice(), arrays, {});
    double area = 0, growth = 0;
    for (float covered : out.at("alpha").toF32()) area += double{covered};
    const std::vector<float> gradient = out.at("grad_verts").toF32();
    // Growing by a part in the picture's plane about the axis: area grows by two parts.
    for (size_t i = 0; i < verts.size(); i += 3)
        growth += double{gradient[i]} * verts[i] + double{gradient[i + 1]} * verts[i + 1];
    // The points that carry the edge lie half a pixel inside it, of a radius of about thirty.
    EXPECT_NEAR(growth / (2 * area), 1, .03);
}

TEST(SurfaceRender, SameBitsTwiceAndForEitherPath) {
    std::vector<std::vector<float>> gradients;
    for (double largeBox : {1e6, 1e6, 2.}) {
        OpCase test = twoBalls(6, 40, 33, 2, true);
        test.attributes["large_box"] = largeBox;
        Npz arrays = arraysOf(test);
        arrays.set("grad_alpha", Array::f64({33, 40}, random({33, 40}, 3).data));
        arrays.set("grad_image", Array::f64({33, 40, 3}, random({33, 40, 3}, 4).data));
        const Npz out = Op::find("surface_render")->run(testDevice(), arrays, {});
        gradients.push_back(out.at("grad_verts").toF32());
    }
    EXPECT_EQ(gradients[0], gradients[1]);
    ASSERT_EQ(gradients[0].size(), gradients[2].size());  // another order of the same numbers
    double difference = 0, length = 0;
    for (size_t i = 0; i < gradients[0].size(); ++i) {
        difference += std::pow(double{gradients[0][i]} - double{gradients[2][i]}, 2);
        length += std::pow(double{gradients[0][i]}, 2);
    }
    EXPECT_LT(std::sqrt(difference / length), 1e-5);
}

// A pixel that teaches half has half a say in the texture and a whole one in the vertices.
TEST(SurfaceRender, PixelsTeachTheTextureWhatTheyMay) {
    OpCase test = twoBalls(5, 23, 19, 2, true);
    auto run = [&](bool taught) {
        Npz arrays = arraysOf(test);
        const Value teaches = uniform({19, 23}, 0, 1, 6);
        Value dImage = random({19, 23, 3}, 4);
        if (taught)
            arrays.set("teaches", Array::f64({19, 23}, teaches.data));
        else
            for (size_t i = 0; i < dImage.data.size(); ++i) dImage.data[i] *= teaches.data[i / 3];
        arrays.set("grad_image", Array::f64({19, 23, 3}, dImage.data));
        return Op::find("surface_render")->run(testDevice(), arrays, {});
    };
    const Npz taught = run(true), scaled = run(false);
    const std::vector<float> a = taught.at("grad_texture").toF32();
    const std::vector<float> b = scaled.at("grad_texture").toF32();
    for (size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-5);
    EXPECT_NE(taught.at("grad_verts").toF32(), scaled.at("grad_verts").toF32());

    test.inputs["teaches"] = {{19, 23}, std::vector<double>(19 * 23, 1)};
    test.directionTolerance = 2e-4;
    checkOp("surface_render", test);
}

// A plane that turns away from the camera: what a pixel teaches is weighted by a power of the
// cosine of its own ray with given normals, which turn from place to place, or with the plane's,
// and the vertices' gradient by nothing.
TEST(SurfaceRender, WhoSeesAPlaceAskewTeachesLess) {
    constexpr int64_t kSize = 24;
    OpCase test = twoBalls(3, kSize, kSize, 1, true);
    // z = 3 + 1.5 x.
    test.inputs["verts"] = {{4, 3}, {-1, -1, 1.5, 1, -1, 4.5, 1, 1, 4.5, -1, 1, 1.5}};
    test.integers["faces"] = indices({2, 3}, {0, 2, 1, 0, 3, 2});
    test.inputs["uvs"] = {{4, 2}, {.1, .1, .9, .1, .9, .9, .1, .9}};
    test.integers["faces_uv"] = test.integers["faces"];
    test.attributes["cx"] = test.attributes["cy"] = kSize / 2;
    const auto normalAt = [](double x, double y, bool given) {
        return given ? std::array{1.5 + .4 * x, .3 * y, -1.} : std::array{1.5, 0., -1.};
    };
    const auto powerAt = [](double x, double y) { return 2 + x + .5 * y; };
    auto run = [&](bool turned, bool given) {
        Npz arrays = arraysOf(test);
        Value dImage = random({kSize, kSize, 3}, 4);
        if (turned) {
            std::vector<double> facing;
            const std::vector<double>& verts = test.inputs["verts"].data;
            for (size_t v = 0; v < verts.size(); v += 3) {
                for (double n : normalAt(verts[v], verts[v + 1], given))
                    facing.push_back(given ? n : 0);
                facing.push_back(powerAt(verts[v], verts[v + 1]));
            }
            arrays.set("facing", Array::f64({4, 4}, facing));
        } else {
            for (size_t i = 0; i < dImage.data.size(); ++i) {
                const double x = (double(i / 3 % kSize) + .5 - kSize / 2.) / kSize;
                const double y = (double(i / 3 / kSize) + .5 - kSize / 2.) / kSize;
                const double z = 3 / (1 - 1.5 * x);
                const auto [nx, ny, nz] = normalAt(x * z, y * z, given);
                const double cosine =
                    -(nx * x + ny * y + nz) /
                    std::sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + 1));
                dImage.data[i] *= std::pow(std::abs(cosine), powerAt(x * z, y * z));
            }
        }
        arrays.set("grad_image", Array::f64(dImage.shape, dImage.data));
        return Op::find("surface_render")->run(testDevice(), arrays, {});
    };
    for (bool given : {true, false}) {
        const Npz turned = run(true, given), scaled = run(false, given);
        const std::vector<float> a = turned.at("grad_texture").toF32();
        const std::vector<float> b = scaled.at("grad_texture").toF32();
        double most = 0;
        for (size_t i = 0; i < a.size(); ++i) {
            EXPECT_NEAR(a[i], b[i], 1e-4);
            most = std::max(most, std::abs(double{a[i]}));
        }
        EXPECT_GT(most, .1);
        EXPECT_NE(turned.at("grad_verts").toF32(), scaled.at("grad_verts").toF32());
    }
}

TEST(SurfaceRender, ATextureNeedsItsAtlasAndBackground) {
    OpCase test = twoBalls(3, 8, 8, 1, true);
    const Npz arrays = arraysOf(test, "background");
    expectInputError([&] { Op::find("surface_render")->run(testDevice(), arrays, {}); },
                     "background: expected beside a texture");
}

}  // namespace
}  // namespace doppel
