// A body's pose from landmarks: joints, feet, shapes of a height, keypoints.
#include "trainer/person/body_start.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "nn/body/body.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/capture.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/person/heads.h"

namespace doppel {
namespace {

// What a perfect network would see of a body, on a scale of its own.
PersonLandmarks landmarksOfBody(const JointPlaces& joints, const glm::dquat& head,
                                const Camera& camera) {
    PersonLandmarks person;
    const glm::dvec3 middle = (joints[joint::kLeftHip] + joints[joint::kRightHip]) / 2.;
    const auto put = [&](size_t i, const glm::dvec3& at) {
        const glm::dvec3 world = .85 * (at - middle);
        const auto uv = camera.project({at.x, at.y, at.z});
        person.points[i] = {{uv[0], uv[1], 0}, {world.x, world.y, world.z}, 1, 1};
    };
    for (size_t j = 0; j < joint::kCount; ++j)
        if (const auto i = landmarkOfJoint(j)) put(*i, joints[j]);
    for (size_t i = landmark::kLeftPinky; i <= landmark::kRightThumb; ++i)
        put(i, joints[i % 2 ? joint::kLeftWrist : joint::kRightWrist]);
    const glm::dvec3 centre = joints[joint::kHead];
    constexpr std::array kFaceLandmarks{landmark::kNose, landmark::kLeftEye, landmark::kRightEye,
                                        landmark::kLeftEar, landmark::kRightEar};
    for (size_t k = 0; k < kFaceLandmarks.size(); ++k)
        put(kFaceLandmarks[k], centre + head * kFace[k]);
    for (const auto& [ankle, foot, heel, tip] :
         {std::array{size_t(joint::kLeftAnkle), size_t(joint::kLeftFoot),
                     size_t(landmark::kLeftHeel), size_t(landmark::kLeftFootTip)},
          {size_t(joint::kRightAnkle), size_t(joint::kRightFoot), size_t(landmark::kRightHeel),
           size_t(landmark::kRightFootTip)}}) {
        put(heel, joints[ankle]);
        put(tip, joints[foot]);
    }
    return person;
}

TEST(BodyPoser3d, StandsTheBodyWhereItsLandmarksAre) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    const Camera camera = cameraOfAngle(600, 1080, kGuessedAngle);
    EXPECT_NEAR(2 * std::atan(1080 / 2. / camera.fy), 60 * M_PI / 180, 1e-9);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int round = 0; round < 20; ++round) {
        Theta theta{};
        const auto turn = [&](size_t j, const glm::dvec3& axisAngle) {
            setJointRotation(theta, j, quaternionOf(axisAngle));
        };
        // Upright before the camera, turned anywhere about its own axis; hinges bend one way.
        setJointRotation(
            theta, joint::kPelvis,
            quaternionOf({M_PI, 0, 0}) *
                quaternionOf({.2 * uniform(random), M_PI * uniform(random), .2 * uniform(random)}));
        turn(joint::kLeftElbow, {0, -.3 - std::abs(uniform(random)), 0});
        turn(joint::kRightElbow, {0, .3 + std::abs(uniform(random)), 0});
        turn(joint::kLeftKnee, {.2 + std::abs(uniform(random)), 0, 0});
        turn(joint::kRightKnee, {.2 + std::abs(uniform(random)), 0, 0});
        for (size_t j : {joint::kLeftShoulder, joint::kRightShoulder})
            turn(j, {.5 * uniform(random), .5 * uniform(random), uniform(random)});
        for (size_t j : {joint::kLeftHip, joint::kRightHip})
            turn(j, {.6 * uniform(random), .2 * uniform(random), .3 * uniform(random)});
        const Trans trans{.3f * float(uniform(random)), .2f, 3.5f + float(uniform(random))};
        const auto joints = jointPlaces(body, Betas{}, theta, trans);
        glm::dquat head = jointRotation(theta, joint::kPelvis);
        const BodyStart start = poser(landmarksOfBody(joints, head, camera), camera);
        const auto found = jointPlaces(body, Betas{}, start.theta, start.trans);
        for (size_t j = 0; j < joint::kCount; ++j) {
            if (!landmarkOfJoint(j)) continue;
            EXPECT_LT(glm::length(found[j] - joints[j]), .02)
                << jointName(j) << " in round " << round;
        }
        EXPECT_LT(start.residual, 3) << round;
        // Hinges bend about their own axes.
        const glm::dvec3 elbow = axisAngleOf(jointRotation(start.theta, joint::kLeftElbow));
        EXPECT_LT(glm::length(glm::dvec3(elbow.x, 0, elbow.z)), .3 * glm::length(elbow)) << round;
        EXPECT_LT(elbow.y, 0) << round;
    }
}

// Somebody who leans forward and looks ahead, once with the neck bent as far as the head, once with
// a neck that is stretched back alone.
TEST(BodyPoser3d, NecksBendToWhereHeadsAreSeen) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    const Camera camera = cameraOfAngle(600, 1080, kGuessedAngle);
    constexpr double kLean = .9;
    for (const double side : {-M_PI / 2, M_PI / 2})
        for (const double neck : {.5, 1.5}) {
            const glm::dquat looks = quaternionOf({M_PI, 0, 0}) * quaternionOf({0, side, 0});
            Theta theta{};
            setJointRotation(theta, joint::kPelvis, looks * quaternionOf({kLean, 0, 0}));
            setJointRotation(theta, joint::kNeck, quaternionOf({-neck * kLean, 0, 0}));
            setJointRotation(theta, joint::kHead, quaternionOf({(neck - 1) * kLean, 0, 0}));
            const Trans trans{0, .2f, 3.5f};
            const auto joints = jointPlaces(body, Betas{}, theta, trans);
            const BodyStart start =
                poser(landmarksOfBody(joints, looks, camera), camera, glm::mat3_cast(looks));
            const auto found = jointPlaces(body, Betas{}, start.theta, start.trans);
            // From the neck, which is where it is: half of the way that the usual bend leaves.
            const double off = glm::length(found[joint::kHead] - found[joint::kNeck] -
                                           joints[joint::kHead] + joints[joint::kNeck]);
            const double usual = 2 * std::sin(std::abs(neck - .5) * kLean / 2) *
                                 glm::length(joints[joint::kHead] - joints[joint::kNeck]);
            EXPECT_LT(off, .5 * usual + .01) << side << " " << neck;
        }
}

// Where no face is found.
TEST(BodyPoser3d, HeadsAreTiltedAsTheyAreSeenAndTurnedHalfAsFar) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    const Camera camera = cameraOfAngle(600, 1080, kGuessedAngle);
    const auto headOf = [&](const Theta& theta) {
        glm::dquat turned(1, 0, 0, 0);
        for (int j = int(joint::kHead); j >= 0; j = body.parents[size_t(j)])
            turned = jointRotation(theta, size_t(j)) * turned;
        return turned;
    };
    const glm::dquat upright = quaternionOf({M_PI, 0, 0}) * quaternionOf({0, .8, 0});
    const auto found = [&](const glm::dquat& head) {
        Theta theta{};
        setJointRotation(theta, joint::kPelvis, upright);
        const auto joints = jointPlaces(body, Betas{}, theta, {0, .2f, 3.5f});
        const BodyStart start = poser(landmarksOfBody(joints, upright * head, camera), camera);
        return axisAngleOf(glm::inverse(upright) * headOf(start.theta));
    };
    const glm::dvec3 straight = found({1, 0, 0, 0});  // the face's own axes, about
    for (const glm::dvec3 tilt :
         {glm::dvec3(.4, 0, 0), glm::dvec3(0, 0, .4), glm::dvec3(0, .6, 0)}) {
        const glm::dvec3 wanted = tilt * (tilt.y > 0 ? .5 : 1);
        EXPECT_LT(glm::length(found(quaternionOf(tilt)) - straight - wanted), .12)
            << tilt.x << " " << tilt.y << " " << tilt.z;
    }
}

// Networks see how deep a foot reaches by less than half, and not at all from behind: it is known
// from how long feet are. Legs that are nearly straight are turned with their feet.
TEST(BodyPoser3d, FeetPointWhereTheyAreSeenToWhateverTheirDepth) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    const Camera camera = cameraOfAngle(600, 1080, kGuessedAngle);
    struct Leg {
        size_t hip, knee, ankle, foot, heel, tip;  // joints, and two landmarks
        double outwards;                           // of the hip, radians
    };
    const Leg legs[] = {{joint::kLeftHip, joint::kLeftKnee, joint::kLeftAnkle, joint::kLeftFoot,
                         landmark::kLeftHeel, landmark::kLeftFootTip, .25},
                        {joint::kRightHip, joint::kRightKnee, joint::kRightAnkle, joint::kRightFoot,
                         landmark::kRightHeel, landmark::kRightFootTip, -.25}};
    const auto rest = jointPlaces(body, Betas{}, {}, {});
    for (int side = 0; side < 8; ++side) {
        const glm::dquat pelvis =
            quaternionOf({M_PI, 0, 0}) * quaternionOf({0, 2 * M_PI * side / 8, 0});
        Theta theta{};
        setJointRotation(theta, joint::kPelvis, pelvis);
        for (const Leg& leg : legs)
            setJointRotation(theta, leg.hip, quaternionOf({0, leg.outwards, 0}));
        const auto joints = jointPlaces(body, Betas{}, theta, {0, .1f, 3.2f});
        PersonLandmarks person = landmarksOfBody(joints, pelvis, camera);
        const auto forward = [&](const Leg& leg) {  // of the rest pose
            const glm::dvec3 foot = rest[leg.foot] - rest[leg.ankle];
            return glm::normalize(glm::dvec3(foot.x, 0, foot.z));
        };
        for (const Leg& leg : legs) {
            const glm::dquat turned = pelvis * jointRotation(theta, leg.hip);
            const glm::dvec3 heel = joints[leg.ankle] + turned * glm::dvec3(0, -.06, -.05),
                             way = .22 * (turned * forward(leg)), tip = heel + way;
            Landmark &from = person.points[leg.heel], &to = person.points[leg.tip];
            const auto u = camera.project({heel.x, heel.y, heel.z}),
                       v = camera.project({tip.x, tip.y, tip.z});
            from.picture = {u[0], u[1], 0};
            to.picture = {v[0], v[1], 0};
            to.world = from.world;
            if (way.z < 0) to.world[2] += .85 * .4 * way.z;
        }
        const BodyStart start = poser(person, camera);
        for (const Leg& leg : legs) {
            const glm::dquat thigh =
                jointRotation(start.theta, joint::kPelvis) * jointRotation(start.theta, leg.hip);
            const glm::dquat foot = thigh * jointRotation(start.theta, leg.knee) *
                                    jointRotation(start.theta, leg.ankle);
            const auto off = [&](const glm::dquat& q) {  // degrees
                const glm::dvec3 truth = pelvis * jointRotation(theta, leg.hip) * forward(leg);
                return glm::degrees(
                    std::acos(std::clamp(glm::dot(q * forward(leg), truth), -1., 1.)));
            };
            EXPECT_LT(off(foot), 10) << side << " joint " << leg.ankle;
            EXPECT_LT(off(thigh), 15) << side << " joint " << leg.hip;
        }
    }
}

TEST(BodyPoser3d, LandmarksAreMovedToTheJoints) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    const Camera camera = cameraOfAngle(600, 1080, kGuessedAngle);
    Theta theta{};
    setJointRotation(theta, joint::kPelvis,
                     quaternionOf({M_PI, 0, 0}) * quaternionOf({0, M_PI / 2, 0}));
    const auto joints = jointPlaces(body, Betas{}, theta, {0, .2f, 4});
    const PersonLandmarks person =
        landmarksOfBody(joints, jointRotation(theta, joint::kPelvis), camera);
    const PersonLandmarks moved = poser.atJoints(person, camera);
    const auto by = [&](size_t i, size_t k) {
        return moved.points[i].world[k] - person.points[i].world[k];
    };
    // She is seen from the side, looking to the right: her left is away from the camera. The
    // landmarks are .85 times as large as she is.
    EXPECT_NEAR(by(landmark::kLeftHip, 2) / .85,
                -std::copysign(.025, person.points[landmark::kLeftHip].world[2]), 3e-3);
    EXPECT_NEAR(by(landmark::kRightHip, 2) / .85,
                -std::copysign(.025, person.points[landmark::kRightHip].world[2]), 3e-3);
    EXPECT_NEAR(by(landmark::kLeftHip, 1) / .85, .040, 3e-3);
    const double forward = person.points[landmark::kNose].world[0] > 0 ? 1 : -1;
    EXPECT_NEAR(by(landmark::kLeftShoulder, 0) / .85, -.014 * forward, 3e-3);
    EXPECT_GT(moved.points[landmark::kLeftHip].picture[1],
              person.points[landmark::kLeftHip].picture[1] + 5);
    EXPECT_EQ(moved.points[landmark::kLeftKnee].picture,
              person.points[landmark::kLeftKnee].picture);

    // Where all is in one point there is no trunk to move by.
    PersonLandmarks point;
    const PersonLandmarks same = poser.atJoints(point, camera);
    EXPECT_EQ(same.points[landmark::kLeftHip].world, (Point3{0, 0, 0}));
    const BodyStart start = poser(same, camera);
    for (float v : start.theta) EXPECT_TRUE(std::isfinite(v));
    for (float v : start.trans) EXPECT_TRUE(std::isfinite(v));
}

TEST(BodyPoser3d, AShapeHasTheHeightThatIsGiven) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    for (double metres : {1.5, 1.65, 1.9}) {
        const Betas betas = betasOfHeight(body, metres);
        const auto points = shapedVertices(body, std::vector<double>(betas.begin(), betas.end()));
        double low = 9, high = -9;
        for (size_t i = 1; i < points.size(); i += 3) {
            low = std::min(low, points[i]);
            high = std::max(high, points[i]);
        }
        EXPECT_NEAR(high - low, metres, 1e-3);
        for (float b : betas) EXPECT_LT(std::abs(b), 4);
    }
    // A taller body stands farther away where the picture is the same.
    const BodyPoser3d small(body), tall(body, betasOfHeight(body, 1.95));
    const Camera camera = cameraOfAngle(600, 1080, kGuessedAngle);
    Theta theta{};
    setJointRotation(theta, joint::kPelvis, quaternionOf({M_PI, 0, 0}));
    const PersonLandmarks person = landmarksOfBody(jointPlaces(body, Betas{}, theta, {0, .2f, 4}),
                                                   jointRotation(theta, joint::kPelvis), camera);
    EXPECT_NEAR(small(person, camera).trans[2], 4, .05);
    EXPECT_GT(tall(person, camera).trans[2], 4.2);
}

TEST(BodyPoser3d, KeypointsAreOpenPoses) {
    PersonLandmarks person;
    for (size_t i = 0; i < landmark::kCount; ++i)
        person.points[i] = {{double(i), 100. + double(i), 0}, {}, .5, .5};
    const auto keypoints = openPoseKeypoints(person);
    const auto joints = keypointJoints("openpose25");
    for (size_t k = 0; k < joints.size(); ++k) {
        if (joints[k] < 0) continue;
        const auto number = landmarkOfJoint(size_t(joints[k]));
        ASSERT_TRUE(number) << k;
        EXPECT_EQ(keypoints[3 * k], float(*number));
        EXPECT_EQ(keypoints[3 * k + 1], 100 + float(*number));
        EXPECT_EQ(keypoints[3 * k + 2], .25f);
    }
}

}  // namespace
}  // namespace doppel
