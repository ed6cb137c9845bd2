// What stage fit knows of people's poses: which are likely, where joints end, that bodies stand.
#include <gtest/gtest.h>

#include <cmath>

#include "nn/body/human_joints.h"
#include "nn/body/likely_pose.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/preset.h"
#include "trainer/data/capture.h"
#include "trainer/data/pose.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/fit.h"

namespace doppel {
namespace {

using test::Folder;

constexpr double kDegree = M_PI / 180;

TEST(LikelyPose, IsTheSameOnBothSidesAndWithinItsLimits) {
    const std::vector<LikelyAngle> pose = likelyPose();
    ASSERT_EQ(pose.size(), size_t(kThetaSize));
    for (size_t j = 0; j < joint::kCount; ++j)
        for (size_t k = 0; k < 3; ++k) {
            const LikelyAngle& a = pose[3 * j + k];
            const LikelyAngle& b = pose[3 * oppositeJoint(j) + k];
            const bool turned = k > 0 && oppositeJoint(j) != j;
            EXPECT_EQ(a.mean, turned ? -b.mean : b.mean) << jointName(j) << k;
            EXPECT_EQ(a.precision, b.precision) << jointName(j) << k;
            EXPECT_EQ(a.low, turned ? -b.high : b.low) << jointName(j) << k;
            EXPECT_LE(a.low, a.mean) << jointName(j) << k;
            EXPECT_GE(a.high, a.mean) << jointName(j) << k;
        }
    // Knees bend backwards, elbows forwards, by some 150 degrees and not the other way.
    const auto limits = [&](size_t joint, size_t k) {
        return std::pair(pose[3 * joint + k].low / kDegree, pose[3 * joint + k].high / kDegree);
    };
    EXPECT_NEAR(limits(joint::kLeftKnee, 0).first, 0, 1e-4);
    EXPECT_NEAR(limits(joint::kLeftKnee, 0).second, 152, 1e-4);
    EXPECT_NEAR(limits(joint::kLeftElbow, 1).first, -152, 1e-4);
    EXPECT_NEAR(limits(joint::kLeftElbow, 1).second, 0, 1e-4);
    EXPECT_NEAR(limits(joint::kRightElbow, 1).first, 0, 1e-4);
    EXPECT_NEAR(limits(joint::kRightElbow, 1).second, 152, 1e-4);
}

// The man from four sides, his given poses off in what outlines from the front hardly see: knees
// bent and the trunk leant into the picture.
struct Recording {
    Folder folder;
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    Capture truth = renderActor(testDevice(), readActor(assetFolder() / "actor", "man"),
                                actorSession(4, 0, kActorDistance), folder / "actor",
                                {.size = 96, .samples = 1});

    Recording() {
        const Poses poses = readPoses(folder / "actor" / "truth.npz", true);
        truth.theta = poses.theta;
        truth.trans = poses.trans;
    }

    Capture fitted(const Capture& given, double likely, double limits, double balance) {
        Capture capture = given;
        FitPreset preset = presetByName("ci").fit;
        preset.size = 96;
        preset.passes = 120;
        preset.likely = likely;
        preset.limits = limits;
        preset.balance = balance;
        fitCapture(testDevice(), body, capture, {.preset = preset, .loop = {.seed = 1}});
        return capture;
    }
    // How far a joint's rotation in its parent's frame is off, degrees, a mean over frames.
    double off(const Capture& capture, size_t joint) const {
        double sum = 0;
        for (size_t f = 0; f < capture.size(); ++f)
            sum += glm::length(axisAngleOf(jointRotation(capture.theta[f], joint) *
                                           glm::conjugate(jointRotation(truth.theta[f], joint))));
        return sum / double(capture.size()) / kDegree;
    }
};

Recording& recording() {
    static Recording made;
    return made;
}

void turn(Theta& theta, size_t joint, const glm::dvec3& by) {
    setJointRotation(theta, joint, jointRotation(theta, joint) * quaternionOf(by * kDegree));
}

TEST(FitOfLikelyPoses, KneesThatNobodySeesBentAreStraight) {
    Capture given = recording().truth;
    for (Theta& theta : given.theta)
        for (const size_t side : {0, 1}) {
            turn(theta, joint::kLeftHip + side, {-12, 0, 0});
            turn(theta, joint::kLeftKnee + side, {24, 0, 0});
        }
    const auto knees = [&](double likely) {
        const Capture fitted = recording().fitted(given, likely, 0, 0);
        return (recording().off(fitted, joint::kLeftKnee) +
                recording().off(fitted, joint::kRightKnee)) /
               2;
    };
    const double without = knees(0), with = knees(presetByName("ci").fit.likely);
    std::cout << "knees off by " << without << " and " << with << " degrees\n";
    EXPECT_LT(with, .5 * without);
}

TEST(FitOfLikelyPoses, KneesDoNotBendForwards) {
    Capture given = recording().truth;
    for (Theta& theta : given.theta) turn(theta, joint::kLeftKnee, {-30, 0, 0});
    const auto least = [&](double limits) {
        const Capture fitted = recording().fitted(given, 0, limits, 0);
        double angle = 0;
        for (const Theta& theta : fitted.theta)
            angle = std::min<double>(angle, theta[3 * joint::kLeftKnee] / kDegree);
        return angle;
    };
    const double without = least(0), with = least(presetByName("ci").fit.limits);
    std::cout << "the left knee at " << without << " and " << with << " degrees\n";
    EXPECT_LT(without, -5);
    EXPECT_GT(with, .5 * without);
}

// Leant back as seen by him: away from the camera from the front, towards it from behind.
TEST(FitOfLikelyPoses, BodiesStandOverTheirFeet) {
    Capture given = recording().truth;
    for (Theta& theta : given.theta) turn(theta, joint::kPelvis, {-15, 0, 0});
    // How far the centre of mass is beside the middle of the feet, as a level camera sees it; mm.
    const auto beside = [&](const Capture& capture) {
        double sum = 0;
        for (size_t f = 0; f < capture.size(); ++f) {
            const JointPlaces places =
                jointPlaces(recording().body, capture.betas, capture.theta[f], capture.trans[f]);
            glm::dvec3 way(0);
            for (size_t j = 0; j < joint::kCount; ++j) way += jointMasses()[j] * places[j];
            for (const size_t j :
                 {joint::kLeftAnkle, joint::kRightAnkle, joint::kLeftFoot, joint::kRightFoot})
                way -= .25 * places[j];
            sum += 1000 * std::hypot(way.x, way.z);
        }
        return sum / double(capture.size());
    };
    const double inTruth = beside(recording().truth),
                 without = beside(recording().fitted(given, 0, 0, 0)),
                 with = beside(recording().fitted(given, 0, 0, presetByName("ci").fit.balance));
    std::cout << "beside the feet by " << without << " and " << with << " mm, in truth " << inTruth
              << "\n";
    EXPECT_LT(with, .5 * without);
}

}  // namespace
}  // namespace doppel
