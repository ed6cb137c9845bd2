#include "trainer/motion/retarget/girth.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "trainer/motion/retarget/limb.h"

namespace doppel {

namespace {

using namespace joint;

// A ball on a limb.
struct Ball {
    size_t joint = 0;
    glm::dvec3 rest{0};
    double radius = 0;
};

struct Overlap {
    double depth = 0;     // metres, negative where they are apart
    glm::dvec3 away{0};   // the way out, for the ball
    glm::dvec3 place{0};  // of the ball
};

Ball ballOn(const Capsule& capsule, double share) {
    return {capsule.joint, glm::mix(capsule.from, capsule.to, share),
            glm::mix(capsule.fromRadius, capsule.toRadius, share)};
}

// The part of an arm that may touch the body: not the elbow's end, which goes over into the upper
// arm.
std::vector<Ball> armBalls(const Proportions& body, size_t side) {
    std::vector<Ball> balls;
    for (const double share : {.3, .65, 1.}) balls.push_back(ballOn(body.forearms[side], share));
    for (const double share : {.4, .7, 1.}) balls.push_back(ballOn(body.hands[side], share));
    return balls;
}

// Of a thigh the lower half: at the hips both are one.
std::vector<Ball> legBalls(const Proportions& body, size_t side) {
    std::vector<Ball> balls;
    for (const double share : {.4, .6, .8, 1.}) balls.push_back(ballOn(body.thighs[side], share));
    for (const double share : {.33, .67, 1.}) balls.push_back(ballOn(body.shins[side], share));
    balls.push_back(ballOn(body.feet[side], .8));
    return balls;
}

std::vector<const Capsule*> armObstacles(const Proportions& body) {
    std::vector<const Capsule*> obstacles;
    for (const Capsule& level : body.trunk) obstacles.push_back(&level);
    obstacles.push_back(&body.head);
    for (const Capsule& thigh : body.thighs) obstacles.push_back(&thigh);
    return obstacles;
}

std::vector<const Capsule*> legObstacles(const Proportions& body, size_t side) {
    return {&body.thighs[1 - side], &body.shins[1 - side], &body.feet[1 - side]};
}

Overlap overlapOf(const Proportions& body, const PlacedJoints& joints, const Ball& ball,
                  const Capsule& capsule) {
    Overlap overlap;
    overlap.place = joints.at(body, ball.joint, ball.rest);
    const glm::dvec3 from = joints.at(body, capsule.joint, capsule.from);
    const glm::dvec3 along = joints.at(body, capsule.joint, capsule.to) - from;
    const double square = glm::dot(along, along);
    const double share =
        square > 0 ? std::clamp(glm::dot(overlap.place - from, along) / square, 0., 1.) : 0;
    const glm::dvec3 off = overlap.place - (from + share * along);
    const double distance = glm::length(off);
    overlap.depth = ball.radius + glm::mix(capsule.fromRadius, capsule.toRadius, share) - distance;
    overlap.away = distance > 1e-6 ? off / distance : glm::dvec3(0, 0, 1);
    return overlap;
}

// Balls against capsules; those of both bodies correspond one by one.
struct Encounter {
    std::vector<Ball> balls;
    std::vector<const Capsule*> obstacles;
};

// How deep each pair may be in a frame: as deep as the source's. A gap allows nothing.
std::vector<double> allowedDepths(const Proportions& source, const Encounter& encounter,
                                  const JointPose& pose) {
    const PlacedJoints joints = placed(source, pose);
    std::vector<double> allowed;
    for (const Ball& ball : encounter.balls)
        for (const Capsule* obstacle : encounter.obstacles)
            allowed.push_back(std::max(0., overlapOf(source, joints, ball, *obstacle).depth));
    return allowed;
}

// The pair that is deepest beyond what is allowed; depth 0: none is.
Overlap worstOf(const Proportions& body, const PlacedJoints& joints, const Encounter& encounter,
                const std::vector<double>& allowed) {
    Overlap worst;
    size_t pair = 0;
    for (const Ball& ball : encounter.balls)
        for (const Capsule* obstacle : encounter.obstacles) {
            Overlap overlap = overlapOf(body, joints, ball, *obstacle);
            overlap.depth -= allowed[pair++];
            if (overlap.depth > worst.depth) worst = overlap;
        }
    return worst;
}

Encounter ofArm(const Proportions& body, size_t side) {
    return {armBalls(body, side), armObstacles(body)};
}

Encounter ofLeg(const Proportions& body, size_t side) {
    return {legBalls(body, side), legObstacles(body, side)};
}

// What a frame's limb is turned by: rotation vectors at its two joints, before their own rotations.
struct Turns {
    std::vector<glm::dvec3> root, middle;
};

constexpr double kMostTurn = .6;    // radians, of a joint
constexpr double kNear = .001;      // metres that are left alone
constexpr double kElbowShare = .4;  // of the elbow's part in what it takes, the shoulder's is 1
constexpr double kAverage = .07;    // seconds, deviation of the smoothing
constexpr int kRounds = 4, kSteps = 12;

glm::dvec3 bounded(const glm::dvec3& turn) {
    const double angle = glm::length(turn);
    return angle > kMostTurn ? turn * (kMostTurn / angle) : turn;
}

void applyTurn(JointPose& pose, size_t joint, const glm::dvec3& turn) {
    pose.local[joint] = glm::normalize(quaternionOf(turn) * pose.local[joint]);
}

// Solves each frame by itself from where the smoothed turns of the round before have brought it,
// and smooths; the last rounds smooth less, so that little of what they add is lost.
template <typename Solve>
void inRounds(Turns& turns, double fps, const Solve& solve) {
    for (int round = 0; round < kRounds; ++round) {
        for (size_t f = 0; f < turns.root.size(); ++f) solve(f, turns.root[f], turns.middle[f]);
        const double deviation = kAverage * fps / (1 + round);
        turns.root = smoothOverTime(turns.root, deviation);
        turns.middle = smoothOverTime(turns.middle, deviation);
    }
}

bool isZero(const std::vector<glm::dvec3>& turns) {
    return std::ranges::all_of(turns, [](const glm::dvec3& t) { return t == glm::dvec3(0); });
}

}  // namespace

double excessDepth(const Proportions& source, const JointPose& sourcePose,
                   const Proportions& target, const JointPose& targetPose) {
    const PlacedJoints joints = placed(target, targetPose);
    double most = 0;
    for (size_t side : {0, 1})
        for (const bool arm : {true, false}) {
            const auto of = arm ? ofArm : ofLeg;
            const auto allowed = allowedDepths(source, of(source, side), sourcePose);
            most = std::max(most, worstOf(target, joints, of(target, side), allowed).depth);
        }
    return most;
}

void clearLegs(const Proportions& source, std::span<const JointPose> sourcePoses,
               const Proportions& target, std::vector<JointPose>& poses, double fps) {
    const size_t frames = poses.size();
    CHECK(sourcePoses.size() == frames, "both bodies have the same frames");
    const Encounter theirs = ofLeg(source, 0), ours = ofLeg(target, 0);
    std::vector<std::vector<double>> allowed;
    for (const JointPose& pose : sourcePoses)
        allowed.push_back(allowedDepths(source, theirs, pose));
    const auto turned = [&](size_t f, const glm::dvec3& left, const glm::dvec3& right) {
        JointPose pose = poses[f];
        applyTurn(pose, kLeftHip, left);
        applyTurn(pose, kRightHip, right);
        return pose;
    };
    // Both legs share it: `root` is the left hip's, `middle` the right one's.
    Turns turns{std::vector<glm::dvec3>(frames), std::vector<glm::dvec3>(frames)};
    inRounds(turns, fps, [&](size_t f, glm::dvec3& left, glm::dvec3& right) {
        for (int step = 0; step < kSteps; ++step) {
            const JointPose pose = turned(f, left, right);
            const PlacedJoints joints = placed(target, pose);
            const Overlap worst = worstOf(target, joints, ours, allowed[f]);
            if (worst.depth < kNear) return;
            const glm::dquat toPelvis = glm::conjugate(joints.turn[kPelvis]);
            for (size_t side : {0, 1}) {
                const glm::dvec3 away = side == 0 ? worst.away : -worst.away;
                const glm::dvec3 arm = worst.place - joints.place[kLeftHip + side];
                const glm::dvec3 lever = glm::cross(arm, away);
                const double square = glm::dot(lever, lever);
                if (square < 1e-4) return;
                glm::dvec3& turn = side == 0 ? left : right;
                turn = bounded(turn + toPelvis * (lever * (.5 * worst.depth / square)));
            }
        }
    });
    if (isZero(turns.root) && isZero(turns.middle)) return;
    for (size_t f = 0; f < frames; ++f) {
        const PlacedJoints before = placed(target, poses[f]);
        poses[f] = turned(f, turns.root[f], turns.middle[f]);
        const PlacedJoints after = placed(target, poses[f]);
        for (size_t side : {0, 1})
            poses[f].local[kLeftAnkle + side] = glm::normalize(
                glm::conjugate(after.turn[kLeftKnee + side]) * before.turn[kLeftAnkle + side]);
    }
}

void clearArms(const Proportions& source, std::span<const JointPose> sourcePoses,
               const Proportions& target, std::vector<JointPose>& poses, double fps) {
    const size_t frames = poses.size();
    CHECK(sourcePoses.size() == frames, "both bodies have the same frames");
    for (size_t side : {0, 1}) {
        const Limb arm = armOf(side);
        const Encounter theirs = ofArm(source, side), ours = ofArm(target, side);
        std::vector<std::vector<double>> allowed;
        for (const JointPose& pose : sourcePoses)
            allowed.push_back(allowedDepths(source, theirs, pose));
        const auto turned = [&](size_t f, const glm::dvec3& root, const glm::dvec3& middle) {
            JointPose pose = poses[f];
            applyTurn(pose, arm.root, root);
            applyTurn(pose, arm.middle, middle);
            return pose;
        };
        Turns turns{std::vector<glm::dvec3>(frames), std::vector<glm::dvec3>(frames)};
        inRounds(turns, fps, [&](size_t f, glm::dvec3& root, glm::dvec3& middle) {
            for (int step = 0; step < kSteps; ++step) {
                const PlacedJoints joints = placed(target, turned(f, root, middle));
                const Overlap worst = worstOf(target, joints, ours, allowed[f]);
                if (worst.depth < kNear) return;
                // The least turn of both joints that moves the ball out, the elbow's counting more;
                // in the frames of the joints' parents.
                const glm::dvec3 atRoot =
                    glm::cross(worst.place - joints.place[arm.root], worst.away);
                const glm::dvec3 atMiddle =
                    kElbowShare * glm::cross(worst.place - joints.place[arm.middle], worst.away);
                const double square = glm::dot(atRoot, atRoot) + glm::dot(atMiddle, atMiddle);
                if (square < 1e-4) return;
                const double scale = worst.depth / square;
                root = bounded(root + glm::conjugate(joints.turn[target.parents[arm.root]]) *
                                          (scale * atRoot));
                middle = bounded(middle + glm::conjugate(joints.turn[arm.root]) *
                                              (kElbowShare * scale * atMiddle));
            }
        });
        for (size_t f = 0; f < frames; ++f)
            if (turns.root[f] != glm::dvec3(0) || turns.middle[f] != glm::dvec3(0))
                poses[f] = turned(f, turns.root[f], turns.middle[f]);
    }
}

}  // namespace doppel
