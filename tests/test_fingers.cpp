#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "nn/body/fingers.h"
#include "nn/ops/body.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

const char* const kDefaultBody = DOPPEL_SOURCE_DIR "/assets/body/default.npz";
const char* const kFullBody = DOPPEL_SOURCE_DIR "/assets/body/default-full.npz";

BodyModel bodyOf(const char* file) { return bodyFromNpz(readNpz(file)); }

std::array<double, 3> at(const std::vector<float>& verts, size_t v) {
    return {verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]};
}

double distance(const std::array<double, 3>& a, const std::array<double, 3>& b) {
    return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

// The vertex that a finger moves whole and that is farthest from its knuckle.
size_t tipOf(const FingerRig& rig, const BodyModel& body, int finger) {
    const float* knuckle =
        &rig.turns[size_t(FingerRig::kTurnNumbers * (FingerRig::kTurns * finger + 2))];
    size_t found = 0;
    double farthest = 0;
    for (size_t v = 0; v + 1 < rig.begin.size(); ++v)
        for (int e = rig.begin[v]; e < rig.begin[v + 1]; ++e) {
            if (rig.fingers[size_t(e)] != finger || rig.entries[size_t(5 * e)] < 1) continue;
            const double far =
                distance(at(body.templateVertices, v), {knuckle[0], knuckle[1], knuckle[2]});
            if (far > farthest) farthest = far, found = v;
        }
    return found;
}

double degreesBetween(const std::array<double, 3>& a, const std::array<double, 3>& b) {
    const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    return std::acos(dot / (std::hypot(a[0], a[1], a[2]) * std::hypot(b[0], b[1], b[2]))) * 180 /
           M_PI;
}

std::array<double, 3> minus(const std::array<double, 3>& a, const std::array<double, 3>& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

TEST(Fingers, AreFoundOnBothBodies) {
    for (const char* file : {kDefaultBody, kFullBody}) {
        const BodyModel body = bodyOf(file);
        const FingerRig rig = fingerRig(body);
        ASSERT_FALSE(rig.empty()) << file;
        ASSERT_EQ(rig.amounts.size(), 40u);
        for (int finger = 0; finger < 10; ++finger) {
            const auto tip = at(body.templateVertices, tipOf(rig, body, finger));
            // Palms look down and thumbs ahead; fingers point away from the body.
            EXPECT_EQ(tip[0] > 0, finger < 5) << file << " finger " << finger;
            EXPECT_GT(std::abs(tip[0]), .7) << file << " finger " << finger;
            const auto thumb = at(body.templateVertices, tipOf(rig, body, finger < 5 ? 4 : 9));
            if (finger % 5 != 4) {
                EXPECT_GT(thumb[2], tip[2]) << file << " finger " << finger;
            }
        }
        // What is not of a hand stays.
        const std::vector<float> bent = bentFingers(rig, body.templateVertices, {1, 1, 1, 1});
        const std::vector<float> shares = handShares(body);
        for (size_t i = 0; i < bent.size(); ++i)
            if (shares[i / 3] < .5f) {
                ASSERT_EQ(bent[i], body.templateVertices[i]) << file;
            }
    }
}

TEST(Fingers, CurlTowardsThePalmAndCloseWithinIt) {
    const BodyModel body = bodyOf(kDefaultBody);
    const FingerRig rig = fingerRig(body);
    ASSERT_FALSE(rig.empty());
    const std::vector<float>& flat = body.templateVertices;
    EXPECT_EQ(bentFingers(rig, flat, {}), flat);
    const std::vector<float> curled = bentFingers(rig, flat, {1, 0, 1, 0});
    const std::vector<float> closed = bentFingers(rig, flat, {0, 1, 0, 1});
    const std::vector<float> left = bentFingers(rig, flat, {1, 1, 0, 0});
    std::map<int, double> spread;  // of neighbours' directions
    for (int finger = 0; finger < 10; ++finger) {
        const size_t tip = tipOf(rig, body, finger);
        const float* turn = &rig.turns[size_t(7 * 4 * finger)];
        const std::array<double, 3> last{turn[0], turn[1], turn[2]};
        EXPECT_LT(at(curled, tip)[1], at(flat, tip)[1] - .015) << finger;  // the palm looks down
        if (finger % 5 == 4) continue;
        // Bones keep their lengths: as far from the knuckle's pivot's line as before, within what a
        // chord is shorter than its arc.
        const std::array<double, 3> knuckle{turn[14], turn[15], turn[16]};
        const double before = distance(at(flat, tip), knuckle),
                     after = distance(at(curled, tip), knuckle);
        EXPECT_GT(after, .8 * before) << finger;
        EXPECT_LT(after, before) << finger;
        EXPECT_NEAR(distance(at(closed, tip), knuckle), before, 1e-4) << finger;
        EXPECT_NEAR(at(closed, tip)[1], at(flat, tip)[1], .012) << finger;
        EXPECT_LT(distance(last, knuckle), before);
    }
    for (const int hand : {0, 5}) {
        double widestFlat = 0, widestClosed = 0;
        for (int a = hand; a < hand + 4; ++a)
            for (int b = hand; b < a; ++b) {
                const auto knuckle = [&](int finger) {
                    const float* turn = &rig.turns[size_t(7 * (4 * finger + 2))];
                    return std::array<double, 3>{turn[0], turn[1], turn[2]};
                };
                const size_t ta = tipOf(rig, body, a), tb = tipOf(rig, body, b);
                widestFlat = std::max(widestFlat, degreesBetween(minus(at(flat, ta), knuckle(a)),
                                                                 minus(at(flat, tb), knuckle(b))));
                widestClosed =
                    std::max(widestClosed, degreesBetween(minus(at(closed, ta), knuckle(a)),
                                                          minus(at(closed, tb), knuckle(b))));
            }
        EXPECT_GT(widestFlat, 20);
        EXPECT_LT(widestClosed, .7 * widestFlat);
    }
    // Each hand has its own amounts.
    for (size_t v = 0; v < static_cast<size_t>(body.vertexCount); ++v)
        if (flat[3 * v] < 0) {
            ASSERT_EQ(at(left, v), at(flat, v));
        }
}

TEST(Fingers, FacesKeepTheirSide) {
    const BodyModel body = bodyOf(kDefaultBody);
    const std::vector<float>& flat = body.templateVertices;
    const std::vector<float> bent = bentFingers(fingerRig(body), flat, {1, 1, 1, 1});
    const auto normal = [&](const std::vector<float>& verts, size_t f) {
        const auto corner = [&](size_t k) { return at(verts, size_t(body.faces[3 * f + k])); };
        const auto u = minus(corner(1), corner(0)), w = minus(corner(2), corner(0));
        return std::array<double, 3>{u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2],
                                     u[0] * w[1] - u[1] * w[0]};
    };
    // Fingers turn by 65 degrees or so; what turns by twice that is folded, as skin is between a
    // thumb and a palm, of which each hand has some 700 faces.
    int folded = 0;
    for (size_t f = 0; f < static_cast<size_t>(body.faceCount); ++f)
        folded += degreesBetween(normal(flat, f), normal(bent, f)) > 130;
    EXPECT_LE(folded, 16);
}

TEST(Fingers, HandsWithoutFingersHaveNoRig) {
    BodyModel body = bodyOf(kDefaultBody);
    for (size_t v = 0; v < static_cast<size_t>(body.vertexCount); ++v)  // mittens
        if (std::abs(body.templateVertices[3 * v]) > .7f)
            body.templateVertices[3 * v] = std::copysign(.7f, body.templateVertices[3 * v]);
    EXPECT_TRUE(fingerRig(body).empty());
}

// Nails that are shells of their own, or vertices that no face has, as files of strangers may have.
TEST(Fingers, HandsOfSeveralPiecesHaveNoRig) {
    BodyModel body = bodyOf(kDefaultBody);
    const size_t tip = tipOf(fingerRig(body), body, 1);
    for (size_t f = 0; f < body.faces.size(); f += 3) {
        const auto face = std::span(body.faces).subspan(f, 3);
        if (std::ranges::find(face, static_cast<int32_t>(tip)) != face.end())
            std::ranges::fill(face, body.faces[0]);
    }
    EXPECT_TRUE(fingerRig(body).empty());
}

// Fingers and thumb on one line have no palm between them.
TEST(Fingers, HandsWithoutAPalmHaveNoRig) {
    BodyModel body = bodyOf(kDefaultBody);
    for (size_t i = 0; i < body.templateVertices.size(); ++i)
        if (i % 3 != 0) body.templateVertices[i] = 0;
    EXPECT_TRUE(fingerRig(body).empty());
}

// Three fingers over seven vertices, of which some have none, one or several.
TEST(BendFingers, MatchesTheFormula) {
    const std::vector<int> begin{0, 0, 1, 3, 4, 4, 7, 8}, fingers{0, 1, 2, 2, 0, 1, 2, 1};
    const std::vector<int> amounts{0, 0, 0, 1, 1, 2, 2, 0, 3, 3, 3, 2};
    for (const double scale : {0., .7, 2.}) {
        Value turns = random({3, 4, 7}, 3);
        for (size_t t = 0; t < 12; ++t) {
            double* axis = &turns.data[7 * t + 3];
            const double length = std::hypot(axis[0], axis[1], axis[2]);
            for (int c = 0; c < 3; ++c) axis[c] /= length;
        }
        Value amount = random({4}, 5);
        for (double& a : amount.data) a *= scale;
        checkOp("bend_fingers",
                {.inputs = {{"verts", random({7, 3}, 1)},
                            {"amounts", amount},
                            {"turns", turns},
                            {"entries", uniform({8, 5}, 0, 1, 7)}},
                 .integers = {{"turn_amounts", indices({3, 4}, amounts)},
                              {"begin", indices({8}, begin)},
                              {"fingers", indices({8}, fingers)}},
                 .reference = [](const Values& in) -> Values {
                     Value y = in.at("verts");
                     const auto &t = in.at("turns").data, &e = in.at("entries").data;
                     for (size_t v = 0; v < 7; ++v) {
                         std::array<double, 3> sum{};
                         for (auto i = size_t(in.at("begin").data[v]);
                              i < size_t(in.at("begin").data[v + 1]); ++i) {
                             std::array<double, 3> q{};
                             for (size_t c = 0; c < 3; ++c) q[c] = in.at("verts").data[3 * v + c];
                             for (size_t j = 0; j < 4; ++j) {
                                 const size_t n = 4 * size_t(in.at("fingers").data[i]) + j;
                                 const double* turn = &t[7 * n];
                                 const double angle =
                                     turn[6] * e[5 * i + 1 + j] *
                                     in.at("amounts").data[size_t(in.at("turn_amounts").data[n])];
                                 // By quaternions, which the shader does not use.
                                 const double w = std::cos(angle / 2), s = std::sin(angle / 2);
                                 const double x = s * turn[3], yq = s * turn[4], z = s * turn[5];
                                 double r[3];
                                 for (size_t c = 0; c < 3; ++c) r[c] = q[c] - turn[c];
                                 q = {turn[0] + (1 - 2 * (yq * yq + z * z)) * r[0] +
                                          2 * (x * yq - w * z) * r[1] + 2 * (x * z + w * yq) * r[2],
                                      turn[1] + 2 * (x * yq + w * z) * r[0] +
                                          (1 - 2 * (x * x + z * z)) * r[1] +
                                          2 * (yq * z - w * x) * r[2],
                                      turn[2] + 2 * (x * z - w * yq) * r[0] +
                                          2 * (yq * z + w * x) * r[1] +
                                          (1 - 2 * (x * x + yq * yq)) * r[2]};
                             }
                             for (size_t c = 0; c < 3; ++c)
                                 sum[c] += e[5 * i] * (q[c] - in.at("verts").data[3 * v + c]);
                         }
                         for (size_t c = 0; c < 3; ++c) y.data[3 * v + c] += sum[c];
                     }
                     return {{"y", y}};
                 }});
    }
}

// The host's, which offsets are kept by, and the device's, which they are learned by.
TEST(BendFingers, IsWhatTheHostComputes) {
    const BodyModel body = bodyOf(kDefaultBody);
    const FingerRig rig = fingerRig(body);
    const HandAmounts amounts{.9f, .4f, -.2f, 1.2f};
    Graph graph(testDevice());
    Tensor verts = graph.constant(body.templateVertices, {body.vertexCount, 3});
    Tensor bent = bendFingers(graph, verts, graph.constant(std::span<const float>(amounts), {4}),
                              fingerTensors(graph, rig));
    graph.output(bent);
    graph.compile({.reuseMemory = false, .poison = true});
    graph.run();
    const std::vector<float> device = graph.read<float>(bent),
                             host = bentFingers(rig, body.templateVertices, amounts);
    double moved = 0;
    for (size_t i = 0; i < host.size(); ++i) {
        ASSERT_NEAR(device[i], host[i], 2e-6);
        moved = std::max(moved, std::abs(double{host[i]} - double{body.templateVertices[i]}));
    }
    EXPECT_GT(moved, .04);
}

TEST(BendFingers, RefusesWhatDoesNotFit) {
    const Op* op = Op::find("bend_fingers");
    ASSERT_NE(op, nullptr);
    const auto run = [&](std::vector<int32_t> begin, int32_t finger, int32_t amount) {
        Npz arrays;
        arrays.set("verts", Array::f64({2, 3}, std::vector<double>(6)));
        arrays.set("amounts", Array::f64({4}, std::vector<double>(4)));
        arrays.set("turns", Array::f64({1, 4, 7}, std::vector<double>(28)));
        arrays.set("entries", Array::f64({1, 5}, std::vector<double>(5)));
        arrays.set("turn_amounts", Array::i32({1, 4}, std::vector<int32_t>{0, 1, 2, amount}));
        arrays.set("begin", Array::i32({static_cast<int64_t>(begin.size())}, begin));
        arrays.set("fingers", Array::i32({1}, std::vector<int32_t>{finger}));
        op->run(testDevice(), arrays, {});
    };
    run({0, 1, 1}, 0, 3);
    expectInputError([&] { run({0, 1}, 0, 0); }, "begin: expected 3 numbers that rise from 0 to 1");
    expectInputError([&] { run({0, 2, 1}, 0, 0); }, "begin has 2; expected 0 to 1");
    expectInputError([&] { run({0, 1, 1}, 1, 0); }, "fingers has 1; expected 0 to 0");
    expectInputError([&] { run({0, 1, 1}, 0, 4); }, "turn_amounts has 4; expected 0 to 3");
}

}  // namespace
}  // namespace doppel
