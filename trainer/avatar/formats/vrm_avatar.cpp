#include "trainer/avatar/formats/vrm_avatar.h"

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <limits>

#include "trainer/avatar/formats/joint_names.h"
#include "trainer/motion/retarget/proportions.h"

namespace doppel {

namespace {

constexpr double kFalls = .06;       // metres below the nape from where hair hangs
constexpr double kBone = .07;        // metres of a joint of hair
constexpr double kThickness = .015;  // metres around it

glm::dvec3 vertexOf(const GltfScene& scene, size_t v) {
    return {scene.positions[3 * v], scene.positions[3 * v + 1], scene.positions[3 * v + 2]};
}

glm::dvec3 placeOf(const GltfJoint& joint) {
    return {joint.position[0], joint.position[1], joint.position[2]};
}

std::array<float, 3> floats(const glm::dvec3& v) {
    return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

// The vertices of a part's mesh.
std::pair<size_t, size_t> verticesOf(const GltfScene& scene, std::string_view name) {
    for (size_t i = 0; i < scene.parts.size(); ++i)
        if (scene.parts[i].name == name)
            return {scene.parts[i].firstVertex, i + 1 < scene.parts.size()
                                                    ? scene.parts[i + 1].firstVertex
                                                    : scene.positions.size() / 3};
    return {0, 0};
}

// The middle of the hair at a height, half a bone up and down.
glm::dvec3 middleAt(const GltfScene& scene, std::pair<size_t, size_t> hair, double height,
                    const glm::dvec3& otherwise) {
    glm::dvec3 sum(0);
    double count = 0;
    for (size_t v = hair.first; v < hair.second; ++v) {
        const glm::dvec3 place = vertexOf(scene, v);
        if (std::abs(place.y - height) > kBone / 2) continue;
        sum += place;
        ++count;
    }
    glm::dvec3 middle = count > 0 ? sum / count : otherwise;
    middle.y = height;
    return middle;
}

// A vertex below the nape goes with the two joints next to it, and just below with the head.
void hang(GltfScene& scene, size_t v, double nape, double bone, size_t first, size_t bones) {
    const double along = (nape - vertexOf(scene, v).y) / bone;
    if (along <= 0) return;
    const double held = std::clamp(1 - along, 0., 1.);
    const double at = std::clamp(along - .5, 0., static_cast<double>(bones) - 1);
    const auto upper = std::min(static_cast<size_t>(at), bones - 1);
    const size_t lower = std::min(upper + 1, bones - 1);
    const double share = at - static_cast<double>(upper);
    const std::array<std::pair<size_t, double>, 4> moved = {
        {{joint::kHead, held},
         {first + upper, (1 - held) * (1 - share)},
         {first + lower, (1 - held) * share},
         {0, 0.}}};
    for (size_t k = 0; k < 4; ++k) {
        scene.joints[4 * v + k] = static_cast<uint16_t>(moved[k].first);
        scene.weights[4 * v + k] = static_cast<float>(moved[k].second);
    }
}

double distanceTo(const glm::dvec3& from, const glm::dvec3& to, const glm::dvec3& place) {
    const glm::dvec3 along = to - from;
    const double square = glm::dot(along, along);
    const double share =
        square > 0 ? std::clamp(glm::dot(place - from, along) / square, 0., 1.) : 0;
    return glm::distance(place, from + share * along);
}

// The two upper levels of the trunk, as thick as leaves the hair where it hangs at rest.
std::vector<VrmSpring::Collider> trunkBehind(const GltfScene& scene, const Proportions& body,
                                             const std::vector<size_t>& chain) {
    std::vector<VrmSpring::Collider> colliders;
    const size_t levels = body.trunk.size();
    for (size_t i = levels - std::min<size_t>(2, levels); i < levels; ++i) {
        const Capsule& level = body.trunk[i];
        const glm::dvec3 from = level.from - body.rest[level.joint],
                         to = level.to - body.rest[level.joint];
        const glm::dvec3 joint = placeOf(scene.skeleton[level.joint]);
        double radius = level.fromRadius;
        for (const size_t j : chain)
            radius =
                std::min(radius, distanceTo(joint + from, joint + to, placeOf(scene.skeleton[j])) -
                                     kThickness);
        if (radius > .01)
            colliders.push_back(
                {level.joint, floats(from), floats(to), static_cast<float>(radius)});
    }
    return colliders;
}

void hangHair(const Avatar& avatar, GltfScene& scene, GltfVrm& vrm) {
    const auto hair = verticesOf(scene, "hair");
    const glm::dvec3 nape = placeOf(scene.skeleton[joint::kHead]);
    double lowest = std::numeric_limits<double>::infinity();
    for (size_t v = hair.first; v < hair.second; ++v)
        lowest = std::min(lowest, vertexOf(scene, v).y);
    const double length = nape.y - lowest;
    if (!(length > kFalls) || hair.first == hair.second) return;
    const auto bones = static_cast<size_t>(std::max(2., std::round(length / kBone)));
    const double bone = length / static_cast<double>(bones);
    VrmSpring spring{"hair", {}, static_cast<float>(kThickness), {}};
    const size_t first = scene.skeleton.size();
    glm::dvec3 place = nape;
    for (size_t k = 0; k <= bones; ++k) {  // the last one is where the hair ends
        place = middleAt(scene, hair, nape.y - bone * static_cast<double>(k), place);
        const size_t above = k == 0 ? size_t{joint::kHead} : first + k - 1;
        scene.skeleton.push_back(
            {fmt::format("hair_{}", k + 1), static_cast<int>(above), floats(place)});
        spring.joints.push_back(first + k);
    }
    for (size_t v = hair.first; v < hair.second; ++v) hang(scene, v, nape.y, bone, first, bones);
    spring.colliders = trunkBehind(scene, proportionsOf(avatar.body, avatar.betas), spring.joints);
    vrm.springs.push_back(std::move(spring));
}

}  // namespace

GltfVrm vrmOf(const Avatar& avatar, GltfScene& scene) {
    GltfVrm vrm;
    const auto name = avatar.provenance.find("capture");
    vrm.name = name != avatar.provenance.end() && !name->second.empty() ? name->second : "avatar";
    // Hands end there; fingers are not posed.
    for (size_t j = 0; j < joint::kLeftHand; ++j)
        vrm.bones.emplace_back(jointNameFor(JointNames::Vrm, j), j);
    hangHair(avatar, scene, vrm);
    return vrm;
}

}  // namespace doppel
