// The mesh refinement network against the numbers of its authors' head in PyTorch, and its laws.
#include "nn/nets/mesh_net.h"
#include "nn/ops/linalg.h"

#include <cmath>
#include <map>
#include <optional>
#include <random>

#include "nn/steps/mesh_step.h"
#include "tests/files.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

struct Refined {
    std::vector<float> out, gradVerts;
    std::map<std::string, std::vector<float>> parameterGradients;
};

// Refines verts with the given weights and sends the gradient back.
Refined run(const MeshNetConfig& config, const std::vector<float>& verts,
            const std::vector<int32_t>& faces, const std::vector<float>& limit,
            const std::vector<float>& upstream,
            const std::function<void(Parameters&)>& setWeights) {
    Parameters parameters;
    addMeshNetParameters(parameters, config, 1);
    parameters.allocate(testDevice());
    setWeights(parameters);
    auto vertices = static_cast<int64_t>(limit.size());
    Graph graph(testDevice());
    Tensor v = graph.variable({vertices, 3}), d = graph.input({vertices, 3});
    MeshTensors mesh = meshTensors(graph, meshTopology(faces, vertices, "test"));
    MeshNet net(graph, parameters, config, mesh, graph.constant(limit, {vertices}));
    Tensor out = net.refine(v).back();
    graph.backward({{out, d}});
    Tensor dv = graph.gradient(v);
    graph.output(out);
    graph.output(dv);
    graph.compile({.poison = true});
    graph.write(v, verts);
    graph.write(d, upstream);
    graph.run();
    Refined result{graph.read<float>(out), graph.read<float>(dv), {}};
    for (const Parameters::Entry& entry : parameters.entries())
        result.parameterGradients[entry.name] = parameters.read(entry, Parameters::kGradient);
    return result;
}

std::vector<double> toDouble(const std::vector<float>& values) {
    return {values.begin(), values.end()};
}

TEST(MeshNet, MatchesTheAuthorsHead) {
    Npz golden = readNpz(test::sourceFolder() / "tests/data/mesh_net_ico1.npz");
    Refined got = run({.blocks = 2, .layers = 2, .hidden = 16}, golden.at("verts").toF32(),
                      golden.at("faces").toI32(), golden.at("limit").toF32(),
                      golden.at("grad_out").toF32(), [&](Parameters& parameters) {
                          for (const Parameters::Entry& entry : parameters.entries()) {
                              const Array& value = golden.at(entry.name);
                              ASSERT_EQ(value.shape, entry.shape) << entry.name;
                              parameters.write(entry, value.toF32());
                          }
                      });
    auto near = [&](const std::vector<float>& values, const std::string& expected) {
        EXPECT_LE(relativeError(toDouble(values), golden.at(expected).toF64(), 1e-12), 1e-4)
            << expected;
    };
    near(got.out, "expect_out");
    near(got.gradVerts, "expect_grad_verts");
    EXPECT_EQ(got.parameterGradients.size(), 2u * (2 * 4 + 2));
    for (const auto& [name, gradient] : got.parameterGradients)
        near(gradient, "expect_grad_" + name);
}

// Two tetrahedra that share a face, and a vertex of its own.
const std::vector<int32_t> kFaces = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 4, 2, 3, 4, 3, 1, 4};
const std::vector<float> kVerts = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2};

TEST(MeshNet, UntrainedMovesNothing) {
    Refined got = run({.blocks = 3, .layers = 2, .hidden = 5}, kVerts, kFaces,
                      std::vector<float>(6, 0.1f), std::vector<float>(18, 1), [](Parameters&) {});
    EXPECT_EQ(got.out, kVerts);
    double offsets = 0, layers = 0;
    for (const auto& [name, gradient] : got.parameterGradients)
        for (float g : gradient) {
            ASSERT_TRUE(std::isfinite(g)) << name;
            (name.find("offset") != std::string::npos ? offsets : layers) +=
                std::abs(static_cast<double>(g));
        }
    EXPECT_GT(offsets, 0) << "training can start";
    EXPECT_EQ(layers, 0) << "behind weights of zero";
}

TEST(MeshNet, LimitsHold) {
    MeshNetConfig config{.blocks = 3, .layers = 1, .hidden = 8};
    std::vector<float> limit = {0, 0.01f, 0.02f, 0.03f, 0, 0.05f};
    auto wild = [](Parameters& parameters) {
        uint32_t seed = 0;
        for (const Parameters::Entry& entry : parameters.entries()) {
            std::vector<double> values = random(entry.shape, ++seed).data;
            parameters.write(entry, std::vector<float>(values.begin(), values.end()));
        }
    };
    Refined got = run(config, kVerts, kFaces, limit, std::vector<float>(18, 1), wild);
    double moved = 0;
    for (size_t i = 0; i < kVerts.size(); ++i) {
        float offset = std::abs(got.out[i] - kVerts[i]);
        EXPECT_LE(offset, 3 * limit[i / 3] + 1e-6f) << "three blocks, each within its bound";
        moved = std::max(moved, static_cast<double>(offset));
    }
    EXPECT_GT(moved, 0.05) << "the sum goes beyond one bound";
    EXPECT_EQ(run(config, kVerts, kFaces, limit, std::vector<float>(18, 1), wild).out, got.out);
}

TEST(MeshNet, InitialWeights) {
    auto values = [](uint32_t seed) {
        Parameters parameters;
        addMeshNetParameters(parameters, {}, seed);
        EXPECT_EQ(parameters.entries().size(), 3u * (6 * 4 + 2));
        parameters.allocate(testDevice());
        return std::pair(parameters.read(*parameters.find("mesh.block0.layer1.weight0")),
                         parameters.read(*parameters.find("mesh.block0.layer1.weight1")));
    };
    auto [first, second] = values(7);
    ASSERT_EQ(first.size(), 128u * 131);
    double sum = 0, squares = 0;
    for (float w : first) {
        sum += static_cast<double>(w);
        squares += static_cast<double>(w) * static_cast<double>(w);
    }
    auto n = static_cast<double>(first.size());
    EXPECT_NEAR(sum / n, 0, 5e-4);
    EXPECT_NEAR(std::sqrt(squares / n), 0.01, 3e-4);
    EXPECT_NE(first, second);
    EXPECT_EQ(values(7).first, first) << "the seed decides";
    EXPECT_NE(values(8).first, first);
}

// One network, two bodies in one graph: gradients add up.
TEST(MeshNet, SharedBetweenBodies) {
    MeshNetConfig config{.blocks = 1, .layers = 2, .hidden = 8};
    Parameters parameters;
    addMeshNetParameters(parameters, config, 3);
    parameters.allocate(testDevice());
    const Parameters::Entry& weight = *parameters.find("mesh.block0.offset.weight");
    auto gradient = [&](const std::vector<std::vector<float>>& bodies) {
        Graph graph(testDevice());
        MeshTensors mesh = meshTensors(graph, meshTopology(kFaces, 6, "test"));
        MeshNet net(graph, parameters, config, mesh,
                    graph.constant(std::vector<float>(6, 0.1f), {6}));
        std::vector<std::pair<Tensor, Tensor>> upstream;
        for (const std::vector<float>& body : bodies)
            upstream.emplace_back(net.refine(graph.constant(body, {6, 3})).back(),
                                  graph.constant(body, {6, 3}));
        graph.backward(upstream);
        graph.compile({.poison = true});
        graph.run();
        return toDouble(parameters.read(weight, Parameters::kGradient));
    };
    std::vector<float> other = kVerts;
    for (size_t i = 0; i < other.size(); ++i) other[i] += 0.1f * static_cast<float>(i % 5);
    std::vector<double> a = gradient({kVerts}), b = gradient({other});
    for (size_t i = 0; i < a.size(); ++i) a[i] += b[i];
    EXPECT_LE(relativeError(gradient({kVerts, other}), a, 1e-12), 1e-5);
}

// A body that is posed again and again: what a pose leaves where it is is not computed again, and
// the mesh has the bits of one that is computed from the beginning.
TEST(MeshNet, ComputesNoMoreThanAPoseMoved) {
    BodyModel body = bodyFromNpz(readNpz(test::sourceFolder() / "assets/body/default.npz"));
    MeshNetConfig config{.blocks = 2, .layers = 2, .hidden = 32, .deviation = 0.05f};
    Parameters parameters;
    addMeshNetParameters(parameters, config, 5);
    parameters.allocate(testDevice());
    std::mt19937 random(5);
    std::normal_distribution<float> normal(0, 0.05f);
    for (const Parameters::Entry& entry : parameters.entries()) {
        std::vector<float> values(static_cast<size_t>(elementCount(entry.shape)));
        for (float& value : values) value = normal(random);
        parameters.write(entry, values);
    }
    struct Rerun {
        Graph graph;
        std::optional<MovedRows> moved;
        Tensor theta, trans, beta, verts;
        Rerun() : graph(testDevice()) {
            theta = graph.input({72});
            trans = graph.input({3});
            beta = graph.input({10});
        }
    };
    Rerun whole, part;
    auto build = [&](Rerun& r, bool byParts) {
        LbsModel skin = lbsModel(r.graph, body);
        Tensor rest = r.graph.constant(body.templateVertices, {body.vertexCount, 3});
        MeshNetwork network = meshNetwork(r.graph, body, config, ClampBounds::Paper, parameters);
        if (byParts) {
            ShapedBody shaped = shapeBody(r.graph, skin, rest, r.beta);
            r.graph.endPreparation();
            if (network.net.takesRows()) r.moved.emplace(r.graph, body, network.net.reach());
            r.verts = network.refine(skin, shaped, r.theta, r.trans, r.moved ? &*r.moved : nullptr);
        } else {
            r.verts = network.refine(skin, rest, r.beta, r.theta, r.trans);
        }
        r.graph.output(r.verts);
        r.graph.compile({.poison = true});
    };
    build(whole, false);
    build(part, true);
    EXPECT_TRUE(part.moved || !testDevice().kernelPath().texels);

    std::vector<float> theta(72), trans{0, 0.1f, 3}, beta(10);
    auto run = [&](Rerun& r) {
        r.graph.write(r.theta, theta);
        r.graph.write(r.trans, trans);
        r.graph.write(r.beta, beta);
        if (r.moved) r.moved->write(theta, trans);
        r.graph.run();
        return r.graph.read<float>(r.verts);
    };
    auto shape = [&] {
        part.graph.write(part.beta, beta);
        part.graph.prepare();
        if (part.moved) part.moved->forget();
    };
    shape();
    std::vector<float> before;
    auto expectSame = [&](const char* what) {
        std::vector<float> expected = run(whole), got = run(part);
        EXPECT_TRUE(got == expected) << what;
        EXPECT_TRUE(before.empty() || got != before) << what;
        before = got;
    };
    expectSame("the first pose");
    EXPECT_EQ(run(part), before) << "the same pose again";
    theta[3 * 18 + 1] = -0.8f;
    expectSame("the left elbow");
    theta[3 * 18 + 1] = -0.9f, theta[3 * 5] = 0.4f;
    expectSame("the left elbow and the right knee");
    theta[0] = 0.3f;
    expectSame("the whole body");
    trans[1] = 0;
    expectSame("its place");
    theta[3 * 3 + 2] = 0.2f;
    expectSame("the lowest of the spine");
    theta = std::vector<float>(72);
    expectSame("back again");
    beta[1] = 2;
    shape();
    expectSame("another shape");

    // A preparation of which the lists do not hear leaves nothing but NaN of the last pose, which
    // shows what is not computed again.
    if (!part.moved) return;
    part.graph.prepare();
    theta[3 * 18 + 1] = -0.8f;
    std::vector<float> got = run(part), expected = run(whole);
    size_t left = 0, done = 0, hand = 0;
    for (size_t v = 0; v < static_cast<size_t>(body.vertexCount); ++v) {
        left += std::isnan(got[3 * v]);
        if (body.part[v] != kLeftHand) continue;
        ++hand;
        done += got[3 * v] == expected[3 * v];
    }
    EXPECT_EQ(done, hand);
    EXPECT_GT(left, static_cast<size_t>(body.vertexCount) / 2);
}

}  // namespace
}  // namespace doppel
