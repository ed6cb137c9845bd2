#include "trainer/avatar/export.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <iterator>
#include <limits>
#include <vector>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "nn/body/body.h"
#include "nn/body/fingers.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/formats/mesh_parts.h"
#include "trainer/avatar/formats/model_files.h"
#include "trainer/avatar/formats/motion_files.h"
#include "trainer/avatar/formats/vrm_avatar.h"
#include "trainer/avatar/rig.h"
#include "trainer/avatar/sheet.h"
#include "trainer/data/pose.h"
#include "trainer/motion/upright.h"

namespace doppel {

namespace {

constexpr size_t kJoints = BodyModel::kJoints, kLeftShoulder = 16, kRightShoulder = 17;

// ---- mesh ---------------------------------------------------------------------------------------

glm::dvec3 vertex(std::span<const float> verts, size_t v) {
    return {verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]};
}

float lowest(std::span<const float> verts) {
    float low = std::numeric_limits<float>::infinity();
    for (size_t i = 1; i < verts.size(); i += 3) low = std::min(low, verts[i]);
    return low;
}

}  // namespace

// ---- motion -------------------------------------------------------------------------------------

namespace {

GltfAnimation animate(const Rig& rig, std::span<const float> bindVerts, float ground,
                      const Motion& motion) {
    CHECK(motion.size() > 0, "a motion has frames");
    GltfAnimation animation;
    animation.name = motion.name.empty() ? "motion" : motion.name;
    double fps = motion.fps > 0 ? motion.fps : 30;
    glm::dquat upright = uprightRotation(motion);
    Placement first = rig.place(motion.theta[0]);
    double low = std::numeric_limits<double>::infinity();  // below the pelvis
    for (size_t v = 0; v < bindVerts.size() / 3; ++v) {
        Rig::Blend skin = rig.skin(first, v);
        glm::dvec3 posed = skin.turn * vertex(bindVerts, v) + skin.move;
        low = std::min(low, (upright * (posed - rig.rest[0])).y);
    }
    for (size_t k = 0; k < motion.size(); ++k) {
        animation.times.push_back(static_cast<float>(static_cast<double>(k) / fps));
        for (size_t j = 0; j < kJoints; ++j) {
            glm::dquat q = jointRotation(motion.theta[k], j);
            if (j == 0) q = upright * q;
            for (double x : {q.x, q.y, q.z, q.w})
                animation.rotations.push_back(static_cast<float>(x));
        }
        // v = R(theta_0) (v' - j_0) + j_0 + t: the pelvis is at j_0 + t, however it is turned.
        const Trans &t = motion.trans[k], &start = motion.trans[0];
        glm::dvec3 path =
            upright * (glm::dvec3(t[0], t[1], t[2]) - glm::dvec3(start[0], start[1], start[2]));
        glm::dvec3 rest = rig.rest[0] - glm::dvec3(0, ground, 0);
        glm::dvec3 moved = path - glm::dvec3(0, low, 0) - rest;
        for (int c = 0; c < 3; ++c) animation.translations.push_back(static_cast<float>(moved[c]));
    }
    return animation;
}

// The vertices that skinning brings closest, in the mean of squares, to what the networks make of
// these poses: per vertex three numbers from three equations for each pose. Body frame.
std::vector<float> bindVertices(AvatarRenderer& renderer, const Rig& rig,
                                std::vector<Theta> poses) {
    auto count = static_cast<size_t>(rig.body.vertexCount);
    std::vector<glm::dmat3> matrix(count, glm::dmat3(0));
    std::vector<glm::dvec3> side(count, glm::dvec3(0));
    for (Theta& theta : poses) {
        std::fill_n(theta.begin(), 3, 0.0f);
        std::vector<float> posed = renderer.vertices(theta, Trans{});
        Placement placed = rig.place(theta);
        for (size_t v = 0; v < count; ++v) {
            Rig::Blend skin = rig.skin(placed, v);
            matrix[v] += glm::transpose(skin.turn) * skin.turn;
            side[v] += glm::transpose(skin.turn) * (vertex(posed, v) - skin.move);
        }
    }
    std::vector<float> bind;
    for (size_t v = 0; v < count; ++v) {
        glm::dvec3 x = glm::inverse(matrix[v]) * side[v];
        for (int c = 0; c < 3; ++c) bind.push_back(static_cast<float>(x[c]));
    }
    return bind;
}

// Arms lowered, as people stand: the network has seen that, but nobody in a T-pose. And what the
// motions show.
std::vector<Theta> posesToMatch(const Motion* motion, std::span<const Motion> further) {
    constexpr size_t kFromMotion = 15;
    std::vector<Theta> poses(1);
    poses[0][3 * kLeftShoulder + 2] = -0.9f;
    poses[0][3 * kRightShoulder + 2] = 0.9f;
    const auto add = [&](const Motion& shown) {
        size_t step = (shown.size() + kFromMotion - 1) / kFromMotion;
        for (size_t k = 0; k < shown.size(); k += step) poses.push_back(shown.theta[k]);
    };
    if (motion) add(*motion);
    for (const Motion& shown : further) add(shown);
    return poses;
}

}  // namespace

namespace {

// The joints above the ground, and the motion.
GltfScene skeletonScene(const Avatar& avatar, std::span<const float> bindVerts,
                        const Motion* motion, JointNames names) {
    GltfScene scene;
    const Rig rig(avatar.body, avatar.betas);
    const float ground = lowest(bindVerts);
    for (size_t j = 0; j < kJoints; ++j) {
        std::array<float, 3> place;
        for (size_t c = 0; c < 3; ++c)
            place[c] = static_cast<float>(rig.rest[j][static_cast<int>(c)]);
        place[1] -= ground;
        scene.skeleton.push_back(
            {jointNameFor(names, j), std::max(avatar.body.parents[j], -1), place});
    }
    if (motion) scene.animation = animate(rig, bindVerts, ground, *motion);
    return scene;
}

// What each shape coefficient adds to the vertices, at one standard deviation.
std::vector<GltfMorph> shapeMorphs(const BodyModel& body, std::span<const uint32_t> sources) {
    constexpr size_t kShapes = std::tuple_size_v<Betas>;
    std::vector<GltfMorph> morphs;
    for (size_t k = 0; k < kShapes; ++k) {
        GltfMorph morph{fmt::format("shape{}", k), {}};
        for (const size_t v : sources)
            for (size_t c = 0; c < 3; ++c)
                morph.positions.push_back(body.shapeDirections[(3 * v + c) * kShapes + k]);
        morphs.push_back(std::move(morph));
    }
    return morphs;
}

// What curls and closes each hand from where it is (nn/body/fingers.h); none of mittens.
std::vector<GltfMorph> handMorphs(const BodyModel& body, std::span<const float> bindVerts,
                                  std::span<const uint32_t> sources) {
    BodyModel shown = body;
    shown.templateVertices.assign(bindVerts.begin(), bindVerts.end());
    shown.offsets.clear();
    const FingerRig fingers = fingerRig(shown);
    std::vector<GltfMorph> morphs;
    if (fingers.empty()) return morphs;
    for (const char* name : {"curlLeftHand", "closeLeftHand", "curlRightHand", "closeRightHand"}) {
        HandAmounts amounts{};
        amounts[morphs.size()] = 1;
        const std::vector<float> bent = bentFingers(fingers, bindVerts, amounts);
        GltfMorph morph{name, {}};
        for (const size_t v : sources)
            for (size_t i = 3 * v; i < 3 * v + 3; ++i)
                morph.positions.push_back(bent[i] - bindVerts[i]);
        morphs.push_back(std::move(morph));
    }
    return morphs;
}

}  // namespace

GltfScene avatarScene(const Avatar& avatar, std::span<const float> bindVerts, const Motion* motion,
                      const ExportSettings& settings) {
    const BodyModel& body = avatar.body;
    CHECK(bindVerts.size() == 3 * static_cast<size_t>(body.vertexCount),
          "the bind pose must have the body's {} vertices", body.vertexCount);
    if (avatar.texture.empty())
        throwInput("the avatar has no texture yet; train stage texture first");

    GltfScene scene = skeletonScene(avatar, bindVerts, motion, settings.names);
    const Rig rig(avatar.body, avatar.betas);
    for (const Motion& further : settings.furtherMotions)
        scene.furtherAnimations.push_back(animate(rig, bindVerts, lowest(bindVerts), further));
    const std::vector<MeshPart> parts = meshParts(body);
    const auto sources = fillMesh(
        scene, bindVerts, areaNormals(bindVerts, body.faces), inPartsOrder(body.faces, parts),
        body.uvs, inPartsOrder(body.uvFaces, parts), body.weights, BodyModel::kJoints);
    markParts(scene, parts);
    float ground = lowest(bindVerts);
    for (size_t i = 1; i < scene.positions.size(); i += 3) scene.positions[i] -= ground;
    const TextureKind texture = settings.texture;
    CHECK(texture != TextureKind::Refined, "an exported mesh has one texture for all views");
    bool baked = texture != TextureKind::Coarse && !avatar.bakedTexture.empty();
    CHECK(baked || texture != TextureKind::Baked, "the avatar has a baked texture");
    const int size = avatar.textureSize;
    std::vector<float> colours = baked ? avatar.bakedTexture : avatar.texture;
    spreadCharts(texelPlaces(body, size), size, colours);
    scene.baseColor = toImage(colours, size, size);
    scene.unlit = !settings.lit;
    scene.doubleSided = true;
    if (settings.shapes) {
        scene.morphs = shapeMorphs(body, sources);
        std::ranges::move(handMorphs(body, bindVerts, sources), std::back_inserter(scene.morphs));
    }
    return scene;
}

bool isExportName(const std::filesystem::path& out) {
    const std::string ending = endingOf(out);
    return ending == ".glb" || ending == ".vrm" || ending == ".usda" || ending == ".obj" ||
           isMotionFile(out);
}

bool isMotionFile(const std::filesystem::path& out) {
    const std::string ending = endingOf(out);
    return ending == ".bvh" || ending == ".npz" || ending == ".json";
}

namespace {

// What was asked for is in the file, or said not to be.
void requireCarried(const std::filesystem::path& out, const ExportSettings& settings) {
    const std::string ending = endingOf(out);
    const auto require = [&](bool asked, const char* flag, bool carried, const char* where) {
        if (asked && !carried)
            throwInput("{}: expected {} for {}, found another", out.string(), where, flag);
    };
    const bool vrm = ending == ".vrm";
    if (!settings.furtherMotions.empty() && ending != ".glb")
        throwInput("{}: expected one motion, found {}; .glb and --web take several", out.string(),
                   settings.furtherMotions.size() + 1);
    require(settings.shapes, "--shapes", vrm || ending == ".glb", ".glb or .vrm");
    require(!settings.author.empty(), "--author", vrm, ".vrm");
    require(!settings.licence.empty(), "--licence", vrm, ".vrm");
    const VrmPermissions &may = settings.permissions, least;
    require(may.wearer != least.wearer, "--avatar-permission", vrm, ".vrm");
    require(may.commercial != least.commercial, "--commercial-usage", vrm, ".vrm");
    require(may.modification != least.modification, "--modification", vrm, ".vrm");
    require(may.credit != least.credit, "--credit-notation", vrm, ".vrm");
    require(may.violence || may.sexual || may.politics || may.hate || may.redistribution, "--allow",
            vrm, ".vrm");
    require(settings.lit, "--material lit", vrm || ending == ".glb" || ending == ".usda",
            ".glb, .vrm or .usda");
    require(settings.names != JointNames::Smpl, "--names", ending != ".obj" && ending != ".npz",
            ".glb, .vrm, .usda, .bvh or .json");
}

}  // namespace

void exportAvatar(Device& device, const Avatar& avatar, const std::filesystem::path& out,
                  const Motion* motion, const ExportSettings& settings) {
    const std::string ending = endingOf(out);
    if (!isExportName(out))
        throwInput("{}: expected a name that ends in .glb, .vrm, .usda, .obj, .bvh, .npz or .json",
                   out.string());
    requireCarried(out, settings);
    if (isMotionFile(out)) {
        if (!motion) throwInput("{}: expected a motion (--motion), found none", out.string());
        const std::vector<double> shaped = shapedVertices(
            avatar.body, std::vector<double>(avatar.betas.begin(), avatar.betas.end()));
        const GltfScene scene = skeletonScene(
            avatar, std::vector<float>(shaped.begin(), shaped.end()), motion, settings.names);
        (ending == ".bvh" ? writeBvh : ending == ".npz" ? writeAmass : writePosesJson)(out, scene);
        return;
    }
    if (ending == ".vrm" && motion)
        throwInput(
            "{}: expected no motion, since a VRM file is an avatar without one; .glb and "
            ".bvh take it",
            out.string());
    if (ending == ".obj" && motion && motion->size() != 1)
        throwInput("{}: expected one frame, since an OBJ has one pose, found {}; --frames picks it",
                   out.string(), motion->size());
    AvatarRenderer renderer(device, avatar, true, TextureKind::Coarse);
    std::vector<float> verts;
    if (ending == ".obj" && motion) {
        verts = renderer.vertices(motion->theta[0], motion->trans[0]);
        const glm::dquat upright = uprightRotation(*motion);
        const Trans& t = motion->trans[0];
        glm::dvec3 pelvis =
            upright * (Rig(avatar.body, avatar.betas).rest[0] + glm::dvec3(t[0], t[1], t[2]));
        pelvis.y = 0;
        for (size_t v = 0; v < verts.size() / 3; ++v) {
            const glm::dvec3 turned = upright * vertex(verts, v) - pelvis;
            for (int c = 0; c < 3; ++c)
                verts[3 * v + static_cast<size_t>(c)] = static_cast<float>(turned[c]);
        }
        motion = nullptr;
    } else {
        verts = bindVertices(renderer, Rig(avatar.body, avatar.betas),
                             posesToMatch(motion, settings.furtherMotions));
    }
    for (float x : verts)
        if (!std::isfinite(x))
            throwInput(
                "{}: cannot be made: the avatar's mesh network gives vertices that are not "
                "finite; train stage mesh again",
                out.string());
    GltfScene scene = avatarScene(avatar, verts, motion, settings);
    if (ending == ".vrm") {
        scene.vrm = vrmOf(avatar, scene);
        scene.vrm->author = settings.author.empty() ? "unknown" : settings.author;
        scene.vrm->licence = settings.licence;
        scene.vrm->permissions = settings.permissions;
    }
    (ending == ".obj" ? writeObj : ending == ".usda" ? writeUsd : writeGlb)(out, scene);
}

}  // namespace doppel
