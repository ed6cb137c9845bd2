// The viewer's skeleton against the skinning op; limits.
#include <cmath>
#include <limits>
#include <random>
#include <set>

#include "tests/op_test.h"
#include "tests/posed_body.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/body_render.h"
#include "viewer/pose/skeleton.h"

namespace doppel {
namespace {

using namespace test;

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

TEST(Skeleton, EditsBothSides) {
    std::mt19937 random(6);
    const Skeleton skeleton = skeletonOf(body(), Betas{});
    const Pose began = randomPose(random, 1);
    Pose pose = began;
    pose.rotation[joint::kLeftElbow] = {.1, -.7, .2};
    pose.rotation[joint::kSpine3] = {.2, 0, 0};
    pose.rotation[joint::kRightKnee] = {.4, 0, 0};  // of another limb
    Pose expected = pose;
    expected.rotation[joint::kRightElbow] = {.1, .7, -.2};
    EXPECT_EQ(mirroredAcross(skeleton, pose, began, joint::kLeftWrist), expected);
    EXPECT_EQ(mirroredAcross(skeleton, pose, began, joint::kSpine3), pose);
    EXPECT_EQ(mirroredAcross(skeleton, began, began, joint::kLeftWrist), began);

    // A side that is copied is as the other one of the mirror image.
    const Pose toRight = sideCopied(pose, true), toLeft = sideCopied(pose, false),
               image = mirrored(pose);
    for (size_t j = 1; j < joint::kCount; ++j) {
        const size_t across = oppositeJoint(j);
        if (across == j) {
            EXPECT_EQ(toRight.rotation[j], pose.rotation[j]) << jointName(j);
            EXPECT_EQ(toLeft.rotation[j], pose.rotation[j]) << jointName(j);
            continue;
        }
        const bool left = across > j;
        EXPECT_EQ(toRight.rotation[j], (left ? pose : image).rotation[j]) << jointName(j);
        EXPECT_EQ(toLeft.rotation[j], (left ? image : pose).rotation[j]) << jointName(j);
    }
    EXPECT_EQ(toRight.rotation[0], pose.rotation[0]);

    // Places: twice is the place again, and the trunk's joints are in the plane.
    const PosedSkeleton posed = forwardKinematics(skeleton, pose);
    const glm::dvec3 place(.3, .2, 2.9),
        across = placeAcross(skeleton, posed, joint::kLeftWrist, place);
    EXPECT_GT(glm::distance(across, place), .01);
    EXPECT_LT(glm::distance(placeAcross(skeleton, posed, joint::kRightElbow, across), place),
              1e-12);
    EXPECT_NEAR(glm::distance(across, posed.position[joint::kSpine3]),
                glm::distance(place, posed.position[joint::kSpine3]), 1e-12);
}

TEST(Skeleton, PointsABone) {
    std::mt19937 random(7);
    const Skeleton skeleton = skeletonOf(body(), Betas{});
    const Pose pose = randomPose(random, 1);
    EXPECT_EQ(limbOf(skeleton, joint::kRightWrist), Limb::RightArm);
    EXPECT_EQ(limbOf(skeleton, joint::kLeftFoot), Limb::LeftLeg);
    for (size_t trunk : {joint::kPelvis, joint::kLeftHip, joint::kRightCollar, joint::kHead})
        EXPECT_FALSE(limbOf(skeleton, trunk)) << jointName(trunk);
    const PosedSkeleton before = forwardKinematics(skeleton, pose);
    const glm::dvec3 elbow = before.position[joint::kLeftElbow],
                     towards = glm::normalize(glm::dvec3(.3, -.5, .2));
    const Pose pointed = pointBone(skeleton, pose, joint::kLeftWrist, elbow + towards);
    Pose rest = pointed;
    rest.rotation[joint::kLeftElbow] = pose.rotation[joint::kLeftElbow];
    EXPECT_EQ(rest, pose) << "the elbow alone turns";
    const glm::dvec3 wrist = forwardKinematics(skeleton, pointed).position[joint::kLeftWrist];
    EXPECT_LT(glm::distance(glm::normalize(wrist - elbow), towards), 1e-9);
    EXPECT_EQ(pointBone(skeleton, pose, joint::kLeftWrist, elbow), pose);
}

TEST(Skeleton, ListsJointsLimbByLimb) {
    const auto& order = jointsByLimb();
    const std::set<size_t> all(order.begin(), order.end());
    EXPECT_EQ(all.size(), size_t{joint::kCount});
    const Skeleton skeleton = skeletonOf(body(), Betas{});
    for (size_t i = 1; i < order.size(); ++i) {
        // From the trunk outwards: each hangs on the one before, or begins a limb.
        const bool follows = skeleton.parents[order[i]] == static_cast<int>(order[i - 1]);
        EXPECT_TRUE(follows || limbOfTree(order[i]) != limbOfTree(order[i - 1])) << i;
    }
    EXPECT_EQ(limbOfTree(joint::kRightHand), Limb::RightArm);
    EXPECT_EQ(limbOfTree(joint::kLeftHip), Limb::LeftLeg);
    EXPECT_FALSE(limbOfTree(joint::kHead));
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

}  // namespace
}  // namespace doppel
