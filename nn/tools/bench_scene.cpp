#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <random>

#include "nn/core/initialise.h"
#include "nn/ops/body.h"
#include "nn/ops/raster.h"
#include "nn/tools/bench.h"

extern "C" {
extern const uint8_t doppel_bench_body[], doppel_bench_body_end[];
}

namespace doppel::bench {

namespace {

constexpr double kPi = 3.141592653589793;

}  // namespace

const BodyModel& defaultBody() {
    static const BodyModel body = bodyFromNpz(npzFromBytes(
        {doppel_bench_body, static_cast<size_t>(doppel_bench_body_end - doppel_bench_body)},
        "the embedded body"));
    return body;
}

BodyModel ballBody(int64_t vertices) {
    // Rings from pole to pole, twice as many vertices around as rings.
    int64_t rings = std::max<int64_t>(3, std::llround(std::sqrt(double(vertices) / 2)));
    int64_t around = 2 * rings, V = rings * around + 2;
    std::vector<float> verts, uvs;
    std::vector<float> weights(size_t(V) * joint::kCount), regressor(size_t(V) * joint::kCount);
    std::vector<int32_t> faces, uvFaces, parents{-1};
    auto point = [&](double latitude, double longitude) {
        verts.push_back(float(.25 * std::sin(latitude) * std::sin(longitude)));
        verts.push_back(float(.85 * std::cos(latitude)));
        verts.push_back(float(.2 * std::sin(latitude) * std::cos(longitude)));
    };
    for (int64_t r = 0; r < rings; ++r)
        for (int64_t a = 0; a < around; ++a)
            point(kPi * double(r + 1) / double(rings + 1), 2 * kPi * double(a) / double(around));
    point(0, 0);
    point(kPi, 0);
    auto at = [&](int64_t r, int64_t a) {
        return int32_t(r < 0 ? V - 2 : r == rings ? V - 1 : r * around + a % around);
    };
    // The atlas: latitude and longitude; the seam and the poles have UVs of their own.
    auto uvAt = [&](int64_t r, int64_t a) { return int32_t((r + 1) * (around + 1) + a); };
    for (int64_t r = -1; r <= rings; ++r)
        for (int64_t a = 0; a <= around; ++a) {
            uvs.push_back(float(double(a) / double(around)));
            uvs.push_back(float(double(r + 1) / double(rings + 1)));
        }
    auto face = [&](std::array<std::array<int64_t, 2>, 3> corners) {
        for (auto [r, a] : corners) {
            faces.push_back(at(r, a));
            uvFaces.push_back(uvAt(r, a));
        }
    };
    for (int64_t a = 0; a < around; ++a) {
        face({{{-1, a}, {0, a}, {0, a + 1}}});
        face({{{rings, a}, {rings - 1, a + 1}, {rings - 1, a}}});
        for (int64_t r = 0; r + 1 < rings; ++r) {
            face({{{r, a}, {r + 1, a}, {r + 1, a + 1}}});
            face({{{r, a}, {r + 1, a + 1}, {r, a + 1}}});
        }
    }
    // Joints along the body; a vertex follows the two next to it.
    for (int32_t j = 1; j < kJointCount; ++j) parents.push_back(j - 1);
    std::vector<double> ofJoint(joint::kCount);
    for (int64_t v = 0; v < V; ++v) {
        double along = std::clamp((.85 - double(verts[size_t(3 * v + 1)])) / 1.7, 0.0, 1.0) *
                       double(kJointCount - 1);
        auto j = std::min<size_t>(size_t(along), joint::kCount - 2);
        weights[size_t(v) * joint::kCount + j] = float(1 - (along - double(j)));
        weights[size_t(v) * joint::kCount + j + 1] = 1 - weights[size_t(v) * joint::kCount + j];
        ofJoint[size_t(std::lround(along))] += 1;
    }
    for (int64_t v = 0; v < V; ++v) {
        double along = std::clamp((.85 - double(verts[size_t(3 * v + 1)])) / 1.7, 0.0, 1.0) *
                       double(kJointCount - 1);
        auto j = size_t(std::lround(along));
        regressor[j * size_t(V) + size_t(v)] = float(1 / ofJoint[j]);
    }
    for (size_t j = 0; j < joint::kCount; ++j)
        if (ofJoint[j] == 0) regressor[j * size_t(V)] = 1;
    std::vector<int32_t> tree(2 * joint::kCount);
    std::copy(parents.begin(), parents.end(), tree.begin());
    for (int32_t j = 0; j < kJointCount; ++j) tree[joint::kCount + size_t(j)] = j;
    int64_t F = int64_t(faces.size()) / 3;
    Npz arrays;
    arrays.file = "a ball";
    arrays.set("v_template", Array::f32({V, 3}, verts));
    arrays.set("f", Array::i32({F, 3}, faces));
    arrays.set("shapedirs", Array::f32({V, 3, 10}, randomValues(V * 30, 3, -.01f, .01f)));
    arrays.set("weights", Array::f32({V, kJointCount}, weights));
    arrays.set("J_regressor", Array::f32({kJointCount, V}, regressor));
    arrays.set("kintree_table", Array::i32({2, kJointCount}, tree));
    arrays.set("vt", Array::f32({int64_t(uvs.size()) / 2, 2}, uvs));
    arrays.set("ft", Array::i32({F, 3}, uvFaces));
    return bodyFromNpz(arrays);
}

std::vector<float> randomValues(int64_t count, uint32_t seed, float low, float high) {
    std::vector<float> values(static_cast<size_t>(count));
    uint64_t state = seed;
    for (float& value : values) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        value = low + (high - low) * static_cast<float>(state >> 40) * 0x1p-24f;
    }
    return values;
}

std::vector<float> standingTheta() {
    std::vector<float> theta(kThetaSize);
    theta[0] = float(kPi);                     // y up to y down
    theta[3 * joint::kLeftShoulder + 2] = -1;  // the arms
    theta[3 * joint::kRightShoulder + 2] = 1;
    return theta;
}

std::vector<float> standingTrans() { return {0, .2f, 3}; }

std::vector<float> standingCamera(int64_t size, double sigma, double blurRadius) {
    auto side = static_cast<float>(size);
    return cameraValues({1.55f * side, 1.55f * side, side / 2, side / 2, static_cast<float>(sigma),
                         static_cast<float>(blurRadius), 0, 0});
}

std::vector<float> standingVerts(const BodyModel& body) {
    Graph graph(device());
    auto values = [&](const std::vector<float>& v) {
        return graph.constant(std::span<const float>(v), {static_cast<int64_t>(v.size())});
    };
    PosedBody posed =
        lbs(graph, lbsModel(graph, body),
            graph.constant(std::span<const float>(body.templateVertices), {body.vertexCount, 3}),
            values(standingTheta()), values(std::vector<float>(10)), values(standingTrans()));
    graph.output(posed.verts);
    graph.compile();
    graph.run();
    return graph.read<float>(posed.verts);
}

}  // namespace doppel::bench
