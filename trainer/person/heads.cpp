#include "trainer/person/heads.h"

#include <algorithm>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kMostTurn = 1.2;  // radians
// How much a point of a face counts by its normal's cosine to the camera: on an outline the network
// is half as exact (4 mm off on synthetic actors, for 2 mm where the cosine is above the second
// number), and behind it it guesses.
constexpr double kOnOutline = .2, kSeenWhole = .6;

// Of a joint in the body's space.
glm::dquat turned(const BodyModel& body, const Theta& pose, int joint) {
    glm::dquat rotation(1, 0, 0, 0);
    for (int j = joint; j >= 0; j = body.parents[size_t(j)])
        rotation = jointRotation(pose, size_t(j)) * rotation;
    return rotation;
}

}  // namespace

// The places that explain BlazePose's landmarks in 40 frames each of two synthetic actors best,
// brought to the default body's size by the length of their trunks. They differ by up to 13 mm.
const std::array<glm::dvec3, 5> kFace{{{0, .050, .129},
                                       {.025, .081, .103},
                                       {-.025, .081, .103},
                                       {.052, .070, .051},
                                       {-.052, .070, .051}}};

void aimHeads(const BodyModel& body, std::span<const Theta> looks, std::vector<Theta>& theta,
              double neckPart) {
    CHECK(looks.size() == theta.size(), "each pose has a head to look like");
    for (size_t f = 0; f < theta.size(); ++f) {
        const glm::dquat neck = turned(body, theta[f], joint::kNeck),
                         head = turned(body, theta[f], joint::kHead),
                         wanted = turned(body, looks[f], joint::kHead);
        const glm::dvec3 turn = axisAngleOf(wanted * glm::inverse(head));
        if (!(glm::length(turn) < kMostTurn)) continue;
        const glm::dquat turnedNeck = quaternionOf(turn * neckPart) * neck;
        setJointRotation(theta[f], joint::kNeck,
                         jointRotation(theta[f], joint::kNeck) * glm::inverse(neck) * turnedNeck);
        setJointRotation(theta[f], joint::kHead, glm::inverse(turnedNeck) * wanted);
    }
}

std::array<float, 3> headJointSeen(const BodyModel& body, const Theta& pose,
                                   const glm::dvec3& place, const FacePoints& points,
                                   const Camera& camera) {
    const glm::dquat head = turned(body, pose, joint::kHead);
    const auto at = [&](const glm::dvec3& p) {
        const auto [u, v] = camera.project({p.x, p.y, std::max(p.z, .1)});
        return glm::dvec2(u, v);
    };
    glm::dvec2 sum(0);
    double sure = 0;
    for (size_t k = 0; k < points.size(); ++k) {
        const auto [u, v, confidence] = points[k];
        if (!(confidence > 0)) continue;
        sum += double(confidence) * (glm::dvec2(u, v) - (at(place + head * kFace[k]) - at(place)));
        sure += double(confidence);
    }
    if (!(sure > 0)) return {};
    sum /= sure;
    return {float(sum.x), float(sum.y), float(sure / double(points.size()))};
}

std::vector<float> faceTargets(const BodyModel& body, std::span<const float> verts,
                               const SeenFace& seen) {
    const SurfacePoints& points = body.facePoints;
    std::vector<float> targets(points.corners.size());
    if (seen.empty()) return targets;
    CHECK(seen.size() == points.trust.size(), "a face has {} points", points.trust.size());
    const auto at = [&](size_t v) {
        return glm::dvec3(verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]);
    };
    // Each vertex's normal over the faces around it, for a point may lie in a sliver.
    std::vector<glm::dvec3> normals(static_cast<size_t>(body.vertexCount));
    for (size_t f = 0; f < body.faces.size(); f += 3) {
        const std::array<size_t, 3> corner{size_t(body.faces[f]), size_t(body.faces[f + 1]),
                                           size_t(body.faces[f + 2])};
        const glm::dvec3 normal =
            glm::cross(at(corner[1]) - at(corner[0]), at(corner[2]) - at(corner[0]));
        for (size_t v : corner) normals[v] += normal;
    }
    for (size_t p = 0; p < seen.size(); ++p) {
        glm::dvec3 place(0), normal(0);
        for (size_t k = 3 * p; k < 3 * p + 3; ++k) {
            const auto v = static_cast<size_t>(points.corners[k]);
            place += double(points.weights[k]) * at(v);
            normal += double(points.weights[k]) * normals[v];
        }
        const double cosine =
            -glm::dot(normal, place) / std::max(glm::length(normal) * glm::length(place), 1e-12);
        const double facing =
            cosine > 0 ? std::min(1., kOnOutline + (1 - kOnOutline) * cosine / kSeenWhole) : 0;
        targets[3 * p] = seen[p][0];
        targets[3 * p + 1] = seen[p][1];
        targets[3 * p + 2] = static_cast<float>(facing * double(points.trust[p] * seen[p][2]));
    }
    return targets;
}

}  // namespace doppel
