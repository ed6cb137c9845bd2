// The body model: the default one, files in SMPL's own form, hostile files, the atlas.
#include "nn/body/body.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numeric>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "nn/body/body_atlas.h"
#include "nn/body/face_views.h"
#include "nn/ops/body.h"
#include "tests/files.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

const std::string kDefaultBody = test::sourceFolder() / "assets/body/default.npz";

const std::vector<int64_t> kTree = {
    0xffffffff, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7,  8,  9,  9,  9,  12, 13, 14, 16, 17, 18, 19, 20, 21,
    0,          1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23};

// A box with the joints spread over its corners: the smallest file that is a body.
Npz tinyBody() {
    std::vector<float> vertices, weights(8 * 24), regressor(24 * 8), shapes(8 * 3 * 10, 0.01f);
    for (size_t v = 0; v < 8; ++v) {
        for (size_t axis = 0; axis < 3; ++axis) vertices.push_back((v >> axis) & 1 ? 0.5f : -0.5f);
        weights[v * 24 + v] = 0.75f;
        weights[v * 24 + 15] += 0.25f;
    }
    for (size_t j = 0; j < 24; ++j) regressor[j * 8 + j % 8] = 1;
    std::vector<int32_t> faces = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                  2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
    Npz body;
    body.file = "box.npz";
    body.set("v_template", Array::f32({8, 3}, vertices));
    body.set("f", Array::i32({12, 3}, faces));
    body.set("shapedirs", Array::f32({8, 3, 10}, shapes));
    body.set("weights", Array::f32({8, 24}, weights));
    body.set("J_regressor", Array::f32({24, 8}, regressor));
    body.set("kintree_table", Array::i64({2, 24}, kTree));
    return body;
}

Array floats(const Array& like, const std::function<void(std::vector<float>&)>& change) {
    std::vector<float> values = like.toF32();
    change(values);
    return Array::f32(like.shape, values);
}
Array integers(const Array& like, const std::function<void(std::vector<int64_t>&)>& change) {
    std::vector<int64_t> values = like.toI64();
    change(values);
    return Array::i64(like.shape, values);
}

TEST(Body, ReadsTheSmallestFile) {
    BodyModel body = bodyFromNpz(tinyBody());
    EXPECT_EQ(body.vertexCount, 8);
    EXPECT_EQ(body.faceCount, 12);
    EXPECT_EQ(body.parents[0], -1);
    EXPECT_EQ(body.parents[23], 21);
    EXPECT_TRUE(body.poseDirections.empty());
    EXPECT_EQ(body.part[1], kLeftThigh);
    EXPECT_EQ(body.part[4], kLeftCalf);
    EXPECT_EQ(body.uvFaces.size(), body.faces.size());
    // The root's parent also comes as -1, the weights as doubles.
    Npz arrays = tinyBody();
    arrays.set("kintree_table", integers(arrays.at("kintree_table"), [](auto& t) { t[0] = -1; }));
    arrays.set("weights", Array::f64({8, 24}, arrays.at("weights").toF64()));
    EXPECT_EQ(bodyFromNpz(arrays).parents, body.parents);
}

TEST(Body, RefusesWhatIsWrong) {
    auto refuse = [](const std::string& name, const Array& array, const std::string& words) {
        SCOPED_TRACE(name);
        Npz arrays = tinyBody();
        arrays.set(name, array);
        expectInputError([&] { bodyFromNpz(arrays); }, words);
    };
    Npz good = tinyBody();
    auto numbers = [&](const char* name, size_t place, float value) {
        return floats(good.at(name), [&](auto& v) { v[place] = value; });
    };
    auto ints = [&](const char* name, size_t place, int64_t value) {
        return integers(good.at(name), [&](auto& v) { v[place] = value; });
    };
    std::vector<float> many(8 * 300);
    auto zeros = [&](std::vector<int64_t> shape) {
        auto n = static_cast<size_t>(elementCount(shape));
        return Array::f32(shape, std::span(many).first(n));
    };
    refuse("v_template", zeros({8, 4}), "box.npz: v_template: expected shape");
    refuse("v_template", zeros({0, 3}), "box.npz: v_template: expected 3 to 1000000 vertices");
    refuse("v_template", numbers("v_template", 5, NAN), "v_template: element 5 is nan");
    refuse("v_template", numbers("v_template", 5, 170), "expected metres");
    refuse("v_template", Array::text("hello"), "box.npz: v_template");
    refuse("f", ints("f", 7, 8), "box.npz: f: element 7 is 8; expected 0 to 7");
    refuse("f", ints("f", 7, -1), "f: element 7 is -1");
    refuse("f", ints("f", 0, 2), "face 0 names a vertex twice");
    refuse("f", Array::i32({0, 3}, {}), "f: expected 1 to 2000000 faces, found 0");
    refuse("f", zeros({12, 3}), "box.npz: f");
    refuse("shapedirs", zeros({8, 3, 9}), "shapedirs: expected shape [8, 3, 10] or more than 10");
    refuse("shapedirs", zeros({7, 3, 10}), "found [7, 3, 10]");
    refuse("shapedirs", numbers("shapedirs", 3, INFINITY), "shapedirs: element 3 is inf");
    refuse("weights", zeros({8, 52}), "box.npz: weights: expected shape");
    refuse("weights", numbers("weights", 0, 0.5f), "weights: row 0 sums to 0.75; expected 1");
    refuse("weights", numbers("weights", 1, -0.5f), "weights: row 0 has the weight -0.5");
    refuse("J_regressor", zeros({24, 8}), "J_regressor: row 0 sums to 0; expected 1");
    refuse("J_regressor", zeros({8, 24}), "J_regressor: expected shape");
    refuse("kintree_table", ints("kintree_table", 4, 4), "joint 4 has the parent 4");
    refuse("kintree_table", ints("kintree_table", 4, 1LL << 40), "joint 4 has the parent 1099511");
    refuse("kintree_table", ints("kintree_table", 0, 3), "joint 0 has the parent 3; expected -1");
    refuse("kintree_table", ints("kintree_table", 30, 7), "kintree_table: row 1 has 7 at place 6");
    refuse("posedirs", zeros({8, 3, 93}), "posedirs: expected shape");
    refuse("offsets", zeros({7, 3}), "offsets: expected shape [8, 3]");
    refuse("offsets", floats(zeros({8, 3}), [](auto& v) { v[4] = NAN; }), "offsets: element 4 is");
    refuse("offsets", floats(zeros({8, 3}), [](auto& v) { v[4] = -11; }), "an offset of -11");
    refuse("part", Array::i32({8}, std::vector<int32_t>(8, 15)), "part: element 0 is 15");
    refuse("face_mask", Array::i32({7}, std::vector<int32_t>(7, 1)), "face_mask: expected shape");
    refuse("sole_mask", Array::i32({8}, std::vector<int32_t>(8, 2)), "sole_mask: element 0 is 2");
    refuse("face_points", Array::i32({468, 3}, std::vector<int32_t>(1404)),
           "box.npz: face_point_weights is missing");
    refuse("face_points", Array::i32({468, 3}, std::vector<int32_t>(1404, 8)),
           "face_points: element 0 is 8; expected 0 to 7");
    refuse("face_points", Array::i32({25, 3}, std::vector<int32_t>(75)),
           "face_points: expected shape [468, 3]");
    refuse("vt", zeros({9, 2}), "box.npz: ft is missing");
    refuse("ft", Array::i32({12, 3}, std::vector<int32_t>(36)), "box.npz: vt is missing");
    for (const char* name :
         {"v_template", "f", "shapedirs", "weights", "J_regressor", "kintree_table"}) {
        Npz arrays;
        arrays.file = "box.npz";
        for (const auto& [key, array] : good)
            if (key != name) arrays.set(key, array);
        expectInputError([&] { bodyFromNpz(arrays); },
                         fmt::format("box.npz: {} is missing; a body model has", name));
    }
    Npz arrays = tinyBody();
    arrays.set("vt", floats(zeros({4, 2}), [](auto& v) { v[3] = 1.5f; }));
    arrays.set("ft", Array::i32({12, 3}, std::vector<int32_t>(36)));
    expectInputError([&] { bodyFromNpz(arrays); }, "vt: row 1 has 1.5; expected 0 to 1");
    arrays.set("vt", zeros({4, 2}));
    arrays.set("ft", Array::i32({12, 3}, std::vector<int32_t>(36, 4)));
    expectInputError([&] { bodyFromNpz(arrays); }, "ft: element 0 is 4; expected 0 to 3");
    arrays.set("ft", Array::i32({11, 3}, std::vector<int32_t>(33)));
    expectInputError([&] { bodyFromNpz(arrays); }, "ft: expected shape");
}

TEST(Body, DefaultBodyIsWhole) {
    BodyModel body = bodyFromNpz(readNpz(kDefaultBody));
    EXPECT_GT(body.vertexCount, 6000);
    std::vector<int> parts(kBodyPartEnd);
    for (uint8_t p : body.part) ++parts[p];
    EXPECT_EQ(parts[0], 0);
    for (size_t p = kHead; p < kBodyPartEnd; ++p) EXPECT_GT(parts[p], 50) << "part " << p;
    EXPECT_GT(std::accumulate(body.face.begin(), body.face.end(), 0), 300);
    EXPECT_GT(std::accumulate(body.sole.begin(), body.sole.end(), 0), 50);
    std::vector<double> joints = restJoints(body, std::vector<double>(10));
    EXPECT_GT(joints[3 * 15 + 1], joints[1] + 0.4) << "the head is above the pelvis";
    EXPECT_GT(joints[3 * 20], 0.5) << "the left wrist is on the body's left";
}

TEST(Body, ClampBoundsAreTheTable) {
    BodyModel body = bodyFromNpz(readNpz(kDefaultBody));
    std::vector<float> paper = clampBounds(body, ClampBounds::Paper);
    std::vector<float> program = clampBounds(body, ClampBounds::Program);
    for (float bound : clampBounds(body, ClampBounds::None)) EXPECT_EQ(bound, 1);
    for (size_t v = 0; v < paper.size(); ++v) {
        uint8_t part = body.part[v];
        bool frozen = body.face[v] || body.sole[v] || part == kLeftHand || part == kRightHand;
        ASSERT_EQ(paper[v] == 0, frozen) << v;
        ASSERT_EQ(program[v] == 0, frozen) << v;
        if (frozen) continue;
        const std::map<int, std::pair<float, float>> table = {
            {kTorso, {0.06f, 0.06f}},        {kHead, {0.04f, 0.04f}},
            {kLeftUpperArm, {0.02f, 0.04f}}, {kRightForearm, {0.04f, 0.02f}},
            {kRightThigh, {0.04f, 0.04f}},   {kLeftCalf, {0.03f, 0.03f}},
            {kRightFoot, {0.02f, 0.02f}},
        };
        auto row = table.find(part);
        if (row == table.end()) continue;
        ASSERT_EQ(paper[v], row->second.first) << int(part);
        ASSERT_EQ(program[v], row->second.second) << int(part);
    }
}

// Poses a body with the compact form that stages use.
std::pair<std::vector<float>, std::vector<float>> pose(const BodyModel& body,
                                                       const std::vector<float>& theta,
                                                       const std::vector<float>& beta,
                                                       const std::vector<float>& trans) {
    Graph graph(testDevice());
    Tensor t = graph.input({72}), b = graph.input({10}), move = graph.input({3});
    PosedBody posed = lbs(graph, lbsModel(graph, body),
                          graph.constant(body.templateVertices, {body.vertexCount, 3}), t, b, move);
    graph.output(posed.verts);
    graph.output(posed.joints);
    graph.compile({.reuseMemory = false, .poison = true});
    graph.write(t, theta);
    graph.write(b, beta);
    graph.write(move, trans);
    graph.run();
    return {graph.read<float>(posed.verts), graph.read<float>(posed.joints)};
}

std::vector<float> toFloat(const std::vector<double>& values) {
    return {values.begin(), values.end()};
}

TEST(Body, FacesAreStiffWhereAsked) {
    const BodyModel body = bodyFromNpz(readNpz(kDefaultBody));
    const std::vector<float> shares = faceShares(body), stiffness = surfaceStiffness(body, 1, 1000);
    size_t on = 0, around = 0;
    for (size_t v = 0; v < shares.size(); ++v) {
        if (body.face[v]) {
            EXPECT_EQ(shares[v], 1) << v;
            EXPECT_FLOAT_EQ(stiffness[v], 1000) << v;
            ++on;
        } else {
            EXPECT_LT(shares[v], 1) << v;
            around += shares[v] > 0;
        }
    }
    EXPECT_GT(on, 100u);
    EXPECT_GT(around, on / 4);
    EXPECT_LT(around, 3 * on);
    // No step from one vertex to the next is more than a ring's.
    for (size_t f = 0; f < body.faces.size(); f += 3)
        for (size_t k = 0; k < 3; ++k)
            EXPECT_LE(std::abs(shares[size_t(body.faces[f + k])] -
                               shares[size_t(body.faces[f + (k + 1) % 3])]),
                      .21f);
}

TEST(Body, FingersAreStiffAndHeadsAreNot) {
    const BodyModel body = bodyFromNpz(readNpz(kDefaultBody));
    const std::vector<float> stiffness = surfaceStiffness(body, 1000, 1);
    ASSERT_EQ(stiffness.size(), static_cast<size_t>(body.vertexCount));
    const auto farthest = [&](size_t axis, float side) {
        size_t found = 0;
        for (size_t v = 0; v < stiffness.size(); ++v)
            if (side * body.templateVertices[3 * v + axis] >
                side * body.templateVertices[3 * found + axis])
                found = v;
        return found;
    };
    for (float side : {-1.f, 1.f}) EXPECT_NEAR(stiffness[farthest(0, side)], 1000, 1);
    for (float side : {-1.f, 1.f}) EXPECT_EQ(stiffness[farthest(1, side)], 1);  // sole, crown
    EXPECT_GE(*std::ranges::min_element(stiffness), 1);
    EXPECT_EQ(surfaceStiffness(body, 1, 1), std::vector<float>(stiffness.size(), 1));
}

// By which it is told who paints a place: of the default body, unposed, which looks along +z.
TEST(Body, OneViewSeesTheMiddleOfAFaceBest) {
    const BodyModel body = bodyFromNpz(readNpz(kDefaultBody));
    std::vector<glm::dvec3> verts, normals(static_cast<size_t>(body.vertexCount));
    for (size_t v = 0; v < normals.size(); ++v)
        verts.push_back({body.templateVertices[3 * v], body.templateVertices[3 * v + 1],
                         body.templateVertices[3 * v + 2]});
    for (size_t f = 0; f < body.faces.size(); f += 3) {
        const auto a = static_cast<size_t>(body.faces[f]),
                   b = static_cast<size_t>(body.faces[f + 1]),
                   c = static_cast<size_t>(body.faces[f + 2]);
        const glm::dvec3 normal = glm::cross(verts[b] - verts[a], verts[c] - verts[a]);
        for (const size_t v : {a, b, c}) normals[v] += normal;
    }
    for (glm::dvec3& normal : normals) normal = glm::normalize(normal);
    const auto looks = [&](double middle) {
        const SparseMatrix rows = viewNormals(body, middle);
        EXPECT_EQ(rows.rows(), body.vertexCount);
        std::vector<glm::dvec3> found;
        for (size_t v = 0; v < normals.size(); ++v) {
            glm::dvec3 normal(0);
            double sum = 0;
            for (auto k = static_cast<size_t>(rows.begin[v]); k < size_t(rows.begin[v + 1]); ++k) {
                normal += double{rows.value[k]} * normals[static_cast<size_t>(rows.column[k])];
                sum += double{rows.value[k]};
            }
            EXPECT_NEAR(sum, 1, 1e-5) << v;
            found.push_back(glm::normalize(normal));
        }
        return found;
    };
    const std::vector<glm::dvec3> own = looks(0), found = looks(.6);
    double low = 1e9, high = -1e9, side = 0;
    for (size_t v = 0; v < normals.size(); ++v) {
        EXPECT_LT(glm::distance(own[v], normals[v]), 1e-12) << v;
        if (!body.face[v]) {
            EXPECT_LT(glm::distance(found[v], normals[v]), 1e-12) << v;
            continue;
        }
        low = std::min(low, verts[v].y), high = std::max(high, verts[v].y);
        side = std::max(side, verts[v].x);
    }
    double ownTurn = 0, aside = 1;
    size_t middle = 0;
    for (size_t v = 0; v < normals.size(); ++v) {
        if (!body.face[v]) continue;
        const double across = verts[v].x / side,
                     along = (2 * verts[v].y - low - high) / (high - low);
        if (std::hypot(across, along) < .55) {
            ++middle;
            ownTurn = std::max(ownTurn, std::abs(normals[v].x));
            EXPECT_LT(std::abs(found[v].x), .1) << v;
            EXPECT_GT(found[v].z, .9) << v;
        }
        if (std::abs(along) < .2 && across > .95) aside = std::min(aside, found[v].x);
    }
    EXPECT_GT(middle, 100u);
    EXPECT_GT(ownTurn, .7);  // a nose's flank
    EXPECT_GT(aside, .5);
}

TEST(Body, ZeroPoseGivesTheShapedTemplate) {
    BodyModel body = bodyFromNpz(readNpz(kDefaultBody));
    std::vector<double> beta = random({10}, 3).data;
    auto [verts, joints] = pose(body, std::vector<float>(72), toFloat(beta), {0, 0, 0});
    std::vector<double> shaped = shapedVertices(body, beta), rest = restJoints(body, beta);
    for (size_t i = 0; i < shaped.size(); ++i)
        ASSERT_NEAR(static_cast<double>(verts[i]), shaped[i], 2e-6);
    for (size_t i = 0; i < rest.size(); ++i)
        ASSERT_NEAR(static_cast<double>(joints[i]), rest[i], 2e-6);
}

TEST(Body, CompactFormMatchesTheOp) {
    BodyModel body = bodyFromNpz(readNpz(kDefaultBody));
    int64_t vertices = body.vertexCount;
    std::vector<float> theta = toFloat(random({72}, 1).data), beta = toFloat(random({10}, 2).data);
    for (float& angle : theta) angle *= 0.4f;
    Value upstream = random({vertices, 3}, 3), jointUpstream = random({24, 3}, 4);
    Npz arrays;
    arrays.set("template", Array::f32({vertices, 3}, body.templateVertices));
    arrays.set("shapedirs", Array::f32({vertices, 3, 10}, body.shapeDirections));
    arrays.set("weights", Array::f32({vertices, 24}, body.weights));
    arrays.set("joint_regressor", Array::f32({24, vertices}, body.jointRegressor));
    arrays.set("parents", Array::i32({24}, body.parents));
    arrays.set("theta", Array::f32({72}, theta));
    arrays.set("beta", Array::f32({10}, beta));
    arrays.set("trans", Array::f32({3}, std::vector<float>{0.1f, 0.2f, 3}));
    arrays.set("grad_verts", Array::f64(upstream.shape, upstream.data));
    arrays.set("grad_joints", Array::f64(jointUpstream.shape, jointUpstream.data));
    Npz expected = Op::find("lbs")->run(testDevice(), arrays, {});

    std::vector<std::vector<float>> runs;
    for (int run = 0; run < 2; ++run) {
        Graph graph(testDevice());
        Tensor base = graph.variable({vertices, 3}), t = graph.variable({72});
        Tensor b = graph.variable({10}), move = graph.variable({3});
        Tensor dverts = graph.input({vertices, 3}), djoints = graph.input({24, 3});
        PosedBody posed = lbs(graph, lbsModel(graph, body), base, t, b, move);
        graph.backward({{posed.verts, dverts}, {posed.joints, djoints}});
        std::vector<std::pair<std::string, Tensor>> outputs = {
            {"verts", posed.verts},
            {"joints", posed.joints},
            {"grad_template", graph.gradient(base)},
            {"grad_theta", graph.gradient(t)},
            {"grad_beta", graph.gradient(b)},
            {"grad_trans", graph.gradient(move)}};
        for (auto& [name, tensor] : outputs) graph.output(tensor);
        graph.compile({.poison = true, .timestamps = true});
        graph.write(base, body.templateVertices);
        graph.write(t, theta);
        graph.write(b, beta);
        graph.write(move, std::vector<float>{0.1f, 0.2f, 3});
        graph.write(dverts, toFloat(upstream.data));
        graph.write(djoints, toFloat(jointUpstream.data));
        graph.run();
        runs.emplace_back();
        for (auto& [name, tensor] : outputs) {
            std::vector<float> values = graph.read<float>(tensor);
            EXPECT_LE(
                relativeError({values.begin(), values.end()}, expected.at(name).toF64(), 1e-6),
                2e-5)
                << name;
            runs.back().insert(runs.back().end(), values.begin(), values.end());
        }
    }
    EXPECT_EQ(std::memcmp(runs[0].data(), runs[1].data(), runs[0].size() * 4), 0)
        << "two runs give the same bits";
}

// A triangle of an atlas, drawn with `size` texels a side: calls back for every covered centre.
void drawTexels(const BodyModel& body, size_t f, int size, const std::function<void(int)>& texel) {
    std::array<std::array<double, 2>, 3> p;
    for (size_t i = 0; i < 3; ++i)
        for (size_t c = 0; c < 2; ++c)
            p[i][c] = size * static_cast<double>(body.uvs[2 * size_t(body.uvFaces[3 * f + i]) + c]);
    auto edge = [](const auto& a, const auto& b, double x, double y) {
        return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]);
    };
    auto [left, right] = std::minmax({p[0][0], p[1][0], p[2][0]});
    auto [top, bottom] = std::minmax({p[0][1], p[1][1], p[2][1]});
    for (int y = int(top); y < std::min(size, int(bottom) + 1); ++y)
        for (int x = int(left); x < std::min(size, int(right) + 1); ++x) {
            double a = edge(p[0], p[1], x + 0.5, y + 0.5), b = edge(p[1], p[2], x + 0.5, y + 0.5),
                   c = edge(p[2], p[0], x + 0.5, y + 0.5);
            if ((a > 0 && b > 0 && c > 0) || (a < 0 && b < 0 && c < 0)) texel(y * size + x);
        }
}

// A socket's ground slides behind the lids as the head turns: eyes that are learned on it are
// smears.
TEST(DefaultBody, HasNoHolesForEyes) {
    for (const char* name : {"default.npz", "default-full.npz"}) {
        const BodyModel body = bodyFromNpz(readNpz(test::sourceFolder() / "assets/body" / name));
        int eyes = 0;
        for (size_t v = 0; v < body.templateVertices.size(); v += 3) {
            const float* at = &body.templateVertices[v];
            if (std::abs(std::abs(at[0]) - .03f) > .01f || std::abs(at[1] - .455f) > .006f ||
                at[2] < .1f)
                continue;
            EXPECT_GT(at[2], .14f) << name << " vertex " << v / 3;
            ++eyes;
        }
        EXPECT_GT(eyes, 20) << name;
    }
}

// A face that is learned from pictures is thinner than a deep mouth here and there, which then
// shows through the cheeks. Its inside has a chart of the atlas to itself.
TEST(DefaultBody, HasNoDeepMouth) {
    for (const char* name : {"default.npz", "default-full.npz"}) {
        const BodyModel body = bodyFromNpz(readNpz(test::sourceFolder() / "assets/body" / name));
        std::vector<size_t> chart(static_cast<size_t>(body.uvCount));
        std::iota(chart.begin(), chart.end(), size_t{0});
        auto chartOf = [&](int32_t uv) {
            auto root = static_cast<size_t>(uv);
            while (chart[root] != root) root = chart[root] = chart[chart[root]];
            return root;
        };
        for (size_t f = 0; f < body.uvFaces.size(); f += 3)
            for (size_t k : {1u, 2u})
                chart[chartOf(body.uvFaces[f + k])] = chartOf(body.uvFaces[f]);
        struct Extent {
            float side = 0, low = 9, top = -9, back = 9, front = -9;
        };
        std::map<size_t, Extent> extents;
        for (size_t i = 0; i < body.uvFaces.size(); ++i) {
            const float* at = &body.templateVertices[3 * static_cast<size_t>(body.faces[i])];
            Extent& extent = extents[chartOf(body.uvFaces[i])];
            extent.side = std::max(extent.side, std::abs(at[0]));
            extent.low = std::min(extent.low, at[1]), extent.top = std::max(extent.top, at[1]);
            extent.back = std::min(extent.back, at[2]),
            extent.front = std::max(extent.front, at[2]);
        }
        int mouths = 0;
        for (const auto& [root, extent] : extents) {
            if (extent.side > .05f || extent.low < .3f || extent.top > .44f) continue;
            EXPECT_LT(extent.front - extent.back, .02f) << name;
            ++mouths;
        }
        EXPECT_EQ(mouths, 1) << name;
    }
}

// SMPL's own file has no atlas, labels or masks: leave the default body without them.
TEST(Body, FillsInWhatSmplsFileLacks) {
    Npz full = readNpz(kDefaultBody), bare;
    bare.file = "SMPL_NEUTRAL.npz";
    BodyModel body = bodyFromNpz(full);
    for (const char* name : {"v_template", "f", "shapedirs", "weights", "J_regressor"})
        bare.set(name, full.at(name));
    std::vector<float> wide(size_t(body.vertexCount) * 3 * 12, 7);
    for (size_t i = 0; i < wide.size() / 12; ++i)
        for (size_t k = 0; k < 10; ++k) wide[12 * i + k] = body.shapeDirections[10 * i + k];
    bare.set("shapedirs", Array::f32({body.vertexCount, 3, 12}, wide));
    bare.set("kintree_table", Array::i64({2, 24}, kTree));
    bare.set("J", Array::scalarF32(0));
    BodyModel filled = bodyFromNpz(bare);
    EXPECT_EQ(filled.shapeDirections, body.shapeDirections) << "the first ten count";

    size_t sameParts = 0;
    std::array<int, 2> face{}, sole{};
    for (size_t v = 0; v < body.part.size(); ++v) {
        sameParts += filled.part[v] == body.part[v];
        face[0] += filled.face[v] && body.face[v];
        face[1] += filled.face[v] || body.face[v];
        sole[0] += filled.sole[v] && body.sole[v];
        sole[1] += filled.sole[v] || body.sole[v];
    }
    EXPECT_GT(sameParts, body.part.size() * 95 / 100);
    EXPECT_GT(face[0], face[1] / 2) << "the guessed face is mostly the face";
    EXPECT_GT(sole[0], sole[1] * 7 / 10);

    // The atlas: every face has texels, next to none of them twice.
    constexpr int kSize = 1024;
    std::vector<int> owners(kSize * kSize);
    size_t seen = 0, invisible = 0, twice = 0, used = 0;
    for (size_t f = 0; f < size_t(filled.faceCount); ++f) {
        size_t before = seen;
        drawTexels(filled, f, kSize, [&](int texel) {
            ++seen;
            ++owners[size_t(texel)];
        });
        invisible += seen == before;
    }
    for (int count : owners) {
        used += count > 0;
        twice += count > 1;
    }
    EXPECT_GT(used, size_t{kSize} * kSize * 4 / 10) << "the atlas is well filled";
    EXPECT_LT(twice, used / 100) << "faces share no texels";
    EXPECT_LT(invisible, size_t(filled.faceCount) / 10);
    Atlas atlas = makeAtlas(filled.templateVertices, filled.faces, filled.part);
    EXPECT_EQ(atlas.uvs, filled.uvs) << "the same body gives the same atlas";
    EXPECT_LT(atlas.chartCount, 500);
}

}  // namespace
}  // namespace doppel
