#include "viewer/pose/balance.h"

#include <algorithm>
#include <cmath>

namespace doppel {

glm::dvec2 wayOut(const glm::dvec2& p, std::span<const glm::dvec2> corners) {
    const auto side = [](const glm::dvec2& a, const glm::dvec2& b, const glm::dvec2& c) {
        return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    };
    glm::dvec2 way(INFINITY);
    for (size_t i = 0; i < corners.size(); ++i)
        for (size_t j = i; j < corners.size(); ++j) {
            const glm::dvec2 a = corners[i], along = corners[j] - a;
            const double length = glm::dot(along, along);
            const double share =
                length > 0 ? std::clamp(glm::dot(p - a, along) / length, 0., 1.) : 0;
            const glm::dvec2 here = p - a - share * along;
            if (glm::dot(here, here) < glm::dot(way, way)) way = here;
            for (size_t k = j + 1; k < corners.size(); ++k) {
                const double ab = side(a, corners[j], p), bc = side(corners[j], corners[k], p),
                             ca = side(corners[k], a, p);
                if ((ab > 0 && bc > 0 && ca > 0) || (ab < 0 && bc < 0 && ca < 0))
                    return glm::dvec2(0);
            }
        }
    return way;
}

void addFoot(const PosedSkeleton& posed, size_t joint, const glm::dvec3& moved,
             std::vector<glm::dvec2>& corners) {
    const bool left =
        joint == joint::kLeftAnkle || joint == joint::kLeftFoot || joint == joint::kLeftKnee;
    const size_t ankle = left ? joint::kLeftAnkle : joint::kRightAnkle,
                 ball = left ? joint::kLeftFoot : joint::kRightFoot;
    corners.push_back(fromAbove(posed.position[ankle] + moved));
    corners.push_back(fromAbove(posed.position[ball] + moved));
}

glm::dvec3 centreOfMass(const PosedSkeleton& posed) {
    glm::dvec3 sum(0);
    for (size_t j = 0; j < joint::kCount; ++j) sum += jointMasses()[j] * posed.position[j];
    return sum;
}

double outOfBalance(const PosedSkeleton& posed, std::span<const size_t> feet) {
    std::vector<glm::dvec2> corners;
    for (size_t foot : feet) addFoot(posed, foot, glm::dvec3(0), corners);
    return corners.empty() ? 0 : glm::length(wayOut(fromAbove(centreOfMass(posed)), corners));
}

}  // namespace doppel
