#include "engine/io/gltf.h"

// Only the declarations: the library is linked.
#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numeric>
#include <sstream>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"

namespace doppel {
namespace {

// Appends data to the one buffer; every view starts at a multiple of 4, as accessors ask.
int addView(tinygltf::Model& model, const void* data, size_t size, int target) {
    std::vector<unsigned char>& buffer = model.buffers[0].data;
    buffer.resize((buffer.size() + 3) / 4 * 4);
    tinygltf::BufferView view;
    view.buffer = 0;
    view.byteOffset = buffer.size();
    view.byteLength = size;
    view.target = target;
    const unsigned char* bytes = static_cast<const unsigned char*>(data);
    buffer.insert(buffer.end(), bytes, bytes + size);
    model.bufferViews.push_back(std::move(view));
    return static_cast<int>(model.bufferViews.size()) - 1;
}

template <typename T>
int addAccessor(tinygltf::Model& model, std::span<const T> values, int components,
                int componentType, int type, int target, bool bounds = false) {
    tinygltf::Accessor accessor;
    accessor.bufferView = addView(model, values.data(), values.size_bytes(), target);
    accessor.componentType = componentType;
    accessor.type = type;
    const size_t width = static_cast<size_t>(components);
    accessor.count = values.size() / width;
    if (bounds) {
        accessor.minValues.assign(values.begin(), values.begin() + components);
        accessor.maxValues = accessor.minValues;
        for (size_t i = 0; i < values.size(); ++i) {
            const double value = static_cast<double>(values[i]);
            accessor.minValues[i % width] = std::min(accessor.minValues[i % width], value);
            accessor.maxValues[i % width] = std::max(accessor.maxValues[i % width], value);
        }
    }
    model.accessors.push_back(std::move(accessor));
    return static_cast<int>(model.accessors.size()) - 1;
}

int addFloats(tinygltf::Model& model, std::span<const float> values, int components, int target,
              bool bounds = false) {
    const int type = components == 1   ? TINYGLTF_TYPE_SCALAR
                     : components == 2 ? TINYGLTF_TYPE_VEC2
                     : components == 3 ? TINYGLTF_TYPE_VEC3
                     : components == 4 ? TINYGLTF_TYPE_VEC4
                                       : TINYGLTF_TYPE_MAT4;
    return addAccessor(model, values, components, TINYGLTF_COMPONENT_TYPE_FLOAT, type, target,
                       bounds);
}

void requireFinite(const std::filesystem::path& path, const char* what,
                   std::span<const float> values) {
    for (size_t i = 0; i < values.size(); ++i) {
        if (!std::isfinite(values[i])) {
            throwInput("{}: cannot be exported: {} hold {} at element {}; expected finite numbers",
                       path.string(), what, values[i], i);
        }
    }
}

void checkAnimation(const std::filesystem::path& path, const GltfScene& scene,
                    const GltfAnimation& animation) {
    const size_t keys = animation.times.size();
    CHECK(keys > 0 && animation.rotations.size() == keys * scene.skeleton.size() * 4 &&
              animation.translations.size() == keys * 3,
          "the animation must have rotations and translations for {} keys", keys);
    requireFinite(path, "animation times", animation.times);
    requireFinite(path, "animation rotations", animation.rotations);
    requireFinite(path, "animation translations", animation.translations);
    for (size_t k = 0; k < keys; ++k) {
        CHECK(animation.times[k] >= 0 && (k == 0 || animation.times[k] > animation.times[k - 1]),
              "the animation's times must rise");
    }
}

void check(const std::filesystem::path& path, const GltfScene& scene) {
    const size_t count = scene.positions.size() / 3;
    CHECK(count > 0 && scene.positions.size() == count * 3 && scene.normals.size() == count * 3 &&
              scene.uvs.size() == count * 2 && scene.joints.size() == count * 4 &&
              scene.weights.size() == count * 4,
          "positions, normals, UVs, joints and weights must be of {} vertices", count);
    CHECK(!scene.indices.empty() && scene.indices.size() % 3 == 0, "indices must make triangles");
    for (const uint32_t index : scene.indices) {
        CHECK(index < count, "index {} must be one of {} vertices", index, count);
    }
    CHECK(!scene.skeleton.empty() && scene.skeleton.size() <= 65535, "the skeleton needs joints");
    for (size_t j = 0; j < scene.skeleton.size(); ++j) {
        const int parent = scene.skeleton[j].parent;
        CHECK(j == 0 ? parent == -1 : parent >= 0 && parent < static_cast<int>(j),
              "the parent of joint {} must be an earlier joint, and only the first a root", j);
        requireFinite(path, "joints", scene.skeleton[j].position);
    }
    for (const uint16_t joint : scene.joints) {
        CHECK(joint < scene.skeleton.size(), "joint {} must be one of {}", joint,
              scene.skeleton.size());
    }
    CHECK(scene.baseColor.empty() || scene.baseColor.channels >= 3,
          "the texture must have colours");
    requireFinite(path, "positions", scene.positions);
    requireFinite(path, "normals", scene.normals);
    requireFinite(path, "UVs", scene.uvs);
    requireFinite(path, "weights", scene.weights);
    for (const GltfMorph& morph : scene.morphs) {
        CHECK(morph.positions.size() == count * 3, "a morph target moves each of {} vertices",
              count);
        requireFinite(path, "morph targets", morph.positions);
    }
    if (scene.animation) checkAnimation(path, scene, *scene.animation);
    for (const GltfAnimation& animation : scene.furtherAnimations)
        checkAnimation(path, scene, animation);
}

std::vector<float> unitNormals(std::span<const float> normals) {
    std::vector<float> result(normals.begin(), normals.end());
    for (size_t i = 0; i < result.size(); i += 3) {
        double x = result[i], y = result[i + 1], z = result[i + 2];
        const double length = std::sqrt(x * x + y * y + z * z);
        // A vertex of degenerate faces only; glTF wants some direction.
        if (length < 1e-20) x = 0, y = 1, z = 0;
        const double scale = length < 1e-20 ? 1 : 1 / length;
        result[i] = static_cast<float>(x * scale);
        result[i + 1] = static_cast<float>(y * scale);
        result[i + 2] = static_cast<float>(z * scale);
    }
    return result;
}

// Weights that sum to 1; joint 0 where the weight is 0, as validators ask.
void normalizeWeights(std::vector<uint16_t>& joints, std::vector<float>& weights) {
    for (size_t v = 0; v < weights.size(); v += 4) {
        double sum = 0;
        for (size_t k = 0; k < 4; ++k) sum += std::max(weights[v + k], 0.0f);
        for (size_t k = 0; k < 4; ++k) {
            weights[v + k] =
                sum > 0 ? static_cast<float>(std::max(weights[v + k], 0.0f) / sum) : (k == 0);
            if (weights[v + k] == 0) joints[v + k] = 0;
        }
    }
}

void addMaterial(tinygltf::Model& model, const GltfScene& scene) {
    tinygltf::Material material;
    material.name = scene.name;
    material.doubleSided = scene.doubleSided;
    material.pbrMetallicRoughness.metallicFactor = 0;
    material.pbrMetallicRoughness.roughnessFactor = 1;
    if (scene.unlit) {
        material.extensions["KHR_materials_unlit"] = tinygltf::Value(tinygltf::Value::Object());
        model.extensionsUsed.push_back("KHR_materials_unlit");
    }
    if (!scene.baseColor.empty()) {
        const std::vector<uint8_t> png = encodePng(scene.baseColor);
        tinygltf::Image image;
        image.name = "baseColor";
        image.bufferView = addView(model, png.data(), png.size(), 0);
        image.mimeType = "image/png";
        model.images.push_back(std::move(image));
        tinygltf::Sampler sampler;
        sampler.minFilter = TINYGLTF_TEXTURE_FILTER_LINEAR_MIPMAP_LINEAR;
        sampler.magFilter = TINYGLTF_TEXTURE_FILTER_LINEAR;
        sampler.wrapS = sampler.wrapT = TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE;
        model.samplers.push_back(std::move(sampler));
        tinygltf::Texture texture;
        texture.source = 0;
        texture.sampler = 0;
        model.textures.push_back(std::move(texture));
        material.pbrMetallicRoughness.baseColorTexture.index = 0;
    }
    model.materials.push_back(std::move(material));
}

// Where a part's vertices and indices are in the scene's.
struct Range {
    std::string name;
    size_t firstVertex, vertices, firstIndex, indices;

    template <typename T>
    std::span<const T> of(const std::vector<T>& rows, size_t width) const {
        return std::span(rows).subspan(width * firstVertex, width * vertices);
    }
};

std::vector<Range> rangesOf(const GltfScene& scene) {
    const size_t vertices = scene.positions.size() / 3;
    if (scene.parts.empty()) return {{scene.name, 0, vertices, 0, scene.indices.size()}};
    std::vector<Range> ranges;
    for (size_t i = 0; i < scene.parts.size(); ++i) {
        const GltfPart& part = scene.parts[i];
        const bool last = i + 1 == scene.parts.size();
        ranges.push_back(
            {part.name, part.firstVertex,
             (last ? vertices : scene.parts[i + 1].firstVertex) - part.firstVertex, part.firstIndex,
             (last ? scene.indices.size() : scene.parts[i + 1].firstIndex) - part.firstIndex});
    }
    return ranges;
}

int addIndices(tinygltf::Model& model, const GltfScene& scene, const Range& range) {
    std::vector<uint32_t> indices(
        scene.indices.begin() + std::ptrdiff_t(range.firstIndex),
        scene.indices.begin() + std::ptrdiff_t(range.firstIndex + range.indices));
    for (uint32_t& index : indices) {
        CHECK(index >= range.firstVertex && index - range.firstVertex < range.vertices,
              "a part's triangles have its own vertices");
        index -= static_cast<uint32_t>(range.firstVertex);
    }
    constexpr int kIndices = TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER;
    if (range.vertices >= 65535)
        return addAccessor<uint32_t>(model, indices, 1, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT,
                                     TINYGLTF_TYPE_SCALAR, kIndices);
    const std::vector<uint16_t> small(indices.begin(), indices.end());
    return addAccessor<uint16_t>(model, small, 1, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT,
                                 TINYGLTF_TYPE_SCALAR, kIndices);
}

void addMesh(tinygltf::Model& model, const GltfScene& scene, const Range& range) {
    const auto own = [](const auto& span) { return std::vector(span.begin(), span.end()); };
    auto joints = own(range.of(scene.joints, 4));
    auto weights = own(range.of(scene.weights, 4));
    normalizeWeights(joints, weights);
    constexpr int kVertices = TINYGLTF_TARGET_ARRAY_BUFFER;
    tinygltf::Primitive primitive;
    primitive.mode = TINYGLTF_MODE_TRIANGLES;
    primitive.material = 0;
    primitive.attributes["POSITION"] =
        addFloats(model, range.of(scene.positions, 3), 3, kVertices, true);
    primitive.attributes["NORMAL"] =
        addFloats(model, unitNormals(own(range.of(scene.normals, 3))), 3, kVertices);
    primitive.attributes["TEXCOORD_0"] = addFloats(model, range.of(scene.uvs, 2), 2, kVertices);
    primitive.attributes["JOINTS_0"] = addAccessor<uint16_t>(
        model, joints, 4, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT, TINYGLTF_TYPE_VEC4, kVertices);
    primitive.attributes["WEIGHTS_0"] = addFloats(model, weights, 4, kVertices);
    primitive.indices = addIndices(model, scene, range);
    tinygltf::Mesh mesh;
    mesh.name = range.name;
    tinygltf::Value::Array names;
    for (const GltfMorph& morph : scene.morphs) {
        primitive.targets.push_back(
            {{"POSITION", addFloats(model, range.of(morph.positions, 3), 3, kVertices, true)}});
        mesh.weights.push_back(0);
        names.emplace_back(morph.name);
    }
    if (!names.empty())
        mesh.extras =
            tinygltf::Value(tinygltf::Value::Object{{"targetNames", tinygltf::Value(names)}});
    mesh.primitives.push_back(std::move(primitive));
    model.meshes.push_back(std::move(mesh));
}

tinygltf::Node meshNode(const std::string& name, size_t mesh) {
    tinygltf::Node node;
    node.name = name;
    node.mesh = static_cast<int>(mesh);
    node.skin = 0;
    return node;
}

// Node 0 is the first mesh, node j + 1 is joint j, further meshes come behind.
void addSkeleton(tinygltf::Model& model, const GltfScene& scene) {
    model.nodes.push_back(meshNode(model.meshes[0].name, 0));
    tinygltf::Skin skin;
    skin.name = scene.name;
    std::vector<float> inverseBind;
    for (size_t j = 0; j < scene.skeleton.size(); ++j) {
        const GltfJoint& joint = scene.skeleton[j];
        tinygltf::Node node;
        node.name = joint.name;
        std::array<float, 3> origin = {};
        if (joint.parent >= 0) {
            origin = scene.skeleton[static_cast<size_t>(joint.parent)].position;
            model.nodes[static_cast<size_t>(joint.parent) + 1].children.push_back(
                static_cast<int>(j) + 1);
        }
        for (size_t c = 0; c < 3; ++c) {
            node.translation.push_back(static_cast<double>(joint.position[c] - origin[c]));
        }
        model.nodes.push_back(std::move(node));
        skin.joints.push_back(static_cast<int>(j) + 1);
        const std::array<float, 3>& p = joint.position;
        const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -p[0], -p[1], -p[2], 1};
        inverseBind.insert(inverseBind.end(), std::begin(matrix), std::end(matrix));
    }
    skin.skeleton = 1;
    skin.inverseBindMatrices = addFloats(model, inverseBind, 16, 0);
    model.skins.push_back(std::move(skin));
    tinygltf::Scene gltfScene;
    gltfScene.name = scene.name;
    gltfScene.nodes = {0, 1};
    for (size_t mesh = 1; mesh < model.meshes.size(); ++mesh) {
        gltfScene.nodes.push_back(static_cast<int>(model.nodes.size()));
        model.nodes.push_back(meshNode(model.meshes[mesh].name, mesh));
    }
    model.scenes.push_back(std::move(gltfScene));
    model.defaultScene = 0;
}

void addAnimation(tinygltf::Model& model, const GltfScene& scene, const GltfAnimation& source) {
    const size_t keys = source.times.size(), joints = scene.skeleton.size();
    tinygltf::Animation animation;
    animation.name = source.name;
    const int times = addFloats(model, source.times, 1, 0, true);
    const auto channel = [&](int node, const char* path, int output) {
        tinygltf::AnimationSampler sampler;
        sampler.input = times;
        sampler.output = output;
        sampler.interpolation = "LINEAR";
        animation.samplers.push_back(std::move(sampler));
        tinygltf::AnimationChannel target;
        target.sampler = static_cast<int>(animation.samplers.size()) - 1;
        target.target_node = node;
        target.target_path = path;
        animation.channels.push_back(std::move(target));
    };
    std::vector<float> translations(source.translations);
    for (size_t i = 0; i < translations.size(); ++i) {
        translations[i] += scene.skeleton[0].position[i % 3];
    }
    channel(1, "translation", addFloats(model, translations, 3, 0));
    for (size_t j = 0; j < joints; ++j) {
        std::vector<float> rotations(keys * 4);
        std::array<double, 4> previous = {0, 0, 0, 1};
        for (size_t k = 0; k < keys; ++k) {
            std::array<double, 4> q;
            double length = 0, dot = 0;
            for (size_t c = 0; c < 4; ++c) {
                q[c] = static_cast<double>(source.rotations[(k * joints + j) * 4 + c]);
                length += q[c] * q[c];
            }
            length = std::sqrt(length);
            CHECK(length > 1e-6, "the rotation of joint {} at key {} must not be zero", j, k);
            for (size_t c = 0; c < 4; ++c) dot += q[c] * previous[c];
            // q and −q are one rotation, but players go the short way between keys only where
            // neighbours agree.
            for (size_t c = 0; c < 4; ++c) {
                q[c] *= (dot < 0 ? -1 : 1) / length;
                rotations[k * 4 + c] = static_cast<float>(q[c]);
            }
            previous = q;
        }
        channel(static_cast<int>(j) + 1, "rotation", addFloats(model, rotations, 4, 0));
    }
    model.animations.push_back(std::move(animation));
}

}  // namespace

std::vector<uint32_t> fillMesh(GltfScene& scene, std::span<const float> verts,
                               std::span<const float> normals, std::span<const int32_t> faces,
                               std::span<const float> uvs, std::span<const int32_t> facesUv,
                               std::span<const float> weights, int joints) {
    const size_t count = verts.size() / 3, texels = uvs.size() / 2;
    const size_t jointCount = static_cast<size_t>(joints);
    CHECK(joints > 0 && joints <= 65535 && normals.size() == verts.size() &&
              faces.size() == facesUv.size() && weights.size() == count * jointCount,
          "the mesh's arrays must fit each other");
    scene.positions.clear();
    scene.normals.clear();
    scene.uvs.clear();
    scene.joints.clear();
    scene.weights.clear();
    scene.indices.clear();
    std::vector<uint32_t> sources;
    std::map<std::pair<int32_t, int32_t>, uint32_t> corners;  // (vertex, UV) → vertex of the scene
    std::vector<size_t> order(jointCount);
    for (size_t i = 0; i < faces.size(); ++i) {
        CHECK(faces[i] >= 0 && static_cast<size_t>(faces[i]) < count && facesUv[i] >= 0 &&
                  static_cast<size_t>(facesUv[i]) < texels,
              "a face must be made of vertices and UVs that exist");
        const auto [corner, isNew] =
            corners.try_emplace({faces[i], facesUv[i]}, static_cast<uint32_t>(sources.size()));
        scene.indices.push_back(corner->second);
        if (!isNew) continue;
        const size_t v = static_cast<size_t>(faces[i]), t = static_cast<size_t>(facesUv[i]);
        sources.push_back(static_cast<uint32_t>(v));
        for (size_t c = 0; c < 3; ++c) {
            scene.positions.push_back(verts[v * 3 + c]);
            scene.normals.push_back(normals[v * 3 + c]);
        }
        for (size_t c = 0; c < 2; ++c) scene.uvs.push_back(uvs[t * 2 + c]);
        const std::span<const float> own = weights.subspan(v * jointCount, jointCount);
        std::iota(order.begin(), order.end(), size_t{0});
        const size_t kept = std::min<size_t>(4, jointCount);
        std::partial_sort(
            order.begin(), order.begin() + static_cast<ptrdiff_t>(kept), order.end(),
            [&](size_t a, size_t b) { return own[a] != own[b] ? own[a] > own[b] : a < b; });
        for (size_t k = 0; k < 4; ++k) {
            scene.joints.push_back(k < kept ? static_cast<uint16_t>(order[k]) : uint16_t{0});
            scene.weights.push_back(k < kept ? own[order[k]] : 0.0f);
        }
    }
    return sources;
}

void writeGlb(const std::filesystem::path& path, const GltfScene& scene) {
    const char* expected = scene.vrm ? ".vrm" : ".glb";
    if (endingOf(path) != expected) {
        throwInput("{}: expected a name that ends with {}", path.string(), expected);
    }
    check(path, scene);
    AtomicFile file(path);  // before the work, so that a bad folder is said at once
    tinygltf::Model model;
    model.asset.version = "2.0";
    model.asset.generator = "Doppel";
    model.buffers.resize(1);
    addMaterial(model, scene);
    for (const Range& range : rangesOf(scene)) addMesh(model, scene, range);
    addSkeleton(model, scene);
    if (scene.animation) addAnimation(model, scene, *scene.animation);
    for (const GltfAnimation& animation : scene.furtherAnimations)
        addAnimation(model, scene, animation);
    if (scene.vrm) addVrm(model, *scene.vrm);
    std::ostringstream out;
    tinygltf::TinyGLTF writer;
    if (!writer.WriteGltfSceneToStream(&model, out, false, true)) {
        throwMachine("{}: cannot be encoded as glTF", path.string());
    }
    file.write(out.view());
    file.commit();
}

}  // namespace doppel
