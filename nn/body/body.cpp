#include "nn/body/body.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/error.h"
#include "nn/body/body_atlas.h"
#include "nn/body/joint.h"
#include "nn/body/mesh_topology.h"

namespace doppel {

namespace {

constexpr int64_t kMaxVertices = 1'000'000, kMaxFaces = 2'000'000;

// Of SMPL's 24 joints, the part that their skin belongs to.
constexpr std::array<uint8_t, BodyModel::kJoints> kPartOfJoint = {
    kTorso,       kLeftThigh,    kRightThigh, kTorso,     kLeftCalf,     kRightCalf,
    kTorso,       kLeftFoot,     kRightFoot,  kTorso,     kLeftFoot,     kRightFoot,
    kHead,        kTorso,        kTorso,      kHead,      kLeftUpperArm, kRightUpperArm,
    kLeftForearm, kRightForearm, kLeftHand,   kRightHand, kLeftHand,     kRightHand};

// Reads arrays of one file and says in one line what is wrong with them.
struct Reader {
    const Npz& arrays;

    std::string where(std::string_view name) const {
        return fmt::format("{}: {}", arrays.file.empty() ? "body model" : arrays.file, name);
    }
    const Array* find(std::string_view name) const { return arrays.find(name); }
    const Array& need(std::string_view name) const {
        const Array* array = find(name);
        if (!array)
            throwInput(
                "{} is missing; a body model has v_template, f, shapedirs, weights, "
                "J_regressor and kintree_table",
                where(name));
        return *array;
    }
    std::vector<float> numbers(std::string_view name, std::initializer_list<int64_t> shape) const {
        const Array& array = need(name).requireShape(shape, where(name));
        if (!array.isNumber())
            throwInput("{}: expected numbers, found {}", where(name), dtypeName(array.dtype));
        std::vector<float> values = array.toF32(where(name));
        for (size_t i = 0; i < values.size(); ++i)
            if (!std::isfinite(values[i]))
                throwInput("{}: element {} is {}; expected finite numbers", where(name), i,
                           values[i]);
        return values;
    }
    // Whole numbers in [0, end).
    std::vector<int32_t> indices(std::string_view name, std::initializer_list<int64_t> shape,
                                 int64_t end) const {
        std::vector<int32_t> result;
        for (int64_t value : need(name).requireShape(shape, where(name)).toI64(where(name))) {
            if (value < 0 || value >= end)
                throwInput("{}: element {} is {}; expected 0 to {}", where(name), result.size(),
                           value, end - 1);
            result.push_back(static_cast<int32_t>(value));
        }
        return result;
    }
    std::vector<uint8_t> labels(std::string_view name, int64_t vertexCount, int64_t end) const {
        std::vector<int32_t> values = indices(name, {vertexCount}, end);
        return {values.begin(), values.end()};
    }
    // Rows of weights that make an average: they sum to one.
    void checkRows(std::string_view name, const std::vector<float>& values, size_t columns,
                   double tolerance) const {
        for (size_t row = 0; row * columns < values.size(); ++row) {
            double sum = 0;
            for (size_t i = 0; i < columns; ++i)
                sum += static_cast<double>(values[row * columns + i]);
            if (!(std::abs(sum - 1) <= tolerance))
                throwInput("{}: row {} sums to {:.6g}; expected 1", where(name), row, sum);
        }
    }
};

std::vector<uint8_t> partsFromWeights(const BodyModel& body) {
    std::vector<uint8_t> part;
    for (auto row = body.weights.begin(); row != body.weights.end(); row += BodyModel::kJoints)
        part.push_back(kPartOfJoint[size_t(std::max_element(row, row + BodyModel::kJoints) - row)]);
    return part;
}

// The front of the head below the hairline: where the head joint dominates, before the middle
// of these vertices and in the lower four fifths of their height.
std::vector<uint8_t> faceFromWeights(const BodyModel& body) {
    std::vector<size_t> head;
    double depth = 0, low = INFINITY, high = -INFINITY;
    for (size_t v = 0; v < body.part.size(); ++v) {
        const float* row = &body.weights[v * BodyModel::kJoints];
        if (std::max_element(row, row + BodyModel::kJoints) - row != joint::kHead) continue;
        head.push_back(v);
        auto y = static_cast<double>(body.templateVertices[3 * v + 1]);
        depth += static_cast<double>(body.templateVertices[3 * v + 2]);
        low = std::min(low, y);
        high = std::max(high, y);
    }
    std::vector<uint8_t> face(body.part.size());
    for (size_t v : head)
        face[v] = static_cast<double>(body.templateVertices[3 * v + 2]) >
                      depth / static_cast<double>(head.size()) &&
                  static_cast<double>(body.templateVertices[3 * v + 1]) < low + 0.8 * (high - low);
    return face;
}

// Vertices of the feet that look down and are within 3 cm of the ground.
std::vector<uint8_t> solesFromTemplate(const BodyModel& body) {
    const std::vector<float>& x = body.templateVertices;
    std::vector<double> normals(x.size());
    for (size_t f = 0; f < body.faces.size(); f += 3) {
        std::array<size_t, 3> corner;
        for (size_t i = 0; i < 3; ++i) corner[i] = size_t(body.faces[f + i]) * 3;
        auto side = [&](size_t to, size_t axis) {
            return static_cast<double>(x[corner[to] + axis]) -
                   static_cast<double>(x[corner[0] + axis]);
        };
        for (size_t axis = 0; axis < 3; ++axis) {
            size_t a = (axis + 1) % 3, b = (axis + 2) % 3;
            double cross = side(1, a) * side(2, b) - side(1, b) * side(2, a);
            for (size_t c : corner) normals[c + axis] += cross;
        }
    }
    float ground = INFINITY;
    for (size_t v = 0; v < body.part.size(); ++v) ground = std::min(ground, x[3 * v + 1]);
    std::vector<uint8_t> sole(body.part.size());
    for (size_t v = 0; v < body.part.size(); ++v) {
        const double* n = &normals[3 * v];
        double length = std::hypot(n[0], n[1], n[2]);
        sole[v] = (body.part[v] == kLeftFoot || body.part[v] == kRightFoot) &&
                  n[1] < -0.5 * length && x[3 * v + 1] < ground + 0.03f;
    }
    return sole;
}

// How much of a body with a cap is the model. What is the model's names nothing of the cap.
void readModelSize(const Reader& in, BodyModel& body) {
    const std::array<int64_t, 3> all = {body.vertexCount, body.faceCount, body.uvCount};
    const std::vector<int64_t> sizes = in.need("model_size")
                                           .requireShape({3}, in.where("model_size"))
                                           .toI64(in.where("model_size"));
    for (size_t i = 0; i < 3; ++i)
        if (sizes[i] < 1 || sizes[i] > all[i])
            throwInput("{}: element {} is {}; expected 1 to {}", in.where("model_size"), i,
                       sizes[i], all[i]);
    for (int64_t i = 0; i < 3 * sizes[1]; ++i)
        if (body.faces[size_t(i)] >= sizes[0] || body.uvFaces[size_t(i)] >= sizes[2])
            throwInput("{}: expected faces of the model to name its own vertices, found face {}",
                       in.where("model_size"), i / 3);
    body.modelVertices = sizes[0];
    body.modelFaces = sizes[1];
    body.modelUvs = sizes[2];
}

}  // namespace

SparseMatrix matrixOf(const SurfacePoints& points, int64_t vertexCount) {
    SparseMatrix matrix;
    matrix.columns = vertexCount;
    for (size_t k = 0; k < points.corners.size(); ++k) {
        matrix.add(points.corners[k], points.weights[k]);
        if (k % 3 == 2) matrix.endRow();
    }
    return matrix;
}

std::vector<float> BodyModel::restVertices() const {
    std::vector<float> rest = templateVertices;
    for (size_t i = 0; i < offsets.size(); ++i) rest[i] += offsets[i];
    return rest;
}

void checkParents(std::span<const int32_t> parents, std::string_view where) {
    for (size_t j = 0; j < parents.size(); ++j) {
        bool fits =
            j == 0 ? parents[j] < 0 : parents[j] >= 0 && parents[j] < static_cast<int32_t>(j);
        if (!fits)
            throwInput("{}: joint {} has the parent {}; expected {}", where, j, parents[j],
                       j == 0 ? "-1" : fmt::format("0 to {}", j - 1));
    }
}

BodyModel bodyFromNpz(const Npz& arrays) {
    Reader in{arrays};
    BodyModel body;
    body.file = arrays.file;
    constexpr int64_t kJoints = BodyModel::kJoints, kShapes = BodyModel::kShapes;

    body.templateVertices = in.numbers("v_template", {-1, 3});
    body.vertexCount = static_cast<int64_t>(body.templateVertices.size() / 3);
    if (body.vertexCount < 3 || body.vertexCount > kMaxVertices)
        throwInput("{}: expected 3 to {} vertices, found {}", in.where("v_template"), kMaxVertices,
                   body.vertexCount);
    for (float x : body.templateVertices)
        if (std::abs(x) > 10)
            throwInput("{}: a vertex is {:.4g} from the origin; expected metres, at most 10",
                       in.where("v_template"), x);
    body.faces = in.indices("f", {-1, 3}, body.vertexCount);
    body.faceCount = static_cast<int64_t>(body.faces.size() / 3);
    if (body.faceCount < 1 || body.faceCount > kMaxFaces)
        throwInput("{}: expected 1 to {} faces, found {}", in.where("f"), kMaxFaces,
                   body.faceCount);
    for (size_t f = 0; f < body.faces.size(); f += 3)
        if (body.faces[f] == body.faces[f + 1] || body.faces[f + 1] == body.faces[f + 2] ||
            body.faces[f + 2] == body.faces[f])
            throwInput("{}: face {} names a vertex twice", in.where("f"), f / 3);

    // SMPL's files come with 10 or 300 directions, strongest first.
    const Array& shapes = in.need("shapedirs");
    if (shapes.shape.size() != 3 || shapes.shape[0] != body.vertexCount || shapes.shape[1] != 3 ||
        shapes.shape[2] < kShapes)
        throwInput("{}: expected shape [{}, 3, 10] or more than 10, found {}",
                   in.where("shapedirs"), body.vertexCount, shapes.shapeText());
    int64_t given = shapes.shape[2];
    std::vector<float> directions = in.numbers("shapedirs", {body.vertexCount, 3, given});
    for (int64_t row = 0; row < 3 * body.vertexCount; ++row)
        body.shapeDirections.insert(body.shapeDirections.end(), &directions[size_t(row * given)],
                                    &directions[size_t(row * given)] + kShapes);

    body.weights = in.numbers("weights", {body.vertexCount, kJoints});
    for (size_t i = 0; i < body.weights.size(); ++i)
        if (body.weights[i] < 0)
            throwInput("{}: row {} has the weight {}; expected 0 or more", in.where("weights"),
                       i / size_t{kJoints}, body.weights[i]);
    in.checkRows("weights", body.weights, size_t{kJoints}, 1e-3);
    body.jointRegressor = in.numbers("J_regressor", {kJoints, body.vertexCount});
    in.checkRows("J_regressor", body.jointRegressor, size_t(body.vertexCount), 1e-2);

    // SMPL's root has the parent 2^32 - 1, some copies write -1.
    std::vector<int64_t> tree = in.need("kintree_table")
                                    .requireShape({2, kJoints}, in.where("kintree_table"))
                                    .toI64(in.where("kintree_table"));
    if (tree[0] == 0xffffffffLL) tree[0] = -1;
    for (size_t j = 0; j < size_t{kJoints}; ++j) {
        if (tree[j] < -1 || tree[j] >= kJoints)
            throwInput("{}: joint {} has the parent {}; expected -1 to 23",
                       in.where("kintree_table"), j, tree[j]);
        if (tree[size_t{kJoints} + j] != static_cast<int64_t>(j))
            throwInput("{}: row 1 has {} at place {}; expected {}", in.where("kintree_table"),
                       tree[size_t{kJoints} + j], j, j);
        body.parents.push_back(static_cast<int32_t>(tree[j]));
    }
    checkParents(body.parents, in.where("kintree_table"));

    if (in.find("offsets")) {
        body.offsets = in.numbers("offsets", {body.vertexCount, 3});
        for (float x : body.offsets)
            if (std::abs(x) > 10)
                throwInput("{}: an offset of {:.4g}; expected metres, at most 10",
                           in.where("offsets"), x);
    }
    if (in.find("posedirs"))
        body.poseDirections =
            in.numbers("posedirs", {body.vertexCount, 3, BodyModel::kPoseFeatures});

    body.part = in.find("part") ? in.labels("part", body.vertexCount, kBodyPartEnd)
                                : partsFromWeights(body);
    body.face =
        in.find("face_mask") ? in.labels("face_mask", body.vertexCount, 2) : faceFromWeights(body);
    body.sole = in.find("sole_mask") ? in.labels("sole_mask", body.vertexCount, 2)
                                     : solesFromTemplate(body);
    if (in.find("face_points") || in.find("face_point_weights") || in.find("face_point_trust")) {
        constexpr auto kPoints = static_cast<int64_t>(kFacePoints);
        body.facePoints = {in.indices("face_points", {kPoints, 3}, body.vertexCount),
                           in.numbers("face_point_weights", {kPoints, 3}),
                           in.numbers("face_point_trust", {kPoints})};
        in.checkRows("face_point_weights", body.facePoints.weights, 3, 1e-3);
        for (size_t i = 0; i < kFacePoints; ++i)
            if (!(body.facePoints.trust[i] >= 0 && body.facePoints.trust[i] <= 1))
                throwInput("{}: element {} is {}; expected 0 to 1", in.where("face_point_trust"), i,
                           body.facePoints.trust[i]);
    }
    if (in.find("vt") || in.find("ft")) {
        body.uvs = in.numbers("vt", {-1, 2});
        body.uvCount = static_cast<int64_t>(body.uvs.size() / 2);
        for (size_t i = 0; i < body.uvs.size(); ++i)
            if (body.uvs[i] < 0 || body.uvs[i] > 1)
                throwInput("{}: row {} has {}; expected 0 to 1", in.where("vt"), i / 2,
                           body.uvs[i]);
        body.uvFaces = in.indices("ft", {body.faceCount, 3}, body.uvCount);
    } else {
        Atlas atlas = makeAtlas(body.templateVertices, body.faces, body.part);
        body.uvs = std::move(atlas.uvs);
        body.uvFaces = std::move(atlas.uvFaces);
        body.uvCount = static_cast<int64_t>(body.uvs.size() / 2);
    }
    body.modelVertices = body.vertexCount;
    body.modelFaces = body.faceCount;
    body.modelUvs = body.uvCount;
    if (in.find("model_size")) readModelSize(in, body);
    return body;
}

std::vector<double> shapedVertices(const BodyModel& body, std::span<const double> beta) {
    CHECK(beta.size() == BodyModel::kShapes, "beta has ten numbers");
    const std::vector<float> rest = body.restVertices();
    std::vector<double> shaped(rest.begin(), rest.end());
    for (size_t i = 0; i < shaped.size(); ++i)
        for (size_t k = 0; k < beta.size(); ++k)
            shaped[i] += beta[k] * static_cast<double>(body.shapeDirections[i * beta.size() + k]);
    return shaped;
}

std::vector<double> restJoints(const BodyModel& body, std::span<const double> beta) {
    std::vector<double> shaped = shapedVertices(body, beta);
    size_t vertices = body.part.size();
    std::vector<double> joints(3 * size_t{BodyModel::kJoints});
    for (size_t j = 0; j < joints.size() / 3; ++j)
        for (size_t v = 0; v < vertices; ++v) {
            auto weight = static_cast<double>(body.jointRegressor[j * vertices + v]);
            for (size_t axis = 0; axis < 3; ++axis)
                joints[3 * j + axis] += weight * shaped[3 * v + axis];
        }
    return joints;
}

std::vector<float> clampBounds(const BodyModel& body, ClampBounds source) {
    if (source == ClampBounds::None) return std::vector<float>(body.part.size(), 1.0f);
    bool paper = source == ClampBounds::Paper;
    std::array<float, kBodyPartEnd> bounds{};  // K by body part, m
    bounds[kHead] = 0.04f;
    bounds[kTorso] = 0.06f;
    bounds[kLeftUpperArm] = bounds[kRightUpperArm] = paper ? 0.02f : 0.04f;
    bounds[kLeftForearm] = bounds[kRightForearm] = paper ? 0.04f : 0.02f;
    bounds[kLeftThigh] = bounds[kRightThigh] = 0.04f;
    bounds[kLeftCalf] = bounds[kRightCalf] = 0.03f;
    bounds[kLeftFoot] = bounds[kRightFoot] = 0.02f;
    // Hands: 0 in the paper; .01 in the program, whose anchors then freeze all of them.
    std::vector<float> result;
    for (size_t v = 0; v < body.part.size(); ++v)
        result.push_back(body.face[v] || body.sole[v] ? 0 : bounds[body.part[v]]);
    return result;
}

std::vector<float> handShares(const BodyModel& body) {
    std::vector<float> result;
    for (size_t v = 0; v < static_cast<size_t>(body.vertexCount); ++v) {
        float held = 0;
        for (size_t j :
             {joint::kLeftWrist, joint::kRightWrist, joint::kLeftHand, joint::kRightHand})
            held += body.weights[kJointCount * v + j];
        result.push_back(std::min(held, 1.f));
    }
    return result;
}

std::vector<float> faceShares(const BodyModel& body) {
    constexpr int kRings = 4;
    std::vector<float> shares(static_cast<size_t>(body.vertexCount));
    for (size_t v = 0; v < body.face.size(); ++v) shares[v] = body.face[v] ? 1.f : 0.f;
    for (int ring = 1; ring <= kRings; ++ring) {
        const float share = 1 - static_cast<float>(ring) / (kRings + 1);
        const std::vector<float> before = shares;
        for (size_t f = 0; f < body.faces.size(); f += 3) {
            float most = 0;
            for (size_t k = 0; k < 3; ++k)
                most = std::max(most, before[static_cast<size_t>(body.faces[f + k])]);
            for (size_t k = 0; k < 3; ++k) {
                float& own = shares[static_cast<size_t>(body.faces[f + k])];
                if (most > share) own = std::max(own, share);
            }
        }
    }
    return shares;
}

std::vector<float> surfaceStiffness(const BodyModel& body, double hands, double face) {
    std::vector<float> result = handShares(body);
    const std::vector<float> faces = faceShares(body);
    for (size_t v = 0; v < result.size(); ++v)
        result[v] =
            static_cast<float>(1 + (hands - 1) * double{result[v]} + (face - 1) * double{faces[v]});
    return result;
}

}  // namespace doppel
