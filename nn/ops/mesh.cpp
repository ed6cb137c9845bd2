#include "nn/ops/mesh.h"

#include <algorithm>

#include "engine/files/numbers.h"
#include "mesh/params.h"
#include "nn/core/op.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

void checkVerts(const Tensor& verts, const MeshTensors& mesh) {
    CHECK(verts.shape == Shape({mesh.vertexCount, 3}), "the mesh has vertices of the shape {}",
          toString({mesh.vertexCount, 3}));
}

uint32_t vertexCountOf(const MeshTensors& mesh) { return u32(mesh.vertexCount); }

// Sum of the first n numbers of x, always added up in the same order. Result [].
Tensor sum(Graph& graph, const Tensor& x, uint32_t n) {
    Tensor y = graph.temporary({});
    sumAxis(graph, x, 1, n, 1, y);
    return y;
}

// Adds what arrives at the faces' sums over their corners, dfaces [F,3], to the gradient of verts.
void cornerGradient(Graph& graph, const Tensor& verts, const MeshTensors& mesh,
                    const Tensor& dfaces) {
    graph.dispatch("mesh/corner_gradient.from_faces",
                   {{"verts", verts},
                    {"cornerBegin", mesh.cornerBegin},
                    {"corners", mesh.corners},
                    {"dfaces", dfaces},
                    {"dverts", graph.gradientTarget(verts)}},
                   MeshParams{vertexCountOf(mesh), 1}, vertexCountOf(mesh));
}

MeshTensors meshOf(OpCall& c) {
    int64_t vertices = c["verts"].dim(0);
    if (vertices < 1) throwInput("verts: expected one vertex or more, found none");
    return meshTensors(c.graph, meshTopology(c.ints("faces"), vertices, "faces"));
}

// [ceil(V/rows), 2H, rows], see graph_panels.comp.
Tensor graphPanels(Graph& graph, const Tensor& x, const AdjacencyTensors& adjacency,
                   const GraphConvWeights& w, const ListedRows& list) {
    int64_t vertices = x.dim(0), H = w.halfColumns;
    int64_t rows = gemmPanelRows(graph.device(), vertices);
    Tensor panels = graph.temporary({(vertices + rows - 1) / rows, 2 * H, rows});
    const bool quads = w.row % 4 == 0, onCpu = graph.device().kernelPath().texels;
    // On CPUs many columns at a time: each piece of a vertex's reads the list of its neighbours for
    // itself.
    int64_t columns = onCpu && quads ? 44 : 4;
    while (H % columns != 0) columns -= 4;
    GraphPanelsParams params{u32(vertices), u32(w.inputs), u32(w.row), u32(H),
                             divisorOf(uint64_t(H / columns))};
    dispatchRows(graph, "mesh/graph_panels.gather", list,
                 {{"x", x},
                  {"quads", x},
                  {"neighbourBegin", adjacency.begin},
                  {"neighbours", adjacency.neighbours},
                  {"panels", panels},
                  {"listed", list.list(graph)}},
                 params, static_cast<uint64_t>((vertices + 1) / 2 * (H / columns)),
                 u32(kRowsListed / 2 * (H / columns)),
                 {{"kRows", u32(rows)}, {"kColumns", u32(columns)}, {"kQuads", quads}});
    return panels;
}

StackParams stackParams(const GraphConvWeights& w, int64_t by) {
    return {u32(w.outputs), u32(w.inputs), u32(w.row), u32(w.halfColumns), divisorOf(uint64_t(by))};
}

void stackWeights(Graph& graph, const GraphConvWeights& w) {
    graph.dispatch("mesh/stack.forward",
                   {{"weight0", w.weight0}, {"weight1", w.weight1}, {"weight", w.weight}},
                   stackParams(w, w.row), static_cast<uint64_t>(w.weight.elements()));
}

// y[V,O] = weight0 x + bias0 + what the neighbours give. With a tail [V,3]: ReLU, and the tail and
// zeros behind it, y[V,rowWithTail(O)].
Tensor convolve(Graph& graph, const Tensor& x, const AdjacencyTensors& adjacency,
                const GraphConvWeights& weights, const Tensor& tail, const ListedRows& rows = {}) {
    int64_t V = x.dim(0), O = weights.outputs, row = tail ? rowWithTail(O) : O;
    CHECK(x.dim(1) == weights.row, "x {} fits weights for rows of {}", toString(x.shape),
          weights.row);
    auto vertices = u32(V);
    AggregateParams params{vertices, u32(O), u32(2 * O), u32(row)};
    bool relu = bool(tail);
    Tensor y = graph.temporary({V, row});
    Gemm product{.m = V,
                 .n = O,
                 .k = 2 * weights.halfColumns,
                 .panelsA = true,
                 .ldc = row,
                 .relu = relu,
                 .rows = rows};
    graph.beginOp("graph_conv", flops(product));
    gemm(graph, graphPanels(graph, x, adjacency, weights, rows), weights.wide, y, product);
    if (tail)
        dispatchRows(graph, "mesh/tail.append", rows,
                     {{"tail", tail}, {"y", y}, {"listed", rows.list(graph)}}, params, vertices);
    if (rows) return graph.keep(y), y;
    std::vector<Tensor> inputs{x, weights.weight, weights.bias};
    if (tail) inputs.push_back(tail);
    graph.differentiate(inputs, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        if (tail && graph.wantsGradient(tail))
            graph.dispatch("mesh/tail.backward",
                           {{"dy", dy}, {"dtail", graph.gradientTarget(tail)}}, params, vertices);
        // dz [V,2O]: what arrives at a vertex, and at its neighbours, for they are mutual.
        Tensor dz = graph.temporary({V, 2 * O});
        AggregateParams perVertex = params;
        const bool quads = O % 4 == 0 && row % 4 == 0;
        // On CPUs many columns at a time, as in graphPanels().
        int64_t columns = quads ? (graph.device().kernelPath().texels ? 32 : 4) : 1;
        while (O % columns != 0) columns -= 4;
        perVertex.byRow = divisorOf(uint64_t(O / columns));
        const uint64_t invocations = uint64_t(V * (O / columns));
        if (quads) {
            const auto each = u32(columns);
            graph.dispatch("mesh/aggregate.backward_own_quads",
                           {{"yQuads", y}, {"dyQuads", dy}, {"dzStored", dz}}, perVertex,
                           invocations, {{"kRelu", relu}, {"kColumns", each}});
            graph.dispatch("mesh/aggregate.backward_neighbours_quads",
                           {{"neighbourBegin", adjacency.begin},
                            {"neighbours", adjacency.neighbours},
                            {"dzQuads", dz},
                            {"dzStored", dz}},
                           perVertex, invocations, {{"kColumns", each}});
        } else {
            graph.dispatch("mesh/aggregate.backward_own", {{"y", y}, {"dy", dy}, {"dz", dz}},
                           perVertex, invocations, {{"kRelu", relu}});
            graph.dispatch("mesh/aggregate.backward_neighbours",
                           {{"neighbourBegin", adjacency.begin},
                            {"neighbours", adjacency.neighbours},
                            {"dz", dz}},
                           perVertex, invocations);
        }
        Tensor largest = largestMagnitude(graph, dz);
        if (graph.wantsGradient(x) && !*weights.stacked) {
            stackWeights(graph, weights);
            *weights.stacked = true;
        }
        if (graph.wantsGradient(x))
            gemm(graph, dz, weights.weight, graph.gradientTarget(x),
                 {.m = V, .n = weights.row, .k = 2 * O, .largestA = largest});
        if (graph.wantsGradient(weights.weight))
            gemm(graph, dz, x, graph.gradientTarget(weights.weight),
                 {.m = 2 * O,
                  .n = weights.row,
                  .k = V,
                  .transA = true,
                  .sums = graph.wantsGradient(weights.bias) ? graph.gradientTarget(weights.bias)
                                                            : Tensor(),
                  .largestA = largest});
        else if (graph.wantsGradient(weights.bias))
            sumAxis(graph, dz, 1, V, 2 * O, graph.gradientTarget(weights.bias));
    });
    return y;
}

}  // namespace

Tensor vertexNormals(Graph& graph, const Tensor& verts, const MeshTensors& mesh,
                     const ListedRows& rows) {
    checkVerts(verts, mesh);
    uint32_t vertices = vertexCountOf(mesh);
    MeshParams params{vertices, 1};
    Tensor normals = graph.temporary(verts.shape), scales = graph.temporary({vertices});
    graph.beginOp("vertex_normals");
    dispatchRows(graph, "mesh/normals.forward", rows,
                 {{"verts", verts},
                  {"cornerBegin", mesh.cornerBegin},
                  {"corners", mesh.corners},
                  {"normals", normals},
                  {"scales", scales},
                  {"listed", rows.list(graph)}},
                 params, vertices);
    if (rows) return graph.keep(normals), normals;
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
                    {"neighbourBegin", mesh.adjacency.begin},
                    {"neighbours", mesh.adjacency.neighbours},
                    {"lengths", lengths},
                    {"units", units}},
                   params, vertices);
    Tensor loss = sum(graph, lengths, vertices);
    graph.differentiate({verts}, {loss}, [=, &graph] {
        graph.dispatch("mesh/laplacian.backward",
                       {{"neighbourBegin", mesh.adjacency.begin},
                        {"neighbours", mesh.adjacency.neighbours},
                        {"units", units},
                        {"dloss", graph.gradient(loss)},
                        {"dverts", graph.gradientTarget(verts)}},
                       params, vertices);
    });
    return loss;
}

Tensor offsetPenalty(Graph& graph, const Tensor& offsets, const Tensor& stiffness,
                     const MeshTensors& mesh, float stay, float smooth) {
    checkVerts(offsets, mesh);
    CHECK(stiffness.elements() == vertexCountOf(mesh), "a vertex has a stiffness");
    const uint32_t vertices = vertexCountOf(mesh);
    const OffsetPenaltyParams params{vertices, 1.0f / static_cast<float>(vertices), stay, smooth};
    Tensor terms = graph.temporary({vertices}), bends = graph.temporary(offsets.shape);
    graph.beginOp("offset_penalty");
    graph.dispatch("mesh/offset_penalty.forward",
                   {{"offsets", offsets},
                    {"neighbourBegin", mesh.adjacency.begin},
                    {"neighbours", mesh.adjacency.neighbours},
                    {"stiffness", stiffness},
                    {"terms", terms},
                    {"bends", bends}},
                   params, vertices);
    Tensor loss = sum(graph, terms, vertices);
    graph.differentiate({offsets}, {loss}, [=, &graph] {
        graph.dispatch("mesh/offset_penalty.backward",
                       {{"offsets", offsets},
                        {"neighbourBegin", mesh.adjacency.begin},
                        {"neighbours", mesh.adjacency.neighbours},
                        {"bends", bends},
                        {"dloss", graph.gradient(loss)},
                        {"doffsets", graph.gradientTarget(offsets)}},
                       params, vertices);
    });
    return loss;
}

Tensor foldPenalty(Graph& graph, const Tensor& verts, const Tensor& reference, const Tensor& weight,
                   const MeshTensors& mesh, float least) {
    checkVerts(verts, mesh);
    checkVerts(reference, mesh);
    CHECK(weight.elements() == mesh.faceCount, "a face has a weight");
    const uint32_t faces = u32(mesh.faceCount), rows = std::max(faces, 1u);
    const FoldPenaltyParams params{faces, least};
    Tensor terms = graph.temporary({rows}), walls = graph.temporary({rows, 4});
    graph.beginOp("fold_penalty");
    graph.dispatch("mesh/fold_penalty.forward",
                   {{"verts", verts},
                    {"reference", reference},
                    {"faces", mesh.faces},
                    {"weight", weight},
                    {"terms", terms},
                    {"walls", walls}},
                   params, faces);
    Tensor loss = sum(graph, terms, faces);
    graph.differentiate({verts}, {loss}, [=, &graph] {
        Tensor dfaces = graph.temporary({rows, 3});
        graph.dispatch("mesh/fold_penalty.backward",
                       {{"walls", walls}, {"dloss", graph.gradient(loss)}, {"dfaces", dfaces}},
                       params, faces);
        cornerGradient(graph, verts, mesh, dfaces);
    });
    return loss;
}

Tensor smoothSolve(Graph& graph, const Tensor& x, const MeshTensors& mesh, float lambda,
                   int iterations) {
    checkVerts(x, mesh);
    CHECK(lambda >= 0 && iterations > 0, "lambda {} and {} iterations smooth", lambda, iterations);
    const double lowest = 1 / (1 + double{lambda} * static_cast<double>(mesh.mostNeighbours));
    const double centre = (2 + lowest) / 2, radius = (2 - lowest) / 2;
    SmoothSolveParams params{vertexCountOf(mesh), lambda, 0, static_cast<float>(1 / centre)};
    Tensor y = graph.temporary(x.shape), residual = graph.temporary(x.shape);
    Tensor step = graph.temporary(x.shape), next = graph.temporary(x.shape);
    graph.beginOp("smooth_solve");
    graph.dispatch("mesh/smooth_solve.start",
                   {{"x", x},
                    {"neighbourBegin", mesh.adjacency.begin},
                    {"y", y},
                    {"residual", residual},
                    {"next", step}},
                   params, params.vertices);
    double before = radius / centre;
    for (int i = 1; i < iterations; ++i) {
        const double now = 1 / (2 * centre / radius - before);
        params.ofStep = static_cast<float>(now * before);
        params.ofResidual = static_cast<float>(2 * now / radius);
        before = now;
        graph.dispatch("mesh/smooth_solve.iterate",
                       {{"neighbourBegin", mesh.adjacency.begin},
                        {"neighbours", mesh.adjacency.neighbours},
                        {"y", y},
                        {"residual", residual},
                        {"step", step},
                        {"next", next}},
                       params, params.vertices);
        std::swap(step, next);
    }
    return y;
}

Tensor normalConsistencyLoss(Graph& graph, const Tensor& verts, const MeshTensors& mesh) {
    checkVerts(verts, mesh);
    auto faces = u32(mesh.faceCount);
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
        cornerGradient(graph, verts, mesh, dfaces);
    });
    return loss;
}

Tensor offsetClamp(Graph& graph, const Tensor& verts, const Tensor& offset, const Tensor& limit,
                   const ListedRows& rows) {
    auto vertices = u32(verts.dim(0));
    CHECK(verts.shape == Shape({vertices, 3}) && offset.shape == verts.shape &&
              limit.elements() == vertices,
          "verts and offset have the shape [V,3], limit [V]");
    MeshParams params{vertices, 1};
    Tensor y = graph.temporary(verts.shape);
    graph.beginOp("offset_clamp");
    dispatchRows(graph, "mesh/offset_clamp.forward", rows,
                 {{"verts", verts},
                  {"offset", offset},
                  {"limit", limit},
                  {"y", y},
                  {"listed", rows.list(graph)}},
                 params, vertices);
    if (rows) return graph.keep(y), y;
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

GraphConvWeights graphConvWeights(Graph& graph, const Tensor& weight0, const Tensor& bias0,
                                  const Tensor& weight1, const Tensor& bias1, int64_t row) {
    int64_t O = weight0.dim(0), I = weight0.dim(1);
    CHECK(row >= I, "rows of {} numbers have the weights' {} columns", row, I);
    CHECK(weight1.shape == weight0.shape && bias0.elements() == O && bias1.elements() == O,
          "both weights have the same shape {}", toString(weight0.shape));
    GraphConvWeights w{.inputs = I, .outputs = O, .row = row};
    // A column for the biases; x's own padding where there is some.
    w.halfColumns = row > I && row % 4 == 0 ? row : (I + 1 + 3) / 4 * 4;
    Tensor weight = w.weight = graph.temporary({2 * O, row});
    Tensor bias = w.bias = graph.temporary({2 * O});
    w.wide = graph.temporary({2 * w.halfColumns, O});
    graph.beginOp("graph_conv.weights");
    graph.dispatch("mesh/stack.side_by_side",
                   {{"weight0", weight0},
                    {"bias0", bias0},
                    {"weight1", weight1},
                    {"bias1", bias1},
                    {"wide", w.wide}},
                   stackParams(w, O), static_cast<uint64_t>(w.wide.elements()));
    w.weight0 = weight0;
    w.weight1 = weight1;
    w.stacked = std::make_shared<bool>(false);
    graph.differentiate({weight0, bias0, weight1, bias1}, {weight, bias}, [=, &graph] {
        auto target = [&](const Tensor& input) {
            return graph.wantsGradient(input) ? graph.gradientTarget(input)
                                              : graph.temporary(input.shape);
        };
        graph.dispatch("mesh/stack.backward",
                       {{"dweight", graph.gradient(weight)},
                        {"dbias", graph.gradient(bias)},
                        {"dweight0", target(weight0)},
                        {"dbias0", target(bias0)},
                        {"dweight1", target(weight1)},
                        {"dbias1", target(bias1)}},
                       stackParams(w, I), static_cast<uint64_t>(O * I));
    });
    return w;
}

Tensor graphConv(Graph& graph, const Tensor& x, const AdjacencyTensors& adjacency,
                 const GraphConvWeights& weights) {
    return convolve(graph, x, adjacency, weights, {});
}

Tensor graphConvLayer(Graph& graph, const Tensor& x, const AdjacencyTensors& adjacency,
                      const GraphConvWeights& weights, const Tensor& tail, const ListedRows& rows) {
    return convolve(graph, x, adjacency, weights, tail, rows);
}

bool graphConvTakesRows(const Device& device, const GraphConvWeights& weights) {
    return gemmTakesRows(device) && weights.row % 4 == 0;
}

Tensor withTail(Graph& graph, const Tensor& x, int64_t columns, const Tensor& tail,
                const ListedRows& rows) {
    CHECK(columns == 0 || (x.dim(0) == tail.dim(0) && columns <= x.dim(1)),
          "x has the columns that are kept, and as many rows as the tail");
    auto vertices = u32(tail.dim(0));
    AggregateParams params{vertices, u32(columns), u32(x ? x.dim(1) : 0), u32(rowWithTail(columns)),
                           divisorOf(uint64_t(rowWithTail(columns) / 4))};
    Tensor y = graph.temporary({vertices, params.row});
    graph.beginOp("with_tail");
    Tensor listed = rows.list(graph);
    if (x && x.dim(1) == params.row && !rows) {
        graph.copy(x, y);
        graph.dispatch("mesh/tail.append", {{"tail", tail}, {"y", y}, {"listed", listed}}, params,
                       vertices);
    } else {
        dispatchRows(graph, "mesh/tail.replace", rows,
                     {{"x", x ? x : tail}, {"tail", tail}, {"y", y}, {"listed", listed}}, params,
                     uint64_t{vertices} * params.row / 4, kRowsListed * params.row / 4);
    }
    if (rows) return graph.keep(y), y;
    graph.differentiate({x, tail}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        if (x && graph.wantsGradient(x)) {
            AggregateParams wide = params;
            wide.byRow = divisorOf(params.xRow);
            graph.dispatch("mesh/tail.backward_replace",
                           {{"dy", dy}, {"dx", graph.gradientTarget(x)}}, wide,
                           uint64_t{vertices} * params.xRow);
        }
        if (graph.wantsGradient(tail))
            graph.dispatch("mesh/tail.backward",
                           {{"dy", dy}, {"dtail", graph.gradientTarget(tail)}}, params, vertices);
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

static const Op kOffsetPenalty{{
    .name = "offset_penalty",
    .inputs = "verts[V,3] stiffness[V] faces:i32[F,3]",
    .attributes = "stay=1 smooth=1",
    .outputs = "loss",
    .differentiable = "verts",
    .build =
        [](OpCall& c) {
            c.result("loss", offsetPenalty(c.graph, c["verts"], c["stiffness"], meshOf(c),
                                           c.f("stay"), c.f("smooth")));
        },
}};

static const Op kFoldPenalty{{
    .name = "fold_penalty",
    .inputs = "verts[V,3] reference[V,3] weight[F] faces:i32[F,3]",
    .attributes = "least=0.25",
    .outputs = "loss",
    .differentiable = "verts",
    .build =
        [](OpCall& c) {
            c.result("loss", foldPenalty(c.graph, c["verts"], c["reference"], c["weight"],
                                         meshOf(c), c.f("least")));
        },
}};

static const Op kSmoothSolve{{
    .name = "smooth_solve",
    .inputs = "verts[V,3] faces:i32[F,3]",
    .attributes = "lambda=10 iterations=32",
    .outputs = "y",
    .build =
        [](OpCall& c) {
            const uint32_t iterations = c.u("iterations");
            if (iterations < 1 || iterations > 10000)
                throwInput("attr_iterations: expected 1 to 10000, found {}", iterations);
            if (c.attribute("lambda") < 0)
                throwInput("attr_lambda: expected 0 or more, found {}", c.attribute("lambda"));
            c.result("y", smoothSolve(c.graph, c["verts"], meshOf(c), c.f("lambda"),
                                      static_cast<int>(iterations)));
        },
}};

static const Op kNormalConsistencyLoss{{
    .name = "normal_consistency_loss",
    .inputs = "verts[V,3] faces:i32[F,3]",
    .outputs = "loss",
    .differentiable = "verts",
    .build =
        [](OpCall& c) { c.result("loss", normalConsistencyLoss(c.graph, c["verts"], meshOf(c))); },
}};

static const Op kGraphConv{{
    .name = "graph_conv",
    .inputs = "x[V,I] edges:i32[E,2] weight0[O,I] bias0[O] weight1[O,I] bias1[O]",
    .outputs = "y",
    .differentiable = "x weight0 bias0 weight1 bias1",
    .build =
        [](OpCall& c) {
            Adjacency edges = adjacency(c.ints("edges"), c["x"].dim(0), "graph_conv: edges");
            GraphConvWeights weights = graphConvWeights(c.graph, c["weight0"], c["bias0"],
                                                        c["weight1"], c["bias1"], c["x"].dim(1));
            c.result("y", graphConv(c.graph, c["x"], adjacencyTensors(c.graph, edges), weights));
        },
}};

// A layer of the mesh refinement: graph_conv, ReLU, the normals behind the features.
static const Op kGraphConvLayer{{
    .name = "graph_conv_layer",
    .inputs = "x[V,R] edges:i32[E,2] weight0[O,I] bias0[O] weight1[O,I] bias1[O] tail[V,3]",
    .outputs = "y",
    .differentiable = "x weight0 bias0 weight1 bias1 tail",
    .build =
        [](OpCall& c) {
            if (c["x"].dim(1) < c["weight0"].dim(1))
                throwInput("graph_conv_layer: x has {} columns; expected weight0's {} or more",
                           c["x"].dim(1), c["weight0"].dim(1));
            Adjacency edges = adjacency(c.ints("edges"), c["x"].dim(0), "graph_conv_layer: edges");
            GraphConvWeights weights = graphConvWeights(c.graph, c["weight0"], c["bias0"],
                                                        c["weight1"], c["bias1"], c["x"].dim(1));
            c.result("y", graphConvLayer(c.graph, c["x"], adjacencyTensors(c.graph, edges), weights,
                                         c["tail"]));
        },
}};

static const Op kWithTail{{
    .name = "with_tail",
    .inputs = "x[V,R] tail[V,3]",
    .attributes = "columns",
    .outputs = "y",
    .differentiable = "x tail",
    .build =
        [](OpCall& c) {
            if (c.u("columns") > c["x"].dim(1))
                throwInput("with_tail: attr_columns is {}; expected at most x's {}", c.u("columns"),
                           c["x"].dim(1));
            c.result("y", withTail(c.graph, c["x"], c.u("columns"), c["tail"]));
        },
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
