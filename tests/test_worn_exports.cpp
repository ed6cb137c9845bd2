// Exports of an avatar that wears what hangs free, and has offsets: parts, hair that swings, who
// may do what; as readers see them that are not ours.
#include <gtest/gtest.h>

#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#include <tiny_gltf.h>

#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "nn/body/body_caps.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/formats/mesh_parts.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

// A box of cloth or hair from one corner to the other, that moves with one joint and is of the part
// that its top is nearest to.
BodyCap boxCap(const BodyModel& body, const glm::dvec3& low, const glm::dvec3& high, size_t joint) {
    constexpr int kCells = 6;
    BodyCap cap;
    int64_t nearest = 0;
    const auto at = [&](int64_t v) {
        const float* p = &body.templateVertices[size_t(3 * v)];
        return glm::dvec3(p[0], p[1], p[2]);
    };
    const glm::dvec3 top(.5 * (low.x + high.x), high.y, .5 * (low.z + high.z));
    for (int64_t v = 0; v < body.vertexCount; ++v)
        if (glm::distance(at(v), top) < glm::distance(at(nearest), top)) nearest = v;
    std::map<std::array<int, 3>, int32_t> corners;
    const auto corner = [&](std::array<int, 3> cell) {
        const auto [found, isNew] =
            corners.try_emplace(cell, static_cast<int32_t>(cap.nearest.size()));
        if (!isNew) return found->second;
        for (size_t c = 0; c < 3; ++c)
            cap.vertices.push_back(
                float(glm::mix(low[int(c)], high[int(c)], double(cell[c]) / kCells)));
        cap.nearest.push_back(nearest);
        for (size_t j = 0; j < joint::kCount; ++j) cap.weights.push_back(j == joint ? 1.f : 0.f);
        return found->second;
    };
    for (size_t axis = 0; axis < 3; ++axis)
        for (const int side : {0, kCells})
            for (int i = 0; i < kCells; ++i)
                for (int k = 0; k < kCells; ++k) {
                    const auto place = [&](int a, int b) {
                        std::array<int, 3> cell{};
                        cell[axis] = side;
                        cell[(axis + 1) % 3] = a;
                        cell[(axis + 2) % 3] = b;
                        return corner(cell);
                    };
                    std::array<int32_t, 4> quad{place(i, k), place(i + 1, k), place(i + 1, k + 1),
                                                place(i, k + 1)};
                    if (side == 0) std::swap(quad[1], quad[3]);
                    for (const size_t n : {0, 1, 2, 0, 2, 3}) cap.faces.push_back(quad[n]);
                }
    return cap;
}

BodyCap together(BodyCap one, const BodyCap& other) {
    const auto count = static_cast<int32_t>(one.nearest.size());
    for (const int32_t v : other.faces) one.faces.push_back(v + count);
    one.vertices.insert(one.vertices.end(), other.vertices.begin(), other.vertices.end());
    one.nearest.insert(one.nearest.end(), other.nearest.begin(), other.nearest.end());
    one.weights.insert(one.weights.end(), other.weights.begin(), other.weights.end());
    return one;
}

// Hair down the back of head and trunk, cloth before the thighs, and a belly.
Avatar wornAvatar() {
    const Npz plain = readBodyArrays("default");
    const BodyModel body = bodyFromNpz(plain);
    Avatar avatar;
    avatar.bodyArrays =
        *withCap(plain,
                 together(boxCap(body, {-.08, .12, -.2}, {.08, .45, -.12}, joint::kHead),
                          boxCap(body, {-.15, -.7, .15}, {.15, -.4, .2}, joint::kLeftHip)),
                 Betas{});
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = presetByName("ci");
    std::vector<float> offsets(3 * size_t(avatar.body.vertexCount));
    for (size_t v = 0; v < size_t(avatar.body.modelVertices); ++v)
        if (avatar.body.part[v] == BodyPart::kTorso) offsets[3 * v + 2] = .02f;
    setOffsets(avatar, offsets);
    avatar.textureSize = 64;
    avatar.texture.assign(3 * 64 * 64, .5f);
    return avatar;
}

tinygltf::Model load(const std::filesystem::path& path) {
    tinygltf::Model model;
    tinygltf::TinyGLTF reader;
    std::string error, warning;
    EXPECT_TRUE(reader.LoadBinaryFromFile(&model, &error, &warning, path.string())) << error;
    return model;
}

std::vector<std::string> meshNames(const tinygltf::Model& model) {
    std::vector<std::string> names;
    for (const tinygltf::Mesh& mesh : model.meshes) names.push_back(mesh.name);
    return names;
}

TEST(WornExports, WhatHangsFreeIsAMeshOfItsOwn) {
    Folder folder;
    const Avatar avatar = wornAvatar();
    exportAvatar(testDevice(), avatar, folder / "a.glb", nullptr, {.shapes = true});
    const tinygltf::Model model = load(folder / "a.glb");
    EXPECT_EQ(meshNames(model), (std::vector<std::string>{"body", "hair", "skirt"}));
    size_t triangles = 0, skinned = 0;
    for (const tinygltf::Mesh& mesh : model.meshes) {
        ASSERT_EQ(mesh.primitives.size(), 1u);
        EXPECT_EQ(mesh.primitives[0].targets.size(), 14u);
        triangles += model.accessors[size_t(mesh.primitives[0].indices)].count / 3;
    }
    EXPECT_EQ(triangles, size_t(avatar.body.faceCount));
    for (const tinygltf::Node& node : model.nodes) skinned += node.mesh >= 0 && node.skin == 0;
    EXPECT_EQ(skinned, 3u);
    // Of who wears nothing of the kind there is one, as before.
    Avatar plain = avatar;
    plain.bodyArrays = readBodyArrays("default");
    plain.body = bodyFromNpz(plain.bodyArrays);
    EXPECT_EQ(meshParts(plain.body).size(), 1u);
    exportAvatar(testDevice(), plain, folder / "b.glb", nullptr);
    EXPECT_EQ(meshNames(load(folder / "b.glb")), std::vector<std::string>{"avatar"});
}

TEST(WornExports, HairThatFallsSwingsInAVrm) {
    Folder folder;
    const Avatar avatar = wornAvatar();
    exportAvatar(testDevice(), avatar, folder / "a.vrm", nullptr);
    const tinygltf::Model model = load(folder / "a.vrm");
    ASSERT_TRUE(model.extensions.contains("VRMC_springBone"));
    const auto& springs = model.extensions.at("VRMC_springBone");
    EXPECT_EQ(springs.Get("specVersion").Get<std::string>(), "1.0");
    ASSERT_EQ(springs.Get("springs").ArrayLen(), 1u);
    const auto& joints = springs.Get("springs").Get(0).Get("joints");
    ASSERT_GT(joints.ArrayLen(), 3u);
    // A chain, from the head down.
    std::map<int, int> parents;
    for (size_t n = 0; n < model.nodes.size(); ++n)
        for (const int child : model.nodes[n].children) parents[child] = int(n);
    int above = int(joint::kHead) + 1;
    for (size_t k = 0; k < joints.ArrayLen(); ++k) {
        const int node = joints.Get(int(k)).Get("node").Get<int>();
        EXPECT_EQ(parents[node], above);
        above = node;
    }
    EXPECT_FALSE(model.extensions.at("VRMC_vrm").Has("expressions"));
    // A .glb has the bones that everybody has, and so has a VRM of short hair.
    exportAvatar(testDevice(), avatar, folder / "a.glb", nullptr);
    EXPECT_EQ(load(folder / "a.glb").skins[0].joints.size(), 24u);
    Avatar plain = avatar;
    plain.bodyArrays = readBodyArrays("default");
    plain.body = bodyFromNpz(plain.bodyArrays);
    exportAvatar(testDevice(), plain, folder / "b.vrm", nullptr);
    EXPECT_FALSE(load(folder / "b.vrm").extensions.contains("VRMC_springBone"));
}

TEST(WornExports, SaysWhoMayDoWhat) {
    Folder folder;
    const Avatar avatar = wornAvatar();
    const auto metaOf = [&](const VrmPermissions& permissions) {
        exportAvatar(testDevice(), avatar, folder / "a.vrm", nullptr, {.permissions = permissions});
        return load(folder / "a.vrm").extensions.at("VRMC_vrm").Get("meta");
    };
    const auto least = metaOf({});
    EXPECT_EQ(least.Get("avatarPermission").Get<std::string>(), "onlyAuthor");
    EXPECT_EQ(least.Get("commercialUsage").Get<std::string>(), "personalNonProfit");
    EXPECT_EQ(least.Get("modification").Get<std::string>(), "prohibited");
    EXPECT_EQ(least.Get("creditNotation").Get<std::string>(), "required");
    for (const char* question :
         {"allowExcessivelyViolentUsage", "allowExcessivelySexualUsage",
          "allowPoliticalOrReligiousUsage", "allowAntisocialOrHateUsage", "allowRedistribution"})
        EXPECT_FALSE(least.Get(question).Get<bool>()) << question;
    VrmPermissions some;
    some.wearer = "everyone";
    some.modification = "allowModification";
    some.redistribution = true;
    const auto more = metaOf(some);
    EXPECT_EQ(more.Get("avatarPermission").Get<std::string>(), "everyone");
    EXPECT_EQ(more.Get("modification").Get<std::string>(), "allowModification");
    EXPECT_TRUE(more.Get("allowRedistribution").Get<bool>());
    EXPECT_FALSE(more.Get("allowExcessivelyViolentUsage").Get<bool>());
    EXPECT_EQ(
        messageOf<InputError>([&] {
            exportAvatar(testDevice(), avatar, folder / "a.glb", nullptr, {.permissions = some});
        }),
        (folder / "a.glb").string() + ": expected .vrm for --avatar-permission, found another");
}

TEST(WornExports, TheMaterialIsUnlitOrLit) {
    Folder folder;
    const Avatar avatar = wornAvatar();
    for (const bool lit : {false, true}) {
        exportAvatar(testDevice(), avatar, folder / "a.glb", nullptr, {.lit = lit});
        const tinygltf::Model model = load(folder / "a.glb");
        EXPECT_EQ(model.materials[0].extensions.contains("KHR_materials_unlit"), !lit);
        exportAvatar(testDevice(), avatar, folder / "a.usda", nullptr, {.lit = lit});
        const std::string usd = test::bytesOf(folder / "a.usda");
        EXPECT_EQ(usd.find("inputs:diffuseColor.connect") != std::string::npos, lit);
        EXPECT_EQ(usd.find("inputs:emissiveColor.connect") != std::string::npos, !lit);
    }
    EXPECT_NE(messageOf<InputError>([&] {
                  exportAvatar(testDevice(), avatar, folder / "a.obj", nullptr, {.lit = true});
              }).find("a.obj: expected .glb, .vrm or .usda for --material lit, found another"),
              std::string::npos);
}

// ---- readers that are not ours ------------------------------------------------------------------

std::string printedBy(const std::string& command) {
    std::string text;
    FILE* pipe = popen(command.c_str(), "r");
    EXPECT_NE(pipe, nullptr);
    std::array<char, 4096> part;
    while (pipe != nullptr && fgets(part.data(), int(part.size()), pipe)) text += part.data();
    if (pipe != nullptr) {
        EXPECT_EQ(pclose(pipe), 0) << command;
    }
    return text;
}

class InThree : public ::testing::Test {
protected:
    void SetUp() override {
        if (std::system(fmt::format("node '{}' 2>/dev/null", script()).c_str()) != 0)
            GTEST_SKIP() << "no node, or no packages three and @pixiv/three-vrm "
                            "(scripts/setup --tools)";
    }
    static std::string script() { return (test::sourceFolder() / "tests/three/load.mjs").string(); }
    nlohmann::json loaded(const std::filesystem::path& file) const {
        return nlohmann::json::parse(
            printedBy(fmt::format("node '{}' '{}' 2>/dev/null", script(), file.string())));
    }
};

TEST_F(InThree, AGlbIsTheMeshesOnTheGround) {
    Folder folder;
    Motion motion;
    motion.theta.resize(3);
    motion.trans.resize(3);
    exportAvatar(testDevice(), wornAvatar(), folder / "a.glb", &motion, {.lit = true});
    const auto told = loaded(folder / "a.glb");
    ASSERT_EQ(told["meshes"].size(), 3u);
    EXPECT_EQ(told["meshes"][1]["name"], "hair");
    EXPECT_NEAR(told["meshes"][0]["low"][1].get<double>(), 0, .01);
    EXPECT_NEAR(told["meshes"][0]["high"][1].get<double>(), 1.66, .1);
    EXPECT_EQ(told["materials"][0], "MeshStandardMaterial");
    EXPECT_EQ(told["animations"], 1);
}

TEST_F(InThree, AVrmHasBonesPermissionsAndHairThatSwings) {
    Folder folder;
    exportAvatar(testDevice(), wornAvatar(), folder / "a.vrm", nullptr, {.author = "Ada"});
    const auto told = loaded(folder / "a.vrm");
    EXPECT_EQ(told["materials"][0], "MeshBasicMaterial");
    EXPECT_EQ(told["bones"], 22);
    EXPECT_EQ(told["expressions"], 0);
    EXPECT_EQ(told["meta"]["metaVersion"], "1");
    EXPECT_EQ(told["meta"]["authors"][0], "Ada");
    EXPECT_EQ(told["meta"]["avatarPermission"], "onlyAuthor");
    ASSERT_TRUE(told.contains("springs"));
    EXPECT_LT(told["springs"]["rest"].get<double>(), .02) << told["springs"];
    EXPECT_GT(told["springs"]["turned"].get<double>(), .02) << told["springs"];
    EXPECT_LT(told["springs"]["settled"].get<double>(), .05) << told["springs"];
}

TEST(WornExports, KhronosFindsNothing) {
    if (std::system("node -e \"require('gltf-validator')\" 2>/dev/null") != 0)
        GTEST_SKIP() << "no node, or no package gltf-validator (scripts/setup --tools)";
    const std::string script =
        "const v=require('gltf-validator'),fs=require('fs');v.validateBytes(new "
        "Uint8Array(fs.readFileSync(process.argv[1]))).then(r=>{console.log(JSON.stringify(r."
        "issues))})";
    Folder folder;
    const Avatar avatar = wornAvatar();
    Motion motion;
    motion.theta.resize(3);
    motion.trans.resize(3);
    exportAvatar(testDevice(), avatar, folder / "a.glb", &motion, {.shapes = true, .lit = true});
    exportAvatar(testDevice(), avatar, folder / "a.vrm", nullptr, {.shapes = true});
    for (const std::string& name : folder.names()) {
        const auto issues = nlohmann::json::parse(
            printedBy(fmt::format("node -e \"{}\" '{}'", script, (folder / name).string())));
        EXPECT_EQ(issues["numErrors"], 0) << name << issues;
        EXPECT_EQ(issues["numWarnings"], 0) << name << issues;
    }
}

}  // namespace
}  // namespace doppel
