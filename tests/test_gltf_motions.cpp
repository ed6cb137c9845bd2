// Animations of glTF files as Mixamo, VRM, Blender and drawn curves have them, become motions;
// damaged ones are refused.
#include <gtest/gtest.h>

#include <functional>
#include <map>

#include "engine/error.h"
#include "engine/io/gltf.h"
#include "engine/io/gltf_nodes.h"
#include "nn/body/body.h"
#include "tests/files.h"
#include "tests/moving_person.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/export.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using namespace test;

// ---- glTF, as text with its numbers inside ------------------------------------------------------

std::string base64(const std::string& bytes) {
    constexpr const char* kDigits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (size_t i = 0; i < bytes.size(); i += 3) {
        uint32_t bits = 0;
        for (size_t k = 0; k < 3; ++k)
            bits = bits << 8 | (i + k < bytes.size() ? static_cast<uint8_t>(bytes[i + k]) : 0u);
        for (size_t k = 0; k < 4; ++k)
            text += i + k > bytes.size() ? '=' : kDigits[bits >> (18 - 6 * k) & 63];
    }
    return text;
}

class GltfText {
public:
    int floats(const std::vector<double>& values, const char* type, size_t width) {
        const size_t begin = buffer_.size();
        for (const double value : values) {
            const auto single = static_cast<float>(value);
            buffer_.append(reinterpret_cast<const char*>(&single), 4);
        }
        views_ += fmt::format("{}{{\"buffer\":0,\"byteOffset\":{},\"byteLength\":{}}}",
                              views_.empty() ? "" : ",", begin, buffer_.size() - begin);
        accessors_ += fmt::format(
            "{}{{\"bufferView\":{},\"componentType\":5126,\"count\":{},\"type\":\"{}\"}}",
            accessors_.empty() ? "" : ",", count_, values.size() / width, type);
        return count_++;
    }
    void channel(size_t node, const char* path, int times, int values, const char* between) {
        samplers_ += fmt::format("{}{{\"input\":{},\"output\":{},\"interpolation\":\"{}\"}}",
                                 samplers_.empty() ? "" : ",", times, values, between);
        channels_ += fmt::format("{}{{\"sampler\":{},\"target\":{{\"node\":{},\"path\":\"{}\"}}}}",
                                 channels_.empty() ? "" : ",", samplerCount_++, node, path);
    }
    std::string text(const std::string& nodes, const std::string& more = "") const {
        return fmt::format(
            "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],"
            "\"nodes\":[{}],\"buffers\":[{{\"byteLength\":{},\"uri\":\"data:application/"
            "octet-stream;base64,{}\"}}],\"bufferViews\":[{}],\"accessors\":[{}],"
            "\"animations\":[{{\"name\":\"wave\",\"samplers\":[{}],\"channels\":[{}]}}]{}}}",
            nodes, buffer_.size(), base64(buffer_), views_, accessors_, samplers_, channels_, more);
    }

private:
    std::string buffer_, views_, accessors_, samplers_, channels_;
    int count_ = 0, samplerCount_ = 0;
};

struct Writing {
    glm::dquat armature = turn(-90, kX);  // Blender's z up to glTF's y up
    double scale = .01;                   // centimetres below the armature
    bool bound = true;  // the nodes stand in the first frame, a skin says the rest
    const char* between = "LINEAR";
    std::string more;
    std::vector<double> hipScales;  // [K][3] of the hips' node, where there are some
    std::function<std::string(const std::string&)> rename = [](const std::string& name) {
        return "mixamorig:" + name;
    };
};

std::string gltfOf(const std::vector<Bone>& bones, const std::vector<Turns>& frames,
                   const std::vector<glm::dvec3>& where, const Writing& writing) {
    GltfText gltf;
    const auto axesAbove = [&](size_t b) {
        return bones[b].parent < 0 ? writing.armature
                                   : bones[static_cast<size_t>(bones[b].parent)].axes;
    };
    const auto localTurn = [&](size_t b, const glm::dquat& own) {
        return glm::conjugate(axesAbove(b)) * own * bones[b].axes;
    };
    const auto localMove = [&](size_t b, const glm::dvec3& offset) {
        return glm::conjugate(axesAbove(b)) * offset / writing.scale;
    };
    std::vector<double> seconds;
    for (size_t f = 0; f < frames.size(); ++f) seconds.push_back(.5 + double(f) / 24);
    const int times = gltf.floats(seconds, "SCALAR", 1);
    const bool cubic = std::string(writing.between) == "CUBICSPLINE";
    const auto write = [&](size_t node, const char* path, const std::vector<double>& values,
                           size_t width) {
        std::vector<double> keyed;
        for (size_t k = 0; k < frames.size(); ++k) {
            if (cubic) keyed.insert(keyed.end(), width, 0.);
            keyed.insert(keyed.end(), values.begin() + std::ptrdiff_t(k * width),
                         values.begin() + std::ptrdiff_t((k + 1) * width));
            if (cubic) keyed.insert(keyed.end(), width, 0.);
        }
        gltf.channel(node, path, times, gltf.floats(keyed, width == 4 ? "VEC4" : "VEC3", width),
                     writing.between);
    };
    std::string nodes, joints;
    std::vector<double> inverse;
    std::vector<glm::dvec3> rest;
    std::string roots;
    for (size_t b = 0; b < bones.size(); ++b) {
        std::vector<double> rotations, moves;
        for (size_t f = 0; f < frames.size(); ++f) {
            const glm::dquat q = localTurn(b, frames[f][b]);
            rotations.insert(rotations.end(), {q.x, q.y, q.z, q.w});
            const glm::dvec3 t = localMove(b, where[f]);
            moves.insert(moves.end(), {t.x, t.y, t.z});
        }
        write(b + 1, "rotation", rotations, 4);
        if (bones[b].parent < 0) write(b + 1, "translation", moves, 3);
        if (b == 0 && !writing.hipScales.empty()) write(1, "scale", writing.hipScales, 3);
        const bool moved = writing.bound;
        const glm::dquat q = localTurn(b, moved ? frames[0][b] : glm::dquat(1, 0, 0, 0));
        const glm::dvec3 t =
            localMove(b, bones[b].parent < 0 && moved ? where[0] : bones[b].offset);
        std::string children;
        for (size_t c = 0; c < bones.size(); ++c)
            if (bones[c].parent == static_cast<int>(b))
                children += fmt::format("{}{}", children.empty() ? "" : ",", c + 1);
        nodes += fmt::format(
            ",{{\"name\":\"{}\",\"rotation\":[{:.9f},{:.9f},{:.9f},{:.9f}],"
            "\"translation\":[{:.9f},{:.9f},{:.9f}]{}}}",
            writing.rename(bones[b].name), q.x, q.y, q.z, q.w, t.x, t.y, t.z,
            children.empty() ? "" : ",\"children\":[" + children + "]");
        joints += fmt::format("{}{}", b ? "," : "", b + 1);
        // The bind matrix in the armature's space.
        const glm::dvec3 place = bones[b].parent < 0
                                     ? bones[b].offset
                                     : rest[static_cast<size_t>(bones[b].parent)] + bones[b].offset;
        rest.push_back(place);
        glm::dmat4 bind = glm::mat4_cast(glm::conjugate(writing.armature) * bones[b].axes);
        bind[3] = glm::dvec4(glm::conjugate(writing.armature) * place / writing.scale, 1);
        const glm::dmat4 back = glm::inverse(bind);
        for (int c = 0; c < 16; ++c) inverse.push_back(back[c / 4][c % 4]);
    }
    const glm::dquat a = writing.armature;
    nodes = fmt::format(
                "{{\"name\":\"Armature\",\"rotation\":[{:.9f},{:.9f},{:.9f},{:.9f}],"
                "\"scale\":[{},{},{}],\"children\":[1]}}",
                a.x, a.y, a.z, a.w, writing.scale, writing.scale, writing.scale) +
            nodes;
    std::string more = writing.more;
    if (writing.bound)
        more += fmt::format(",\"skins\":[{{\"joints\":[{}],\"inverseBindMatrices\":{}}}]", joints,
                            gltf.floats(inverse, "MAT4", 16));
    return gltf.text(nodes, more);
}

std::vector<Bone> ownAxes(std::vector<Bone> bones) {
    for (size_t b = 0; b < bones.size(); ++b)
        bones[b].axes = turn(31 * double(b), {1, double(b % 3), -.5});
    return bones;
}

TEST(Motions, GltfAsMixamoAndBlenderWriteIt) {
    Folder folder;
    const auto bones = ownAxes(person());
    const auto frames = poses(bones.size());
    const auto where = places(frames.size());
    const Motion expected = expectedOf(bones, frames, where, 24);
    for (const bool bound : {true, false})
        for (const char* between : {"LINEAR", "STEP", "CUBICSPLINE"}) {
            SCOPED_TRACE(between);
            Writing writing;
            writing.bound = bound, writing.between = between;
            folder.write("dance.gltf", gltfOf(bones, frames, where, writing));
            const Motion found = readMotion(folder / "dance.gltf");
            expectSame(found, expected, 1e-3);
            EXPECT_EQ(found.name, "wave");
            EXPECT_EQ(found.note, "a T-pose as the rest pose, 0.943 metres to the unit");
        }
}

// Bones by the names that a Japanese author gave them; the file says what is what.
TEST(Motions, VrmNamesItsBones) {
    Folder folder;
    const auto bones = ownAxes(person());
    const auto frames = poses(bones.size());
    const auto where = places(frames.size());
    const Motion expected = expectedOf(bones, frames, where, 24);
    std::map<std::string, std::string> vrm = {{"Hips", "hips"},    {"Spine", "spine"},
                                              {"Spine1", "chest"}, {"Spine2", "upperChest"},
                                              {"Neck", "neck"},    {"Head", "head"}};
    for (const auto& [side, s] : {std::pair{"Left", "left"}, {"Right", "right"}})
        for (const auto& [ours, theirs] : {std::pair{"UpLeg", "UpperLeg"},
                                           {"Leg", "LowerLeg"},
                                           {"Foot", "Foot"},
                                           {"ToeBase", "Toes"},
                                           {"Shoulder", "Shoulder"},
                                           {"Arm", "UpperArm"},
                                           {"ForeArm", "LowerArm"},
                                           {"Hand", "Hand"}})
            vrm[side + std::string(ours)] = s + std::string(theirs);
    std::string one, old;
    for (size_t b = 0; b < bones.size(); ++b) {
        const std::string& bone = vrm.at(bones[b].name);
        one += fmt::format("{}\"{}\":{{\"node\":{}}}", b ? "," : "", bone, b + 1);
        old += fmt::format("{}{{\"bone\":\"{}\",\"node\":{}}}", b ? "," : "", bone, b + 1);
    }
    Writing writing;
    writing.rename = [](const std::string& name) {
        return fmt::format("\xe9\xaa\xa8{}", std::hash<std::string>()(name) % 9973);
    };
    for (const std::string& extension :
         {fmt::format(
              "\"VRMC_vrm\":{{\"specVersion\":\"1.0\",\"humanoid\":{{\"humanBones\":{{{}}}}}}}",
              one),
          fmt::format("\"VRMC_vrm_animation\":{{\"humanoid\":{{\"humanBones\":{{{}}}}}}}", one),
          fmt::format("\"VRM\":{{\"humanoid\":{{\"humanBones\":[{}]}}}}", old)}) {
        writing.more = ",\"extensions\":{" + extension + "}";
        folder.write("a.vrm", gltfOf(bones, frames, where, writing));
        expectSame(readMotion(folder / "a.vrm"), expected, 1e-3);
    }
    writing.more = "";
    folder.write("a.vrm", gltfOf(bones, frames, where, writing));
    EXPECT_NE(messageOf<InputError>([&] {
                  readMotion(folder / "a.vrm");
              }).find("a.vrm: expected a person's joints, with names such as LeftUpLeg"),
              std::string::npos);
}

// What export writes comes back: the same joints, the motion's own rate.
TEST(Motions, AnExportedAnimationComesBack) {
    Folder folder;
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.textureSize = 16;
    avatar.texture.assign(16 * 16 * 3, .5f);
    Motion motion;
    motion.name = "session";
    motion.fps = 25;
    for (const MotionFrame& frame : actorSession(4, 4, 3)) {
        motion.theta.push_back(frame.theta);
        motion.trans.push_back(frame.trans);
    }
    motion.cameras.resize(motion.size());
    writeGlb(folder / "a.glb", avatarScene(avatar, avatar.body.templateVertices, &motion));
    const Motion back = readMotion(folder / "a.glb");
    ASSERT_EQ(back.size(), motion.size());
    EXPECT_EQ(back.fps, 25);
    const glm::dquat upright(0, 1, 0, 0);
    for (size_t f = 0; f < motion.size(); ++f) {
        const auto was = placeJoints(motion.theta[f], motion.trans[f]);
        const auto is = placeJoints(back.theta[f], back.trans[f]);
        const glm::dvec3 moved = is[0] - upright * was[0];
        const auto first = placeJoints(motion.theta[0], motion.trans[0]);
        const auto begins = placeJoints(back.theta[0], back.trans[0]);
        EXPECT_LT(glm::length(moved - (begins[0] - upright * first[0])), 2e-3) << f;
        for (size_t j = 0; j < joint::kCount; ++j)
            EXPECT_LT(glm::length(is[j] - (upright * was[j] + moved)), 2e-3) << f << jointName(j);
    }
}

TEST(Motions, DamagedGltfIsRefused) {
    Folder folder;
    const auto bones = person();
    const auto frames = poses(bones.size());
    const std::string whole = gltfOf(bones, frames, places(frames.size()), {});
    const auto expect = [&](std::string text, const std::string& from, const std::string& to,
                            const std::string& sentence) {
        if (!from.empty()) {
            ASSERT_NE(text.find(from), std::string::npos) << from;
            text.replace(text.find(from), from.size(), to);
        }
        folder.write("bad.gltf", text);
        const std::string found = messageOf<InputError>([&] { readMotion(folder / "bad.gltf"); });
        EXPECT_NE(found.find("bad.gltf: "), std::string::npos) << found;
        EXPECT_NE(found.find(sentence), std::string::npos) << found;
        EXPECT_EQ(found.find('\n'), std::string::npos) << found;
    };
    expect(whole.substr(0, whole.size() / 2), "", "", "expected a glTF 2.0 file");
    expect(whole, "\"children\":[1]", "\"children\":[1,0]", "nodes: expected a tree");
    expect(whole, "\"children\":[2,7,15]", "\"children\":[2,7,99]",
           "nodes: expected each node below one other, found node 99");
    expect(whole, "\"count\":4,\"type\":\"SCALAR\"", "\"count\":5000,\"type\":\"SCALAR\"",
           "animation times: expected 5000 elements, found fewer bytes");
    expect(whole, "\"count\":4,\"type\":\"VEC4\"", "\"count\":3,\"type\":\"VEC4\"",
           "animation values: expected 16 for 4 keys, found 12");
    expect(whole, "\"target\":{\"node\":1,", "\"target\":{\"node\":77,",
           "animations: expected nodes");
    expect(whole, "\"target\":{\"node\":2,", "\"target\":{\"node\":1,",
           "animations: expected one channel for the rotation of node 1, found two");
    expect(whole, "\"count\":4,\"type\":\"SCALAR\"", "\"count\":20000000,\"type\":\"SCALAR\"",
           "animations: expected at most 134217728 numbers, found more");
    std::string still = whole;
    still.erase(still.find(",\"animations\""));
    expect(still + "}", "", "", "animations: expected one that moves a skeleton, found none");
    // Bones that vanish or leave the world in one of the frames.
    Writing writing;
    writing.hipScales.assign(12, 1);
    for (size_t c = 0; c < 3; ++c) writing.hipScales[c] = 0;
    expect(gltfOf(bones, frames, places(frames.size()), writing), "", "",
           "rotations: expected finite numbers, found ");
    for (size_t c = 0; c < 3; ++c) writing.hipScales[c] = 1e11;
    expect(gltfOf(bones, frames, places(frames.size()), writing), "", "",
           "translations: expected numbers from -1000000 to 1000000, found ");
}

std::string glbOf(std::string json) {
    json.resize((json.size() + 3) / 4 * 4, ' ');
    const auto word = [](size_t number) {
        const auto small = static_cast<uint32_t>(number);
        return std::string(reinterpret_cast<const char*>(&small), 4);
    };
    return "glTF" + word(2) + word(json.size() + 20) + word(json.size()) + "JSON" + json;
}

TEST(Motions, DeeplyNestedGltfIsRefused) {
    Folder folder;
    const auto bones = person();
    const auto frames = poses(bones.size());
    const std::string whole = gltfOf(bones, frames, places(frames.size()), {});
    const auto withExtras = [&](const std::string& extras) {
        std::string text = whole;
        const std::string asset = "\"asset\":{";
        text.insert(text.find(asset) + asset.size(), "\"extras\":" + extras + ",");
        return text;
    };
    const auto nested = [](size_t depth) {
        return std::string(depth, '[') + std::string(depth, ']');
    };
    for (const auto& make : {+[](std::string text) { return text; }, glbOf}) {
        folder.write("deep.glb", make(withExtras(nested(200'000))));
        const std::string found = messageOf<InputError>([&] { readMotion(folder / "deep.glb"); });
        EXPECT_NE(found.find("deep.glb: expected JSON nested at most 64 deep, found more at byte "),
                  std::string::npos)
            << found;
        // Two levels are around it; what stands in strings counts for nothing.
        for (const std::string& extras :
             {nested(62), "\"\\\"" + std::string(200, '[') + "\\\\\""}) {
            folder.write("good.glb", make(withExtras(extras)));
            EXPECT_EQ(readMotion(folder / "good.glb").size(), frames.size()) << extras;
        }
        folder.write("deep.glb", make(withExtras(nested(63))));
        EXPECT_THROW(readMotion(folder / "deep.glb"), InputError);
    }
}

// Other files than those beside it and below are not read.
TEST(Motions, GltfStaysInItsFolder) {
    Folder folder;
    const auto bones = person();
    const auto frames = poses(bones.size());
    const std::string whole = gltfOf(bones, frames, places(frames.size()), {});
    for (const char* name : {"scene/below", "scene-2", "elsewhere"})
        fs::create_directories(folder / name);
    for (const char* name : {"secret.bin", "scene/own.bin", "scene/below/own.bin",
                             "scene-2/other.bin", "elsewhere/here.bin"})
        folder.write(name, std::string("1234"));
    folder.link("../secret.bin", "scene/link.bin");
    folder.link("..", "scene/up");
    folder.link("below/own.bin", "scene/inner.bin");
    const auto read = [&](const std::string& uri) {
        std::string text = whole;
        const std::string end = "}],\"bufferViews\"";
        text.insert(text.find(end) + 1, ",{\"byteLength\":4,\"uri\":\"" + uri + "\"}");
        folder.write("scene/a.gltf", text);
        return readMotion(folder / "scene/a.gltf").size();
    };
    const fs::path before = fs::current_path();
    fs::current_path(folder / "elsewhere");
    for (const char* uri : {"own.bin", "below/own.bin", "below/../own.bin", "inner.bin"})
        EXPECT_EQ(read(uri), frames.size()) << uri;
    for (const std::string& uri :
         {std::string("../secret.bin"), std::string("link.bin"), std::string("up/secret.bin"),
          std::string("below/../../secret.bin"), std::string("%2e%2e/secret.bin"),
          std::string("../scene-2/other.bin"), std::string("here.bin"), std::string("./here.bin"),
          (folder / "secret.bin").string(), std::string("none.bin")}) {
        const std::string found = messageOf<InputError>([&] { read(uri); });
        EXPECT_NE(found.find("a.gltf: expected a glTF 2.0 file"), std::string::npos) << uri;
    }
    fs::current_path(before);
}

}  // namespace
}  // namespace doppel
