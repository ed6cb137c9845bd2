#include "nn/mesh_ops.h"

#include <algorithm>

#include "mesh/params.h"
#include "nn/linalg.h"
#include "nn/op.h"

namespace doppel {

namespace {

void checkVerts(const Tensor& verts, const MeshTensors& mesh) {
    CHECK(verts.shape == Shape({mesh.vertexCount, 3}), "the mesh has vertices of the shape {}",
          toString({mesh.vertexCount, 3}));
}

uint32_t vertexCountOf(const MeshTensors& mesh) { return static_cast<uint32_t>(mesh.vertexCount); }

// Sum of the first n numbers of x, always added up in the same order. Result [].
Tensor sum(Graph& graph, const Tensor& x, uint32_t n) {
    Tensor y = graph.temporary({});
    sumAxis(graph, x, 1, n, 1, y);
    return y;
}

MeshTensors meshOf(OpCall& c) {
    int64_t vertices = c["verts"].dim(0);
    if (vertices < 1) throwInput("verts: expected one vertex or more, found none");
    return meshTensors(c.graph, meshTopology(c.ints("faces"), vertices, "faces"));
}

}  // namespace

Tensor vertexNormals(Graph& graph, const Tensor& verts, const MeshTensors& mesh) {
    checkVerts(verts, mesh);
    uint32_t vertices = vertexCountOf(mesh);
    MeshParams params{vertices, 1};
    Tensor normals = graph.temporary(verts.shape), scales = graph.temporary({vertices});
    graph.beginOp("vertex_normals");
    graph.dispatch("mesh/normals.forward",
                   {{"verts", verts},
                    {"cornerBegin", mesh.cornerBegin},
                    {"corners", mesh.corners},
                    {"normals", normals},
                    {"scales", scales}},
                   params, vertices);
    graph.differentiate({verts}, {normals}, [=, &graph] {
        Tensor dsums = graph.temporary(verts.shape);
        graph.dispatch(
            "mesh/normals.backward_sum",
            {{"y", normals}, {"dy", graph.gradient(normals)}, {"scales", scales}, {"dsums", dsums}},
            params, vertices);
        graph.dispatch("mesh/corner_gradient.from_vertices",
                       {{"verts", verts},
                        {"cornerBegin", mesh.cornerBegin},
                        {"corners", mesh.corners},
                        {"dvertexSums", dsums},
                        {"dverts", graph.gradientTarget(verts)}},
                       params, vertices);
    });
    return normals;
}

Tensor laplacianLoss(Graph& graph, const Tensor& verts, const MeshTensors& mesh) {
    checkVerts(verts, mesh);
    uint32_t vertices = vertexCountOf(mesh);
    MeshParams params{vertices, 1.0f / static_cast<float>(vertices)};
    Tensor lengths = graph.temporary({vertices}), units = graph.temporary(verts.shape);
    graph.beginOp("laplacian_loss");
    graph.dispatch("mesh/laplacian.forward",
                   {{"verts", verts},
                    {"neighbourBegin", mesh.neighbourBegin},
                    {"neighbours", mesh.neighbours},
                    {"lengths", lengths},
                    {"units", units}},
                   params, vertices);
    Tensor loss = sum(graph, lengths, vertices);
    graph.differentiate({verts}, {loss}, [=, &graph] {
        graph.dispatch("mesh/laplacian.backward",
                       {{"neighbourBegin", mesh.neighbourBegin},
                        {"neighbours", mesh.neighbours},
                        {"units", units},
                        {"dloss", graph.gradient(loss)},
                        {"dverts", graph.gradientTarget(verts)}},
                       params, vertices);
    });
    return loss;
}

Tensor normalConsistencyLoss(Graph& graph, const Tensor& verts, const MeshTensors& mesh) {
    checkVerts(verts, mesh);
    auto faces = static_cast<uint32_t>(mesh.faceCount);
    MeshParams params{faces, mesh.pairCount > 0 ? 1.0f / static_cast<float>(mesh.pairCount) : 0.0f};
    uint32_t rows = std::max(faces, 1u);  // a buffer is never empty
    Tensor units = graph.temporary({rows, 4}), terms = graph.temporary({rows});
    graph.beginOp("normal_consistency_loss");
    graph.dispatch("mesh/consistency.normals",
                   {{"verts", verts}, {"faces", mesh.faces}, {"units", units}}, params, faces);
    graph.dispatch("mesh/consistency.forward",
                   {{"units", units},
                    {"pairBegin", mesh.pairBegin},
                    {"pairFaces", mesh.pairFaces},
                    {"terms", terms}},
                   params, faces);
    Tensor loss = sum(graph, terms, faces);
    graph.differentiate({verts}, {loss}, [=, &graph] {
        Tensor dfaces = graph.temporary({rows, 3});
        graph.dispatch("mesh/consistency.backward",
                       {{"units", units},
                        {"pairBegin", mesh.pairBegin},
                        {"pairFaces", mesh.pairFaces},
                        {"dloss", graph.gradient(loss)},
                        {"dfaces", dfaces}},
                       params, faces);
        graph.dispatch("mesh/corner_gradient.from_faces",
                       {{"verts", verts},
                        {"cornerBegin", mesh.cornerBegin},
                        {"corners", mesh.corners},
                        {"dfaces", dfaces},
                        {"dverts", graph.gradientTarget(verts)}},
                       MeshParams{vertexCountOf(mesh), 1}, vertexCountOf(mesh));
    });
    return loss;
}

Tensor offsetClamp(Graph& graph, const Tensor& verts, const Tensor& offset, const Tensor& limit) {
    auto vertices = static_cast<uint32_t>(verts.dim(0));
    CHECK(verts.shape == Shape({vertices, 3}) && offset.shape == verts.shape &&
              limit.elements() == vertices,
          "verts and offset have the shape [V,3], limit [V]");
    MeshParams params{vertices, 1};
    Tensor y = graph.temporary(verts.shape);
    graph.beginOp("offset_clamp");
    graph.dispatch("mesh/offset_clamp.forward",
                   {{"verts", verts}, {"offset", offset}, {"limit", limit}, {"y", y}}, params,
                   vertices);
    graph.differentiate({verts, offset}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        if (graph.wantsGradient(offset))
            graph.dispatch("mesh/offset_clamp.backward",
                           {{"offset", offset},
                            {"limit", limit},
                            {"dy", dy},
                            {"doffset", graph.gradientTarget(offset)}},
                           params, vertices);
        if (graph.wantsGradient(verts)) graph.copy(dy, graph.gradientTarget(verts));
    });
    return y;
}

static const Op kVertexNormals{{
    .name = "vertex_normals",
    .inputs = "verts[V,3] faces:i32[F,3]",
    .outputs = "normals",
    .differentiable = "verts",
    .build = [](OpCall& c) { c.result("normals", vertexNormals(c.graph, c["verts"], meshOf(c))); },
}};

static const Op kLaplacianLoss{{
    .name = "laplacian_loss",
    .inputs = "verts[V,3] faces:i32[F,3]",
    .outputs = "loss",
    .differentiable = "verts",
    .build = [](OpCall& c) { c.result("loss", laplacianLoss(c.graph, c["verts"], meshOf(c))); },
}};

static const Op kNormalConsistencyLoss{{
    .name = "normal_consistency_loss",
    .inputs = "verts[V,3] faces:i32[F,3]",
    .outputs = "loss",
    .differentiable = "verts",
    .build =
        [](OpCall& c) { c.result("loss", normalConsistencyLoss(c.graph, c["verts"], meshOf(c))); },
}};

static const Op kOffsetClamp{{
    .name = "offset_clamp",
    .inputs = "verts[V,3] offset[V,3] limit[V]",
    .outputs = "y",
    .differentiable = "verts offset",
    .build =
        [](OpCall& c) { c.result("y", offsetClamp(c.graph, c["verts"], c["offset"], c["limit"])); },
}};

}  // namespace doppel
