#include "trainer/person/heads.h"

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kMostTurn = 1.2;  // radians

// Of a joint in the body's space.
glm::dquat turned(const BodyModel& body, const Theta& pose, int joint) {
    glm::dquat rotation(1, 0, 0, 0);
    for (int j = joint; j >= 0; j = body.parents[size_t(j)])
        rotation = jointRotation(pose, size_t(j)) * rotation;
    return rotation;
}

}  // namespace

void aimHeads(const BodyModel& body, std::span<const Theta> looks, std::vector<Theta>& theta) {
    CHECK(looks.size() == theta.size(), "each pose has a head to look like");
    for (size_t f = 0; f < theta.size(); ++f) {
        const glm::dquat neck = turned(body, theta[f], joint::kNeck),
                         head = turned(body, theta[f], joint::kHead),
                         wanted = turned(body, looks[f], joint::kHead);
        const glm::dvec3 turn = axisAngleOf(wanted * glm::inverse(head));
        if (!(glm::length(turn) < kMostTurn)) continue;
        const glm::dquat turnedNeck = quaternionOf(turn / 2.) * neck;
        setJointRotation(theta[f], joint::kNeck,
                         jointRotation(theta[f], joint::kNeck) * glm::inverse(neck) * turnedNeck);
        setJointRotation(theta[f], joint::kHead, glm::inverse(turnedNeck) * wanted);
    }
}

}  // namespace doppel
