#include "trainer/motion/retarget/hands.h"

#include <algorithm>
#include <cmath>

#include "trainer/motion/retarget/limb.h"

namespace doppel {

namespace {

using namespace joint;

const glm::dvec3 kAcross(1, 0, 1);
constexpr double kTouching = .03, kApart = .1;  // metres between surfaces
constexpr double kAverage = .03;                // seconds, deviation of the smoothing

// 1 where surfaces touch, 0 from where they are apart.
double closeness(double gap) {
    const double part = std::clamp((kApart - gap) / (kApart - kTouching), 0., 1.);
    return part * part * (3 - 2 * part);
}

// The palm.
struct Palm {
    glm::dvec3 place{0};
    double radius = 0;
};
Palm palmOf(const Proportions& body, const PlacedJoints& joints, size_t side) {
    constexpr double kShare = .6;  // of the way from the wrist to the middle of the fingers
    const Capsule& hand = body.hands[side];
    return {joints.at(body, hand.joint, glm::mix(hand.from, hand.to, kShare)),
            glm::mix(hand.fromRadius, hand.toRadius, kShare)};
}

// What a hand may rest on, in the same order for all bodies.
std::vector<const Capsule*> restsOf(const Proportions& body) {
    std::vector<const Capsule*> rests;
    for (const Capsule& level : body.trunk) rests.push_back(&level);
    rests.push_back(&body.head);
    for (const Capsule& thigh : body.thighs) rests.push_back(&thigh);
    return rests;
}

// A place beside a capsule: at a share of its axis, that way in its joint's frame, and so far off
// its surface.
struct Beside {
    double share = 0, gap = 0;
    glm::dvec3 away{0, 0, 1};
};

Beside besideOf(const Proportions& body, const PlacedJoints& joints, const Capsule& capsule,
                const Palm& palm) {
    const glm::dvec3 from = joints.at(body, capsule.joint, capsule.from);
    const glm::dvec3 along = joints.at(body, capsule.joint, capsule.to) - from;
    const double square = glm::dot(along, along);
    Beside found;
    if (square > 0) found.share = std::clamp(glm::dot(palm.place - from, along) / square, 0., 1.);
    const glm::dvec3 off = palm.place - (from + found.share * along);
    const double distance = glm::length(off);
    if (distance > 1e-6) found.away = glm::conjugate(joints.turn[capsule.joint]) * (off / distance);
    found.gap =
        distance - palm.radius - glm::mix(capsule.fromRadius, capsule.toRadius, found.share);
    return found;
}

glm::dvec3 placeBeside(const Proportions& body, const PlacedJoints& joints, const Capsule& capsule,
                       const Beside& beside, double radius) {
    const glm::dvec3 on = glm::mix(capsule.from, capsule.to, beside.share);
    const double away =
        beside.gap + radius + glm::mix(capsule.fromRadius, capsule.toRadius, beside.share);
    return joints.at(body, capsule.joint, on) + joints.turn[capsule.joint] * (away * beside.away);
}

// A frame of both bodies.
struct Pair {
    const Proportions &source, &target;
    PlacedJoints theirs, ours;
};

// Where the body that it rests on takes a palm from where it is: the mean over all that is near.
glm::dvec3 moveToBody(const Pair& pair, size_t side) {
    const Palm theirs = palmOf(pair.source, pair.theirs, side),
               ours = palmOf(pair.target, pair.ours, side);
    const auto from = restsOf(pair.source), to = restsOf(pair.target);
    glm::dvec3 sum(0);
    double most = 0, total = 0;
    for (size_t i = 0; i < from.size(); ++i) {
        const Beside beside = besideOf(pair.source, pair.theirs, *from[i], theirs);
        const double near = closeness(beside.gap);
        if (near == 0) continue;
        const glm::dvec3 place = placeBeside(pair.target, pair.ours, *to[i], beside, ours.radius);
        most = std::max(most, near);
        // The nearest decides, and one takes over from another without a jump.
        const double weight = near * near * std::exp(-std::max(beside.gap, -.05) / .01);
        sum += weight * (place - ours.place);
        total += weight;
    }
    return total > 0 ? most / total * sum : sum;
}

double gapOfHands(const Proportions& body, const PlacedJoints& joints) {
    const Palm left = palmOf(body, joints, 0), right = palmOf(body, joints, 1);
    return glm::distance(left.place, right.place) - left.radius - right.radius;
}

// Palms that meet are as far from each other as the source's, about their own middle.
void meet(const Pair& pair, std::array<glm::dvec3, 2>& moves) {
    const double near = closeness(gapOfHands(pair.source, pair.theirs));
    if (near == 0) return;
    std::array<Palm, 2> theirs, ours;
    for (size_t side : {0, 1}) {
        theirs[side] = palmOf(pair.source, pair.theirs, side);
        ours[side] = palmOf(pair.target, pair.ours, side);
        ours[side].place += moves[side];
    }
    const double thicker =
        (ours[0].radius + ours[1].radius) / (theirs[0].radius + theirs[1].radius);
    const glm::dvec3 middle = .5 * (ours[0].place + ours[1].place);
    const glm::dvec3 half = .5 * thicker * (theirs[1].place - theirs[0].place);
    for (size_t side : {0, 1}) {
        const glm::dvec3 goal = side == 0 ? middle - half : middle + half;
        moves[side] += near * (goal - ours[side].place);
    }
}

// Towards an arm's whole length the last twenty-fifth is taken ever more slowly, so that an elbow
// does not snap straight where the goal goes out of reach.
double withinReach(double distance, double length) {
    const double most = .998 * length, soft = .96 * length;
    if (distance <= soft) return distance;
    return soft + (most - soft) * (1 - std::exp(-(distance - soft) / (most - soft)));
}

// The hand by so much, as far as the arm goes.
void moveHand(const Proportions& body, size_t side, const glm::dvec3& move, JointPose& pose) {
    const Limb arm = armOf(side);
    const PlacedJoints joints = placed(body, pose);
    const glm::dvec3 root = joints.place[arm.root];
    const glm::dvec3 goal = joints.place[arm.end] + move;
    const double far = glm::distance(goal, root);
    if (far < 1e-6) return;
    reach(body, arm, root + (goal - root) * (withinReach(far, lengthOf(body, arm)) / far), pose);
}

}  // namespace

void touchAsTheSource(const Proportions& source, std::span<const JointPose> sourcePoses,
                      const Proportions& target, std::vector<JointPose>& poses, double fps) {
    std::array<std::vector<glm::dvec3>, 2> moves;
    for (size_t f = 0; f < poses.size(); ++f) {
        const Pair pair{source, target, placed(source, sourcePoses[f]), placed(target, poses[f])};
        std::array<glm::dvec3, 2> both{moveToBody(pair, 0), moveToBody(pair, 1)};
        meet(pair, both);
        for (size_t side : {0, 1}) moves[side].push_back(both[side]);
    }
    for (size_t side : {0, 1}) {
        moves[side] = smoothOverTime(moves[side], kAverage * fps);
        for (size_t f = 0; f < poses.size(); ++f)
            if (glm::length(moves[side][f]) > 1e-6)
                moveHand(target, side, moves[side][f], poses[f]);
    }
}

void reachInSpace(const Proportions& source, std::span<const JointPose> sourcePoses, double size,
                  const Proportions& target, std::vector<JointPose>& poses) {
    for (size_t f = 0; f < poses.size(); ++f) {
        const PlacedJoints theirs = placed(source, sourcePoses[f]);
        for (size_t side : {0, 1}) {
            const PlacedJoints ours = placed(target, poses[f]);
            const glm::dvec3 root = kAcross * ours.place[kPelvis];
            const glm::dvec3 goal = root + size * (theirs.place[joint::kLeftHand + side] -
                                                   kAcross * theirs.place[kPelvis]);
            moveHand(target, side, goal - ours.place[joint::kLeftHand + side], poses[f]);
        }
    }
}

double touchError(const Proportions& source, const JointPose& sourcePose, const Proportions& target,
                  const JointPose& targetPose) {
    const Pair pair{source, target, placed(source, sourcePose), placed(target, targetPose)};
    const auto from = restsOf(source), to = restsOf(target);
    std::array<Palm, 2> theirs, ours;
    for (size_t side : {0, 1}) {
        theirs[side] = palmOf(source, pair.theirs, side);
        ours[side] = palmOf(target, pair.ours, side);
    }
    double sum = 0, count = 0;
    if (gapOfHands(source, pair.theirs) <= kTouching) {
        const double thicker =
            (ours[0].radius + ours[1].radius) / (theirs[0].radius + theirs[1].radius);
        sum += glm::distance(ours[1].place - ours[0].place,
                             thicker * (theirs[1].place - theirs[0].place));
        ++count;
    }
    // Of what is near, what is nearest: levels of the trunk touch each other.
    for (size_t side : {0, 1}) {
        Beside nearest{0, INFINITY};
        size_t what = 0;
        for (size_t i = 0; i < from.size(); ++i) {
            const Beside beside = besideOf(source, pair.theirs, *from[i], theirs[side]);
            if (beside.gap < nearest.gap) nearest = beside, what = i;
        }
        if (nearest.gap > kTouching) continue;
        sum += glm::distance(ours[side].place,
                             placeBeside(target, pair.ours, *to[what], nearest, ours[side].radius));
        ++count;
    }
    return count > 0 ? sum / count : -1;
}

}  // namespace doppel
