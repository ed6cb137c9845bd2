// Topology of a mesh, and the ops that gather along it.
#include "nn/ops/mesh.h"

#include <cmath>
#include <map>
#include <set>

#include "mesh/params.h"
#include "nn/ops/linalg.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

using Vector = std::array<double, 3>;

Vector at(const Value& verts, int v) {
    const double* p = &verts.data[3 * size_t(v)];
    return {p[0], p[1], p[2]};
}
Vector minus(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vector cross(const Vector& a, const Vector& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// A grid of (n+1) x (n+1) vertices in a disturbed plane, two triangles a cell, every third one
// wound the other way; a last vertex belongs to no face.
struct TestMesh {
    Value verts;
    std::vector<int> faces;

    Value faceArray() const { return indices({int64_t(faces.size() / 3), 3}, faces); }
};
TestMesh grid(int n) {
    int side = n + 1;
    TestMesh mesh;
    mesh.verts = uniform({side * side + 1, 3}, -0.3, 0.3, 5);
    for (int v = 0; v < side * side; ++v) {
        mesh.verts.data[3 * size_t(v)] += v % side;
        mesh.verts.data[3 * size_t(v) + 1] += v / side;
    }
    for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) {
            int a = y * side + x, b = a + 1, c = a + side, d = c + 1;
            for (std::array<int, 3> f : {std::array{a, b, c}, std::array{b, d, c}}) {
                if (mesh.faces.size() % 9 == 6) std::swap(f[1], f[2]);
                mesh.faces.insert(mesh.faces.end(), f.begin(), f.end());
            }
        }
    return mesh;
}

std::map<std::pair<int, int>, std::vector<std::pair<int, int>>> facesAtEdges(const Value& faces) {
    std::map<std::pair<int, int>, std::vector<std::pair<int, int>>> result;  // face, third corner
    for (size_t i = 0; i < faces.data.size(); ++i) {
        size_t f = i / 3 * 3;
        int a = int(faces.data[i]), b = int(faces.data[f + (i + 1) % 3]);
        int c = int(faces.data[f + (i + 2) % 3]);
        if (a != b) result[std::minmax(a, b)].push_back({int(f / 3), c});
    }
    return result;
}

Values normalsReference(const Values& in) {
    Value normals{in.at("verts").shape, std::vector<double>(in.at("verts").data.size())};
    const auto& faces = in.at("faces").data;
    for (size_t f = 0; f < faces.size(); f += 3) {
        Vector a = at(in.at("verts"), int(faces[f]));
        Vector n = cross(minus(at(in.at("verts"), int(faces[f + 1])), a),
                         minus(at(in.at("verts"), int(faces[f + 2])), a));
        for (size_t i = 0; i < 3; ++i)
            for (size_t c = 0; c < 3; ++c) normals.data[3 * size_t(faces[f + i]) + c] += n[c];
    }
    for (size_t v = 0; v < normals.data.size(); v += 3) {
        double* n = &normals.data[v];
        double length = std::max(std::hypot(n[0], n[1], n[2]), 1e-6);
        for (size_t c = 0; c < 3; ++c) n[c] /= length;
    }
    return {{"normals", normals}};
}

Values laplacianReference(const Values& in) {
    const Value& verts = in.at("verts");
    std::vector<std::set<int>> neighbours(verts.data.size() / 3);
    for (const auto& [edge, faces] : facesAtEdges(in.at("faces"))) {
        neighbours[size_t(edge.first)].insert(edge.second);
        neighbours[size_t(edge.second)].insert(edge.first);
    }
    double sum = 0;
    for (size_t v = 0; v < neighbours.size(); ++v) {
        Vector mean{};
        for (int n : neighbours[v])
            for (size_t c = 0; c < 3; ++c)
                mean[c] += at(verts, n)[c] / double(neighbours[v].size());
        Vector d = minus(mean, at(verts, int(v)));
        if (!neighbours[v].empty()) sum += std::sqrt(dot(d, d));
    }
    return {{"loss", {{}, {sum / double(neighbours.size())}}}};
}

// The definition by edges: n0 = (v1 - v0) x (a - v0), n1 = -(v1 - v0) x (b - v0).
Values consistencyReference(const Values& in) {
    const Value& verts = in.at("verts");
    double sum = 0, pairs = 0;
    for (const auto& [edge, faces] : facesAtEdges(in.at("faces")))
        for (size_t i = 0; i < faces.size(); ++i)
            for (size_t k = i + 1; k < faces.size(); ++k) {
                Vector v0 = at(verts, edge.first), along = minus(at(verts, edge.second), v0);
                Vector n0 = cross(along, minus(at(verts, faces[i].second), v0));
                Vector n1 = cross(minus(at(verts, faces[k].second), v0), along);
                double lengths = std::sqrt(dot(n0, n0) * dot(n1, n1));
                sum += 1 - (lengths > 0 ? dot(n0, n1) / lengths : 0);
                ++pairs;
            }
    return {{"loss", {{}, {pairs > 0 ? sum / pairs : 0}}}};
}

void checkMeshOp(const std::string& op, const std::function<Values(const Values&)>& reference,
                 const std::vector<TestMesh>& meshes) {
    for (const TestMesh& mesh : meshes)
        checkOp(op, {.inputs = {{"verts", mesh.verts}},
                     .integers = {{"faces", mesh.faceArray()}},
                     .reference = reference});
}

// A strip of triangles.
TestMesh strip(int64_t faces) {
    TestMesh mesh{random({faces + 2, 3}), {}};
    for (int f = 0; f < int(faces); ++f) mesh.faces.insert(mesh.faces.end(), {f, f + 1, f + 2});
    return mesh;
}

// One face, closed, open, with an isolated vertex, with three faces at one edge; vertices and faces
// at the edges of a workgroup of 64 and of a part of a sum of 256.
std::vector<TestMesh> meshes() {
    std::vector<TestMesh> all{{random({3, 3}), {0, 1, 2}},
                              {random({4, 3}), {0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 3, 2}},
                              {random({5, 3}), {0, 1, 2, 1, 0, 3, 0, 1, 4}},
                              grid(2),
                              grid(13),
                              grid(40)};
    for (int64_t tile : {64, 256})
        for (int64_t n : edgeSizes(tile))
            for (int64_t faces : {n, n - 2})
                if (faces > 0) all.push_back(strip(faces));
    return all;
}

TEST(MeshOps, VertexNormals) { checkMeshOp("vertex_normals", normalsReference, meshes()); }
TEST(MeshOps, LaplacianLoss) { checkMeshOp("laplacian_loss", laplacianReference, meshes()); }
TEST(MeshOps, NormalConsistencyLoss) {
    checkMeshOp("normal_consistency_loss", consistencyReference, meshes());
}

OpCase caseOf(const TestMesh& mesh) {
    OpCase test;
    test.inputs["verts"] = mesh.verts;
    test.integers["faces"] = mesh.faceArray();
    return test;
}

std::vector<std::set<int>> neighboursOf(const Values& in) {
    std::vector<std::set<int>> neighbours(in.at("verts").data.size() / 3);
    for (const auto& [edge, faces] : facesAtEdges(in.at("faces"))) {
        neighbours[size_t(edge.first)].insert(edge.second);
        neighbours[size_t(edge.second)].insert(edge.first);
    }
    return neighbours;
}

TEST(MeshOps, OffsetPenalty) {
    for (const TestMesh& mesh : meshes()) {
        OpCase test = caseOf(mesh);
        test.inputs["stiffness"] = uniform({int64_t(mesh.verts.data.size() / 3)}, 0, 4, 14);
        test.attributes = {{"stay", .3}, {"smooth", 5}};
        test.reference = [](const Values& in) -> Values {
            const Value& x = in.at("verts");
            const auto neighbours = neighboursOf(in);
            double loss = 0;
            for (size_t v = 0; v < neighbours.size(); ++v)
                for (size_t c = 0; c < 3; ++c) {
                    const double own = x.data[3 * v + c];
                    double bend = 0;
                    for (int n : neighbours[v])
                        bend += (own - x.data[3 * size_t(n) + c]) / double(neighbours[v].size());
                    loss += .3 * own * own + 5 * in.at("stiffness").data[v] * bend * bend;
                }
            return {{"loss", {{}, {loss / double(neighbours.size())}}}};
        };
        checkOp("offset_penalty", test);
    }
}

TEST(MeshOps, FoldPenalty) {
    int whole = 0, shrunk = 0, turned = 0;
    for (const TestMesh& mesh : meshes()) {
        OpCase test = caseOf(mesh);
        const Value noise = uniform(test.inputs.at("verts").shape, -.8, .8, 12);
        Value& reference = test.inputs["reference"] = test.inputs.at("verts");
        for (size_t i = 0; i < noise.data.size(); ++i) reference.data[i] += noise.data[i];
        test.inputs["weight"] = uniform({int64_t(mesh.faces.size() / 3)}, 0, 2, 13);
        test.attributes = {{"least", .4}};
        test.reference = [&](const Values& in) -> Values {
            const Value& faces = in.at("faces");
            auto crossOf = [&](const char* name, size_t f) {
                auto corner = [&](size_t k) { return at(in.at(name), int(faces.data[3 * f + k])); };
                return cross(minus(corner(1), corner(0)), minus(corner(2), corner(0)));
            };
            const size_t count = faces.data.size() / 3;
            double loss = 0;
            for (size_t f = 0; f < count; ++f) {
                const Vector c = crossOf("verts", f), c0 = crossOf("reference", f);
                if (dot(c0, c0) <= 1e-24) continue;
                const double left = dot(c, c0) / dot(c0, c0), wall = std::max(0., .4 - left);
                ++(left < 0 ? turned : left < .4 ? shrunk : whole);
                loss += in.at("weight").data[f] * wall * wall;
            }
            return {{"loss", {{}, {loss}}}};
        };
        checkOp("fold_penalty", test);
    }
    EXPECT_TRUE(whole && shrunk && turned) << "a kind of face was never seen";
}

// The same polynomial of (I + lambda L) in double precision.
Values smoothSolveReference(const Values& in) {
    const Value& x = in.at("verts");
    const auto neighbours = neighboursOf(in);
    const double lambda = in.at("lambda").data[0];
    size_t most = 0;
    for (const auto& list : neighbours) most = std::max(most, list.size());
    const double low = 1 / (1 + lambda * double(most));
    const double centre = (2 + low) / 2, radius = (2 - low) / 2;
    std::vector<double> y(x.data.size()), r(y.size()), d(y.size());
    for (size_t i = 0; i < y.size(); ++i) {
        r[i] = x.data[i] / (1 + lambda * double(neighbours[i / 3].size()));
        d[i] = r[i] / centre;
    }
    double rho = radius / centre;
    for (int k = 0; k < int(in.at("iterations").data[0]); ++k) {
        std::vector<double> applied(y.size());
        for (size_t v = 0; v < neighbours.size(); ++v)
            for (size_t c = 0; c < 3; ++c) {
                const double degree = double(neighbours[v].size());
                double sum = (1 + lambda * degree) * d[3 * v + c];
                for (int n : neighbours[v]) sum -= lambda * d[3 * size_t(n) + c];
                applied[3 * v + c] = sum / (1 + lambda * degree);
            }
        const double next = 1 / (2 * centre / radius - rho);
        for (size_t i = 0; i < y.size(); ++i) {
            y[i] += d[i];
            r[i] -= applied[i];
            d[i] = next * rho * d[i] + 2 * next / radius * r[i];
        }
        rho = next;
    }
    return {{"y", {x.shape, y}}};
}

TEST(MeshOps, SmoothSolve) {
    for (const TestMesh& mesh : meshes())
        for (double iterations : {1, 2, 9, 32}) {
            OpCase test = caseOf(mesh);
            test.attributes = {{"lambda", 10}, {"iterations", iterations}};
            test.reference = smoothSolveReference;
            checkOp("smooth_solve", test);
        }
}

// Enough iterations solve the equation.
TEST(MeshOps, SmoothSolveConverges) {
    for (const TestMesh& mesh : {grid(2), grid(13), strip(64)}) {
        OpCase test = caseOf(mesh);
        test.attributes = {{"lambda", 10}, {"iterations", 400}};
        test.reference = [](const Values& in) -> Values {
            // (I + lambda L) y = x by Gauss-Seidel.
            const Value& x = in.at("verts");
            const auto neighbours = neighboursOf(in);
            std::vector<double> y(x.data.size());
            for (int sweep = 0; sweep < 4000; ++sweep)
                for (size_t v = 0; v < neighbours.size(); ++v)
                    for (size_t c = 0; c < 3; ++c) {
                        double sum = x.data[3 * v + c];
                        for (int n : neighbours[v]) sum += 10 * y[3 * size_t(n) + c];
                        y[3 * v + c] = sum / (1 + 10 * double(neighbours[v].size()));
                    }
            return {{"y", {x.shape, y}}};
        };
        test.forwardTolerance = 2e-5;
        checkOp("smooth_solve", test);
    }
}

TEST(MeshOps, WithoutFaces) {
    TestMesh bare{random({13, 3}), {}};
    checkMeshOp("vertex_normals", normalsReference, {bare});
    checkMeshOp("laplacian_loss", laplacianReference, {bare});
    checkMeshOp("normal_consistency_loss", consistencyReference, {bare});
}

Npz runOn(const char* op, const Value& verts, const std::vector<int>& faces,
          const std::string& output, const Value& upstream) {
    Npz arrays;
    arrays.set("verts", Array::f64(verts.shape, verts.data));
    arrays.set("faces", Array::i32({int64_t(faces.size() / 3), 3},
                                   std::vector<int32_t>(faces.begin(), faces.end())));
    arrays.set("grad_" + output, Array::f64(upstream.shape, upstream.data));
    return Op::find(op)->run(testDevice(), arrays, {.reuseMemory = false, .poison = true});
}

Values graphConvReference(const Values& in) {
    const Value& x = in.at("x");
    auto V = size_t(x.shape[0]), R = size_t(x.shape[1]), O = size_t(in.at("weight0").shape[0]),
         I = size_t(in.at("weight0").shape[1]);
    auto product = [&](const char* weight, const char* bias, size_t v, size_t o) {
        double sum = in.at(bias).data[o];
        for (size_t i = 0; i < I; ++i) sum += in.at(weight).data[o * I + i] * x.data[v * R + i];
        return sum;
    };
    Value y{{int64_t(V), int64_t(O)}, std::vector<double>(V * O)};
    const std::vector<double>& edges = in.at("edges").data;
    for (size_t o = 0; o < O; ++o) {
        for (size_t v = 0; v < V; ++v) y.data[v * O + o] += product("weight0", "bias0", v, o);
        for (size_t e = 0; e < edges.size(); e += 2) {
            auto a = size_t(edges[e]), b = size_t(edges[e + 1]);
            y.data[a * O + o] += product("weight1", "bias1", b, o);
            y.data[b * O + o] += product("weight1", "bias1", a, o);
        }
    }
    return {{"y", y}};
}

// ReLU, then the tail and zeros up to a multiple of four.
Values layerReference(const Values& in) {
    Value features = graphConvReference(in).at("y");
    auto V = size_t(features.shape[0]), O = size_t(features.shape[1]), row = (O + 6) / 4 * 4;
    Value y{{int64_t(V), int64_t(row)}, std::vector<double>(V * row)};
    for (size_t v = 0; v < V; ++v) {
        for (size_t o = 0; o < O; ++o)
            y.data[v * row + o] = std::max(0.0, features.data[v * O + o]);
        for (size_t k = 0; k < 3; ++k) y.data[v * row + O + k] = in.at("tail").data[3 * v + k];
    }
    return {{"y", y}};
}

// A ring with spokes from vertex 0, which leaves the last vertex alone.
Value ringEdges(int vertices) {
    std::vector<int> edges;
    for (int v = 0; v + 2 < vertices; ++v) {
        edges.insert(edges.end(), {v, v + 1});
        if (v > 1) edges.insert(edges.end(), {0, v});
    }
    return indices({int64_t(edges.size() / 2), 2}, edges);
}

OpCase graphConvCase(int64_t V, int64_t I, int64_t O) {
    return {.inputs = {{"x", random({V, I}, 1)},
                       {"weight0", random({O, I}, 2)},
                       {"bias0", random({O}, 3)},
                       {"weight1", random({O, I}, 4)},
                       {"bias1", random({O}, 5)}},
            .integers = {{"edges", ringEdges(int(V))}},
            .reference = graphConvReference};
}

TEST(MeshOps, GraphConv) {
    // One vertex has no edges. Multiples of sixteen outputs take the kernel of pairs.
    for (auto [V, I, O] : {std::array{1, 1, 1}, std::array{13, 5, 13}, std::array{127, 13, 16}})
        checkOp("graph_conv", graphConvCase(V, I, O));
    // Outputs at the edges of an invocation's columns, rows at those of a panel, and columns of x
    // with and without padding to a multiple of four.
    for (int64_t O : edgeSizes(4)) checkOp("graph_conv", graphConvCase(13, 8, O));
    for (int64_t V : edgeSizes(gemmPanelRows(testDevice(), 1000)))
        checkOp("graph_conv", graphConvCase(V, 11, 32));
    for (int64_t I : {3, 4, 5, 43, 44, 45, 87, 88}) checkOp("graph_conv", graphConvCase(9, I, 4));
}

TEST(MeshOps, GraphConvLayer) {
    for (auto [V, I, O, extra] :
         {std::array{13, 5, 13, 3}, std::array{13, 11, 32, 1}, std::array{127, 11, 16, 1},
          std::array{5, 3, 31, 1}, std::array{6, 3, 33, 1}, std::array{7, 12, 96, 0},
          std::array{33, 5, 64, 3}}) {
        OpCase testCase = graphConvCase(V, I, O);
        testCase.inputs["x"] = random({V, I + extra}, 1);
        testCase.inputs["tail"] = random({V, 3}, 6);
        testCase.reference = layerReference;
        checkOp("graph_conv_layer", testCase);
    }
}

Values withTailReference(const Values& in) {
    auto keep = size_t(in.at("columns").data[0]), V = size_t(in.at("x").shape[0]),
         R = size_t(in.at("x").shape[1]), row = (keep + 6) / 4 * 4;
    Value y{{int64_t(V), int64_t(row)}, std::vector<double>(V * row)};
    for (size_t v = 0; v < V; ++v) {
        for (size_t k = 0; k < keep; ++k) y.data[v * row + k] = in.at("x").data[v * R + k];
        for (size_t k = 0; k < 3; ++k) y.data[v * row + keep + k] = in.at("tail").data[3 * v + k];
    }
    return {{"y", y}};
}

TEST(MeshOps, WithTail) {
    for (auto [V, R, columns] :
         {std::array{1, 1, 0}, std::array{13, 12, 7}, std::array{127, 8, 5}, std::array{13, 5, 5}})
        checkOp("with_tail", {.inputs = {{"x", random({V, R}, 1)}, {"tail", random({V, 3}, 2)}},
                              .attributes = {{"columns", columns}},
                              .reference = withTailReference,
                              .floor = 1e-3});
}

// Faces without area: a point, a line, a corner named twice, a face folded onto its neighbour.
TEST(MeshOps, DegenerateFaces) {
    Value verts{{7, 3}, {0, 0, 0, 0, 0, 0, 0, 0, 0,  // three vertices at one place
                         1, 0, 0, 2, 0, 0,           // in line with them
                         0, 1, 0, 0, 0, 1}};
    std::vector<int> faces = {0, 1, 2, 0, 3, 4, 3, 3, 5, 0, 3, 5, 0, 5, 3, 0, 3, 6};
    Npz out = runOn("vertex_normals", verts, faces, "normals", random({7, 3}));
    std::vector<double> normals = out.at("normals").toF64();
    for (size_t c = 0; c < 3; ++c) {
        EXPECT_EQ(normals[3 + c], 0) << "no area around vertex 1";
        EXPECT_EQ(normals[12 + c], 0) << "no area around vertex 4";
    }
    for (double g : out.at("grad_verts").toF64()) EXPECT_TRUE(std::isfinite(g));
    for (const char* op : {"laplacian_loss", "normal_consistency_loss"}) {
        out = runOn(op, verts, faces, "loss", {{}, {1}});
        EXPECT_TRUE(std::isfinite(out.at("loss").scalar())) << op;
        for (double g : out.at("grad_verts").toF64()) EXPECT_TRUE(std::isfinite(g)) << op;
    }
    // A flat mesh is consistent, one folded by half a turn is not, one of no area is neither.
    Value square{{4, 3}, {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}};
    out = runOn("normal_consistency_loss", square, {0, 1, 2, 3, 2, 1}, "loss", {{}, {1}});
    EXPECT_NEAR(out.at("loss").scalar(), 0, 1e-6);
    Value folded{{4, 3}, {0, 0, 0, 1, 0, 0, 0, 1, 0, 0.2, 0.2, 0}};
    out = runOn("normal_consistency_loss", folded, {0, 1, 2, 1, 2, 3}, "loss", {{}, {1}});
    EXPECT_NEAR(out.at("loss").scalar(), 2, 1e-6);
    out = runOn("normal_consistency_loss", {{4, 3}, std::vector<double>(12)}, {0, 1, 2, 1, 2, 3},
                "loss", {{}, {1}});
    EXPECT_NEAR(out.at("loss").scalar(), 1, 1e-6);
}

TEST(MeshOps, LossesOfSmallMeshesKeepTheirDigits) {
    // A body's smallest faces have edges of half a millimetre, a metre from the origin.
    TestMesh mesh = grid(13);
    for (double& x : mesh.verts.data) x = x * 5e-4 + 1;
    for (bool laplacian : {true, false})
        checkOp(laplacian ? "laplacian_loss" : "normal_consistency_loss",
                {.inputs = {{"verts", mesh.verts}},
                 .integers = {{"faces", mesh.faceArray()}},
                 .reference = laplacian ? laplacianReference : consistencyReference,
                 .differenceStep = 1e-8});
}

TEST(MeshOps, OffsetClamp) {
    for (int64_t n : {1, 13, 63, 64, 65, 127}) {
        Value limit = uniform({n}, 0, 1.5, 3);
        for (size_t v = 0; v < limit.data.size(); v += 3) limit.data[v] = 0;
        checkOp("offset_clamp", {.inputs = {{"verts", random({n, 3}, 1)},
                                            {"offset", uniform({n, 3}, -1, 1, 2)},
                                            {"limit", limit}},
                                 .reference = [](const Values& in) -> Values {
                                     Value y = in.at("verts");
                                     for (size_t i = 0; i < y.data.size(); ++i) {
                                         double bound = in.at("limit").data[i / 3];
                                         y.data[i] +=
                                             std::clamp(in.at("offset").data[i], -bound, bound);
                                     }
                                     return {{"y", y}};
                                 }});
    }
    // What sits exactly on its bound is held, a bound of zero holds a zero.
    Npz arrays;
    arrays.set("verts", Array::f64({2, 3}, std::vector<double>(6)));
    arrays.set("offset", Array::f64({2, 3}, std::vector<double>{0.25, -0.25, 0.2, 0, 0, 0}));
    arrays.set("limit", Array::f64({2}, std::vector<double>{0.25, 0}));
    arrays.set("grad_y", Array::f64({2, 3}, std::vector<double>(6, 1)));
    Npz out = Op::find("offset_clamp")->run(testDevice(), arrays, {});
    EXPECT_EQ(out.at("grad_offset").toF64(), (std::vector<double>{0, 0, 1, 0, 0, 0}));
}

TEST(Mesh, Topology) {
    std::vector<int32_t> faces = {0, 1, 2, 2, 1, 3};
    MeshTopology mesh = meshTopology(faces, 5, "test");
    EXPECT_EQ(mesh.edges, (std::vector<int32_t>{0, 1, 0, 2, 1, 2, 1, 3, 2, 3}));
    EXPECT_EQ(mesh.adjacency.begin, (std::vector<int32_t>{0, 2, 5, 8, 10, 10}));
    EXPECT_EQ(mesh.adjacency.neighbours, (std::vector<int32_t>{1, 2, 0, 2, 3, 0, 1, 3, 1, 2}));
    EXPECT_EQ(mesh.cornerBegin, (std::vector<int32_t>{0, 1, 3, 5, 6, 6}));
    EXPECT_EQ(mesh.corners,
              (std::vector<int32_t>{0, 1, 2, 0, 2, 0, 1, 3, 2, 0, 0, 1, 1, 1, 3, 1, 2, 1}));
    EXPECT_EQ(mesh.pairCount, 1);
    EXPECT_EQ(mesh.pairFaces, (std::vector<int32_t>{2, 0})) << "wound alike";
    faces = {0, 1, 2, 1, 2, 3};
    EXPECT_EQ(meshTopology(faces, 4, "test").pairFaces, (std::vector<int32_t>{3, 1}));
}

TEST(Mesh, RefusesWhatIsNoMesh) {
    auto run = [](const std::vector<int>& faces) {
        runOn("laplacian_loss", random({5, 3}), faces, "loss", {{}, {1}});
    };
    expectInputError([&] { run({0, 1, 5}); }, "faces: row 0 names vertex 5; expected 0 to 4");
    expectInputError([&] { run({0, 1, 2, 3, -1, 2}); }, "faces: row 1 names vertex -1");
    OpCase graph = graphConvCase(13, 2, 2);
    graph.integers["edges"].data[3] = 13;
    Npz arrays;
    for (const auto& [name, value] : graph.inputs)
        arrays.set(name, Array::f64(value.shape, value.data));
    const Value& edges = graph.integers["edges"];
    arrays.set("edges",
               Array::i32(edges.shape, std::vector<int32_t>(edges.data.begin(), edges.data.end())));
    expectInputError([&] { Op::find("graph_conv")->run(testDevice(), arrays, {}); },
                     "graph_conv: edges: row 1 names vertex 13; expected 0 to 12");
    std::vector<int> fan;
    for (int f = 0; f < 65; ++f) fan.insert(fan.end(), {0, 1, 2 + f % 3});
    expectInputError([&] { run(fan); }, "the edge 0-1 belongs to 65 faces; expected at most 64");
}

}  // namespace
}  // namespace doppel
