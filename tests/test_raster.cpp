// The soft silhouette against a plain loop, and what any picture has to bear.
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "tests/raster_scene.h"

namespace doppel {
namespace {

using namespace test;

// ---- a plain loop in double precision -----------------------------------------------------------

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

}  // namespace
}  // namespace doppel
