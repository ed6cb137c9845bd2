// The viewer's skeleton against the skinning op; limits; inverse kinematics.
#include <cmath>
#include <limits>
#include <random>

#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/body_render.h"
#include "viewer/ik.h"
#include "viewer/skeleton.h"

namespace doppel {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;

const BodyModel& body() {
    static const BodyModel model = bodyFromNpz(readBodyArrays("default"));
    return model;
}
const Skeleton& skeleton() {
    static const Skeleton made = skeletonOf(body(), {});
    return made;
}

// The same numbers from every standard library.
double uniformIn(std::mt19937& random, double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.);
}
glm::dvec3 direction(std::mt19937& random) {
    while (true) {
        const glm::dvec3 v(uniformIn(random, -1, 1), uniformIn(random, -1, 1),
                           uniformIn(random, -1, 1));
        const double length = glm::length(v);
        if (length > .1 && length < 1) return v / length;
    }
}

// A pose that a human could take: every joint turned by up to `angle`, then put within its range.
Pose randomPose(std::mt19937& random, double angle) {
    Pose pose;
    for (glm::dvec3& rotation : pose.rotation)
        rotation = direction(random) * uniformIn(random, 0, angle);
    pose.trans = direction(random);
    return clampToLimits(pose);
}

// Arms lowered, elbows and knees a little bent: how people stand.
Pose standing() {
    Pose pose;
    pose.rotation[joint::kLeftShoulder] = {0, 0, -1.1};
    pose.rotation[joint::kRightShoulder] = {0, 0, 1.1};
    pose.rotation[joint::kLeftElbow] = {0, -.3, 0};
    pose.rotation[joint::kRightElbow] = {0, .3, 0};
    return pose;
}

glm::dvec3 placeOf(const Pose& pose, size_t joint) {
    return forwardKinematics(skeleton(), pose).position[joint];
}

// The angle between two poses' rotations of a joint.
double turnBetween(const Pose& a, const Pose& b, size_t joint) {
    return glm::length(axisAngleOf(quaternionOf(a.rotation[joint]) *
                                   glm::conjugate(quaternionOf(b.rotation[joint]))));
}
double largestTurn(const Pose& a, const Pose& b) {
    double largest = 0;
    for (size_t j = 0; j < joint::kCount; ++j) largest = std::max(largest, turnBetween(a, b, j));
    return largest;
}

void expectWithinLimits(const Pose& pose, const std::string& what) {
    const Pose clamped = clampToLimits(pose);
    for (size_t j = 0; j < joint::kCount; ++j)
        EXPECT_LT(turnBetween(pose, clamped, j), 1e-6) << what << ": " << jointName(j);
}

// ---- skeleton -----------------------------------------------------------------------------------

TEST(Skeleton, StandsWhereTheSkinningOpPutsIt) {
    BodyPoser poser(testDevice(), body());
    std::mt19937 random(3);
    for (int i = 0; i < 4; ++i) {
        Betas betas{};
        if (i > 0)
            for (float& beta : betas) beta = static_cast<float>(uniformIn(random, -2, 2));
        Pose pose;
        for (glm::dvec3& rotation : pose.rotation)
            rotation = direction(random) * uniformIn(random, 0, i == 3 ? 3.1 : 1.5);
        pose.trans = 3. * direction(random);
        pose = poseOf(thetaOf(pose), transOf(pose));  // as the op sees it
        const PosedMesh mesh = poser.pose(thetaOf(pose), transOf(pose), betas);
        const PosedSkeleton posed = forwardKinematics(skeletonOf(body(), betas), pose);
        for (size_t j = 0; j < joint::kCount; ++j) {
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(posed.position[j][c], mesh.joints[j][static_cast<size_t>(c)], 1e-5)
                    << "pose " << i << ", " << jointName(j);
        }
    }
}

TEST(Skeleton, NamesItsJoints) {
    EXPECT_STREQ(jointName(joint::kPelvis), "pelvis");
    EXPECT_STREQ(jointName(joint::kRightHand), "right_hand");
    for (size_t j = 0; j < joint::kCount; ++j) {
        EXPECT_EQ(jointNumber(jointName(j)), j);
        EXPECT_EQ(oppositeJoint(oppositeJoint(j)), j);
    }
    EXPECT_EQ(oppositeJoint(joint::kLeftKnee), joint::kRightKnee);
    EXPECT_EQ(oppositeJoint(joint::kSpine3), joint::kSpine3);
    EXPECT_FALSE(jointNumber("Left_wrist"));
    EXPECT_TRUE(skeleton().hangsOn(joint::kLeftHand, joint::kSpine2));
    EXPECT_TRUE(skeleton().hangsOn(joint::kLeftHand, joint::kLeftHand));
    EXPECT_FALSE(skeleton().hangsOn(joint::kLeftHand, joint::kRightCollar));
    EXPECT_FALSE(skeleton().hangsOn(joint::kPelvis, joint::kLeftHip));
}

TEST(Skeleton, TurnsAJointAboutAnAxisInTheWorld) {
    std::mt19937 random(4);
    for (size_t j = 0; j < joint::kCount; ++j) {
        const Pose pose = randomPose(random, 1.5);
        const glm::dvec3 axis = direction(random);
        const Pose turned = rotateJoint(skeleton(), pose, j, 3. * axis, .7);
        const PosedSkeleton before = forwardKinematics(skeleton(), pose);
        const PosedSkeleton after = forwardKinematics(skeleton(), turned);
        const glm::dmat3 turn = glm::mat3_cast(quaternionOf(.7 * axis));
        for (size_t k = 0; k < joint::kCount; ++k) {
            if (k != j) {
                EXPECT_EQ(turned.rotation[k], pose.rotation[k]);
            }
            const glm::dvec3 expected =
                skeleton().hangsOn(k, j)
                    ? before.position[j] + turn * (before.position[k] - before.position[j])
                    : before.position[k];
            EXPECT_LT(glm::length(after.position[k] - expected), 1e-12);
        }
        EXPECT_LT(largestTurn(rotateJoint(skeleton(), turned, j, axis, -.7), pose), 1e-12);
    }
    const Pose pose = standing();
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(rotateJoint(skeleton(), pose, 3, {0, 0, 0}, 1), pose);
    EXPECT_EQ(rotateJoint(skeleton(), pose, 3, {nan, 0, 0}, 1), pose);
    EXPECT_EQ(rotateJoint(skeleton(), pose, 3, {1, 0, 0}, nan), pose);
}

TEST(Skeleton, ResetsOneJoint) {
    std::mt19937 random(5);
    const Pose original = randomPose(random, 1), pose = randomPose(random, 1);
    Pose expected = pose;
    expected.rotation[joint::kLeftElbow] = original.rotation[joint::kLeftElbow];
    EXPECT_EQ(resetJoint(pose, joint::kLeftElbow, original), expected);
    expected = pose;
    expected.rotation[0] = original.rotation[0], expected.trans = original.trans;
    EXPECT_EQ(resetJoint(pose, joint::kPelvis, original), expected);
}

TEST(Skeleton, MirrorsAcrossTheUprightPlane) {
    std::mt19937 random(6);
    for (int i = 0; i < 20; ++i) {
        // In a camera's space, y down, as well as upright.
        Pose pose = randomPose(random, 1.2);
        if (i % 2)
            pose.rotation[0] = axisAngleOf(quaternionOf({3.14159265358979, 0, 0}) *
                                           quaternionOf(pose.rotation[0]));
        const Pose image = mirrored(pose);
        const Pose again = mirrored(image);
        EXPECT_LT(largestTurn(again, pose), 1e-7);
        EXPECT_EQ(again.trans, pose.trans);
        EXPECT_EQ(image.trans, pose.trans);

        // The image of each joint in the vertical plane through the pelvis across the body. The
        // rest pose is symmetric but for a tenth of a millimetre.
        const PosedSkeleton there = forwardKinematics(skeleton(), pose);
        const PosedSkeleton here = forwardKinematics(skeleton(), image);
        glm::dvec3 normal = there.rotation[0] * glm::dvec3(1, 0, 0);
        normal.y = 0;
        normal = glm::normalize(normal);
        for (size_t j = 0; j < joint::kCount; ++j) {
            const glm::dvec3 offset = there.position[j] - there.position[0];
            const glm::dvec3 expected =
                there.position[0] + offset - 2 * glm::dot(offset, normal) * normal;
            EXPECT_LT(glm::length(here.position[oppositeJoint(j)] - expected), 1e-3)
                << "pose " << i << ", " << jointName(j);
        }
        // It heads where it headed: level parts of the forward axis, mirrored in that plane.
        const glm::dvec3 forward = there.rotation[0] * glm::dvec3(0, 0, 1);
        const glm::dvec3 expected = forward - 2 * glm::dot(forward, normal) * normal;
        EXPECT_LT(glm::length(here.rotation[0] * glm::dvec3(0, 0, 1) - expected), 1e-9);
    }
    // On its side: the pelvis stays.
    Pose lying = standing();
    lying.rotation[0] = {0, 0, 90 * kDegree};
    EXPECT_EQ(mirrored(lying).rotation[0], lying.rotation[0]);
}

// ---- limits -------------------------------------------------------------------------------------

// Bends the given joint about an axis and tells by what angle it is bent after clamping.
double clampedTurn(size_t joint, const glm::dvec3& axis, double degrees) {
    const glm::dquat found =
        clampJoint(joint, quaternionOf(degrees * kDegree * axis), glm::dquat(1, 0, 0, 0));
    return glm::dot(axis, axisAngleOf(found)) / kDegree;
}

TEST(Limits, HingesDoNotBendBackwards) {
    const glm::dvec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
    // Forearms fold forward, the left about −y; calves fold back, about x.
    EXPECT_NEAR(clampedTurn(joint::kLeftElbow, -y, 120), 120, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kLeftElbow, -y, 170), 152, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kLeftElbow, -y, -40), 0, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kRightElbow, y, 120), 120, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kRightElbow, y, -40), 0, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kLeftElbow, z, 50), 8, 1e-9);
    for (size_t knee : {joint::kLeftKnee, joint::kRightKnee}) {
        EXPECT_NEAR(clampedTurn(knee, x, 100), 100, 1e-9);
        EXPECT_NEAR(clampedTurn(knee, x, -30), 0, 1e-9);
        EXPECT_NEAR(clampedTurn(knee, z, 30), 6, 1e-9);
    }
    EXPECT_TRUE(isHinge(joint::kRightElbow));
    EXPECT_FALSE(isHinge(joint::kLeftShoulder));
    EXPECT_NEAR(bendOf(joint::kRightElbow, quaternionOf({0, .8, 0})).flexion, .8, 1e-12);
    EXPECT_NEAR(bendOf(joint::kLeftElbow, quaternionOf({0, -.8, 0})).flexion, .8, 1e-12);
    EXPECT_NEAR(bendOf(joint::kRightKnee, quaternionOf({.8, 0, 0})).flexion, .8, 1e-12);
}

TEST(Limits, AreThoseOfPeople) {
    const glm::dvec3 x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
    EXPECT_NEAR(clampedTurn(joint::kLeftShoulder, -z, 90), 90, 1e-9);  // the arm hangs down
    EXPECT_NEAR(clampedTurn(joint::kLeftShoulder, z, 90), 90, 1e-9);   // and is stretched up
    EXPECT_NEAR(clampedTurn(joint::kLeftShoulder, y, 120), 55, 1e-9);  // not far behind the back
    EXPECT_NEAR(clampedTurn(joint::kRightShoulder, -y, 120), 55, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kLeftHip, -x, 110), 110, 1e-9);  // sitting
    EXPECT_NEAR(clampedTurn(joint::kLeftHip, x, 90), 35, 1e-9);     // little to the back
    EXPECT_NEAR(clampedTurn(joint::kLeftHip, -z, 60), 35, 1e-9);    // legs cross so far
    EXPECT_NEAR(clampedTurn(joint::kRightHip, z, 60), 35, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kHead, y, 170), 42, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kSpine2, x, -60), -14, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kLeftWrist, -z, 100), 82, 1e-9);
    EXPECT_NEAR(clampedTurn(joint::kLeftAnkle, x, 80), 52, 1e-9);
    // The pelvis turns as it likes.
    EXPECT_NEAR(clampedTurn(joint::kPelvis, x, 170), 170, 1e-9);

    // A range is left at its rim, not elsewhere, and clamping again changes nothing.
    std::mt19937 random(7);
    for (int i = 0; i < 300; ++i) {
        Pose pose;
        for (glm::dvec3& rotation : pose.rotation)
            rotation = direction(random) * uniformIn(random, 0, 3.1);
        const Pose clamped = clampToLimits(pose);
        EXPECT_LT(largestTurn(clampToLimits(clamped), clamped), 1e-9);
        // The mirror image is clamped to the mirror image.
        EXPECT_LT(largestTurn(clampToLimits(mirrored(pose)), mirrored(clamped)), 1e-7);
    }
}

TEST(Limits, LetAPoseBeyondThemBe) {
    // An elbow that a capture bent backwards by 20 degrees: it may go back inside, not further out.
    Pose began = standing();
    began.rotation[joint::kLeftElbow] = {0, 20 * kDegree, 0};
    EXPECT_EQ(clampToLimits(began, began), began);
    Pose further = began;
    further.rotation[joint::kLeftElbow] = {0, 35 * kDegree, 0};
    EXPECT_LT(largestTurn(clampToLimits(further, began), began), 1e-9);
    further.rotation[joint::kLeftElbow] = {0, 10 * kDegree, 0};
    EXPECT_EQ(clampToLimits(further, began), further);

    began.rotation[joint::kLeftHip] = {1, 0, 0};  // 57 degrees back, of 35
    EXPECT_EQ(clampToLimits(began, began), began);
    further = began;
    further.rotation[joint::kLeftHip] = {1.4, 0, 0};
    EXPECT_LT(largestTurn(clampToLimits(further, began), began), 1e-9);
}

// ---- inverse kinematics -------------------------------------------------------------------------

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
            const Pose next = solveIk(skeleton(), pose, targets, {.began = &began});
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
            Pose pose = solveIk(skeleton(), drag.pose, std::vector<IkTarget>{{c.joint, target}},
                                {.began = &from});
            const PosedSkeleton posed = forwardKinematics(skeleton(), pose);
            const glm::dvec3 limb =
                glm::normalize(posed.position[c.joint] - posed.position[c.root]);
            EXPECT_GT(glm::dot(limb, glm::normalize(target - posed.position[c.root])), .97)
                << jointName(c.joint) << " " << far;
            EXPECT_LT(bendOf(c.middle, quaternionOf(pose.rotation[c.middle])).flexion,
                      12 * kDegree);
            expectWithinLimits(pose, jointName(c.joint));
            // Holding the mouse still holds the pose still.
            double wander = 0;
            const Pose first = pose;
            for (int i = 0; i < 200; ++i) {
                const Pose next = solveIk(
                    skeleton(), pose, std::vector<IkTarget>{{c.joint, target}}, {.began = &from});
                wander = std::max(wander, largestTurn(next, first));
                pose = next;
            }
            EXPECT_LT(wander, 1 * kDegree) << jointName(c.joint) << " " << far;
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

}  // namespace
}  // namespace doppel
