// The exported file, read back with another reader: bounds, skinning, texture, animation.
#include "engine/io/gltf.h"

#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#include <gtest/gtest.h>
#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <set>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

constexpr int kJoints = 24;

// A column of rings, its atlas cut along one seam, moved by a chain of 24 joints.
GltfScene column() {
    GltfScene scene;
    scene.name = "column";
    constexpr int kRings = 25, kSides = 6;
    std::vector<float> verts, normals, uvs, weights;
    std::vector<int32_t> faces, facesUv;
    for (int r = 0; r < kRings; ++r) {
        for (int s = 0; s <= kSides; ++s) {
            const float angle = 6.2831853f * static_cast<float>(s) / kSides;
            uvs.push_back(static_cast<float>(s) / kSides);
            uvs.push_back(static_cast<float>(r) / (kRings - 1));
            if (s == kSides) continue;  // the seam: the first vertex again, with another UV
            verts.insert(verts.end(), {std::sin(angle) * 0.1f, static_cast<float>(r) * 0.05f,
                                       std::cos(angle) * 0.1f});
            normals.insert(normals.end(), {std::sin(angle) * 3, 0, std::cos(angle) * 3});
            for (int j = 0; j < kJoints; ++j) {
                const float distance = std::abs(static_cast<float>(j - r));
                weights.push_back(std::max(0.0f, 1 - distance / 3));
            }
        }
    }
    for (int r = 0; r + 1 < kRings; ++r) {
        for (int s = 0; s < kSides; ++s) {
            const int a = r * kSides + s, b = r * kSides + (s + 1) % kSides;
            const int ta = r * (kSides + 1) + s, tb = ta + 1;
            for (const int v : {a, b, b + kSides, a, b + kSides, a + kSides}) faces.push_back(v);
            for (const int t : {ta, tb, tb + kSides + 1, ta, tb + kSides + 1, ta + kSides + 1}) {
                facesUv.push_back(t);
            }
        }
    }
    const auto sources = fillMesh(scene, verts, normals, faces, uvs, facesUv, weights, kJoints);
    EXPECT_EQ(sources.size(), size_t{kRings * (kSides + 1)}) << "only the seam is doubled";
    for (size_t v = 0; v < sources.size(); ++v) {
        EXPECT_EQ(scene.positions[v * 3], verts[sources[v] * 3]);
    }
    for (int j = 0; j < kJoints; ++j) {
        scene.skeleton.push_back(
            {fmt::format("joint{}", j), j - 1, {0.01f, 0.05f * static_cast<float>(j), 0}});
    }
    scene.baseColor = Image(8, 8, 3, 77);
    GltfAnimation animation;
    animation.name = "bend";
    for (int k = 0; k < 3; ++k) {
        animation.times.push_back(0.1f * static_cast<float>(k));
        animation.translations.insert(animation.translations.end(), {0, 0, static_cast<float>(k)});
        for (int j = 0; j < kJoints; ++j) {
            const float half = 0.1f * static_cast<float>(k);
            const float sign = k == 1 ? -2.0f : 1.0f;  // the same rotation, not of unit length
            animation.rotations.insert(animation.rotations.end(),
                                       {sign * std::sin(half), 0, 0, sign * std::cos(half)});
        }
    }
    scene.animation = std::move(animation);
    return scene;
}

tinygltf::Model load(const std::filesystem::path& path) {
    tinygltf::Model model;
    tinygltf::TinyGLTF reader;
    std::string error, warning;
    EXPECT_TRUE(reader.LoadBinaryFromFile(&model, &error, &warning, path.string())) << error;
    EXPECT_EQ(error, "");
    EXPECT_EQ(warning, "");
    return model;
}

template <typename T>
std::vector<T> values(const tinygltf::Model& model, int index) {
    const tinygltf::Accessor& accessor = model.accessors.at(static_cast<size_t>(index));
    const auto& view = model.bufferViews.at(static_cast<size_t>(accessor.bufferView));
    const size_t width =
        static_cast<size_t>(tinygltf::GetNumComponentsInType(static_cast<uint32_t>(accessor.type)));
    const size_t bytes = accessor.count * width * sizeof(T);
    EXPECT_EQ(static_cast<size_t>(
                  tinygltf::GetComponentSizeInBytes(static_cast<uint32_t>(accessor.componentType))),
              sizeof(T));
    EXPECT_EQ(view.byteOffset % 4, 0u);
    EXPECT_LE(accessor.byteOffset + bytes, view.byteLength);
    EXPECT_LE(view.byteOffset + view.byteLength, model.buffers.at(0).data.size());
    std::vector<T> result(accessor.count * width);
    std::memcpy(result.data(), &model.buffers[0].data[view.byteOffset + accessor.byteOffset],
                bytes);
    if (!accessor.minValues.empty()) {
        for (size_t i = 0; i < result.size(); ++i) {
            EXPECT_GE(static_cast<double>(result[i]), accessor.minValues.at(i % width));
            EXPECT_LE(static_cast<double>(result[i]), accessor.maxValues.at(i % width));
        }
    }
    return result;
}

TEST(Gltf, meshIsReadBack) {
    Folder folder;
    const GltfScene scene = column();
    writeGlb(folder / "a.glb", scene);
    EXPECT_EQ(folder.names(), std::vector<std::string>{"a.glb"});
    const tinygltf::Model model = load(folder / "a.glb");
    ASSERT_EQ(model.meshes.size(), 1u);
    const tinygltf::Primitive& primitive = model.meshes[0].primitives.at(0);
    const int position = primitive.attributes.at("POSITION");
    EXPECT_EQ(model.accessors.at(static_cast<size_t>(position)).minValues.size(), 3u);
    EXPECT_EQ(values<float>(model, position), scene.positions);
    EXPECT_EQ(values<float>(model, primitive.attributes.at("TEXCOORD_0")), scene.uvs);
    const std::vector<uint16_t> indices = values<uint16_t>(model, primitive.indices);
    EXPECT_TRUE(
        std::equal(indices.begin(), indices.end(), scene.indices.begin(), scene.indices.end()));
    const std::vector<float> normals = values<float>(model, primitive.attributes.at("NORMAL"));
    for (size_t i = 0; i < normals.size(); i += 3) {
        EXPECT_NEAR(std::hypot(normals[i], normals[i + 1], normals[i + 2]), 1, 1e-6);
    }
    const std::vector<float> weights = values<float>(model, primitive.attributes.at("WEIGHTS_0"));
    for (size_t i = 0; i < weights.size(); i += 4) {
        EXPECT_NEAR(weights[i] + weights[i + 1] + weights[i + 2] + weights[i + 3], 1, 1e-6);
    }
    for (const uint16_t joint : values<uint16_t>(model, primitive.attributes.at("JOINTS_0"))) {
        EXPECT_LT(joint, kJoints);
    }

    const tinygltf::Material& material = model.materials.at(0);
    EXPECT_TRUE(material.extensions.contains("KHR_materials_unlit"));
    EXPECT_EQ(model.extensionsUsed, std::vector<std::string>{"KHR_materials_unlit"});
    EXPECT_EQ(material.pbrMetallicRoughness.metallicFactor, 0);
    ASSERT_EQ(material.pbrMetallicRoughness.baseColorTexture.index, 0);
    const tinygltf::Image& image = model.images.at(0);
    EXPECT_EQ(image.mimeType, "image/png");
    EXPECT_EQ(image.width, 8);
    EXPECT_EQ(image.height, 8);
    EXPECT_EQ(image.image.at(0), 77);
}

TEST(Gltf, skeletonRestsWhereTheMeshIs) {
    Folder folder;
    const GltfScene scene = column();
    writeGlb(folder / "a.glb", scene);
    const tinygltf::Model model = load(folder / "a.glb");
    const tinygltf::Skin& skin = model.skins.at(0);
    ASSERT_EQ(skin.joints.size(), size_t{kJoints});
    const std::vector<float> inverse = values<float>(model, skin.inverseBindMatrices);
    ASSERT_EQ(inverse.size(), size_t{kJoints * 16});
    // Down the tree from the root; every joint is met once, and joint · inverse bind is identity.
    std::set<int> met;
    std::vector<std::pair<int, std::array<double, 3>>> queue = {{skin.skeleton, {0, 0, 0}}};
    for (size_t i = 0; i < queue.size(); ++i) {
        const auto [index, origin] = queue[i];
        const tinygltf::Node& node = model.nodes.at(static_cast<size_t>(index));
        EXPECT_TRUE(met.insert(index).second);
        std::array<double, 3> at = origin;
        for (size_t c = 0; c < 3; ++c) at[c] += node.translation.at(c);
        const auto joint = static_cast<size_t>(
            std::find(skin.joints.begin(), skin.joints.end(), index) - skin.joints.begin());
        ASSERT_LT(joint, size_t{kJoints});
        EXPECT_EQ(node.name, scene.skeleton[joint].name);
        for (size_t c = 0; c < 3; ++c) {
            EXPECT_NEAR(at[c] + static_cast<double>(inverse[joint * 16 + 12 + c]), 0, 1e-6);
            EXPECT_NEAR(at[c], static_cast<double>(scene.skeleton[joint].position[c]), 1e-6);
        }
        for (const int child : node.children) queue.emplace_back(child, at);
    }
    EXPECT_EQ(met.size(), size_t{kJoints});
    const tinygltf::Node& mesh =
        model.nodes.at(static_cast<size_t>(model.scenes.at(0).nodes.at(0)));
    EXPECT_EQ(mesh.mesh, 0);
    EXPECT_EQ(mesh.skin, 0);
}

TEST(Gltf, animationIsReadBack) {
    Folder folder;
    GltfScene scene = column();
    writeGlb(folder / "a.glb", scene);
    const tinygltf::Model model = load(folder / "a.glb");
    const tinygltf::Animation& animation = model.animations.at(0);
    EXPECT_EQ(animation.name, "bend");
    ASSERT_EQ(animation.channels.size(), size_t{kJoints + 1});
    for (const tinygltf::AnimationChannel& channel : animation.channels) {
        const auto& sampler = animation.samplers.at(static_cast<size_t>(channel.sampler));
        EXPECT_EQ(values<float>(model, sampler.input), scene.animation->times);
        const std::vector<float> output = values<float>(model, sampler.output);
        if (channel.target_path == "translation") {
            EXPECT_EQ(channel.target_node, model.skins.at(0).joints.at(0));
            EXPECT_NEAR(output.at(0), 0.01, 1e-6) << "the root's rest position is in it";
            EXPECT_NEAR(output.at(8), 2, 1e-6);
            continue;
        }
        ASSERT_EQ(channel.target_path, "rotation");
        for (int k = 0; k < 3; ++k) {
            const size_t at = static_cast<size_t>(k) * 4;
            EXPECT_NEAR(output.at(at), std::sin(0.1 * k), 1e-6) << "no key goes the long way round";
            EXPECT_NEAR(output.at(at + 3), std::cos(0.1 * k), 1e-6);
        }
    }
    writeGlb(folder / "b.glb", scene);
    EXPECT_EQ(readWholeFile(folder / "a.glb"), readWholeFile(folder / "b.glb"));
}

TEST(Gltf, plainOnesToo) {
    Folder folder;
    GltfScene scene = column();
    scene.animation.reset();
    scene.baseColor = {};
    scene.unlit = false;
    writeGlb(folder / "a.glb", scene);
    const tinygltf::Model model = load(folder / "a.glb");
    EXPECT_TRUE(model.animations.empty());
    EXPECT_TRUE(model.images.empty());
    EXPECT_TRUE(model.extensionsUsed.empty());
}

TEST(Gltf, refusals) {
    Folder folder;
    GltfScene scene = column();
    EXPECT_NE(messageOf<InputError>([&] { writeGlb(folder / "a.obj", scene); }).find(".glb"),
              std::string::npos);
    EXPECT_THROW(writeGlb(folder / "no" / "a.glb", scene), InputError);
    scene.positions[5] = NAN;
    EXPECT_NE(messageOf<InputError>([&] {
                  writeGlb(folder / "a.glb", scene);
              }).find("positions hold nan at element 5"),
              std::string::npos);
    EXPECT_TRUE(folder.names().empty());
}

}  // namespace
}  // namespace doppel
