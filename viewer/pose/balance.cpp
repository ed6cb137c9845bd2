#include "viewer/pose/balance.h"

#include <algorithm>
#include <cmath>

namespace doppel {

const std::array<double, joint::kCount>& jointMasses() {
    static const std::array<double, joint::kCount> shares = [] {
        struct Segment {
            size_t from, to;
            double mass, centre;  // shares of the body's mass and of the way
        };
        std::array<double, joint::kCount> sum{};
        const auto add = [&](const Segment& s) {
            sum[s.from] += s.mass * (1 - s.centre);
            sum[s.to] += s.mass * s.centre;
        };
        add({joint::kNeck, joint::kHead, .0694, 1});
        add({joint::kSpine3, joint::kNeck, .1596, .5});
        add({joint::kSpine1, joint::kSpine3, .1633, .5});
        add({joint::kPelvis, joint::kSpine1, .1117, .3});
        for (size_t side : {size_t{0}, size_t{1}}) {  // left joints come just before right ones
            add({joint::kLeftShoulder + side, joint::kLeftElbow + side, .0271, .58});
            add({joint::kLeftElbow + side, joint::kLeftWrist + side, .0162, .46});
            add({joint::kLeftWrist + side, joint::kLeftHand + side, .0061, .8});
            add({joint::kLeftHip + side, joint::kLeftKnee + side, .1416, .41});
            add({joint::kLeftKnee + side, joint::kLeftAnkle + side, .0433, .45});
            add({joint::kLeftAnkle + side, joint::kLeftFoot + side, .0137, .5});
        }
        double whole = 0;
        for (double share : sum) whole += share;
        for (double& share : sum) share /= whole;
        return sum;
    }();
    return shares;
}

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

void addFoot(const PosedSkeleton& posed, size_t joint, std::vector<glm::dvec2>& corners) {
    const bool left =
        joint == joint::kLeftAnkle || joint == joint::kLeftFoot || joint == joint::kLeftKnee;
    const size_t ankle = left ? joint::kLeftAnkle : joint::kRightAnkle,
                 ball = left ? joint::kLeftFoot : joint::kRightFoot;
    corners.push_back(fromAbove(posed.position[ankle]));
    corners.push_back(fromAbove(posed.position[ball]));
}

glm::dvec3 centreOfMass(const PosedSkeleton& posed) {
    glm::dvec3 sum(0);
    for (size_t j = 0; j < joint::kCount; ++j) sum += jointMasses()[j] * posed.position[j];
    return sum;
}

double outOfBalance(const PosedSkeleton& posed, std::span<const size_t> feet) {
    std::vector<glm::dvec2> corners;
    for (size_t foot : feet) addFoot(posed, foot, corners);
    return corners.empty() ? 0 : glm::length(wayOut(fromAbove(centreOfMass(posed)), corners));
}

}  // namespace doppel
