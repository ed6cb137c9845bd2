// Avatars and motions for other programs: VRM, morph targets, USD, OBJ; BVH, AMASS and JSON that
// come back as the joints they were.
#include <gtest/gtest.h>

#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#include <tiny_gltf.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "engine/error.h"
#include "engine/io/gltf_nodes.h"
#include "engine/io/image.h"
#include "nn/body/fingers.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/formats/model_files.h"
#include "trainer/motion/retarget/proportions.h"
#include "trainer/motion/session.h"
#include "trainer/motion/skeleton_motion.h"
#include "trainer/motion/upright.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::Folder;
using test::messageOf;

Avatar plainAvatar(const Betas& betas = {}) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.betas = betas;
    avatar.preset = presetByName("ci");
    avatar.textureSize = 32;
    avatar.texture.assign(32 * 32 * 3, .25f);
    return avatar;
}

// Before a camera, each joint in motion; halfway somebody who looks over the shoulder of a wheel.
Motion walk() {
    Motion motion;
    motion.name = "walk";
    motion.fps = 24;
    auto session = actorSession(6, 6, 3);
    for (size_t f = 0; f < session.size(); ++f) {
        for (size_t i = 3; i < 66; ++i) session[f].theta[i] += .2f * std::sin(float(i * 7 % 11));
        motion.theta.push_back(session[f].theta);
        motion.trans.push_back(session[f].trans);
        motion.trans.back()[0] += .02f * float(f);
    }
    // A joint turned by 90° about x, where the angles of a BVH are not unique.
    setJointRotation(motion.theta[3], joint::kLeftShoulder,
                     quaternionOf({3.14159265358979 / 2, 0, 0}));
    motion.cameras.resize(motion.size());
    return motion;
}

// The joints of `found` are those of `motion` in a world with y up, but for where it begins; mm.
double worstMillimetres(const Motion& found, const Motion& motion, const glm::dquat& upright,
                        const glm::dquat& back = {1, 0, 0, 0}) {
    double worst = 0;
    glm::dvec3 offset;
    for (size_t f = 0; f < motion.size(); ++f) {
        const auto was = placeJoints(motion.theta[f], motion.trans[f]);
        const auto is = placeJoints(found.theta[f], found.trans[f]);
        if (f == 0) offset = back * is[0] - upright * was[0];
        for (size_t j = 0; j < 22; ++j)
            worst = std::max(worst, 1000 * glm::length(back * is[j] - (upright * was[j] + offset)));
    }
    return worst;
}

TEST(Formats, BvhComesBackToTheSameJoints) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    const Motion motion = walk();
    for (const auto names :
         {JointNames::Smpl, JointNames::Vrm, JointNames::Mixamo, JointNames::Unreal}) {
        SCOPED_TRACE(jointNameFor(names, 1));
        exportAvatar(testDevice(), avatar, folder / "a.bvh", &motion, {.names = names});
        const Motion back = readMotion(folder / "a.bvh");
        ASSERT_EQ(back.size(), motion.size());
        EXPECT_EQ(back.fps, 24);
        // Of names other than SMPL's the ends of the hands are not read, and not compared.
        EXPECT_LT(worstMillimetres(back, motion, {0, 1, 0, 0}), 1);
    }
    EXPECT_EQ(folder.names(), std::vector<std::string>{"a.bvh"});
    // In centimetres, the lowest point of the body on the ground in the first frame.
    const std::string text = bytesOf(folder / "a.bvh");
    EXPECT_NE(text.find("Frame Time: 0.041666667"), std::string::npos);
    const Motion back = readMotion(folder / "a.bvh");
    double low = INFINITY;
    for (const auto& place : placeJoints(back.theta[0], back.trans[0]))
        low = std::min(low, place.y);
    EXPECT_GT(low, 0);
    EXPECT_LT(low, .12);
}

// No angle jumps from one frame to the next by more than the joint turns.
TEST(Formats, BvhAnglesDoNotJump) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    Motion spin;
    for (int f = 0; f < 40; ++f) {
        Theta theta{};
        setJointRotation(theta, 0, quaternionOf({0, .3 * f, 0}));
        spin.theta.push_back(theta);
        spin.trans.push_back({});
    }
    exportAvatar(testDevice(), avatar, folder / "a.bvh", &spin);
    std::istringstream lines(bytesOf(folder / "a.bvh"));
    std::string line;
    while (std::getline(lines, line) && !line.starts_with("Frame Time")) {
    }
    double before = 0;
    for (int f = 0; std::getline(lines, line); ++f) {
        std::istringstream numbers(line);
        std::array<double, 6> n{};
        for (double& x : n) numbers >> x;
        EXPECT_NEAR(n[5] - before, f ? .3 * 180 / 3.14159265358979 : 0, 1e-3) << f;
        before = n[5];
    }
}

TEST(Formats, AmassComesBack) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    const Motion motion = walk();
    exportAvatar(testDevice(), avatar, folder / "a.npz", &motion);
    const Motion back = readMotion(folder / "a.npz");
    ASSERT_EQ(back.size(), motion.size());
    EXPECT_EQ(back.fps, 24);
    EXPECT_EQ(takenAs(back), "AMASS, 24 a second, z up");
    EXPECT_LT(worstMillimetres(back, motion, {0, 1, 0, 0},
                               glm::angleAxis(-std::acos(0.), glm::dvec3(1, 0, 0))),
              .1);
    const Npz npz = readNpz(folder / "a.npz");
    for (const char* name : {"poses", "trans", "betas", "dmpls", "gender", "mocap_framerate"})
        EXPECT_TRUE(npz.has(name)) << name;
    npz.at("poses").requireShape({static_cast<int64_t>(motion.size()), 156});
}

TEST(Formats, JsonSaysAll) {
    Folder folder;
    const Avatar avatar = plainAvatar({1, -1});
    const Motion motion = walk();
    exportAvatar(testDevice(), avatar, folder / "a.json", &motion, {.names = JointNames::Unreal});
    const auto json = nlohmann::json::parse(bytesOf(folder / "a.json"));
    EXPECT_EQ(json["fps"], 24);
    EXPECT_EQ(json["up"], "y");
    ASSERT_EQ(json["joints"].size(), 24u);
    EXPECT_EQ(json["joints"][18], "lowerarm_l");
    EXPECT_EQ(json["parents"][18], 16);
    ASSERT_EQ(json["frames"].size(), motion.size());
    // Followed down the tree, the left wrist is where the body has it.
    const auto vec = [](const nlohmann::json& j) {
        return glm::dvec3(j[0].get<double>(), j[1].get<double>(), j[2].get<double>());
    };
    BodyPoser poser(testDevice(), avatar.body);
    glm::dvec3 offset;
    for (size_t f = 0; f < motion.size(); ++f) {
        const auto& frame = json["frames"][f];
        std::vector<glm::dvec3> place;
        std::vector<glm::dquat> turn;
        for (size_t j = 0; j < 24; ++j) {
            const auto& q = frame["rotations"][j];
            const glm::dquat own(q[3].get<double>(), q[0].get<double>(), q[1].get<double>(),
                                 q[2].get<double>());
            const int parent = json["parents"][j].get<int>();
            if (parent < 0) {
                place.push_back(vec(frame["translation"]));
                turn.push_back(own);
                continue;
            }
            const auto p = static_cast<size_t>(parent);
            place.push_back(place[p] + turn[p] * (vec(json["rest"][j]) - vec(json["rest"][p])));
            turn.push_back(turn[p] * own);
        }
        const PosedMesh posed = poser.pose(motion.theta[f], motion.trans[f], avatar.betas);
        const auto& w = posed.joints[20];
        const glm::dvec3 wrist(w[0], -w[1], -w[2]);
        if (f == 0) offset = place[20] - wrist;
        EXPECT_LT(glm::length(place[20] - wrist - offset), 1e-4) << f;
    }
}

TEST(Formats, JsonComesBackToTheSameJoints) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    const Motion motion = walk();
    for (const auto names :
         {JointNames::Smpl, JointNames::Vrm, JointNames::Mixamo, JointNames::Unreal}) {
        exportAvatar(testDevice(), avatar, folder / "a.json", &motion, {.names = names});
        const Motion back = readMotion(folder / "a.json");
        ASSERT_EQ(back.size(), motion.size());
        EXPECT_EQ(back.fps, 24);
        EXPECT_LT(worstMillimetres(back, motion, {0, 1, 0, 0}), 1);
    }
    // Of a body of another shape the bones say whose it is.
    exportAvatar(testDevice(), plainAvatar({2}), folder / "tall.json", &motion);
    const Motion tall = readMotion(folder / "tall.json");
    ASSERT_TRUE(tall.skeleton);
    EXPECT_NEAR(
        tall.skeleton->size,
        proportionsOf(avatar.body, {2}).legLength() / proportionsOf(avatar.body, {}).legLength(),
        .01);
    const auto refusal = [&](const std::string& text) {
        folder.write("b.json", text);
        return messageOf<InputError>([&] { readMotion(folder / "b.json"); });
    };
    const std::string where = (folder / "b.json").string();
    EXPECT_EQ(refusal(R"({"joints": 3})"), where + ": joints: expected a list, found number");
    EXPECT_EQ(refusal(R"({"joints": ["a", "b"], "parents": [-1], "rest": []})"),
              where + ": parents: expected 2 of them, found 1");
    EXPECT_EQ(refusal(R"({"joints": ["a"], "parents": [5], "rest": [[0, 0, 0]]})"),
              where +
                  ": parents: expected -1 for the first joint and for each other one an earlier "
                  "joint, found 5 for joint 0");
    // Narrowed, these would be the fifth joint.
    for (const char* parent : {"-4294967291", "9223372036854775813", "-2"})
        EXPECT_NE(
            refusal(
                fmt::format(R"({{"joints": ["a"], "parents": [{}], "rest": [[0, 0, 0]]}})", parent))
                .find(": parents: expected -1 for the first joint"),
            std::string::npos)
            << parent;
}

TEST(Formats, UsdComesBackToTheSameJoints) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    const Motion motion = walk();
    for (const auto names :
         {JointNames::Smpl, JointNames::Vrm, JointNames::Mixamo, JointNames::Unreal}) {
        exportAvatar(testDevice(), avatar, folder / "a.usda", &motion, {.names = names});
        const Motion back = readMotion(folder / "a.usda");
        ASSERT_EQ(back.size(), motion.size());
        EXPECT_EQ(back.fps, 24);
        EXPECT_LT(worstMillimetres(back, motion, {0, 1, 0, 0}), 1);
    }
    const std::string text = bytesOf(folder / "a.usda");
    const auto refusal = [&](const std::string& word, const std::string& instead) {
        std::string other = text;
        other.replace(other.find(word), word.size(), instead);
        folder.write("b.usda", other);
        return messageOf<InputError>([&] { readMotion(folder / "b.usda"); });
    };
    const std::string where = (folder / "b.usda").string();
    EXPECT_EQ(refusal("def SkelAnimation", "def Scope"),
              where +
                  ": expected def SkelAnimation, found none; of USD only what `doppel export "
                  "--motion` writes is read as a motion");
    EXPECT_EQ(refusal("pelvis/thigh_l\"", "pelvis/x/y\""),
              where + ": joints: expected the joint above pelvis/x/y before it, found none");
    EXPECT_NE(refusal("rotations.timeSamples = {\n                0: [(",
                      "rotations.timeSamples = {\n                0: [(nan, ")
                  .find(": expected a number, found \"nan, "),
              std::string::npos);
    exportAvatar(testDevice(), avatar, folder / "still.usda", nullptr);
    EXPECT_NE(messageOf<InputError>([&] {
                  readMotion(folder / "still.usda");
              }).find("expected def SkelAnimation, found none"),
              std::string::npos);
}

tinygltf::Model load(const fs::path& path) {
    tinygltf::Model model;
    tinygltf::TinyGLTF gltf;
    std::string error, warning;
    EXPECT_TRUE(gltf.LoadBinaryFromFile(&model, &error, &warning, path.string())) << error;
    EXPECT_EQ(error + warning, "");
    return model;
}

TEST(Formats, NamesInGltf) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    const Motion motion = walk();
    for (const auto& [names, hip] : {std::pair{JointNames::Smpl, "left_hip"},
                                     {JointNames::Vrm, "leftUpperLeg"},
                                     {JointNames::Mixamo, "mixamorig:LeftUpLeg"},
                                     {JointNames::Unreal, "thigh_l"}}) {
        SCOPED_TRACE(hip);
        exportAvatar(testDevice(), avatar, folder / "a.glb", &motion, {.names = names});
        const GltfNodes nodes = readGltfNodes(folder / "a.glb");
        std::set<std::string> all;
        for (const GltfNode& node : nodes.nodes) all.insert(node.name);
        EXPECT_TRUE(all.contains(hip));
        EXPECT_EQ(all.size(), 25u) << "the mesh's node and 24 joints, each of its own name";
        const Motion back = readMotion(folder / "a.glb");
        EXPECT_LT(worstMillimetres(back, motion, {0, 1, 0, 0}), 1.5);
    }
    EXPECT_EQ(messageOf<InputError>([] { jointNamesByWord("maya", "--names"); }),
              "--names: expected smpl, vrm, mixamo or unreal, found \"maya\"");
}

// At a share of 1 a target's vertices are those of the body of that coefficient, or of that hand.
TEST(Formats, ShapesAreMorphTargets) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    exportAvatar(testDevice(), avatar, folder / "a.glb", nullptr, {.shapes = true});
    const tinygltf::Model model = load(folder / "a.glb");
    const auto& mesh = model.meshes.at(0);
    const auto& primitive = mesh.primitives.at(0);
    ASSERT_EQ(primitive.targets.size(), 14u);
    EXPECT_EQ(mesh.weights, std::vector<double>(14));
    EXPECT_EQ(mesh.extras.Get("targetNames").Get(3).Get<std::string>(), "shape3");
    EXPECT_EQ(mesh.extras.Get("targetNames").Get(12).Get<std::string>(), "curlRightHand");
    const auto floats = [&](int index) {
        const auto& accessor = model.accessors.at(size_t(index));
        const auto& view = model.bufferViews.at(size_t(accessor.bufferView));
        std::vector<float> values(accessor.count * 3);
        std::memcpy(values.data(), &model.buffers[0].data.at(view.byteOffset), values.size() * 4);
        return values;
    };
    const auto& indices = model.accessors.at(size_t(primitive.indices));
    const auto& view = model.bufferViews.at(size_t(indices.bufferView));
    std::vector<uint16_t> corners(indices.count);
    std::memcpy(corners.data(), &model.buffers[0].data.at(view.byteOffset), corners.size() * 2);
    for (const size_t k : {0, 3, 9}) {
        std::vector<double> beta(10), none(10);
        beta[k] = 1;
        const auto shaped = shapedVertices(avatar.body, beta),
                   plain = shapedVertices(avatar.body, none);
        const auto moved = floats(primitive.targets[k].at("POSITION"));
        double most = 0;
        for (size_t i = 0; i < corners.size(); ++i)
            for (size_t c = 0; c < 3; ++c) {
                const size_t source = 3 * size_t(avatar.body.faces[i]) + c;
                ASSERT_NEAR(moved[3 * size_t(corners[i]) + c], shaped[source] - plain[source],
                            1e-6);
                most = std::max(most, std::abs(shaped[source] - plain[source]));
            }
        EXPECT_GT(most, 1e-3);
    }
    // The body at rest is what is exported of an avatar without networks.
    const std::vector<float> rest = avatar.body.restVertices();
    const FingerRig fingers = fingerRig(avatar.body);
    for (const size_t k : {0, 1, 2, 3}) {
        HandAmounts amounts{};
        amounts[k] = 1;
        const std::vector<float> bent = bentFingers(fingers, rest, amounts);
        const auto moved = floats(primitive.targets[10 + k].at("POSITION"));
        float most = 0;
        for (size_t i = 0; i < corners.size(); ++i)
            for (size_t c = 0; c < 3; ++c) {
                const size_t source = 3 * size_t(avatar.body.faces[i]) + c;
                ASSERT_NEAR(moved[3 * size_t(corners[i]) + c], bent[source] - rest[source], 1e-5);
                most = std::max(most, std::abs(bent[source] - rest[source]));
            }
        EXPECT_GT(most, .01f);
    }
}

TEST(Formats, Vrm) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    exportAvatar(testDevice(), avatar, folder / "a.vrm", nullptr,
                 {.author = "Ada", .licence = "https://example.org/licence"});
    const tinygltf::Model model = load(folder / "a.vrm");
    EXPECT_EQ(std::ranges::count(model.extensionsUsed, "VRMC_vrm"), 1);
    const auto& vrm = model.extensions.at("VRMC_vrm");
    EXPECT_EQ(vrm.Get("specVersion").Get<std::string>(), "1.0");
    const auto& meta = vrm.Get("meta");
    EXPECT_EQ(meta.Get("authors").Get(0).Get<std::string>(), "Ada");
    EXPECT_EQ(meta.Get("licenseUrl").Get<std::string>(), "https://vrm.dev/licenses/1.0/");
    EXPECT_EQ(meta.Get("otherLicenseUrl").Get<std::string>(), "https://example.org/licence");
    EXPECT_EQ(meta.Get("avatarPermission").Get<std::string>(), "onlyAuthor");
    EXPECT_FALSE(meta.Get("allowRedistribution").Get<bool>());
    // All that VRM 1.0 requires.
    const auto& bones = vrm.Get("humanoid").Get("humanBones");
    std::set<int> nodes;
    for (const char* bone :
         {"hips", "spine", "head", "leftUpperLeg", "leftLowerLeg", "leftFoot", "rightUpperLeg",
          "rightLowerLeg", "rightFoot", "leftUpperArm", "leftLowerArm", "leftHand", "rightUpperArm",
          "rightLowerArm", "rightHand"}) {
        ASSERT_TRUE(bones.Has(bone)) << bone;
        nodes.insert(bones.Get(bone).Get("node").Get<int>());
    }
    EXPECT_EQ(nodes.size(), 15u);
    EXPECT_EQ(model.nodes.at(size_t(bones.Get("leftLowerArm").Get("node").Get<int>())).name,
              "left_elbow");
    const Motion motion = walk();
    EXPECT_NE(messageOf<InputError>([&] {
                  exportAvatar(testDevice(), avatar, folder / "b.vrm", &motion);
              }).find("b.vrm: expected no motion"),
              std::string::npos);
}

// Numbers in a line of a file behind a word.
std::vector<double> numbersBehind(const std::string& text, const std::string& word) {
    const size_t begin = text.find(word);
    EXPECT_NE(begin, std::string::npos) << word;
    if (begin == std::string::npos) return {};
    std::string line =
        text.substr(begin + word.size(), text.find('\n', begin) - begin - word.size());
    for (char& c : line)
        if (std::strchr("()[],", c) != nullptr) c = ' ';
    std::istringstream stream(line);
    std::vector<double> numbers;
    for (double x; stream >> x;) numbers.push_back(x);
    return numbers;
}

TEST(Formats, Usd) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    const Motion motion = walk();
    exportAvatar(testDevice(), avatar, folder / "a.usda", &motion, {.names = JointNames::Mixamo});
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"a.png", "a.usda"}));
    const std::string text = bytesOf(folder / "a.usda");
    EXPECT_TRUE(text.starts_with("#usda 1.0\n"));
    EXPECT_EQ(std::ranges::count(text, '{'), std::ranges::count(text, '}'));
    EXPECT_EQ(std::ranges::count(text, '('), std::ranges::count(text, ')'));
    EXPECT_EQ(std::ranges::count(text, '['), std::ranges::count(text, ']'));
    EXPECT_NE(text.find("\"mixamorig_Hips/mixamorig_LeftUpLeg/mixamorig_LeftLeg\""),
              std::string::npos);
    EXPECT_NE(text.find("asset inputs:file = @./a.png@"), std::string::npos);
    EXPECT_EQ(imageSize(folder / "a.png"), (ImageSize{32, 32}));
    const auto points = numbersBehind(text, "point3f[] points = ");
    const auto faces = numbersBehind(text, "int[] faceVertexIndices = ");
    const auto weights = numbersBehind(text, "float[] primvars:skel:jointWeights = ");
    const auto joints = numbersBehind(text, "int[] primvars:skel:jointIndices = ");
    const auto bind = numbersBehind(text, "matrix4d[] bindTransforms = ");
    const auto rest = numbersBehind(text, "matrix4d[] restTransforms = ");
    const size_t count = points.size() / 3;
    ASSERT_EQ(faces.size(), size_t(3 * avatar.body.faceCount));
    ASSERT_EQ(weights.size(), 4 * count);
    ASSERT_EQ(joints.size(), 4 * count);
    ASSERT_EQ(bind.size(), 24u * 16);
    ASSERT_EQ(numbersBehind(text, "texCoord2f[] primvars:st = ").size(), 2 * count);
    ASSERT_EQ(numbersBehind(text, "int[] faceVertexCounts = ").size(), faces.size() / 3);
    // Rest transforms multiply down the tree to the bind transforms.
    for (size_t j = 0; j < 24; ++j)
        for (size_t c = 0; c < 3; ++c) {
            const int parent = avatar.body.parents[j];
            const double above = parent < 0 ? 0 : bind[16 * size_t(parent) + 12 + c];
            EXPECT_NEAR(rest[16 * j + 12 + c] + above, bind[16 * j + 12 + c], 1e-6);
        }
    // Skinned in a frame, it is the body that lbs gives.
    const size_t frame = 7;
    const std::string key = fmt::format("                {}: ", frame);
    const size_t translations = text.find("translations.timeSamples"),
                 rotations = text.find("rotations.timeSamples");
    const auto moves = numbersBehind(text.substr(translations, rotations - translations), key);
    const auto turns = numbersBehind(text.substr(rotations), key);
    ASSERT_EQ(moves.size(), 72u);
    ASSERT_EQ(turns.size(), 96u);
    std::vector<glm::dmat4> bones, world;
    for (size_t j = 0; j < 24; ++j) {
        glm::dmat4 local = glm::mat4_cast(
            glm::dquat(turns[4 * j], turns[4 * j + 1], turns[4 * j + 2], turns[4 * j + 3]));
        local[3] = glm::dvec4(moves[3 * j], moves[3 * j + 1], moves[3 * j + 2], 1);
        const int parent = avatar.body.parents[j];
        world.push_back(parent < 0 ? local : world[size_t(parent)] * local);
        glm::dmat4 matrix(1);
        for (int c = 0; c < 3; ++c) matrix[3][c] = bind[16 * j + 12 + size_t(c)];
        bones.push_back(world.back() * glm::inverse(matrix));
    }
    BodyPoser poser(testDevice(), avatar.body);
    const PosedMesh posed = poser.pose(motion.theta[frame], motion.trans[frame], avatar.betas);
    glm::dvec3 offset;
    double worst = 0;
    for (size_t i = 0; i < faces.size(); ++i) {
        const auto v = size_t(faces[i]);
        glm::dvec4 sum(0);
        for (size_t k = 0; k < 4; ++k)
            sum += weights[4 * v + k] *
                   (bones[size_t(joints[4 * v + k])] *
                    glm::dvec4(points[3 * v], points[3 * v + 1], points[3 * v + 2], 1));
        const float* p = &posed.verts[3 * size_t(avatar.body.faces[i])];
        const glm::dvec3 expected(p[0], -p[1], -p[2]);
        if (i == 0) offset = glm::dvec3(sum) - expected;
        worst = std::max(worst, glm::length(glm::dvec3(sum) - expected - offset));
    }
    EXPECT_LT(worst, 1e-3);
}

// By a reader that is not ours, where node and a three.js that reads skeletons in USD are.
TEST(Formats, UsdAsThreeJsReadsIt) {
    const std::string script = (test::sourceFolder() / "tests/usd/skin.mjs").string();
    if (std::system(fmt::format("node '{}' 2>/dev/null", script).c_str()) != 0)
        GTEST_SKIP() << "no node, or no package three, 0.180 or later";
    Folder folder;
    const Avatar avatar = plainAvatar({1, -1, .5f});
    const Motion motion = walk();
    exportAvatar(testDevice(), avatar, folder / "a.usda", &motion);
    BodyPoser poser(testDevice(), avatar.body);
    for (size_t frame : {size_t{0}, size_t{7}}) {
        ASSERT_EQ(
            std::system(fmt::format("node '{}' '{}' {} '{}'", script, (folder / "a.usda").string(),
                                    frame, (folder / "corners").string())
                            .c_str()),
            0);
        const std::string bytes = bytesOf(folder / "corners");
        std::vector<float> corners(bytes.size() / sizeof(float));
        std::memcpy(corners.data(), bytes.data(), bytes.size());
        ASSERT_EQ(corners.size(), 3 * avatar.body.faces.size());
        const PosedMesh posed = poser.pose(motion.theta[frame], motion.trans[frame], avatar.betas);
        glm::dvec3 offset;
        double worst = 0, low = INFINITY;
        for (size_t i = 0; i < avatar.body.faces.size(); ++i) {
            const float* p = &posed.verts[3 * size_t(avatar.body.faces[i])];
            const glm::dvec3 expected(p[0], -p[1], -p[2]),
                found(corners[3 * i], corners[3 * i + 1], corners[3 * i + 2]);
            if (i == 0) offset = found - expected;
            worst = std::max(worst, glm::length(found - expected - offset));
            low = std::min(low, found.y);
        }
        EXPECT_LT(worst, 1e-3);
        if (frame == 0) {
            EXPECT_NEAR(low, 0, 1e-3);
        }
    }
}

TEST(Formats, Obj) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    Motion motion = walk();
    EXPECT_NE(messageOf<InputError>([&] {
                  exportAvatar(testDevice(), avatar, folder / "a.obj", &motion);
              }).find("a.obj: expected one frame, since an OBJ has one pose, found 24; --frames"),
              std::string::npos);
    const std::vector<size_t> one{5};
    motion = motion.subset(one);
    exportAvatar(testDevice(), avatar, folder / "a.obj", &motion);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"a.mtl", "a.obj", "a.png"}));
    EXPECT_NE(bytesOf(folder / "a.mtl").find("map_Kd a.png"), std::string::npos);
    std::istringstream lines(bytesOf(folder / "a.obj"));
    std::vector<glm::dvec3> points;
    std::vector<size_t> corners;
    std::string line;
    size_t uvs = 0, normals = 0;
    while (std::getline(lines, line)) {
        std::istringstream words(line);
        std::string word;
        words >> word;
        glm::dvec3 v;
        if (word == "v") words >> v.x >> v.y >> v.z, points.push_back(v);
        if (word == "vt") ++uvs;
        if (word == "vn") ++normals;
        if (word != "f") continue;
        for (std::string corner; words >> corner;) {
            corners.push_back(std::stoul(corner) - 1);
            const auto n = std::to_string(corners.back() + 1);
            EXPECT_EQ(corner, n + "/" + n + "/" + n);
        }
    }
    EXPECT_EQ(uvs, points.size());
    EXPECT_EQ(normals, points.size());
    ASSERT_EQ(corners.size(), avatar.body.faces.size());
    BodyPoser poser(testDevice(), avatar.body);
    const PosedMesh posed = poser.pose(motion.theta[0], motion.trans[0], avatar.betas);
    glm::dvec3 offset;
    double low = INFINITY;
    for (size_t i = 0; i < corners.size(); ++i) {
        const float* p = &posed.verts[3 * size_t(avatar.body.faces[i])];
        const glm::dvec3 expected(p[0], -p[1], -p[2]), found = points.at(corners[i]);
        if (i == 0) offset = found - expected;
        ASSERT_LT(glm::length(found - expected - offset), 1e-4);
        low = std::min(low, found.y);
    }
    EXPECT_NEAR(low, 0, 1e-5);
    const auto& pelvis = posed.joints[0];
    EXPECT_NEAR(pelvis[0] + offset.x, 0, 1e-4) << "above the origin";
    EXPECT_NEAR(-pelvis[2] + offset.z, 0, 1e-4);

    // Its own files are replaced; somebody else's are not.
    exportAvatar(testDevice(), avatar, folder / "a.obj", nullptr);
    folder.write("b.png", std::string("holiday"));
    EXPECT_NE(
        messageOf<InputError>(
            [&] { exportAvatar(testDevice(), avatar, folder / "b.usda", nullptr); })
            .find("b.png: expected nothing there, or what an export wrote, since it is written "
                  "beside b.usda"),
        std::string::npos);
    EXPECT_EQ(bytesOf(folder / "b.png"), "holiday");
    EXPECT_FALSE(fs::exists(folder / "b.usda"));
}

TEST(Formats, Refusals) {
    Folder folder;
    const Avatar avatar = plainAvatar();
    const auto expect = [&](const char* name, const ExportSettings& settings,
                            const std::string& sentence) {
        const std::string found = messageOf<InputError>(
            [&] { exportAvatar(testDevice(), avatar, folder / name, nullptr, settings); });
        EXPECT_NE(found.find(sentence), std::string::npos) << found;
    };
    expect("a.fbx", {}, "a.fbx: expected a name that ends in .glb, .vrm, .usda, .obj, .bvh");
    expect("a.bvh", {}, "a.bvh: expected a motion (--motion), found none");
    expect("a.usda", {.shapes = true}, "a.usda: expected .glb or .vrm for --shapes, found another");
    expect("a.bvh", {.shapes = true}, "a.bvh: expected .glb or .vrm for --shapes");
    expect("a.glb", {.author = "Ada"}, "a.glb: expected .vrm for --author");
    expect("a.usda", {.licence = "https://a.org"}, "a.usda: expected .vrm for --licence");
    for (const char* name : {"a.obj", "a.npz"})
        expect(name, {.names = JointNames::Unreal},
               std::string(name) +
                   ": expected .glb, .vrm, .usda, .bvh or .json for --names, found another");
    EXPECT_TRUE(folder.names().empty());
}

// Khronos's validator, where node and its package are (NODE_PATH, or npm's global folder).
TEST(Formats, KhronosFindsNothing) {
    const std::string script =
        "const v=require('gltf-validator'),fs=require('fs');v.validateBytes(new "
        "Uint8Array(fs.readFileSync(process.argv[1]))).then(r=>{console.log(JSON.stringify(r."
        "issues."
        "messages));process.exit(r.issues.numErrors+r.issues.numWarnings?1:0)})";
    if (std::system("node -e \"require('gltf-validator')\" 2>/dev/null") != 0)
        GTEST_SKIP() << "no node, or no package gltf-validator";
    Folder folder;
    const Avatar avatar = plainAvatar();
    const Motion motion = walk();
    exportAvatar(testDevice(), avatar, folder / "plain.glb", nullptr);
    exportAvatar(testDevice(), avatar, folder / "plain.vrm", nullptr);
    exportAvatar(testDevice(), avatar, folder / "whole.vrm", nullptr,
                 {.shapes = true, .author = "Ada", .licence = "https://example.org/licence"});
    const std::vector<Motion> more{motion, motion};
    for (JointNames names :
         {JointNames::Smpl, JointNames::Vrm, JointNames::Mixamo, JointNames::Unreal})
        exportAvatar(testDevice(), avatar, folder / fmt::format("moving-{}.glb", int(names)),
                     &motion, {.names = names, .shapes = true, .furtherMotions = more});
    const std::vector<size_t> one{3};
    const Motion still = motion.subset(one);
    exportAvatar(testDevice(), avatar, folder / "still.glb", &still);
    for (const std::string& name : folder.names())
        EXPECT_EQ(std::system(
                      fmt::format("node -e \"{}\" '{}'", script, (folder / name).string()).c_str()),
                  0)
            << name;
}

}  // namespace
}  // namespace doppel
