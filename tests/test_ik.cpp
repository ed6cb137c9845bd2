// Inverse kinematics.
#include <array>
#include <cmath>
#include <limits>

#include "engine/error.h"
#include "tests/posed_body.h"
#include "viewer/pose/stepping.h"

namespace doppel {
namespace {

using namespace test;

struct Drag {
    Pose pose, began;
    std::vector<IkTarget> pins;
    double largestStep = 0;  // radians per step of the target

    explicit Drag(const Pose& from) : pose(from), began(from) {}
    // Moves the joint to the target in steps of so many metres, as a mouse does.
    void to(size_t joint, const glm::dvec3& target, double step = .01) {
        const glm::dvec3 from = placeOf(pose, joint);
        const int steps = std::max(1, static_cast<int>(glm::length(target - from) / step));
        for (int i = 1; i <= steps; ++i) {
            std::vector<IkTarget> targets = pins;
            targets.push_back({joint, from + (target - from) * (double(i) / steps)});
            const Pose next = solveIk(skeleton(), began, targets);
            largestStep = std::max(largestStep, largestTurn(next, pose));
            pose = next;
        }
    }
};

// Targets where the joint is in other poses that a person can take, within the limits, reached by
// turning only the joints between the pelvis and it.
glm::dvec3 reachable(std::mt19937& random, const Pose& from, size_t joint, double angle) {
    Pose other = from;
    for (int j = skeleton().parents[joint]; j > 0; j = skeleton().parents[size_t(j)])
        other.rotation[size_t(j)] =
            axisAngleOf(quaternionOf(direction(random) * uniformIn(random, 0, angle)) *
                        quaternionOf(from.rotation[size_t(j)]));
    return placeOf(clampToLimits(other), joint);
}

TEST(Ik, ReachesTargets) {
    std::mt19937 random(11);
    struct Case {
        size_t joint;
        double angle;
    };
    for (const Case& c : {Case{joint::kLeftWrist, 1},
                          {joint::kRightWrist, 1},
                          {joint::kLeftAnkle, 1},
                          {joint::kRightAnkle, 1},
                          {joint::kLeftElbow, 1},
                          {joint::kRightElbow, 1},
                          {joint::kLeftKnee, 1},
                          {joint::kRightKnee, 1},
                          {joint::kHead, .25},
                          {joint::kLeftHand, 1},
                          {joint::kRightFoot, 1},
                          {joint::kNeck, .2},
                          {joint::kLeftShoulder, .15}}) {
        double worst = 0;
        int missed = 0;
        for (int i = 0; i < 40; ++i) {
            const Pose from = i % 2 ? standing() : Pose{};
            const glm::dvec3 target = reachable(random, from, c.joint, c.angle);
            Drag drag(from);
            drag.to(c.joint, target);
            const double far = glm::length(placeOf(drag.pose, c.joint) - target);
            worst = std::max(worst, far);
            if (far > 2e-3) ++missed;
            expectWithinLimits(drag.pose, jointName(c.joint));
        }
        EXPECT_EQ(missed, 0) << jointName(c.joint) << ": farthest " << worst << " m";
    }
}

TEST(Ik, DraggedBackThePoseReturns) {
    // Where the target is counts, not the way there.
    for (size_t joint : {joint::kLeftWrist, joint::kRightAnkle, joint::kHead}) {
        const Pose from = standing();
        const glm::dvec3 home = placeOf(from, joint);
        Drag drag(from);
        drag.to(joint, home + glm::dvec3(.05, .15, .2));
        EXPECT_GT(largestTurn(drag.pose, from), .1);
        drag.to(joint, home + glm::dvec3(.1, .3, .1));
        drag.to(joint, home);
        EXPECT_LT(largestTurn(drag.pose, from), 2 * kDegree) << jointName(joint);
    }
}

TEST(Ik, LeavesTheTrunkWhereTheArmReaches) {
    const Pose from = standing();
    Drag drag(from);
    const glm::dvec3 home = placeOf(from, joint::kLeftWrist);
    drag.to(joint::kLeftWrist, home + glm::dvec3(.05, .2, .15));
    for (size_t j : {joint::kSpine1, joint::kSpine2, joint::kSpine3})
        EXPECT_EQ(drag.pose.rotation[j], from.rotation[j]) << jointName(j);
    EXPECT_GT(turnBetween(drag.pose, from, joint::kLeftElbow), 10 * kDegree);
    // Everything that is not between the pelvis and the wrist keeps its bits.
    for (size_t j = 0; j < joint::kCount; ++j) {
        if (j != joint::kLeftWrist && skeleton().hangsOn(joint::kLeftWrist, j) && j > 0) continue;
        EXPECT_EQ(drag.pose.rotation[j], from.rotation[j]) << jointName(j);
    }
    EXPECT_EQ(drag.pose.trans, from.trans);

    // Before and above the knee: the trunk leans forward.
    const glm::dvec3 low = placeOf(from, joint::kLeftKnee) + glm::dvec3(0, .12, .15);
    drag.to(joint::kLeftWrist, low);
    EXPECT_LT(glm::length(placeOf(drag.pose, joint::kLeftWrist) - low), 2e-3);
    const PosedSkeleton posed = forwardKinematics(skeleton(), drag.pose);
    EXPECT_GT(posed.position[joint::kNeck].z - posed.position[joint::kPelvis].z, .1);
    expectWithinLimits(drag.pose, "reaching down");
}

// Captures have arms that are straight, a degree beyond it and a degree askew. Wherever the wrist
// can go by the arm alone the elbow bends, and the trunk does not lean.
TEST(Ik, BendsAnArmThatACaptureHasStraight) {
    for (const bool right : {false, true}) {
        const double side = right ? -1 : 1;
        const size_t shoulder = right ? joint::kRightShoulder : joint::kLeftShoulder,
                     elbow = right ? joint::kRightElbow : joint::kLeftElbow,
                     wrist = right ? joint::kRightWrist : joint::kLeftWrist;
        Pose from = standing();
        from.rotation[shoulder] = {0, 0, -.75 * side};
        from.rotation[elbow] = {.03, .02 * side, -.01 * side};
        const PosedSkeleton posed = forwardKinematics(skeleton(), from);
        const double reach = glm::distance(posed.position[shoulder], posed.position[wrist]);
        int tried = 0;
        for (double x = 0; x < 1; x += .1)
            for (double y = -.9; y < 1; y += .1) {
                const double far = std::hypot(x, y);
                if (far < .4 || far > .95) continue;
                const glm::dvec3 target =
                    posed.position[shoulder] + reach * glm::dvec3(side * x, y, 0);
                const Pose pose = solveIk(skeleton(), from, std::vector<IkTarget>{{wrist, target}});
                const std::string where = fmt::format("{} {:.1f} {:.1f}", right, x, y);
                EXPECT_LT(glm::distance(placeOf(pose, wrist), target), .005) << where;
                for (size_t j : {joint::kSpine1, joint::kSpine2, joint::kSpine3, joint::kPelvis})
                    EXPECT_LT(turnBetween(pose, from, j), 3 * kDegree)
                        << where << " " << jointName(j);
                EXPECT_GT(bendOf(elbow, quaternionOf(pose.rotation[elbow])).flexion, 25 * kDegree)
                    << where;
                ++tried;
            }
        EXPECT_GT(tried, 60);
    }
}

TEST(Ik, StretchesTowardsWhatIsOutOfReach) {
    struct Case {
        size_t joint, root, middle;
        glm::dvec3 way;
    };
    for (const Case& c : {Case{joint::kLeftWrist, joint::kLeftShoulder, joint::kLeftElbow,
                               glm::normalize(glm::dvec3(1, .3, .4))},
                          {joint::kRightAnkle, joint::kRightHip, joint::kRightKnee,
                           glm::normalize(glm::dvec3(-.3, -.6, .8))}}) {
        for (double far : {1., 3., 1000.}) {
            const Pose from = standing();
            Drag drag(from);
            const glm::dvec3 target = placeOf(from, c.root) + far * c.way;
            drag.to(c.joint, placeOf(from, c.root) + c.way, .02);
            const Pose pose = solveIk(skeleton(), from, std::vector<IkTarget>{{c.joint, target}});
            const PosedSkeleton posed = forwardKinematics(skeleton(), pose);
            const glm::dvec3 limb =
                glm::normalize(posed.position[c.joint] - posed.position[c.root]);
            EXPECT_GT(glm::dot(limb, glm::normalize(target - posed.position[c.root])), .97)
                << jointName(c.joint) << " " << far;
            EXPECT_LT(bendOf(c.middle, quaternionOf(pose.rotation[c.middle])).flexion,
                      12 * kDegree);
            expectWithinLimits(pose, jointName(c.joint));
        }
    }
}

TEST(Ik, PassesTheStraightArmSmoothly) {
    // From well inside to beyond reach and back again, along several rays; from the T-pose, whose
    // arms and legs are exactly straight, too.
    for (const auto& [end, root] : {std::pair{joint::kLeftWrist, joint::kLeftShoulder},
                                    {joint::kRightWrist, joint::kRightShoulder},
                                    {joint::kLeftAnkle, joint::kLeftHip}}) {
        const bool leg = end == joint::kLeftAnkle;
        for (int ray = 0; ray < 6; ++ray) {
            std::mt19937 random(uint32_t(100 + ray));
            const Pose from = ray % 2 ? standing() : Pose{};
            const glm::dvec3 side = placeOf(from, root) - placeOf(from, joint::kPelvis);
            glm::dvec3 way = direction(random);
            way = leg ? glm::normalize(.4 * way + glm::dvec3(0, -1, .5))
                      : glm::normalize(.5 * way + glm::dvec3(side.x > 0 ? .8 : -.8, 0, .5));
            const double length = glm::length(placeOf(from, end) - placeOf(from, root));
            Drag drag(from);
            const auto at = [&](double share) {
                return placeOf(from, root) + share * length * way;
            };
            drag.to(end, at(.6), .005);
            // By centimetres: no joint turns further than the geometry of a straightening elbow
            // asks for, whose first centimetre takes 23 degrees of it, a knee's 17.
            for (double share : {1.3, .6, 1.02, .5, 1.3, .6}) drag.to(end, at(share), .01);
            EXPECT_LT(drag.largestStep, 30 * kDegree) << jointName(end) << " ray " << ray;
            const size_t hinge = leg                        ? joint::kLeftKnee
                                 : end == joint::kLeftWrist ? joint::kLeftElbow
                                                            : joint::kRightElbow;
            EXPECT_GT(bendOf(hinge, quaternionOf(drag.pose.rotation[hinge])).flexion, .5);
            expectWithinLimits(drag.pose, jointName(end));
        }
    }
}

TEST(Ik, KeepsPins) {
    const Pose from = standing();
    const PosedSkeleton posed = forwardKinematics(skeleton(), from);
    const std::array<size_t, 3> held = {joint::kLeftAnkle, joint::kRightAnkle, joint::kRightWrist};
    const auto drift = [&](const Pose& pose, size_t joint) {
        return glm::length(placeOf(pose, joint) - posed.position[joint]);
    };
    // The pelvis goes down and aside over pinned feet: the knees bend, the soles stay level.
    Drag squat(from);
    for (size_t pin : {held[0], held[1]}) squat.pins.push_back(pinnedAt(posed, pin));
    const glm::dvec3 low = posed.position[0] + glm::dvec3(.04, -.12, .02);
    squat.to(joint::kPelvis, low);
    EXPECT_LT(glm::length(placeOf(squat.pose, joint::kPelvis) - low), 2e-3);
    for (size_t pin : {held[0], held[1]}) {
        EXPECT_LT(drift(squat.pose, pin), 2e-3) << jointName(pin);
        const glm::dmat3 now = forwardKinematics(skeleton(), squat.pose).rotation[pin];
        EXPECT_LT(glm::length(now * glm::dvec3(0, 0, 1) - posed.rotation[pin][2]), .02);
    }
    EXPECT_GT(squat.pose.rotation[joint::kLeftKnee].x, .5);
    EXPECT_EQ(squat.pose.rotation[joint::kLeftElbow], from.rotation[joint::kLeftElbow]);
    expectWithinLimits(squat.pose, "squat");
    EXPECT_LT(squat.largestStep, 40 * kDegree);

    // The pelvis cannot be lifted off legs that are straight and pinned.
    Drag lift(from);
    lift.pins = squat.pins;
    lift.to(joint::kPelvis, posed.position[0] + glm::dvec3(0, .5, 0));
    EXPECT_LT(placeOf(lift.pose, joint::kPelvis).y - posed.position[0].y, .02);
    for (size_t pin : {held[0], held[1]}) EXPECT_LT(drift(lift.pose, pin), 6e-3);

    // The left hand is dragged while the right one is pinned and the trunk has to lean.
    Drag reach(from);
    for (size_t pin : held) reach.pins.push_back(pinnedAt(posed, pin));
    const glm::dvec3 target = posed.position[joint::kLeftWrist] + glm::dvec3(.2, .1, .45);
    reach.to(joint::kLeftWrist, target);
    EXPECT_LT(glm::length(placeOf(reach.pose, joint::kLeftWrist) - target), 2e-3);
    for (size_t pin : held) EXPECT_LT(drift(reach.pose, pin), 2e-3) << jointName(pin);
    EXPECT_LT(reach.largestStep, 40 * kDegree);

    // One foot is dragged over the pinned other one: the body does not follow.
    Drag step(from);
    step.pins.push_back(pinnedAt(posed, joint::kRightAnkle));
    step.to(joint::kLeftAnkle, posed.position[joint::kLeftAnkle] + glm::dvec3(.1, .2, .2));
    EXPECT_EQ(step.pose.trans, from.trans);
    EXPECT_EQ(step.pose.rotation[joint::kRightHip], from.rotation[joint::kRightHip]);

    // Without pins the body follows the pelvis as it is.
    Drag carry(from);
    carry.to(joint::kPelvis, low);
    EXPECT_EQ(carry.pose.rotation, from.rotation);
    EXPECT_LT(glm::length(carry.pose.trans - (low - posed.position[0])), 1e-4);
}

TEST(Ik, TakesPosesFromCamerasAndBeyondLimits) {
    // Upside down, as before a camera whose y points down, moved away, and with a left elbow that
    // is bent backwards and sideways. The first touch moves nothing.
    Pose from = standing();
    from.rotation[0] = {3.1, .2, 0};
    from.trans = {.4, .2, 3};
    from.rotation[joint::kLeftElbow] = {.1, .3, .4};
    const glm::dvec3 home = placeOf(from, joint::kLeftWrist);
    const Pose touched =
        solveIk(skeleton(), from, std::vector<IkTarget>{{joint::kLeftWrist, home}});
    EXPECT_EQ(touched, from);
    Drag drag(from);
    drag.to(joint::kLeftWrist, home + glm::dvec3(.001, 0, 0), .001);
    EXPECT_LT(drag.largestStep, 3 * kDegree);
    drag.to(joint::kLeftWrist, home + glm::dvec3(.05, -.15, -.1));
    EXPECT_LT(
        glm::length(placeOf(drag.pose, joint::kLeftWrist) - home - glm::dvec3(.05, -.15, -.1)),
        2e-3);
    EXPECT_LT(drag.largestStep, 30 * kDegree);
}

TEST(Ik, GoesBeyondLimitsWhereTheyAreOff) {
    // A foot behind the neck.
    const Pose from = standing();
    const glm::dvec3 target = placeOf(from, joint::kLeftHip) + glm::dvec3(0, .4, -.4);
    const std::vector<IkTarget> targets{{joint::kLeftAnkle, target}};
    const auto beyond = [&](const Pose& pose) {
        double most = 0;
        for (size_t j = 1; j < joint::kCount; ++j)
            for (double by :
                 beyondLimits(j, quaternionOf(pose.rotation[j]), quaternionOf(from.rotation[j])))
                most = std::max(most, by);
        return most;
    };
    const Pose within = solveIk(skeleton(), from, targets);
    EXPECT_GT(glm::distance(placeOf(within, joint::kLeftAnkle), target), .1);
    EXPECT_LT(beyond(within), 1e-6);
    const Pose free = solveIk(skeleton(), from, targets, {.limits = false});
    EXPECT_LT(glm::distance(placeOf(free, joint::kLeftAnkle), target), .005);
    EXPECT_GT(beyond(free), .5);
}

TEST(Ik, LeavesThePoseWhereATargetIsNoPlace) {
    const Pose from = standing();
    const glm::dvec3 place = placeOf(from, joint::kLeftWrist) + glm::dvec3(0, .1, .1);
    for (double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
        for (int c = 0; c < 3; ++c) {
            glm::dvec3 target = place;
            target[c] = bad;
            EXPECT_EQ(solveIk(skeleton(), from, std::vector<IkTarget>{{joint::kLeftWrist, target}}),
                      from);
        }
        EXPECT_EQ(solveIk(skeleton(), from, std::vector<IkTarget>{{joint::kLeftWrist, place, bad}}),
                  from);
    }
    EXPECT_EQ(solveIk(skeleton(), from, {}), from);
    // The same bits again.
    const std::vector<IkTarget> targets{{joint::kLeftWrist, place}};
    EXPECT_EQ(solveIk(skeleton(), from, targets), solveIk(skeleton(), from, targets));
    // Numbers so large that they overflow do no harm.
    const Pose huge =
        solveIk(skeleton(), from, std::vector<IkTarget>{{joint::kLeftWrist, {1e300, 0, 1e300}}});
    EXPECT_TRUE(isFinite(huge));
}

// ---- speed, balance -----------------------------------------------------------------------------

// However fast the mouse was, and whichever way it came: the pose is that of where it is.
TEST(Ik, TheMousesSpeedAndWayDoNotMatter) {
    std::mt19937 random(3);
    const Pose from = standing();
    const PosedSkeleton posed = forwardKinematics(skeleton(), from);
    for (size_t joint : {size_t{joint::kRightAnkle}, size_t{joint::kLeftWrist},
                         size_t{joint::kPelvis}, size_t{joint::kHead}}) {
        const glm::dvec3 target =
            posed.position[joint] + (joint == joint::kPelvis ? glm::dvec3(.1, -.25, .05)
                                     : joint == joint::kHead ? glm::dvec3(.03, -.03, .06)
                                                             : glm::dvec3(.1, .2, .15));
        std::vector<Pose> ends;
        for (double step : {.5, .04, .01, .002}) {
            Drag drag(from);
            if (joint == joint::kPelvis)
                drag.pins = {pinnedAt(posed, joint::kLeftAnkle),
                             pinnedAt(posed, joint::kRightAnkle)};
            if (step < .02) drag.to(joint, posed.position[joint] + .3 * direction(random), step);
            drag.to(joint, target, step);
            ends.push_back(drag.pose);
        }
        for (const Pose& end : ends)
            EXPECT_LT(largestTurn(end, ends[0]), .01 * kDegree) << jointName(joint);
        EXPECT_LT(glm::distance(placeOf(ends[0], joint), target), 2e-3) << jointName(joint);
    }
}

// A mouse is never quite still: half a millimetre is no other pose.
TEST(Ik, PosesHardlyChangeWhereTheTargetHardlyDoes) {
    std::mt19937 random(8);
    const Pose from = standing();
    const PosedSkeleton posed = forwardKinematics(skeleton(), from);
    for (bool pinned : {false, true})
        for (int i = 0; i < 12; ++i) {
            std::vector<IkTarget> targets{
                {joint::kLeftHand,
                 posed.position[joint::kLeftHand] + uniformIn(random, .1, .5) * direction(random)}};
            if (pinned)
                for (size_t foot : {joint::kLeftAnkle, joint::kRightAnkle})
                    targets.push_back(pinnedAt(posed, foot));
            const Pose pose = solveIk(skeleton(), from, targets);
            targets[0].position += .0005 * direction(random);
            EXPECT_LT(largestTurn(solveIk(skeleton(), from, targets), pose), 1 * kDegree)
                << pinned << " " << i;
        }
}

// A hand that is pulled far over pinned feet bends knees and hips, and the body stays over the
// feet.
TEST(Ik, ReachesFarOverPinnedFeetWithoutFallingOver) {
    const Pose from = standing();
    const PosedSkeleton posed = forwardKinematics(skeleton(), from);
    const std::vector<size_t> feet{joint::kLeftAnkle, joint::kRightAnkle};
    const auto reach = [&](const glm::dvec3& by, bool balance) {
        std::vector<IkTarget> targets{{joint::kLeftHand, posed.position[joint::kLeftHand] + by}};
        for (size_t foot : feet) targets.push_back(pinnedAt(posed, foot));
        return solveIk(skeleton(), from, targets, {.balance = balance});
    };
    for (const glm::dvec3& by :
         {glm::dvec3(0, 0, .8), glm::dvec3(0, -.6, .3), glm::dvec3(0, -.7, .6)}) {
        const Pose pose = reach(by, true), falling = reach(by, false);
        const PosedSkeleton now = forwardKinematics(skeleton(), pose);
        expectWithinLimits(pose, "reaching far");
        for (size_t foot : feet)
            EXPECT_LT(glm::distance(now.position[foot], posed.position[foot]), 2e-3);
        for (size_t knee : {joint::kLeftKnee, joint::kRightKnee})
            EXPECT_GT(bendOf(knee, quaternionOf(pose.rotation[knee])).flexion, 20 * kDegree);
        for (size_t hip : {joint::kLeftHip, joint::kRightHip})
            EXPECT_LT(pose.rotation[hip].x, -20 * kDegree);  // bent forward
        EXPECT_LT(outOfBalance(now, feet), .06);
        EXPECT_GT(outOfBalance(forwardKinematics(skeleton(), falling), feet),
                  outOfBalance(now, feet) + .05);
    }
    // Down to the floor is no matter of balance: the hand arrives.
    const Pose low = reach({0, -.6, .3}, true);
    EXPECT_LT(glm::distance(placeOf(low, joint::kLeftHand),
                            posed.position[joint::kLeftHand] + glm::dvec3(0, -.6, .3)),
              2e-3);
    EXPECT_EQ(outOfBalance(posed, {}), 0);
}

constexpr std::array<size_t, 2> kAnkles{joint::kLeftAnkle, joint::kRightAnkle};
const glm::dvec3 kUp(0, 1, 0);

// The joint pulled there from standing, over feet that may step or not.
Pose pulled(size_t joint, const glm::dvec3& by, bool steps) {
    const Pose from = standing();
    const PosedSkeleton posed = forwardKinematics(skeleton(), from);
    std::vector<IkTarget> targets{{joint, posed.position[joint] + by}};
    for (size_t foot : kAnkles) targets.push_back(pinnedAt(posed, foot));
    return steps ? solveWithSteps(skeleton(), from, targets, kAnkles, kUp)
                 : solveIk(skeleton(), from, targets);
}

// A hand that is pulled further than the body reaches: the feet step along the ground, the hand
// arrives, and the body stays over its feet and more upright than without.
TEST(Ik, FeetStepTowardsWhatIsOutOfReach) {
    const Pose from = standing();
    const PosedSkeleton posed = forwardKinematics(skeleton(), from);
    const auto lean = [](const PosedSkeleton& body) {
        const glm::dvec3 trunk = body.position[joint::kNeck] - body.position[joint::kPelvis];
        return std::acos(trunk.y / glm::length(trunk));
    };
    for (const glm::dvec3& by : {glm::dvec3(0, .2, 1), glm::dvec3(1.1, .1, .2),
                                 glm::dvec3(-.3, .1, 1.6), glm::dvec3(0, .2, -1)}) {
        const Pose pose = pulled(joint::kLeftHand, by, true);
        const PosedSkeleton now = forwardKinematics(skeleton(), pose),
                            held =
                                forwardKinematics(skeleton(), pulled(joint::kLeftHand, by, false));
        const glm::dvec3 goal = posed.position[joint::kLeftHand] + by;
        EXPECT_GT(glm::distance(held.position[joint::kLeftHand], goal), .03) << "out of reach";
        EXPECT_LT(glm::distance(now.position[joint::kLeftHand], goal), .02) << by.x << " " << by.z;
        expectWithinLimits(pose, "a step");
        double farthest = 0;
        for (size_t foot : kAnkles) {
            const glm::dvec3 moved = now.position[foot] - posed.position[foot];
            EXPECT_LT(std::abs(moved.y), 5e-3) << "on the ground";
            farthest = std::max(farthest, glm::length(moved));
        }
        EXPECT_GT(farthest, .1);
        EXPECT_LT(glm::distance(now.position[kAnkles[0]], now.position[kAnkles[1]]), .75);
        EXPECT_LT(outOfBalance(now, kAnkles), .08);
        EXPECT_LT(lean(now), lean(held) + 1 * kDegree);
    }
}

TEST(Ik, FeetStayWhereTheBodyReaches) {
    const glm::dvec3 near(.1, .3, .25);
    EXPECT_EQ(pulled(joint::kLeftHand, near, true), pulled(joint::kLeftHand, near, false));
}

// Nothing jumps where a foot begins to go, nor where the other one comes after it.
TEST(Ik, StepsGrowWithTheWay) {
    constexpr double kReach = .3;  // without a step
    Pose last = pulled(joint::kLeftHand, {0, .2, kReach}, true);
    EXPECT_EQ(last, pulled(joint::kLeftHand, {0, .2, kReach}, false));
    for (double far = kReach + .02; far < 1.9; far += .02) {
        const Pose pose = pulled(joint::kLeftHand, {0, .2, far}, true);
        EXPECT_LT(largestTurn(pose, last), 15 * kDegree) << far;
        for (size_t foot : kAnkles)
            EXPECT_LT(glm::distance(placeOf(pose, foot), placeOf(last, foot)), .09) << far;
        last = pose;
    }
    EXPECT_GT(last.trans.z, .8) << "the body has come along";
}

// A body whose parts are where they are known to be.
TEST(Ik, FindsTheCentreOfMass) {
    const PosedSkeleton posed = forwardKinematics(skeleton(), standing());
    const glm::dvec3 centre = centreOfMass(posed);
    // Of somebody who stands it is between navel and hips, in the middle.
    EXPECT_LT(centre.y, posed.position[joint::kSpine3].y);
    EXPECT_GT(centre.y, posed.position[joint::kLeftHip].y);
    EXPECT_NEAR(centre.x, posed.position[joint::kPelvis].x, .01);
    Pose raised = standing();
    raised.rotation[joint::kLeftShoulder] = {0, 0, 1.2};
    const double arm =
        placeOf(raised, joint::kLeftElbow).y - placeOf(standing(), joint::kLeftElbow).y;
    // An arm is a twentieth of the body, and its middle near the elbow.
    EXPECT_NEAR(centreOfMass(forwardKinematics(skeleton(), raised)).y - centre.y, .0494 * arm,
                .25 * .0494 * arm);
}

}  // namespace
}  // namespace doppel
