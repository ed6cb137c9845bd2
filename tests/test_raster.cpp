#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "nn/ops/raster.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

using Vec2 = std::array<double, 2>;
using Vec3 = std::array<double, 3>;

Vec2 operator-(Vec2 a, Vec2 b) { return {a[0] - b[0], a[1] - b[1]}; }
double dot(Vec2 a, Vec2 b) { return a[0] * b[0] + a[1] * b[1]; }
double cross(Vec2 a, Vec2 b) { return a[0] * b[1] - a[1] * b[0]; }

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

Vec3 vec3At(const Value& value, int i) {
    const double* p = &value.data[size_t(i) * 3];
    return {p[0], p[1], p[2]};
}

// A face's corners in pixels and its depths; false where it is skipped.
struct Projected {
    Vec2 p[3];
    double z[3];
};
bool projectFace(const Values& v, const Picture& picture, size_t face, Projected& out) {
    for (size_t k = 0; k < 3; ++k) {
        Vec3 x = vec3At(v.at("verts"), int(v.at("faces").data[face * 3 + k]));
        if (!(x[2] > 0.001)) return false;
        out.p[k] = {picture.fx * x[0] / x[2] + picture.cx, picture.fy * x[1] / x[2] + picture.cy};
        out.z[k] = x[2];
    }
    return true;
}

// What the gradient holds constant: found at the first call, kept afterwards.
struct Decision {
    bool counts, inside;
    int edge;
};
using Decisions = std::map<std::pair<size_t, int64_t>, Decision>;

Values softSilhouetteReference(const Values& v, Decisions& decisions, bool decide) {
    Picture picture(v);
    double sigma = v.at("sigma").data[0], blur = v.at("blur_radius").data[0];
    double ndc = 2.0 / double(std::min(picture.width, picture.height));
    Value image{{picture.height, picture.width}, {}};
    std::vector<double> sum(size_t(picture.height * picture.width));
    for (size_t face = 0; face < v.at("faces").data.size() / 3; ++face) {
        Projected t;
        if (!projectFace(v, picture, face, t)) continue;
        double area = cross(t.p[1] - t.p[0], t.p[2] - t.p[0]) * ndc * ndc;
        if (decide && std::abs(area) <= 1e-8) continue;
        for (int64_t i = 0; i < picture.height * picture.width; ++i) {
            if (!decide && !decisions.contains({face, i})) continue;
            Vec2 pixel{double(i % picture.width) + 0.5, double(i / picture.width) + 0.5};
            double d2[3];
            int sides = 0;
            for (size_t k = 0; k < 3; ++k) {
                Vec2 a = t.p[k], b = t.p[(k + 1) % 3];
                double along = std::clamp(dot(pixel - a, b - a) / dot(b - a, b - a), 0.0, 1.0);
                Vec2 q{a[0] + along * (b[0] - a[0]), a[1] + along * (b[1] - a[1])};
                d2[k] = dot(q - pixel, q - pixel) * ndc * ndc;
                sides += cross(a - pixel, b - pixel) * area > 0;
            }
            if (decide) {
                int edge = int(std::min_element(d2, d2 + 3) - d2);
                bool counts = sides == 3 || d2[edge] < blur;
                if (!counts) continue;
                decisions[{face, i}] = {counts, sides == 3, edge};
            }
            const Decision& decision = decisions.at({face, i});
            double x = (decision.inside ? 1 : -1) * d2[decision.edge] / sigma;
            sum[size_t(i)] -= std::max(x, 0.0) + std::log1p(std::exp(-std::abs(x)));
        }
    }
    for (double s : sum) image.data.push_back(-std::expm1(s));
    return {{"silhouette", image}};
}

std::function<Values(const Values&)> softSilhouetteReference() {
    auto decisions = std::make_shared<Decisions>();
    auto decided = std::make_shared<bool>(false);
    return [=](const Values& v) {
        bool decide = !*decided;
        *decided = true;
        return softSilhouetteReference(v, *decisions, decide);
    };
}

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

// ---- scenes -------------------------------------------------------------------------------------

// Numbers that floats hold exactly, so that a vertex can be put exactly on a pixel's centre.
std::map<std::string, double> camera(int64_t width, int64_t height) {
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
void awkwardScene(int64_t width, int64_t height, Values& inputs,
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

void addAtlas(int64_t faces, Values& inputs, std::map<std::string, Value>& integers) {
    // Some UVs outside [0,1]: clamped.
    inputs["uvs"] = uniform({faces + 2, 2}, -0.1, 1.1, 5);
    std::vector<int> corners;
    for (int64_t f = 0; f < faces; ++f)
        for (int64_t k = 0; k < 3; ++k) corners.push_back(int((f * 7 + k * 3) % (faces + 2)));
    integers["faces_uv"] = indices({faces, 3}, corners);
}

// A bumpy sphere around (0,0,3), closed, about as fine as asked: rows x 2 rows quads.
void sphere(int rows, Values& inputs, std::map<std::string, Value>& integers) {
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

Npz arraysOf(const Values& inputs, const std::map<std::string, Value>& integers,
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

Npz runOp(const std::string& op, const Npz& arrays) {
    return Op::find(op)->run(testDevice(), arrays, {.reuseMemory = false, .poison = true});
}

// ---- soft silhouette ----------------------------------------------------------------------------

TEST(SoftSilhouette, AwkwardScenes) {
    for (auto [width, height] : {std::pair{53, 37}, {16, 16}, {1, 1}, {13, 127}})
        for (double largeBox : {0., 40., 1e6})
            for (double sigma : {1e-4, 3e-3}) {
                SCOPED_TRACE(
                    fmt::format("{}x{} large_box {} sigma {}", width, height, largeBox, sigma));
                OpCase test;
                test.attributes = camera(width, height);
                test.attributes["sigma"] = sigma;
                test.attributes["blur_radius"] = sigma * std::log(1e4 - 1);
                test.attributes["large_box"] = largeBox;
                awkwardScene(width, height, test.inputs, test.integers);
                test.reference = softSilhouetteReference();
                test.directionTolerance = 1e-4;  // S is summed in units of 2^-24
                test.samples = 24;
                checkOp("soft_silhouette", test);
            }
}

TEST(SoftSilhouette, ManyFaces) {
    OpCase test;
    test.attributes = camera(61, 45);
    test.attributes["sigma"] = 1e-4;
    test.attributes["blur_radius"] = 9.21e-4;
    sphere(12, test.inputs, test.integers);
    // Off the axes, where pixels are as near to one edge of a face as to another.
    for (double& value : test.inputs["verts"].data) value += 0.0137;
    test.reference = softSilhouetteReference();
    checkOp("soft_silhouette", test);
}

// Far inside of a huge face exp(S) underflows: the picture is 1 and the gradient 0, not NaN.
TEST(SoftSilhouette, UnderflowKeepsTheGradientFinite) {
    Values inputs;
    std::map<std::string, Value> integers;
    inputs["verts"] = {{3, 3}, {-50, -50, 2, 50, -50, 2, 0, 80, 2}};
    integers["faces"] = indices({1, 3}, {0, 1, 2});
    std::map<std::string, double> attributes = camera(20, 20);
    attributes["sigma"] = 1e-9;
    attributes["blur_radius"] = 1e-8;
    for (double largeBox : {0., 1e6}) {
        attributes["large_box"] = largeBox;
        Npz arrays = arraysOf(inputs, integers, attributes);
        arrays.set("grad_silhouette", Array::f64({20, 20}, std::vector<double>(400, 1.0)));
        Npz out = runOp("soft_silhouette", arrays);
        for (float value : out.at("silhouette").toF32()) EXPECT_EQ(value, 1.0f);
        for (float value : out.at("grad_verts").toF32()) EXPECT_EQ(value, 0.0f);
    }
}

TEST(SoftSilhouette, SameBitsTwiceAndForEitherPath) {
    Values inputs;
    std::map<std::string, Value> integers;
    sphere(40, inputs, integers);
    std::map<std::string, double> attributes = camera(100, 90);
    attributes["sigma"] = 1e-4;
    attributes["blur_radius"] = 9.21e-4;
    std::vector<float> images[3], gradients[3];
    for (size_t run = 0; run < 3; ++run) {
        attributes["large_box"] = run < 2 ? 60 : 1e6;
        Npz arrays = arraysOf(inputs, integers, attributes);
        arrays.set("grad_silhouette", Array::f64({90, 100}, random({90, 100}).data));
        Npz out = runOp("soft_silhouette", arrays);
        images[run] = out.at("silhouette").toF32();
        gradients[run] = out.at("grad_verts").toF32();
    }
    EXPECT_EQ(images[0], images[1]);
    EXPECT_EQ(gradients[0], gradients[1]);
    std::vector<double> a(images[0].begin(), images[0].end()),
        b(images[2].begin(), images[2].end());
    EXPECT_LE(relativeError(a, b, 1e-9), 1e-6);
    a.assign(gradients[0].begin(), gradients[0].end());
    b.assign(gradients[2].begin(), gradients[2].end());
    EXPECT_LE(relativeError(a, b, 1e-9), 1e-5);
}

TEST(SoftSilhouette, RenumberedVerticesAndFacesGiveTheSamePicture) {
    Values inputs, renumbered;
    std::map<std::string, Value> integers, renumberedIntegers;
    sphere(20, inputs, integers);
    renumbered = inputs;
    renumberedIntegers = integers;
    auto vertices = size_t(inputs["verts"].shape[0]), faces = size_t(integers["faces"].shape[0]);
    std::vector<size_t> place(vertices), order(faces);
    std::iota(place.begin(), place.end(), size_t{0});
    std::iota(order.begin(), order.end(), size_t{0});
    std::shuffle(place.begin(), place.end(), std::mt19937(3));
    std::shuffle(order.begin(), order.end(), std::mt19937(4));
    for (size_t v = 0; v < vertices; ++v)
        std::copy_n(&inputs["verts"].data[v * 3], 3, &renumbered["verts"].data[place[v] * 3]);
    for (size_t f = 0; f < faces; ++f)
        for (size_t k = 0; k < 3; ++k)
            renumberedIntegers["faces"].data[f * 3 + k] =
                double(place[size_t(integers["faces"].data[order[f] * 3 + k])]);

    std::map<std::string, double> attributes = camera(64, 70);
    attributes["sigma"] = 1e-4;
    attributes["blur_radius"] = 9.21e-4;
    auto run = [&](const Values& in, const std::map<std::string, Value>& ints) {
        Npz arrays = arraysOf(in, ints, attributes);
        arrays.set("grad_silhouette", Array::f64({70, 64}, random({70, 64}).data));
        return runOp("soft_silhouette", arrays);
    };
    Npz a = run(inputs, integers), b = run(renumbered, renumberedIntegers);
    EXPECT_EQ(a.at("silhouette").toF32(), b.at("silhouette").toF32());
    std::vector<double> da = a.at("grad_verts").toF64(), db = b.at("grad_verts").toF64(),
                        back(da.size());
    for (size_t v = 0; v < vertices; ++v) std::copy_n(&db[place[v] * 3], 3, &back[v * 3]);
    EXPECT_LE(relativeError(back, da, 1e-9), 1e-5);
}

// The camera, sigma and the blur radius are an input that may change between replays.
TEST(SoftSilhouette, CameraChangesBetweenReplays) {
    Values inputs;
    std::map<std::string, Value> integers;
    sphere(10, inputs, integers);
    std::vector<int32_t> faces(integers["faces"].data.begin(), integers["faces"].data.end());
    std::vector<float> verts(inputs["verts"].data.begin(), inputs["verts"].data.end());
    Graph graph(testDevice());
    RasterMesh mesh = rasterMesh(graph, faces, inputs["verts"].shape[0]);
    Tensor vertices = graph.input(inputs["verts"].shape), view = graph.input(kCameraShape);
    Tensor silhouette = softSilhouette(graph, mesh, vertices, view, 33, 41);
    graph.output(silhouette);
    graph.compile();
    graph.write(vertices, verts);
    std::vector<float> previous;
    for (auto [fx, cx, sigma] :
         {std::tuple{61.0, 20.0, 1e-4}, {80.0, 22.5, 1e-4}, {80.0, 22.5, 1e-2}}) {
        double blur = 9.21 * sigma;
        graph.write(view, cameraValues({float(fx), float(fx), float(cx), 17, float(sigma),
                                        float(blur), 0, 0}));
        graph.run();
        std::vector<float> image = graph.read<float>(silhouette);
        EXPECT_NE(image, previous);
        Npz arrays = arraysOf(inputs, integers,
                              {{"fx", fx},
                               {"fy", fx},
                               {"cx", cx},
                               {"cy", 17},
                               {"width", 41},
                               {"height", 33},
                               {"sigma", sigma},
                               {"blur_radius", blur}});
        EXPECT_EQ(image, runOp("soft_silhouette", arrays).at("silhouette").toF32());
        previous = image;
    }
}

TEST(SoftSilhouette, NoFacesGiveAnEmptyPicture) {
    std::map<std::string, double> attributes = camera(9, 7);
    attributes["sigma"] = attributes["blur_radius"] = 1e-4;
    Npz arrays =
        arraysOf({{"verts", random({4, 3})}}, {{"faces", indices({0, 3}, {})}}, attributes);
    arrays.set("grad_silhouette", Array::f64({7, 9}, random({7, 9}).data));
    Npz out = runOp("soft_silhouette", arrays);
    EXPECT_EQ(out.at("silhouette").toF32(), std::vector<float>(63));
    EXPECT_EQ(out.at("grad_verts").toF32(), std::vector<float>(12));
}

TEST(SoftSilhouette, RefusesFacesOfOtherMeshes) {
    Values inputs{{"verts", random({4, 3})}};
    std::map<std::string, double> attributes = camera(8, 8);
    attributes["sigma"] = attributes["blur_radius"] = 1e-4;
    auto run = [&](std::vector<int> faces) {
        return [=] {
            runOp("soft_silhouette",
                  arraysOf(inputs, {{"faces", indices({1, 3}, faces)}}, attributes));
        };
    };
    expectInputError(run({0, 1, 4}), "faces: face 0: expected a vertex from 0 to 3, found 4");
    expectInputError(run({0, -1, 2}), "found -1");
    attributes["width"] = 0;
    expectInputError(run({0, 1, 2}), "attr_width: expected pixels from 1");
    attributes["width"] = 8;
    attributes["sigma"] = 0;
    expectInputError(run({0, 1, 2}), "attr_sigma: expected a positive number");
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
