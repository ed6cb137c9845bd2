#include "viewer/pose/ground_contact.h"

#include <algorithm>
#include <cmath>

namespace doppel {

namespace {

constexpr double kContact = .025;  // metres

PlacedJoints onFloor(const PosedSkeleton& posed, const RigidMotion& toFloor) {
    PlacedJoints joints;
    for (size_t j = 0; j < joint::kCount; ++j) {
        joints.turn[j] = glm::quat_cast(toFloor.rotation * posed.rotation[j]);
        joints.place[j] = toFloor.rotation * posed.position[j] + toFloor.translation;
    }
    return joints;
}

}  // namespace

std::vector<size_t> standingAnkles(const Proportions& body, const PosedSkeleton& posed,
                                   const RigidMotion& toFloor) {
    const PlacedJoints joints = onFloor(posed, toFloor);
    std::vector<size_t> ankles;
    for (size_t foot : {0u, 1u})
        if (std::abs(lowestOfSole(body, joints, foot)) < kContact)
            ankles.push_back(foot == 0 ? joint::kLeftAnkle : joint::kRightAnkle);
    return ankles;
}

double lowestPoint(const Proportions& body, const PosedSkeleton& posed,
                   const RigidMotion& toFloor) {
    const PlacedJoints joints = onFloor(posed, toFloor);
    double lowest = std::min(lowestOfSole(body, joints, 0), lowestOfSole(body, joints, 1));
    const auto add = [&](const Capsule& part) {
        lowest = std::min({lowest, joints.at(body, part.joint, part.from).y - part.fromRadius,
                           joints.at(body, part.joint, part.to).y - part.toRadius});
    };
    for (const Capsule& part : body.trunk) add(part);
    add(body.head);
    // Feet have soles.
    for (const auto* parts : {&body.thighs, &body.shins, &body.forearms, &body.hands})
        for (const Capsule& part : *parts) add(part);
    return lowest;
}

}  // namespace doppel
