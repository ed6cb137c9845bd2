// Motions of other programs: glTF animations as Mixamo, VRM and drawn curves have them, AMASS's
// npz, MakeHuman's skeleton, and which axis is up.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "engine/io/gltf.h"
#include "engine/io/gltf_nodes.h"
#include "nn/body/body.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/export.h"
#include "trainer/motion/session.h"
#include "trainer/motion/skeleton_motion.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

constexpr double kDegree = 3.14159265358979323846 / 180;
const glm::dvec3 kX(1, 0, 0), kY(0, 1, 0), kZ(0, 0, 1);
glm::dquat turn(double degrees, const glm::dvec3& axis) {
    return quaternionOf(degrees * kDegree * glm::normalize(axis));
}

// ---- somebody in motion -------------------------------------------------------------------------

struct Bone {
    std::string name;
    int parent;
    glm::dvec3 offset;            // metres, in the T-pose
    glm::dquat axes{1, 0, 0, 0};  // the bone's own frame in the T-pose
};

// Mixamo's names; each bone's own axes are turned some other way.
std::vector<Bone> person() {
    std::vector<Bone> bones = {{"Hips", -1, {0, .95, 0}},  {"Spine", 0, {0, .1, 0}},
                               {"Spine1", 1, {0, .12, 0}}, {"Spine2", 2, {0, .12, 0}},
                               {"Neck", 3, {0, .2, 0}},    {"Head", 4, {0, .1, 0}}};
    for (const double side : {1., -1.}) {
        const std::string s = side > 0 ? "Left" : "Right";
        const int leg = static_cast<int>(bones.size());
        bones.insert(bones.end(), {{s + "UpLeg", 0, {side * .09, -.05, 0}},
                                   {s + "Leg", leg, {0, -.4, 0}},
                                   {s + "Foot", leg + 1, {0, -.4, 0}},
                                   {s + "ToeBase", leg + 2, {0, -.06, .14}},
                                   {s + "Shoulder", 3, {side * .05, .12, 0}},
                                   {s + "Arm", leg + 4, {side * .12, 0, 0}},
                                   {s + "ForeArm", leg + 5, {side * .28, 0, 0}},
                                   {s + "Hand", leg + 6, {side * .25, 0, 0}}});
    }
    return bones;
}

using Turns = std::vector<glm::dquat>;  // of each bone, about the T-pose's axes

// A few poses with every bone turned; the first is far from a rest pose.
std::vector<Turns> poses(size_t bones, size_t count = 4) {
    std::vector<Turns> all;
    for (size_t f = 0; f < count; ++f) {
        all.emplace_back();
        for (size_t b = 0; b < bones; ++b)
            all.back().push_back(turn(8 + double((7 * b + 5 * f) % 30),
                                      {std::sin(double(b)), .3, std::cos(double(b + f))}));
    }
    return all;
}
std::vector<glm::dvec3> places(size_t count) {
    std::vector<glm::dvec3> all;
    for (size_t f = 0; f < count; ++f) all.emplace_back(.1 * double(f), .95, .2);
    return all;
}

// What the skeleton without any axes of its own gives.
Motion expectedOf(const std::vector<Bone>& bones, const std::vector<Turns>& frames,
                  const std::vector<glm::dvec3>& where, double fps = 30) {
    SkeletonMotion source{"test", "rest", {}, frames.size(), 1 / fps, {}};
    for (const Bone& bone : bones) source.joints.push_back({bone.name, bone.parent});
    source.placed = [&](int64_t frame) {
        SkeletonMotion::Placement placed;
        for (size_t b = 0; b < bones.size(); ++b) {
            const glm::dquat own =
                frame < 0 ? glm::dquat(1, 0, 0, 0) : frames[static_cast<size_t>(frame)][b];
            if (bones[b].parent < 0) {
                placed.rotation.push_back(own);
                placed.position.push_back(frame < 0 ? bones[b].offset
                                                    : where[static_cast<size_t>(frame)]);
                continue;
            }
            const auto p = static_cast<size_t>(bones[b].parent);
            placed.position.push_back(placed.position[p] + placed.rotation[p] * bones[b].offset);
            placed.rotation.push_back(placed.rotation[p] * own);
        }
        return placed;
    };
    return motionFromSkeleton(source);
}

void expectSame(const Motion& found, const Motion& expected, double tolerance = 2e-4) {
    ASSERT_EQ(found.size(), expected.size());
    EXPECT_NEAR(found.fps, expected.fps, 1e-6);
    for (size_t f = 0; f < found.size(); ++f) {
        for (size_t j = 0; j < joint::kCount; ++j)
            EXPECT_LT(glm::length(axisAngleOf(jointRotation(found.theta[f], j) *
                                              glm::conjugate(jointRotation(expected.theta[f], j)))),
                      tolerance)
                << f << " " << jointName(j);
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(found.trans[f][c], expected.trans[f][c], tolerance) << f;
    }
}

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
    expect(whole, "\"uri\":\"data", "\"uri\":\"../../etc/hosts\",\"x\":\"data", "");
    std::string still = whole;
    still.erase(still.find(",\"animations\""));
    expect(still + "}", "", "", "animations: expected one that moves a skeleton, found none");
}

// ---- other skeletons and motions ----------------------------------------------------------------

// MakeHuman's default rig: a root with a pelvis for each side, limbs of two bones each, five spine
// joints, three of the neck.
TEST(Motions, MakeHuman) {
    const auto bones = person();
    const auto frames = poses(bones.size());
    const auto where = places(frames.size());
    std::vector<Bone> rig = {{"root", -1, {0, .95, 0}}};
    std::vector<Turns> turned(frames.size());
    for (size_t f = 0; f < frames.size(); ++f) turned[f].push_back(frames[f][0]);
    const auto add = [&](const std::string& name, int parent, glm::dvec3 offset, int source) {
        rig.push_back({name, parent, offset});
        for (size_t f = 0; f < frames.size(); ++f)
            turned[f].push_back(source < 0 ? glm::dquat(1, 0, 0, 0)
                                           : frames[f][static_cast<size_t>(source)]);
        return static_cast<int>(rig.size()) - 1;
    };
    const int low = add("spine04", 0, bones[1].offset, 1);
    const int middle = add("spine03", low, bones[2].offset, 2);
    const int high = add("spine01", middle, bones[3].offset, 3);
    const int neck = add("neck01", high, bones[4].offset, 4);
    add("head", neck, bones[5].offset, 5);
    for (const int s : {0, 1}) {
        const std::string side = s ? ".R" : ".L";
        const int from = 6 + 8 * s;
        const auto offset = [&](int k) { return bones[static_cast<size_t>(from + k)].offset; };
        const int pelvis = add("pelvis" + side, 0, offset(0) * .4, -1);
        const int thigh = add("upperleg01" + side, pelvis, offset(0) * .6, from);
        const int twist = add("upperleg02" + side, thigh, offset(1) * .5, -1);
        const int shin = add("lowerleg01" + side, twist, offset(1) * .5, from + 1);
        const int foot = add("foot" + side, shin, offset(2), from + 2);
        add("toe1-1" + side, foot, offset(3), from + 3);
        const int clavicle = add("clavicle" + side, high, offset(4), from + 4);
        const int shoulder = add("shoulder01" + side, clavicle, offset(5) * .5, -1);
        const int arm = add("upperarm01" + side, shoulder, offset(5) * .5, from + 5);
        const int fore = add("lowerarm01" + side, arm, offset(6), from + 6);
        add("wrist" + side, fore, offset(7), from + 7);
    }
    expectSame(expectedOf(rig, turned, where), expectedOf(bones, frames, where), 2e-3);
}

struct AmassFile {
    std::vector<double> poses, trans;
    size_t frames = 0;
    void add(const Theta& theta, const glm::dvec3& moved, size_t width) {
        for (size_t k = 0; k < width; ++k)
            poses.push_back(k < 66 ? static_cast<double>(theta[k]) : .1);
        for (int c = 0; c < 3; ++c) trans.push_back(moved[c]);
        ++frames;
    }
};

// Walks in a world with z up, as AMASS has it.
TEST(Motions, AmassOfEitherBody) {
    Folder folder;
    const glm::dquat zUp = turn(90, kX) * glm::dquat(0, 1, 0, 0);  // from the camera's y down
    for (const bool expressive : {false, true}) {
        AmassFile file;
        std::vector<Theta> truth;
        const size_t width = expressive ? 165 : 156;
        const auto session = actorSession(2, 6, 3);
        for (size_t f = 0; f < session.size(); ++f) {
            Theta theta = session[f].theta;
            setJointRotation(theta, 0, zUp * jointRotation(theta, 0));
            file.add(theta, {.1 * double(f), 0, .9}, width);
            truth.push_back(theta);
        }
        Npz npz;
        const auto count = static_cast<int64_t>(file.frames);
        npz.set("poses", Array::f64({count, static_cast<int64_t>(width)}, file.poses));
        npz.set("trans", Array::f64({count, 3}, file.trans));
        npz.set("betas", Array::f64({16}, std::vector<double>(16)));
        npz.set("gender", Array::text("female"));
        if (expressive) {
            npz.set("mocap_frame_rate", Array::scalarF64(120));
            npz.set("surface_model_type", Array::text("smplx"));
        } else {
            npz.set("mocap_framerate", Array::scalarF64(60));
            npz.set("dmpls", Array::f64({count, 8}, std::vector<double>(8 * file.frames)));
        }
        writeNpz(folder / "walk_poses.npz", npz, true);
        const Motion motion = readMotion(folder / "walk_poses.npz");
        ASSERT_EQ(motion.size(), file.frames);
        EXPECT_EQ(motion.fps, expressive ? 120 : 60);
        EXPECT_EQ(takenAs(motion), fmt::format("AMASS, {} a second, z up", expressive ? 120 : 60));
        for (size_t f = 0; f < motion.size(); ++f) {
            for (size_t k = 0; k < 66; ++k) EXPECT_NEAR(motion.theta[f][k], truth[f][k], 1e-5);
            // SMPL+H's hands and SMPL-X's jaw are no joints of ours.
            for (size_t k = 66; k < 72; ++k) EXPECT_EQ(motion.theta[f][k], 0);
            EXPECT_NEAR(motion.trans[f][0], .1 * double(f) + (expressive ? .0031 : 0), 1e-5);
            EXPECT_NEAR(motion.trans[f][2], .9 + (expressive ? .012 - .028 : 0), 1e-5);
        }
        EXPECT_LT(glm::length(uprightRotation(motion) * kZ - kY), 1e-9);
    }
}

// Somebody who rolls about on the floor of a world with z up: the bodies' own axes say nothing.
TEST(Motions, TheGroundSaysWhichAxisIsUp) {
    Motion rolling;
    for (int f = 0; f < 24; ++f) {
        Theta theta{};
        // Along x on the ground, turning about the own length.
        setJointRotation(theta, 0, turn(-90, kZ) * turn(15. * f, kY));
        rolling.theta.push_back(theta);
        rolling.trans.push_back({0, .2f * static_cast<float>(f), 0});
        double low = 0;
        for (const glm::dvec3& place : placeJoints(theta, {})) low = std::min(low, place.z);
        rolling.trans.back()[2] = static_cast<float>(-low);
    }
    EXPECT_LT(glm::length(uprightRotation(rolling) * kZ - kY), 1e-9);
    EXPECT_EQ(takenAs(rolling), "z up");
    // The same in a world with y up.
    Motion other = rolling;
    for (size_t f = 0; f < other.size(); ++f)
        movePose({glm::mat3_cast(turn(-90, kX)), glm::dvec3(0)}, other.theta[f], other.trans[f]);
    EXPECT_EQ(takenAs(other), "y up");
}

}  // namespace
}  // namespace doppel
