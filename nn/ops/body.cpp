#include "nn/ops/body.h"

#include <algorithm>

#include "body/params.h"
#include "engine/files/numbers.h"
#include "nn/body/mesh_topology.h"
#include "nn/core/op.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

constexpr int64_t kJoints = BodyModel::kJoints, kShapes = BodyModel::kShapes;
constexpr int64_t kPoseFeatures = BodyModel::kPoseFeatures;

uint32_t chunksOf(int64_t rows) { return u32((rows + kBodyChunk - 1) / kBodyChunk); }

// Sums over the rows of [rows,columns].
Tensor sumRows(Graph& graph, const Tensor& x, int64_t rows, int64_t columns) {
    Tensor y = graph.temporary({columns});
    sumAxis(graph, x, 1, rows, columns, y);
    return y;
}

// Fills in the lists of weights by joint. `joints` [V,influences]; entries for which `keep` is
// false are left out.
void addEntries(Graph& graph, LbsModel& model, const std::vector<int32_t>& joints,
                const std::function<bool(size_t)>& keep) {
    std::vector<std::vector<int32_t>> byJoint(static_cast<size_t>(kJoints));
    for (size_t i = 0; i < joints.size(); ++i)
        if (keep(i)) byJoint[size_t(joints[i])].push_back(static_cast<int32_t>(i));
    std::vector<int32_t> entries, chunkBegin{0}, jointChunks{0};
    for (const std::vector<int32_t>& list : byJoint) {
        for (size_t i = 0; i < list.size(); ++i) {
            entries.push_back(list[i]);
            if (i + 1 == list.size() || (i + 1) % kBodyChunk == 0)
                chunkBegin.push_back(static_cast<int32_t>(entries.size()));
        }
        jointChunks.push_back(static_cast<int32_t>(chunkBegin.size() - 1));
    }
    model.entryChunks = u32(chunkBegin.size() - 1);
    model.weightJoints =
        graph.constant(std::span<const int32_t>(joints), {model.vertexCount, model.influences});
    model.entries = listConstant(graph, entries);
    model.chunkBegin = listConstant(graph, chunkBegin);
    model.jointChunks = listConstant(graph, jointChunks);
}

// Fills in the regressor's structure. columns: the vertices of each joint's numbers.
void addRegressor(Graph& graph, LbsModel& model, const std::vector<std::vector<int32_t>>& columns) {
    std::vector<int32_t> begin{0}, vertices;
    std::vector<std::vector<int32_t>> byVertex(static_cast<size_t>(model.vertexCount));
    for (size_t joint = 0; joint < columns.size(); ++joint) {
        for (int32_t vertex : columns[joint]) {
            byVertex[size_t(vertex)].insert(
                byVertex[size_t(vertex)].end(),
                {static_cast<int32_t>(joint), static_cast<int32_t>(vertices.size())});
            vertices.push_back(vertex);
        }
        begin.push_back(static_cast<int32_t>(vertices.size()));
    }
    std::vector<int32_t> vertexBegin{0}, vertexEntries;
    for (const std::vector<int32_t>& list : byVertex) {
        vertexEntries.insert(vertexEntries.end(), list.begin(), list.end());
        vertexBegin.push_back(static_cast<int32_t>(vertexEntries.size() / 2));
    }
    model.jointBegin = listConstant(graph, begin);
    model.jointVertices = listConstant(graph, vertices);
    model.vertexBegin = listConstant(graph, vertexBegin);
    model.vertexEntries = listConstant(graph, vertexEntries);
}

// What poseBody() makes besides its result, for gradients.
struct Posing {
    Tensor world, transforms;  // [24,3,4]
    Tensor features;           // [207]
    Tensor posed;              // [V,3] in rest pose, all blend shapes added
    PosedBody body;
};

Posing posing(Graph& graph, const LbsModel& model, const ShapedBody& shaped, const Tensor& theta,
              const Tensor& trans, const ListedRows& rows) {
    auto vertices = u32(model.vertexCount);
    BodyParams params{vertices, model.influences, 0};
    Shape shape = shaped.verts.shape;
    bool blends = static_cast<bool>(model.poseDirections);
    Posing p{.world = graph.temporary({kJoints, 3, 4}),
             .transforms = graph.temporary({kJoints, 3, 4}),
             .features = graph.temporary({kPoseFeatures}),
             .posed = blends ? graph.temporary(shape) : shaped.verts,
             .body = {graph.temporary(shape), graph.temporary({kJoints, 3})}};
    graph.dispatch("body/pose.forward",
                   {{"theta", theta},
                    {"rest", shaped.joints},
                    {"parents", model.parents},
                    {"trans", trans},
                    {"world", p.world},
                    {"transforms", p.transforms},
                    {"joints", p.body.joints},
                    {"features", p.features}},
                   params, 1, {{"local_size", 1}});
    if (blends)
        graph.dispatch("body/pose_blend.forward",
                       {{"poseDirections", model.poseDirections},
                        {"features", p.features},
                        {"shaped", shaped.verts},
                        {"posed", p.posed}},
                       params, uint64_t{vertices} * 3);
    dispatchRows(graph, "body/skin.forward", rows,
                 {{"posed", p.posed},
                  {"weights", model.weights},
                  {"weightJoints", model.weightJoints},
                  {"transforms", p.transforms},
                  {"trans", trans},
                  {"verts", p.body.verts},
                  {"listed", rows.list(graph)}},
                 params, vertices);
    if (rows) graph.keep(p.body.verts);
    return p;
}

ShapedBody shaping(Graph& graph, const LbsModel& model, const Tensor& templateVerts,
                   const Tensor& beta) {
    CHECK(templateVerts.shape == Shape({model.vertexCount, 3}), "the template has the body's {}",
          toString({model.vertexCount, 3}));
    auto vertices = u32(model.vertexCount);
    BodyParams params{vertices, model.influences, 0};
    ShapedBody shaped{graph.temporary(templateVerts.shape), graph.temporary({kJoints, 3})};
    graph.dispatch("body/shape.forward",
                   {{"templateVerts", templateVerts},
                    {"directionPairs", model.shapeDirections},
                    {"betaPairs", beta},
                    {"shaped", shaped.verts}},
                   params, vertices);
    graph.dispatch("body/regress.forward",
                   {{"regressor", model.regressor},
                    {"jointBegin", model.jointBegin},
                    {"jointVertices", model.jointVertices},
                    {"shaped", shaped.verts},
                    {"rest", shaped.joints}},
                   params, uint64_t{3 * kJoints});
    return shaped;
}

}  // namespace

ShapedBody shapeBody(Graph& graph, const LbsModel& model, const Tensor& templateVerts,
                     const Tensor& beta) {
    graph.beginOp("shape");
    return shaping(graph, model, templateVerts, beta);
}

PosedBody poseBody(Graph& graph, const LbsModel& model, const ShapedBody& shaped,
                   const Tensor& theta, const Tensor& trans, const ListedRows& rows) {
    graph.beginOp("lbs");
    return posing(graph, model, shaped, theta, trans, rows).body;
}

LbsModel lbsModel(Graph& graph, const BodyModel& body) {
    LbsModel model;
    model.vertexCount = body.vertexCount;
    auto vertices = static_cast<size_t>(body.vertexCount), joints = static_cast<size_t>(kJoints);
    model.shapeDirections = graph.constant(body.shapeDirections, {body.vertexCount, 3, kShapes});
    if (!body.poseDirections.empty())
        model.poseDirections =
            graph.constant(body.poseDirections, {body.vertexCount, 3, kPoseFeatures});

    size_t influences = 1;
    auto isThere = [](float number) { return number != 0; };
    for (size_t v = 0; v < vertices; ++v)
        influences =
            std::max(influences,
                     static_cast<size_t>(std::count_if(
                         &body.weights[v * joints], &body.weights[v * joints] + joints, isThere)));
    std::vector<float> weights(vertices * influences);
    std::vector<int32_t> weightJoints(vertices * influences);
    for (size_t v = 0; v < vertices; ++v)
        for (size_t j = 0, k = v * influences; j < joints; ++j)
            if (isThere(body.weights[v * joints + j])) {
                weights[k] = body.weights[v * joints + j];
                weightJoints[k++] = static_cast<int32_t>(j);
            }
    model.influences = u32(influences);
    model.weights = graph.constant(weights, {body.vertexCount, model.influences});
    addEntries(graph, model, weightJoints, [&](size_t i) { return isThere(weights[i]); });

    std::vector<float> regressor;
    std::vector<std::vector<int32_t>> columns(joints);
    for (size_t j = 0; j < joints; ++j)
        for (size_t v = 0; v < vertices; ++v)
            if (isThere(body.jointRegressor[j * vertices + v])) {
                regressor.push_back(body.jointRegressor[j * vertices + v]);
                columns[j].push_back(static_cast<int32_t>(v));
            }
    model.regressor = graph.constant(regressor, {static_cast<int64_t>(regressor.size())});
    addRegressor(graph, model, columns);
    model.parents = listConstant(graph, body.parents);
    return model;
}

PosedBody lbs(Graph& graph, const LbsModel& model, const Tensor& templateVerts, const Tensor& theta,
              const Tensor& beta, const Tensor& trans) {
    CHECK(theta.elements() == 3 * kJoints && beta.elements() == kShapes && trans.elements() == 3,
          "theta has 72 numbers, beta 10, trans 3");
    auto vertices = u32(model.vertexCount);
    BodyParams params{vertices, model.influences, 0};
    bool blends = static_cast<bool>(model.poseDirections);
    graph.beginOp("lbs");
    const ShapedBody shaped = shaping(graph, model, templateVerts, beta);
    const Posing p = posing(graph, model, shaped, theta, trans, {});
    const Tensor rest = shaped.joints, world = p.world, transforms = p.transforms, posed = p.posed;
    const Tensor verts = p.body.verts, joints = p.body.joints;

    graph.differentiate({templateVerts, theta, beta, trans}, {verts, joints}, [=, &graph] {
        Tensor dverts = graph.gradient(verts), djoints = graph.gradient(joints);
        // Through the skin.
        Tensor dposed = graph.temporary({vertices, 3});
        Tensor dtransforms = graph.temporary({kJoints, 3, 4});
        Tensor entrySums = graph.temporary({std::max(model.entryChunks, 1u), 3, 4});
        graph.dispatch("body/skin.backward",
                       {{"weights", model.weights},
                        {"weightJoints", model.weightJoints},
                        {"transforms", transforms},
                        {"dverts", dverts},
                        {"dposed", dposed}},
                       params, vertices);
        BodyParams entryParams = params;
        entryParams.chunks = model.entryChunks;
        graph.dispatch("body/skin.backward_chunks",
                       {{"posed", posed},
                        {"weights", model.weights},
                        {"dverts", dverts},
                        {"entries", model.entries},
                        {"chunkBegin", model.chunkBegin},
                        {"partial", entrySums}},
                       entryParams, std::max(model.entryChunks, 1u));
        graph.dispatch("body/skin.backward_joints",
                       {{"partial", entrySums},
                        {"jointChunks", model.jointChunks},
                        {"dtransforms", dtransforms}},
                       params, uint64_t{3 * kJoints});
        Tensor dvertsSum = sumRows(graph, dverts, vertices, 3);
        // Through the pose blend shapes.
        BodyParams chunkParams = params;
        chunkParams.chunks = chunksOf(vertices);
        Tensor dfeatures;
        if (blends) {
            Tensor partial = graph.temporary({chunkParams.chunks, kPoseFeatures});
            graph.dispatch("body/pose_blend.backward",
                           {{"poseDirections", model.poseDirections},
                            {"dposed", dposed},
                            {"partial", partial}},
                           chunkParams, uint64_t{chunkParams.chunks} * kPoseFeatures);
            dfeatures = sumRows(graph, partial, chunkParams.chunks, kPoseFeatures);
        } else {
            dfeatures = graph.temporary({kPoseFeatures});
            graph.fill(dfeatures);
        }
        // Up the tree.
        Tensor dworld = graph.temporary({kJoints, 3, 4}), drest = graph.temporary({kJoints, 3});
        auto target = [&](const Tensor& input) {
            return graph.wantsGradient(input) ? graph.gradientTarget(input)
                                              : graph.temporary(input.shape);
        };
        graph.dispatch("body/pose_backward.backward",
                       {{"theta", theta},
                        {"rest", rest},
                        {"parents", model.parents},
                        {"world", world},
                        {"dtransforms", dtransforms},
                        {"djoints", djoints},
                        {"dvertsSum", dvertsSum},
                        {"dfeatures", dfeatures},
                        {"dworld", dworld},
                        {"dtheta", target(theta)},
                        {"drest", drest},
                        {"dtrans", target(trans)}},
                       params, 1, {{"local_size", 1}});
        // Through the shape.
        if (!graph.wantsGradient(templateVerts) && !graph.wantsGradient(beta)) return;
        Tensor dshaped = target(templateVerts);
        graph.dispatch("body/shape.backward",
                       {{"dposed", dposed},
                        {"regressor", model.regressor},
                        {"vertexBegin", model.vertexBegin},
                        {"vertexEntries", model.vertexEntries},
                        {"drest", drest},
                        {"dshaped", dshaped}},
                       params, vertices);
        if (!graph.wantsGradient(beta)) return;
        Tensor partial = graph.temporary({chunkParams.chunks, kShapes});
        graph.dispatch("body/shape.backward_beta",
                       {{"shapeDirections", model.shapeDirections},
                        {"dshaped", dshaped},
                        {"partial", partial}},
                       chunkParams, chunkParams.chunks);
        sumAxis(graph, partial, 1, chunkParams.chunks, kShapes, graph.gradientTarget(beta));
    });
    return {verts, joints};
}

Tensor rigidTransform(Graph& graph, const Tensor& verts, const Tensor& rotation,
                      const Tensor& pivot, const Tensor& trans, const ListedRows& rows) {
    CHECK(verts.shape.size() == 2 && verts.dim(1) == 3, "vertices have the shape [V,3]");
    CHECK(rotation.elements() == 3 && pivot.elements() == 3 && trans.elements() == 3,
          "rotation, pivot and trans have three numbers");
    auto vertices = u32(verts.dim(0));
    BodyParams params{vertices, 0, chunksOf(vertices)};
    Tensor y = graph.temporary(verts.shape);
    graph.beginOp("rigid_transform");
    dispatchRows(graph, "body/rigid.forward", rows,
                 {{"verts", verts},
                  {"rotation", rotation},
                  {"pivot", pivot},
                  {"trans", trans},
                  {"y", y},
                  {"listed", rows.list(graph)}},
                 params, vertices);
    if (rows) return graph.keep(y), y;
    graph.differentiate({verts, rotation, pivot, trans}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        if (graph.wantsGradient(verts))
            graph.dispatch(
                "body/rigid.backward",
                {{"rotation", rotation}, {"dy", dy}, {"dverts", graph.gradientTarget(verts)}},
                params, vertices);
        if (!graph.wantsGradient(rotation) && !graph.wantsGradient(pivot) &&
            !graph.wantsGradient(trans))
            return;
        Tensor partial = graph.temporary({params.chunks, 4, 3});
        graph.dispatch("body/rigid.backward_chunks",
                       {{"verts", verts}, {"pivot", pivot}, {"dy", dy}, {"partial", partial}},
                       params, params.chunks);
        Tensor sums = sumRows(graph, partial, params.chunks, 12);
        auto target = [&](const Tensor& input) {
            return graph.wantsGradient(input) ? graph.gradientTarget(input)
                                              : graph.temporary(input.shape);
        };
        graph.dispatch("body/rigid.backward_motion",
                       {{"rotation", rotation},
                        {"sums", sums},
                        {"drotation", target(rotation)},
                        {"dpivot", target(pivot)},
                        {"dtrans", target(trans)}},
                       params, 1, {{"local_size", 1}});
    });
    return y;
}

FingerTensors fingerTensors(Graph& graph, const FingerRig& rig) {
    CHECK(!rig.empty(), "a rig has fingers");
    const auto fingers = static_cast<int64_t>(rig.amounts.size()) / kFingerTurns;
    const auto entries = static_cast<int64_t>(rig.fingers.size());
    return {static_cast<int64_t>(rig.begin.size()) - 1,
            graph.constant(rig.turns, {fingers, kFingerTurns, FingerRig::kTurnNumbers}),
            graph.constant(rig.amounts, {fingers, kFingerTurns}),
            listConstant(graph, rig.begin),
            listConstant(graph, rig.fingers),
            graph.constant(rig.entries, {entries, FingerRig::kEntryNumbers})};
}

Tensor bendFingers(Graph& graph, const Tensor& verts, const Tensor& amounts,
                   const FingerTensors& rig) {
    static_assert(kFingerTurns == FingerRig::kTurns);
    CHECK(verts.shape == Shape({rig.vertexCount, 3}), "the vertices are the rig's {}",
          rig.vertexCount);
    const BendFingersParams params{u32(rig.vertexCount), u32(amounts.elements())};
    Tensor y = graph.temporary(verts.shape);
    graph.beginOp("bend_fingers");
    graph.dispatch("body/bend_fingers.forward",
                   {{"verts", verts},
                    {"amounts", amounts},
                    {"turns", rig.turns},
                    {"turnAmount", rig.amounts},
                    {"begin", rig.begin},
                    {"fingers", rig.fingers},
                    {"entries", rig.entries},
                    {"y", y}},
                   params, params.vertices);
    graph.differentiate({verts, amounts}, {y}, [=, &graph] {
        Tensor terms = graph.temporary({params.vertices, params.amounts});
        Tensor dverts =
            graph.wantsGradient(verts) ? graph.gradientTarget(verts) : graph.temporary(verts.shape);
        graph.dispatch("body/bend_fingers.backward",
                       {{"verts", verts},
                        {"amounts", amounts},
                        {"turns", rig.turns},
                        {"turnAmount", rig.amounts},
                        {"begin", rig.begin},
                        {"fingers", rig.fingers},
                        {"entries", rig.entries},
                        {"dy", graph.gradient(y)},
                        {"dverts", dverts},
                        {"terms", terms}},
                       params, params.vertices);
        if (graph.wantsGradient(amounts))
            sumAxis(graph, terms, 1, params.vertices, params.amounts,
                    graph.gradientTarget(amounts));
    });
    return y;
}

static const Op kLbs{{
    .name = "lbs",
    .inputs = "template[V,3] shapedirs[V,3,10] weights[V,24] joint_regressor[24,V] parents:i32[24] "
              "theta[72] beta[10] trans[3] posedirs[V,3,207]?",
    .outputs = "verts joints",
    .differentiable = "template theta beta trans",
    .build =
        [](OpCall& c) {
            // All weights and the whole regressor, zeros included: their numbers come later.
            LbsModel model;
            model.vertexCount = c["template"].dim(0);
            if (model.vertexCount < 1) throwInput("lbs: template has no vertices");
            auto vertices = static_cast<size_t>(model.vertexCount);
            checkParents(c.ints("parents"), "lbs: parents");
            model.influences = kJoints;
            model.shapeDirections = c["shapedirs"];
            model.poseDirections = c["posedirs"];
            model.weights = c["weights"];
            std::vector<int32_t> joints(vertices * size_t{kJoints});
            for (size_t i = 0; i < joints.size(); ++i)
                joints[i] = static_cast<int32_t>(i % kJoints);
            addEntries(c.graph, model, joints, [](size_t) { return true; });
            std::vector<int32_t> all(vertices);
            for (size_t v = 0; v < vertices; ++v) all[v] = static_cast<int32_t>(v);
            model.regressor = c["joint_regressor"];
            addRegressor(c.graph, model, std::vector<std::vector<int32_t>>(size_t{kJoints}, all));
            model.parents = c["parents"];
            PosedBody posed = lbs(c.graph, model, c["template"], c["theta"], c["beta"], c["trans"]);
            c.result("verts", posed.verts);
            c.result("joints", posed.joints);
        },
}};

static const Op kBendFingers{{
    .name = "bend_fingers",
    .inputs = "verts[V,3] amounts[A] turns[F,4,7] turn_amounts:i32[F,4] begin:i32[B] "
              "fingers:i32[E] entries[E,5]",
    .outputs = "y",
    .differentiable = "verts amounts",
    .build =
        [](OpCall& c) {
            const int64_t V = c["verts"].dim(0), E = c["fingers"].dim(0);
            const auto within = [](const std::vector<int32_t>& values, int64_t end,
                                   const char* what) {
                for (const int32_t value : values)
                    if (value < 0 || value >= end)
                        throwInput("bend_fingers: {} has {}; expected 0 to {}", what, value,
                                   end - 1);
            };
            const std::vector<int32_t> begin = c.ints("begin");
            within(begin, E + 1, "begin");
            if (c["begin"].dim(0) != V + 1 || begin.front() != 0 || begin.back() != E ||
                !std::ranges::is_sorted(begin))
                throwInput("bend_fingers: begin: expected {} numbers that rise from 0 to {}", V + 1,
                           E);
            within(c.ints("fingers"), c["turns"].dim(0), "fingers");
            within(c.ints("turn_amounts"), c["amounts"].dim(0), "turn_amounts");
            c.result("y", bendFingers(c.graph, c["verts"], c["amounts"],
                                      {V, c["turns"], c["turn_amounts"], c["begin"], c["fingers"],
                                       c["entries"]}));
        },
}};

static const Op kRigidTransform{{
    .name = "rigid_transform",
    .inputs = "verts[V,3] rotation[3] pivot[3] trans[3]",
    .outputs = "y",
    .differentiable = "verts rotation pivot trans",
    .build =
        [](OpCall& c) {
            c.result("y",
                     rigidTransform(c.graph, c["verts"], c["rotation"], c["pivot"], c["trans"]));
        },
}};

}  // namespace doppel
