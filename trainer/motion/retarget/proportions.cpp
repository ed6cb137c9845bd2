#include "trainer/motion/retarget/proportions.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace doppel {

namespace {

using namespace joint;

constexpr size_t kTrunkLevels = 5;

struct Shaped {
    const BodyModel& body;
    std::vector<double> verts;

    glm::dvec3 at(size_t v) const { return {verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]}; }
    double weight(size_t v, size_t joint) const {
        return static_cast<double>(body.weights[joint::kCount * v + joint]);
    }
    // Of the body itself: a skirt is no thigh.
    size_t count() const { return static_cast<size_t>(body.modelVertices); }
};

// The value below which this share of the numbers lies; 0 of none.
double quantile(std::vector<double> values, double share) {
    if (values.empty()) return 0;
    const auto at = static_cast<size_t>(share * static_cast<double>(values.size() - 1));
    std::ranges::nth_element(values, values.begin() + static_cast<std::ptrdiff_t>(at));
    return values[at];
}

Sole soleOf(const Shaped& shaped, const Proportions& body, size_t foot) {
    const size_t ankle = kLeftAnkle + foot, toes = joint::kLeftFoot + foot;
    Sole sole;
    for (size_t v = 0; v < shaped.count(); ++v) {
        const double ofAnkle = shaped.weight(v, ankle), ofToes = shaped.weight(v, toes);
        if (!shaped.body.sole[v] || ofAnkle + ofToes < .5) continue;
        sole.points.push_back({shaped.at(v), ofToes / (ofAnkle + ofToes)});
    }
    if (sole.points.empty())  // of a body that marks no soles: what is under the joints
        for (const size_t j : {ankle, toes})
            sole.points.push_back(
                {body.rest[j] - glm::dvec3(0, j == ankle ? .08 : .03, 0), j == toes ? 1. : 0.});
    // What the heel and what the toes stand on. A few vertices below that, as a learnt surface has
    // them where nobody saw it, are not what a person stands on.
    std::array<double, 2> floor{};
    for (const bool front : {false, true}) {
        std::vector<double> heights;
        for (const auto& point : sole.points)
            if ((point.toes > .5) == front) heights.push_back(point.place.y);
        if (heights.empty())
            for (const auto& point : sole.points) heights.push_back(point.place.y);
        floor[front] = quantile(heights, .15);
    }
    for (auto& point : sole.points) point.place.y = std::max(point.place.y, floor[point.toes > .5]);
    // The heel is under the ankle and a little behind it, the ball of the foot under the joint
    // where the toes begin.
    const glm::dvec3 along =
        glm::normalize((body.rest[toes] - body.rest[ankle]) * glm::dvec3(1, 0, 1));
    sole.heel = body.rest[ankle] - .03 * along;
    sole.toe = body.rest[toes];
    sole.heel.y = floor[0];
    sole.toe.y = floor[1];
    // A few dozen points are the sole.
    constexpr size_t kMost = 60;
    if (sole.points.size() > kMost) {
        std::vector<Sole::Point> some;
        for (size_t i = 0; i < kMost; ++i)
            some.push_back(sole.points[i * sole.points.size() / kMost]);
        sole.points = std::move(some);
    }
    return sole;
}

// Around the bone between two joints, as thick as the vertices of a part lie from it: the median of
// those of its first and of its second half.
Capsule limbOf(const Shaped& shaped, const Proportions& body, size_t joint, size_t end,
               uint8_t part, double beyond = 1) {
    Capsule capsule{joint, body.rest[joint], {}, 0, 0};
    capsule.to = capsule.from + beyond * (body.rest[end] - capsule.from);
    const glm::dvec3 along = capsule.to - capsule.from;
    std::array<std::vector<double>, 2> away;
    for (size_t v = 0; v < shaped.count(); ++v) {
        if (shaped.body.part[v] != part) continue;
        const glm::dvec3 from = shaped.at(v) - capsule.from;
        const double share = glm::dot(from, along) / glm::dot(along, along);
        if (share < 0 || share > 1) continue;
        away[share < .5 ? 0 : 1].push_back(glm::length(from - share * along));
    }
    // The halves' middles are at a quarter and three quarters; the line through both gives the
    // ends.
    const double first = quantile(away[0], .5), second = quantile(away[1], .5);
    const double slope = away[0].empty() || away[1].empty() ? 0 : second - first;
    capsule.fromRadius = std::max(.01, std::max(first, away[0].empty() ? second : 0) - slope / 2);
    capsule.toRadius = std::max(.01, std::max(second, away[1].empty() ? first : 0) + slope / 2);
    return capsule;
}

std::vector<Capsule> trunkOf(const Shaped& shaped, const Proportions& body) {
    const double bottom = body.rest[kLeftHip].y, top = body.rest[kLeftShoulder].y - .04;
    const double step = (top - bottom) / double(kTrunkLevels - 1);
    std::vector<Capsule> trunk;
    for (size_t level = 0; level < kTrunkLevels; ++level) {
        const double height = bottom + step * double(level);
        std::vector<double> x, z;
        std::array<double, joint::kCount> weight{};
        for (size_t v = 0; v < shaped.count(); ++v) {
            const glm::dvec3 place = shaped.at(v);
            if (std::abs(place.y - height) > step / 2) continue;
            // The hips' level is the thighs' too, whose outer sides are the body's.
            const uint8_t part = shaped.body.part[v];
            if (part != kTorso && !(level == 0 && (part == kLeftThigh || part == kRightThigh)))
                continue;
            x.push_back(std::abs(place.x));
            z.push_back(place.z);
            for (const size_t j : {kPelvis, kSpine1, kSpine2, kSpine3})
                weight[j] += shaped.weight(v, j);
        }
        if (x.size() < 8) continue;
        const double front = quantile(z, .9), back = quantile(z, .1);
        const double radius = std::max(.03, (front - back) / 2);
        const double wide = std::max(0., quantile(x, .9) - radius);
        const auto joint = static_cast<size_t>(std::ranges::max_element(weight) - weight.begin());
        const glm::dvec3 middle(0, height, (front + back) / 2);
        trunk.push_back({joint, middle - glm::dvec3(wide, 0, 0), middle + glm::dvec3(wide, 0, 0),
                         radius, radius});
    }
    return trunk;
}

}  // namespace

double Proportions::legLength() const {
    double sum = 0;
    for (size_t side : {0, 1})
        sum += glm::distance(rest[kLeftHip + side], rest[kLeftKnee + side]) +
               glm::distance(rest[kLeftKnee + side], rest[kLeftAnkle + side]);
    return sum / 2;
}

Proportions proportionsOf(const BodyModel& model, const Betas& betas) {
    const std::vector<double> beta(betas.begin(), betas.end());
    const Shaped shaped{model, shapedVertices(model, beta)};
    const std::vector<double> joints = restJoints(model, beta);
    Proportions body;
    for (size_t j = 0; j < joint::kCount; ++j) {
        body.rest[j] = {joints[3 * j], joints[3 * j + 1], joints[3 * j + 2]};
        body.parents[j] = model.parents[j] < 0 ? j : static_cast<size_t>(model.parents[j]);
    }
    body.trunk = trunkOf(shaped, body);
    body.head = limbOf(shaped, body, joint::kHead, kNeck, BodyPart::kHead, -2.2);
    for (size_t side : {0, 1}) {
        const auto part = [&](BodyPart left) { return static_cast<uint8_t>(left + side); };
        body.soles[side] = soleOf(shaped, body, side);
        body.thighs[side] =
            limbOf(shaped, body, kLeftHip + side, kLeftKnee + side, part(kLeftThigh));
        body.shins[side] =
            limbOf(shaped, body, kLeftKnee + side, kLeftAnkle + side, part(kLeftCalf));
        body.feet[side] = limbOf(shaped, body, kLeftAnkle + side, joint::kLeftFoot + side,
                                 part(BodyPart::kLeftFoot));
        body.forearms[side] =
            limbOf(shaped, body, kLeftElbow + side, kLeftWrist + side, part(kLeftForearm));
        // To the middle of the fingers.
        body.hands[side] = limbOf(shaped, body, kLeftWrist + side, joint::kLeftHand + side,
                                  part(BodyPart::kLeftHand), 1.5);
    }
    return body;
}

Proportions withJoints(Proportions body, const std::array<glm::dvec3, joint::kCount>& rest) {
    const auto& before = body.rest;
    const auto moved = [&](size_t joint) { return rest[joint] - before[joint]; };
    // From a joint to the next, and beyond it where the capsule goes further.
    const auto along = [&](Capsule& capsule, size_t end) {
        const double longer = glm::distance(rest[end], rest[capsule.joint]) /
                              glm::distance(before[end], before[capsule.joint]);
        capsule.to = rest[capsule.joint] + longer * (capsule.to - capsule.from);
        capsule.from = rest[capsule.joint];
    };
    const double bottom = before[kLeftHip].y, top = before[kLeftShoulder].y;
    for (Capsule& level : body.trunk) {
        const double share = std::clamp((level.from.y - bottom) / (top - bottom), 0., 1.);
        const double wider = glm::mix(rest[kLeftHip].x / before[kLeftHip].x,
                                      rest[kLeftShoulder].x / before[kLeftShoulder].x, share);
        const glm::dvec3 move = glm::mix(moved(kLeftHip), moved(kLeftShoulder), share);
        for (glm::dvec3* end : {&level.from, &level.to}) {
            end->x *= wider;
            end->y += move.y;
            end->z += move.z;
        }
    }
    body.head.from += moved(joint::kHead);
    body.head.to += moved(joint::kHead);
    for (size_t side : {0, 1}) {
        along(body.thighs[side], kLeftKnee + side);
        along(body.shins[side], kLeftAnkle + side);
        along(body.feet[side], joint::kLeftFoot + side);
        along(body.forearms[side], kLeftWrist + side);
        along(body.hands[side], joint::kLeftHand + side);
        const glm::dvec3 ankle = moved(kLeftAnkle + side), toes = moved(joint::kLeftFoot + side);
        Sole& sole = body.soles[side];
        sole.heel += ankle;
        sole.toe += toes;
        for (Sole::Point& point : sole.points) point.place += glm::mix(ankle, toes, point.toes);
    }
    body.rest = rest;
    return body;
}

PlacedJoints placed(const Proportions& body, const JointPose& pose) {
    PlacedJoints joints;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const size_t parent = body.parents[j];
        if (parent == j) {
            joints.turn[j] = pose.local[j];
            joints.place[j] = pose.pelvis;
            continue;
        }
        joints.turn[j] = joints.turn[parent] * pose.local[j];
        joints.place[j] =
            joints.place[parent] + joints.turn[parent] * (body.rest[j] - body.rest[parent]);
    }
    return joints;
}

std::array<glm::dvec3, 2> contactPoints(const Proportions& body, const PlacedJoints& joints,
                                        size_t foot) {
    const Sole& sole = body.soles[foot];
    return {joints.at(body, kLeftAnkle + foot, sole.heel),
            joints.at(body, joint::kLeftFoot + foot, sole.toe)};
}

double lowestOfSole(const Proportions& body, const PlacedJoints& joints, size_t foot) {
    double low = std::numeric_limits<double>::infinity();
    for (const Sole::Point& point : body.soles[foot].points) {
        const double ofAnkle = joints.at(body, kLeftAnkle + foot, point.place).y;
        const double ofToes = joints.at(body, joint::kLeftFoot + foot, point.place).y;
        low = std::min(low, (1 - point.toes) * ofAnkle + point.toes * ofToes);
    }
    return low;
}

}  // namespace doppel
