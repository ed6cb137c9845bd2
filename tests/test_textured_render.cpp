// The textured render, its visibility buffer and the visibility map, against plain loops.
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "tests/raster_scene.h"

namespace doppel {
namespace {

using namespace test;

// ---- plain loops in double precision -----------------------------------------------------------

// Perspective-correct barycentrics of a covered point of a projected triangle; edges included.
bool covers(const Vec2* p, Vec2 pixel, double* weights) {
    double total = 0;
    for (size_t k = 0; k < 3; ++k) {
        weights[k] = cross(p[(k + 1) % 3] - pixel, p[(k + 2) % 3] - pixel);
        total += weights[k];
    }
    if (total == 0) return false;
    for (size_t k = 0; k < 3; ++k) weights[k] /= total;
    return std::min({weights[0], weights[1], weights[2]}) >= 0;
}

// What is seen does not depend on the texture, so it is found once.
struct Seen {
    int face;
    Vec2 uv;
};
std::vector<Seen> visibleFaces(const Values& v) {
    Picture picture(v);
    std::vector<Seen> seen;
    for (int64_t i = 0; i < picture.height * picture.width; ++i) {
        Vec2 pixel{double(i % picture.width) + 0.5, double(i / picture.width) + 0.5};
        double nearest = INFINITY;
        int best = -1;
        Vec2 uv{};
        for (size_t face = 0; face < v.at("faces").data.size() / 3; ++face) {
            Projected t;
            double weights[3];
            if (!projectFace(v, picture, face, t) || !covers(t.p, pixel, weights)) continue;
            double inverse = 0, u[2] = {0, 0};
            for (size_t k = 0; k < 3; ++k) {
                inverse += weights[k] / t.z[k];
                size_t corner = size_t(v.at("faces_uv").data[face * 3 + k]);
                for (size_t c = 0; c < 2; ++c)
                    u[c] += weights[k] / t.z[k] * v.at("uvs").data[corner * 2 + c];
            }
            // The same place up to rounding: the lower number keeps it.
            if (1 / inverse >= nearest * (1 - 1e-9)) continue;
            nearest = 1 / inverse;
            best = int(face);
            uv = {u[0] / inverse, u[1] / inverse};
        }
        seen.push_back({best, uv});
    }
    return seen;
}

Values texturedRenderReference(const Values& v, const std::vector<Seen>& seen) {
    Picture picture(v);
    const Value& texture = v.at("texture");
    Shape size{picture.height, picture.width};
    Value image{{size[0], size[1], 3}, {}}, mask{size, {}}, index{size, {}};
    for (auto [best, uv] : seen) {
        index.data.push_back(best);
        mask.data.push_back(best >= 0);
        double texels[2][2], share[2];
        for (size_t c = 0; c < 2; ++c) {
            double count = double(texture.shape[1 - c]);
            double at = std::clamp(uv[c] * count - 0.5, 0.0, count - 1);
            texels[c][0] = std::floor(at);
            texels[c][1] = std::min(texels[c][0] + 1, count - 1);
            share[c] = at - texels[c][0];
        }
        for (size_t channel = 0; channel < 3; ++channel) {
            double value = 0;
            for (size_t y = 0; y < 2; ++y)
                for (size_t x = 0; x < 2; ++x)
                    value +=
                        (y ? share[1] : 1 - share[1]) * (x ? share[0] : 1 - share[0]) *
                        texture
                            .data[size_t(texels[1][y] * double(texture.shape[1]) + texels[0][x]) *
                                      3 +
                                  channel];
            image.data.push_back(best >= 0 ? value : 0);
        }
    }
    return {{"image", image}, {"mask", mask}, {"face_index", index}};
}

std::function<Values(const Values&)> texturedRenderReference() {
    auto seen = std::make_shared<std::vector<Seen>>();
    return [=](const Values& v) {
        if (seen->empty()) *seen = visibleFaces(v);
        return texturedRenderReference(v, *seen);
    };
}

Values visibilityMapReference(const Values& v) {
    auto size = int64_t(v.at("size").data[0]);
    Value map{{size, size}, std::vector<double>(size_t(size * size))};
    for (size_t face = 0; face < v.at("faces").data.size() / 3; ++face) {
        Vec3 x[3];
        Vec2 uv[3];
        for (size_t k = 0; k < 3; ++k) {
            x[k] = vec3At(v.at("verts"), int(v.at("faces").data[face * 3 + k]));
            size_t corner = size_t(v.at("faces_uv").data[face * 3 + k]);
            for (size_t c = 0; c < 2; ++c)
                uv[k][c] = v.at("uvs").data[corner * 2 + c] * double(size);
        }
        double towards = 0;  // triple product of -v0 and the two edges
        for (size_t a = 0; a < 3; ++a) {
            size_t b = (a + 1) % 3, c = (a + 2) % 3;
            towards -= x[0][a] * ((x[1][b] - x[0][b]) * (x[2][c] - x[0][c]) -
                                  (x[1][c] - x[0][c]) * (x[2][b] - x[0][b]));
        }
        if (towards <= 0) continue;
        double weights[3];
        for (int64_t i = 0; i < size * size; ++i)
            if (covers(uv, {double(i % size) + 0.5, double(i / size) + 0.5}, weights))
                map.data[size_t(i)] = 1;
    }
    return {{"visibility", map}};
}

// ---- textured render ----------------------------------------------------------------------------

TEST(TexturedRender, AwkwardScenes) {
    for (auto [width, height] : {std::pair{53, 37}, {16, 16}, {1, 1}, {13, 127}})
        for (double largeBox : {0., 40., 1e6})
            for (Shape texture : {Shape{7, 5, 3}, Shape{1, 1, 3}}) {
                SCOPED_TRACE(fmt::format("{}x{} large_box {} texture {}", width, height, largeBox,
                                         toString(texture)));
                OpCase test;
                test.attributes = camera(width, height);
                test.attributes["large_box"] = largeBox;
                awkwardScene(width, height, test.inputs, test.integers);
                addAtlas(test.integers["faces"].shape[0], test.inputs, test.integers);
                test.inputs["texture"] = uniform(texture, 0, 1);
                test.reference = texturedRenderReference();
                test.constantOutputs = {"mask", "face_index"};
                checkOp("textured_render", test);
            }
}

TEST(TexturedRender, ManyFaces) {
    OpCase test;
    test.attributes = camera(61, 45);
    sphere(16, test.inputs, test.integers);
    addAtlas(test.integers["faces"].shape[0], test.inputs, test.integers);
    test.inputs["texture"] = uniform({24, 31, 3}, 0, 1);
    test.reference = texturedRenderReference();
    test.constantOutputs = {"mask", "face_index"};
    checkOp("textured_render", test);
}

// Gradients far above and far below one keep their precision; NaN and infinity come through.
TEST(TexturedRender, GradientsOfAnySize) {
    Values inputs;
    std::map<std::string, Value> integers;
    sphere(8, inputs, integers);
    addAtlas(integers["faces"].shape[0], inputs, integers);
    inputs["texture"] = uniform({9, 8, 3}, 0, 1);
    Value upstream = random({40, 50, 3});
    std::vector<double> one;
    for (double scale : {1.0, 1e-25, 1e-6, 1e9, 1e25}) {
        Value scaled = upstream;
        for (double& value : scaled.data) value *= scale;
        Npz arrays = arraysOf(inputs, integers, camera(50, 40));
        arrays.set("grad_image", Array::f64(scaled.shape, scaled.data));
        std::vector<double> gradient = runOp("textured_render", arrays).at("grad_texture").toF64();
        for (double& value : gradient) value /= scale;
        if (scale == 1) one = gradient;
        EXPECT_LE(relativeError(gradient, one, 1e-9), 1e-6) << scale;
    }
    for (double bad : {double(NAN), double(INFINITY)}) {
        Value broken = upstream;
        broken.data[(20 * 50 + 25) * 3] = bad;  // in the middle, covered
        Npz arrays = arraysOf(inputs, integers, camera(50, 40));
        std::vector<float> values(broken.data.begin(), broken.data.end());
        arrays.set("grad_image", Array::f32(broken.shape, values));
        for (float value : runOp("textured_render", arrays).at("grad_texture").toF32())
            EXPECT_TRUE(std::isnan(value));
    }
}

TEST(TexturedRender, SameBitsTwiceAndForEitherPath) {
    Values inputs;
    std::map<std::string, Value> integers;
    sphere(30, inputs, integers);
    addAtlas(integers["faces"].shape[0], inputs, integers);
    inputs["texture"] = uniform({33, 47, 3}, 0, 1);
    std::map<std::string, double> attributes = camera(100, 90);
    Npz results[3];
    for (size_t run = 0; run < 3; ++run) {
        attributes["large_box"] = run < 2 ? 12 : 1e6;
        Npz arrays = arraysOf(inputs, integers, attributes);
        arrays.set("grad_image", Array::f64({90, 100, 3}, random({90, 100, 3}).data));
        results[run] = runOp("textured_render", arrays);
    }
    for (const char* name : {"image", "grad_texture", "face_index"})
        EXPECT_EQ(results[0].at(name).bytes, results[1].at(name).bytes) << name;
    EXPECT_EQ(results[0].at("mask").bytes, results[2].at("mask").bytes);
    EXPECT_LE(relativeError(results[0].at("image").toF64(), results[2].at("image").toF64(), 1e-9),
              1e-5);
}

// Of two faces in the same place, the one with the lower number is seen, whatever their winding.
TEST(TexturedRender, TiesGoToTheLowestFace) {
    Values inputs;
    std::map<std::string, Value> integers;
    inputs["verts"] = {{3, 3}, {-0.97, -1.01, 2.3, 1.03, -1.02, 2.1, 0.07, 1.09, 3.3}};
    std::vector<int> faces;
    for (int i = 0; i < 25; ++i) faces.insert(faces.end(), {0, 1, 2, 2, 1, 0});
    integers["faces"] = indices({50, 3}, faces);
    integers["faces_uv"] = integers["faces"];
    inputs["uvs"] = uniform({3, 2}, 0, 1);
    inputs["texture"] = uniform({4, 4, 3}, 0, 1);
    for (double largeBox : {0., 1e6}) {
        std::map<std::string, double> attributes = camera(40, 40);
        attributes["large_box"] = largeBox;
        Npz out = runOp("textured_render", arraysOf(inputs, integers, attributes));
        std::vector<int32_t> index = out.at("face_index").toI32();
        EXPECT_EQ(*std::ranges::max_element(index), 0);
    }
}

// A sheet of triangles whose edges and corners run through pixel centres, and others that miss
// them by a rounding error: no pixel of the sheet is left open.
TEST(TexturedRender, SharedEdgesLeaveNoHoles) {
    for (double scale : {1.0, 0.3712913, 1.0 / 3}) {
        Values inputs;
        std::map<std::string, Value> integers;
        std::vector<double> verts;
        std::vector<int> faces;
        constexpr int kSide = 24;
        std::mt19937 generator(9);
        std::uniform_int_distribution<int> shift(-1, 1);
        for (int r = 0; r <= kSide; ++r)
            for (int c = 0; c <= kSide; ++c) {
                // 3 pixels apart, on pixel centres, moved by whole pixels
                bool inner = r > 0 && c > 0 && r < kSide && c < kSide;
                double u = 3 * c + 0.5 + (inner ? shift(generator) : 0);
                double v = 3 * r + 0.5 + (inner ? shift(generator) : 0);
                double z = 2 + 0.1 * std::sin(c + 2 * r);
                verts.insert(verts.end(), {u * z * scale, v * z * scale, z});
                if (r == kSide || c == kSide) continue;
                int a = r * (kSide + 1) + c;
                faces.insert(faces.end(), {a, a + 1, a + kSide + 1});
                faces.insert(faces.end(), {a + kSide + 2, a + kSide + 1, a + 1});
            }
        inputs["verts"] = {{int64_t(verts.size() / 3), 3}, verts};
        integers["faces"] = indices({int64_t(faces.size() / 3), 3}, faces);
        addAtlas(integers["faces"].shape[0], inputs, integers);
        inputs["texture"] = uniform({4, 4, 3}, 0, 1);
        int size = 3 * kSide + 3;
        Npz out = runOp("textured_render", arraysOf(inputs, integers,
                                                    {{"fx", 1 / scale},
                                                     {"fy", 1 / scale},
                                                     {"cx", 1},
                                                     {"cy", 1},
                                                     {"width", size},
                                                     {"height", size}}));
        std::vector<float> mask = out.at("mask").toF32();
        for (int y = 2; y < 3 * kSide; ++y)
            for (int x = 2; x < 3 * kSide; ++x)
                EXPECT_EQ(mask[size_t(y * size + x)], 1.0f) << x << " " << y << " " << scale;
    }
}

// Each pixel of a sampled picture is the mean of the textured render's samples.
TEST(SampledRender, AveragesSamples) {
    constexpr int64_t kWidth = 37, kHeight = 29;
    for (int samples : {1, 2, 3})
        for (double largeBox : {0., 1024.}) {
            SCOPED_TRACE(fmt::format("{} samples, large faces from {}", samples, largeBox));
            OpCase test;
            test.attributes = camera(kWidth, kHeight);
            test.attributes["large_box"] = largeBox;
            test.attributes["samples"] = samples;
            sphere(8, test.inputs, test.integers);
            // Off the axis, where no edge runs through samples: which face has those is a rounding.
            for (double& value : test.inputs["verts"].data) value += 0.0137;
            addAtlas(test.integers["faces"].shape[0], test.inputs, test.integers);
            test.inputs["texture"] = uniform({9, 14, 3}, 0, 1);
            test.reference = [=, fine = texturedRenderReference()](const Values& v) {
                Values scaled = v;
                for (const char* name : {"fx", "fy", "cx", "cy", "width", "height"})
                    scaled.at(name).data[0] *= samples;
                Values drawn = fine(scaled);
                auto mean = [&](const Value& from, int64_t channels) {
                    Value to{{kHeight, kWidth}, std::vector<double>(kHeight * kWidth * channels)};
                    if (channels > 1) to.shape.push_back(channels);
                    for (int64_t y = 0; y < kHeight * samples; ++y)
                        for (int64_t x = 0; x < kWidth * samples; ++x)
                            for (int64_t c = 0; c < channels; ++c) {
                                int64_t pixel = y / samples * kWidth + x / samples;
                                int64_t sample = y * kWidth * samples + x;
                                to.data[size_t(pixel * channels + c)] +=
                                    from.data[size_t(sample * channels + c)] / (samples * samples);
                            }
                    return to;
                };
                return Values{{"image", mean(drawn.at("image"), 3)},
                              {"coverage", mean(drawn.at("mask"), 1)}};
            };
            checkOp("sampled_render", test);
        }
}

// Reuse: one visibility buffer, depth and barycentrics as documented.
TEST(VisibilityBuffer, DepthAndBarycentrics) {
    Graph graph(testDevice());
    std::vector<int32_t> faces{0, 1, 2};
    std::vector<float> verts{-1, -1, 1, 3, -1, 3, 0, 2, 2};
    RasterMesh mesh = rasterMesh(graph, faces, 3);
    Tensor vertices = graph.constant(std::span<const float>(verts), {3, 3});
    Tensor view = graph.constant(std::span<const float>(cameraValues({20, 20, 24, 24, 1, 0, 0, 0})),
                                 kCameraShape);
    VisibilityBuffer visibility = visibilityBuffer(graph, mesh, vertices, view, 48, 48);
    graph.output(visibility.surface);
    graph.output(visibility.faceIndex);
    graph.compile({.poison = true});
    graph.run();
    std::vector<float> surface = graph.read<float>(visibility.surface);
    std::vector<int32_t> index = graph.read<int32_t>(visibility.faceIndex);
    int covered = 0;
    for (size_t i = 0; i < 48 * 48; ++i) {
        const float* s = &surface[4 * i];
        if (index[i] < 0) {
            EXPECT_EQ(s[3], 0.0f);
            continue;
        }
        ++covered;
        // The barycentrics give back the point under the pixel.
        float x = 0, y = 0, z = 0;
        for (size_t k = 0; k < 3; ++k) {
            x += s[k] * verts[3 * k];
            y += s[k] * verts[3 * k + 1];
            z += s[k] * verts[3 * k + 2];
        }
        EXPECT_NEAR(z, s[3], 1e-4);
        EXPECT_NEAR(20 * x / z + 24, float(i % 48) + 0.5f, 1e-3);
        EXPECT_NEAR(20 * y / z + 24, float(i / 48) + 0.5f, 1e-3);
    }
    EXPECT_GT(covered, 300);
}

// ---- visibility map -----------------------------------------------------------------------------

TEST(VisibilityMap, AgainstPlainLoop) {
    for (double size : {1., 13., 127.})
        for (double largeBox : {0., 40., 1e6}) {
            SCOPED_TRACE(fmt::format("size {} large_box {}", size, largeBox));
            OpCase test;
            test.attributes = {{"size", size}, {"large_box", largeBox}};
            sphere(6, test.inputs, test.integers);
            addAtlas(test.integers["faces"].shape[0], test.inputs, test.integers);
            // small faces
            for (double& value : test.inputs["uvs"].data) value = 0.3 * value + 0.2;
            test.reference = visibilityMapReference;
            checkOp("visibility_map", test);
        }
}

// Of a closed surface, faces seen from one side are those not seen from the other.
TEST(VisibilityMap, FrontAndBack) {
    Values inputs;
    std::map<std::string, Value> integers;
    inputs["verts"] = {{6, 3}, {-1, -1, 2, 1, -1, 2, 0, 1, 2, -1, -1, 2, 0, 1, 2, 1, -1, 2}};
    integers["faces"] = indices({2, 3}, {0, 1, 2, 3, 4, 5});
    inputs["uvs"] = {{6, 2},
                     {0.05, 0.05, 0.45, 0.05, 0.05, 0.95, 0.55, 0.05, 0.95, 0.05, 0.55, 0.95}};
    integers["faces_uv"] = integers["faces"];
    std::vector<float> map = runOp("visibility_map", arraysOf(inputs, integers, {{"size", 20}}))
                                 .at("visibility")
                                 .toF32();
    float left = 0, right = 0;
    for (size_t i = 0; i < map.size(); ++i) (i % 20 < 10 ? left : right) += map[i];
    // y down and z forward: (0,1,2) is wound clockwise as seen, its normal points away.
    EXPECT_EQ(left, 0.0f);
    EXPECT_GT(right, 50.0f);
}

}  // namespace
}  // namespace doppel
