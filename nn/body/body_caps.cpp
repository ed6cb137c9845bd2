#include "nn/body/body_caps.h"

#include <algorithm>

#include "engine/error.h"
#include "nn/body/body_atlas.h"

namespace doppel {

namespace {

// [rows, columns...] with more rows behind the last.
template <typename T>
std::vector<T> joined(std::vector<T> first, const std::vector<T>& more) {
    first.insert(first.end(), more.begin(), more.end());
    return first;
}

// The first `rows` of an array.
Array cut(const Array& array, int64_t rows) {
    Array part = array;
    const int64_t all = array.shape.at(0);
    part.bytes.resize(array.bytes.size() / static_cast<size_t>(all) * static_cast<size_t>(rows));
    part.shape[0] = rows;
    return part;
}

}  // namespace

std::optional<Npz> withCap(const Npz& arrays, const BodyCap& cap, std::span<const float> betas) {
    const BodyModel body = bodyFromNpz(arrays);
    const int64_t V = body.vertexCount, C = static_cast<int64_t>(cap.nearest.size()),
                  F = body.faceCount, G = static_cast<int64_t>(cap.faces.size() / 3);
    CHECK(body.capVertices() == 0, "a body has one cap, of as many pieces as it needs");
    // What shares the shape of the model's vertices shares their parts.
    auto shared = [&](const auto& values, size_t width) {
        std::remove_cvref_t<decltype(values)> rows;
        for (int64_t v : cap.nearest)
            rows.insert(rows.end(), values.begin() + v * static_cast<int64_t>(width),
                        values.begin() + (v + 1) * static_cast<int64_t>(width));
        return rows;
    };
    const std::vector<uint8_t> part = shared(body.part, 1);
    const std::vector<float> directions = shared(body.shapeDirections, 3 * BodyModel::kShapes);
    const std::optional<Atlas> charts = makeAtlasBeside(
        cap.vertices, cap.faces, part, {body.templateVertices, body.faces, body.uvs, body.uvFaces});
    if (!charts) return std::nullopt;

    std::vector<float> vertices = cap.vertices;  // of the model's mean shape
    for (size_t i = 0; i < vertices.size(); ++i)
        for (size_t k = 0; k < BodyModel::kShapes; ++k)
            vertices[i] -= betas[k] * directions[i * BodyModel::kShapes + k];
    std::vector<int32_t> faces = cap.faces, uvFaces = charts->uvFaces;
    for (int32_t& v : faces) v += static_cast<int32_t>(V);
    for (int32_t& t : uvFaces) t += static_cast<int32_t>(body.uvCount);

    Npz all = arrays;
    const int64_t W = V + C;
    all.set("v_template", Array::f32({W, 3}, joined(body.templateVertices, vertices)));
    all.set("f", Array::i32({F + G, 3}, joined(body.faces, faces)));
    all.set("shapedirs",
            Array::f32({W, 3, BodyModel::kShapes}, joined(body.shapeDirections, directions)));
    all.set("weights", Array::f32({W, BodyModel::kJoints}, joined(body.weights, cap.weights)));
    std::vector<float> regressor;
    for (int64_t j = 0; j < BodyModel::kJoints; ++j) {
        const auto row = body.jointRegressor.begin() + j * V;
        regressor.insert(regressor.end(), row, row + V);
        regressor.resize(regressor.size() + static_cast<size_t>(C));
    }
    all.set("J_regressor", Array::f32({BodyModel::kJoints, W}, regressor));
    if (!body.poseDirections.empty())
        all.set("posedirs",
                Array::f32({W, 3, BodyModel::kPoseFeatures},
                           joined(body.poseDirections,
                                  shared(body.poseDirections, 3 * BodyModel::kPoseFeatures))));
    all.set("vt", Array::f32({body.uvCount + static_cast<int64_t>(charts->uvs.size() / 2), 2},
                             joined(body.uvs, charts->uvs)));
    all.set("ft", Array::i32({F + G, 3}, joined(body.uvFaces, uvFaces)));
    all.set("part", Array::u8({W}, joined(body.part, part)));
    const std::vector<uint8_t> none(cap.nearest.size());
    all.set("face_mask", Array::u8({W}, joined(body.face, none)));
    all.set("sole_mask", Array::u8({W}, joined(body.sole, none)));
    all.remove("offsets");
    all.set("model_size", Array::i64({3}, std::vector<int64_t>{V, F, body.uvCount}));
    return all;
}

Npz withoutCap(const Npz& arrays) {
    const BodyModel body = bodyFromNpz(arrays);
    if (body.capVertices() == 0) return arrays;
    const int64_t V = body.modelVertices;
    Npz model = arrays;
    for (const char* name : {"v_template", "shapedirs", "weights", "posedirs", "part", "face_mask",
                             "sole_mask", "offsets"})
        if (const Array* array = arrays.find(name)) model.set(name, cut(*array, V));
    for (const char* name : {"f", "ft"}) model.set(name, cut(arrays.at(name), body.modelFaces));
    model.set("vt", cut(arrays.at("vt"), body.modelUvs));
    std::vector<float> regressor;
    for (int64_t j = 0; j < BodyModel::kJoints; ++j) {
        const auto row = body.jointRegressor.begin() + j * body.vertexCount;
        regressor.insert(regressor.end(), row, row + V);
    }
    model.set("J_regressor", Array::f32({BodyModel::kJoints, V}, regressor));
    model.remove("model_size");
    return model;
}

bool isModelOf(const BodyModel& model, const BodyModel& body) {
    auto begins = [](const auto& first, const auto& all, int64_t count) {
        return static_cast<int64_t>(first.size()) == count &&
               std::equal(first.begin(), first.end(), all.begin());
    };
    return begins(model.templateVertices, body.templateVertices, 3 * body.modelVertices) &&
           begins(model.faces, body.faces, 3 * body.modelFaces) &&
           begins(model.uvs, body.uvs, 2 * body.modelUvs) &&
           begins(model.uvFaces, body.uvFaces, 3 * body.modelFaces);
}

}  // namespace doppel
