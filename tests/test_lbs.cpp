// Skinning and rigid motion against plain double-precision functions; laws of posing.
#include <cmath>

#include "body/params.h"
#include "nn/ops/body.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

using Matrix = std::array<double, 9>;  // by rows

Matrix rotationOf(const double* w) {
    double t2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], t = std::sqrt(t2);
    double a = t > 1e-6 ? std::sin(t) / t : 1 - t2 / 6;
    double b = t > 1e-4 ? (1 - std::cos(t)) / t2 : 0.5 - t2 / 24;
    Matrix r{std::cos(t), -a * w[2], a * w[1], a * w[2],   std::cos(t),
             -a * w[0],   -a * w[1], a * w[0], std::cos(t)};
    for (size_t i = 0; i < 3; ++i)
        for (size_t k = 0; k < 3; ++k) r[3 * i + k] += b * w[i] * w[k];
    return r;
}

std::array<double, 3> multiply(const Matrix& m, const double* v) {
    std::array<double, 3> y{};
    for (size_t i = 0; i < 3; ++i)
        for (size_t k = 0; k < 3; ++k) y[i] += m[3 * i + k] * v[k];
    return y;
}

// SMPL's formulas.
Values lbsReference(const Values& in) {
    const auto& shape = in.at("shapedirs").data;
    size_t vertices = in.at("template").data.size() / 3;
    std::vector<double> shaped = in.at("template").data;
    for (size_t i = 0; i < shaped.size(); ++i)
        for (size_t k = 0; k < 10; ++k) shaped[i] += shape[10 * i + k] * in.at("beta").data[k];
    std::vector<double> rest(72);
    for (size_t j = 0; j < 24; ++j)
        for (size_t v = 0; v < vertices; ++v)
            for (size_t c = 0; c < 3; ++c)
                rest[3 * j + c] +=
                    in.at("joint_regressor").data[j * vertices + v] * shaped[3 * v + c];
    std::vector<Matrix> local(24), world(24);
    std::vector<std::array<double, 3>> origin(24);
    std::vector<double> features;
    for (size_t j = 0; j < 24; ++j) {
        local[j] = rotationOf(&in.at("theta").data[3 * j]);
        if (j == 0) {
            world[j] = local[j];
            origin[j] = {rest[0], rest[1], rest[2]};
            continue;
        }
        auto p = static_cast<size_t>(in.at("parents").data[j]);
        for (size_t i = 0; i < 9; ++i) features.push_back(local[j][i] - (i % 4 == 0 ? 1 : 0));
        for (size_t i = 0; i < 3; ++i)
            for (size_t k = 0; k < 3; ++k) {
                world[j][3 * i + k] = 0;
                for (size_t n = 0; n < 3; ++n)
                    world[j][3 * i + k] += world[p][3 * i + n] * local[j][3 * n + k];
            }
        double bone[3] = {rest[3 * j] - rest[3 * p], rest[3 * j + 1] - rest[3 * p + 1],
                          rest[3 * j + 2] - rest[3 * p + 2]};
        origin[j] = multiply(world[p], bone);
        for (size_t c = 0; c < 3; ++c) origin[j][c] += origin[p][c];
    }
    std::vector<double> posed = shaped;
    if (in.contains("posedirs"))
        for (size_t i = 0; i < posed.size(); ++i)
            for (size_t k = 0; k < 207; ++k)
                posed[i] += in.at("posedirs").data[207 * i + k] * features[k];
    const auto& trans = in.at("trans").data;
    Value verts{in.at("template").shape, std::vector<double>(posed.size())};
    for (size_t v = 0; v < vertices; ++v) {
        for (size_t j = 0; j < 24; ++j) {
            double relative[3];
            for (size_t c = 0; c < 3; ++c) relative[c] = posed[3 * v + c] - rest[3 * j + c];
            auto turned = multiply(world[j], relative);
            for (size_t c = 0; c < 3; ++c)
                verts.data[3 * v + c] +=
                    in.at("weights").data[24 * v + j] * (turned[c] + origin[j][c]);
        }
        for (size_t c = 0; c < 3; ++c) verts.data[3 * v + c] += trans[c];
    }
    Value joints{{24, 3}, {}};
    for (size_t j = 0; j < 24; ++j)
        for (size_t c = 0; c < 3; ++c) joints.data.push_back(origin[j][c] + trans[c]);
    return {{"verts", verts}, {"joints", joints}};
}

Value scaled(Value value, double factor) {
    for (double& x : value.data) x *= factor;
    return value;
}

// Rows that sum to one, most of them with zeros in between, as real weights have them.
Value weightRows(int64_t rows, int64_t columns, uint32_t seed) {
    Value value = uniform({rows, columns}, -0.5, 1, seed);
    for (size_t r = 0; r < size_t(rows); ++r) {
        double* row = &value.data[r * size_t(columns)];
        row[r % size_t(columns)] += 1;
        double sum = 0;
        for (int64_t c = 0; c < columns; ++c) sum += row[c] = std::max(row[c], 0.0);
        for (int64_t c = 0; c < columns; ++c) row[c] /= sum;
    }
    return value;
}

const std::vector<int> kSmplParents = {-1, 0, 0, 0,  1,  2,  3,  4,  5,  6,  7,  8,
                                       9,  9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21};

OpCase lbsCase(int64_t vertices, double angle) {
    return {.inputs = {{"template", random({vertices, 3}, 1)},
                       {"shapedirs", scaled(random({vertices, 3, 10}, 2), 0.1)},
                       {"weights", weightRows(vertices, 24, 3)},
                       {"joint_regressor", weightRows(24, vertices, 4)},
                       {"theta", scaled(random({72}, 5), angle)},
                       {"beta", random({10}, 6)},
                       {"trans", random({3}, 7)}},
            .integers = {{"parents", indices({24}, kSmplParents)}},
            .reference = lbsReference,
            .floor = 1e-3};  // one vertex carries all joints: theta's gradient is exactly zero
}

TEST(Lbs, MatchesTheFormulas) {
    for (int64_t vertices : {13, 127, 300}) checkOp("lbs", lbsCase(vertices, 0.8));
    for (int64_t vertices : edgeSizes(kBodyChunk)) checkOp("lbs", lbsCase(vertices, 0.8));
}

TEST(Lbs, SmallAndLargeAngles) {
    // Zero is where the formulas' quotients are 0/0; pi and beyond is where global orientations
    // are.
    for (double angle : {0.0, 1e-4, 0.3, 3.0, 7.0}) checkOp("lbs", lbsCase(13, angle));
}

TEST(Lbs, PoseBlendShapes) {
    for (int64_t vertices : edgeSizes(kBodyChunk)) {
        OpCase testCase = lbsCase(vertices, 0.5);
        testCase.inputs["posedirs"] = scaled(random({vertices, 3, 207}, 8), 0.05);
        checkOp("lbs", testCase);
    }
}

TEST(Lbs, AnyTreeInOrder) {
    OpCase chain = lbsCase(13, 0.4), star = lbsCase(13, 0.4);
    for (int j = 0; j < 24; ++j) {
        chain.integers["parents"].data[size_t(j)] = j - 1;
        star.integers["parents"].data[size_t(j)] = j == 0 ? -1 : 0;
    }
    checkOp("lbs", chain);
    checkOp("lbs", star);
}

TEST(Lbs, RefusesWhatIsNoTree) {
    const Op* op = Op::find("lbs");
    ASSERT_NE(op, nullptr);
    auto run = [&](int joint, int parent) {
        OpCase testCase = lbsCase(3, 0.1);
        Npz arrays;
        for (const auto& [name, value] : testCase.inputs)
            arrays.set(name, Array::f64(value.shape, value.data));
        std::vector<int32_t> parents(kSmplParents.begin(), kSmplParents.end());
        parents[size_t(joint)] = parent;
        arrays.set("parents", Array::i32({24}, parents));
        op->run(testDevice(), arrays, {});
    };
    expectInputError([&] { run(5, 5); }, "lbs: parents: joint 5 has the parent 5; expected 0 to 4");
    expectInputError([&] { run(7, -1); }, "joint 7 has the parent -1");
    expectInputError([&] { run(0, 0); }, "joint 0 has the parent 0; expected -1");
    expectInputError([&] { run(3, 24); }, "joint 3 has the parent 24");
}

TEST(RigidTransform, MatchesTheFormula) {
    std::vector<int64_t> sizes = edgeSizes(kBodyChunk);
    sizes.insert(sizes.end(), {13, 127, 10000});
    for (int64_t vertices : sizes)
        for (double angle : {0.0, 0.2, 2.0})
            checkOp("rigid_transform",
                    {.inputs = {{"verts", random({vertices, 3}, 1)},
                                {"rotation", scaled(random({3}, 2), angle)},
                                {"pivot", random({3}, 3)},
                                {"trans", random({3}, 4)}},
                     .reference = [](const Values& in) -> Values {
                         Matrix r = rotationOf(in.at("rotation").data.data());
                         Value y = in.at("verts");
                         for (size_t v = 0; v < y.data.size(); v += 3) {
                             double relative[3];
                             for (size_t c = 0; c < 3; ++c)
                                 relative[c] = y.data[v + c] - in.at("pivot").data[c];
                             auto turned = multiply(r, relative);
                             for (size_t c = 0; c < 3; ++c)
                                 y.data[v + c] =
                                     turned[c] + in.at("pivot").data[c] + in.at("trans").data[c];
                         }
                         return {{"y", y}};
                     },
                     .floor = 1e-3,  // the pivot's gradient is zero without rotation
                     .differenceStep = 1e-4});
}

}  // namespace
}  // namespace doppel
