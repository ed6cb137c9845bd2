// Which way faces look: made ones, and those of synthetic actors, whose heads are known.
#include "trainer/person/face.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>

#include "engine/files/atomic_file.h"
#include "engine/files/numbers.h"
#include "engine/io/image.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/preset.h"
#include "trainer/data/capture.h"
#include "trainer/data/pose.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/import/seen_heads.h"
#include "trainer/motion/synthetic.h"
#include "trainer/person/body_start.h"
#include "trainer/person/heads.h"
#include "trainer/person/picture_net.h"
#include "trainer/stages/fit.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;

double degreesBetween(const glm::dmat3& a, const glm::dmat3& b) {
    return glm::length(axisAngleOf(glm::quat_cast(a * glm::transpose(b)))) * 180 / M_PI;
}

// As somebody who faces the camera upright sees us: our left is on the picture's right.
const glm::dmat3 kFacing(glm::dvec3(1, 0, 0), glm::dvec3(0, -1, 0), glm::dvec3(0, 0, -1));

TEST(FaceMesh, PointsGoBackToThePicture) {
    std::vector<float> points(3 * FaceMesh::kPoints, 96);
    points[3 * 7] = 192;
    points[3 * 7 + 1] = 0;
    points[3 * 7 + 2] = -19.2f;
    const FaceMesh face = faceOf(points, 2, {{100, 50}, 80, M_PI / 2});
    EXPECT_NEAR(face.presence, 1 / (1 + std::exp(-2.)), 1e-12);
    EXPECT_NEAR(face.points[0][0], 100, 1e-9);
    EXPECT_NEAR(face.points[0][1], 50, 1e-9);
    // Up and to the right in a square that is turned clockwise by a quarter.
    EXPECT_NEAR(face.points[7][0], 140, 1e-9);
    EXPECT_NEAR(face.points[7][1], 90, 1e-9);
    EXPECT_NEAR(face.points[7][2], -8, 1e-5);
}

TEST(FaceMesh, AxesAreTheFaces) {
    for (const glm::dvec3 turn :
         {glm::dvec3(0), glm::dvec3(.2, .9, -.1), glm::dvec3(0, -1.4, .3)}) {
        const glm::dmat3 wanted = glm::mat3_cast(quaternionOf(turn)) * kFacing;
        FaceMesh face;
        const auto put = [&](size_t i, double x, double y, double z) {
            const glm::dvec3 p = wanted * glm::dvec3(x, y, z) * 50.;
            face.points[i] = {200 + p.x, 100 + p.y, p.z};
        };
        put(263, .45, .3, 0);
        put(33, -.45, .3, 0);
        put(454, .7, 0, -.6);
        put(234, -.7, 0, -.6);
        put(291, .25, -.4, .1);
        put(61, -.25, -.4, .1);
        put(10, 0, .9, 0);
        put(152, 0, -.9, 0);
        const auto axes = face.axes();
        ASSERT_TRUE(axes);
        EXPECT_LT(degreesBetween(*axes, wanted), 1e-6);
    }
    EXPECT_FALSE(FaceMesh().axes());
}

glm::dmat3 headOf(const BodyModel& body, const Theta& theta) {
    glm::dquat turned(1, 0, 0, 0);
    for (int j = int(joint::kHead); j >= 0; j = body.parents[size_t(j)])
        turned = jointRotation(theta, size_t(j)) * turned;
    return glm::mat3_cast(turned);
}

// Outlines turn the trunks of poses that are off, and with them heads that were given on their
// necks; heads that were found by themselves stay.
TEST(Fit, HeadsThatWereFoundByThemselvesStay) {
    Folder folder;
    Capture capture = renderActor(testDevice(), readActor(assetFolder() / "actor", "man"),
                                  actorSession(4, 0, kActorDistance), folder / "actor",
                                  {.size = 96, .samples = 1});
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    for (Theta& theta : capture.theta)
        for (size_t j : {joint::kSpine1, joint::kPelvis})
            setJointRotation(theta, j, jointRotation(theta, j) * quaternionOf({0, .15, .1}));
    FitPreset preset = presetByName("ci").fit;
    preset.size = 96;
    preset.passes = 12;
    const auto moved = [&](bool found) {
        Capture fitted = capture;
        if (found) fitted.source["heads"] = "as the face looks";
        fitCapture(testDevice(), body, fitted, {.preset = preset, .loop = {.seed = 1}});
        double most = 0;
        for (size_t f = 0; f < capture.size(); ++f)
            most = std::max(most, degreesBetween(headOf(body, capture.theta[f]),
                                                 headOf(body, fitted.theta[f])));
        return most;
    };
    EXPECT_GT(moved(false), 3);
    EXPECT_LT(moved(true), .01);
}

// Nose, eyes and ears of a body in a pose.
FacePoints faceOf(const BodyModel& body, const Theta& theta, const Trans& trans,
                  const Camera& camera) {
    const glm::dvec3 head = jointPlaces(body, Betas{}, theta, trans)[joint::kHead];
    FacePoints points;
    for (size_t k = 0; k < points.size(); ++k) {
        const glm::dvec3 at = head + headOf(body, theta) * kFace[k];
        const auto [u, v] = camera.project({at.x, at.y, at.z});
        points[k] = {float(u), float(v), 1};
    }
    return points;
}

TEST(Heads, AFaceTellsWhereItsHeadIs) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const Camera camera{900, 900, 300, 500, 600, 1000};
    Theta theta{};
    setJointRotation(theta, joint::kPelvis, quaternionOf({M_PI, .4, 0}));
    setJointRotation(theta, joint::kHead, quaternionOf({.2, .7, -.1}));
    const Trans trans{.2f, .1f, 3};
    const glm::dvec3 head = jointPlaces(body, Betas{}, theta, trans)[joint::kHead];
    const auto [u, v] = camera.project({head.x, head.y, head.z});
    FacePoints points = faceOf(body, theta, trans, camera);
    const auto expect = [&](double right, double down, double sure) {
        const auto seen = headJointSeen(body, theta, head, points, camera);
        EXPECT_NEAR(seen[0], u + right, 1e-3);
        EXPECT_NEAR(seen[1], v + down, 1e-3);
        EXPECT_NEAR(seen[2], sure, 1e-6);
    };
    expect(0, 0, 1);
    for (auto& point : points) point[0] += 10, point[1] -= 4;
    expect(10, -4, 1);
    // What is not seen may be anywhere, and what is seen half counts half as much.
    points[0] = {NAN, 0, 0};
    points[1][0] += 7;
    points[1][2] = .5;
    expect(10 + 7 * .5 / 3.5, -4, 3.5 / 5);
    for (auto& point : points) point[2] = 0;
    EXPECT_EQ(headJointSeen(body, theta, head, points, camera)[2], 0);
}

// Where a face is seen, there is the head: the neck bends, and the head goes on looking where it
// did.
TEST(Fit, HeadsGoWhereTheirFacesAreSeen) {
    Folder folder;
    constexpr int kSize = 192;
    Capture capture = renderActor(testDevice(), readActor(assetFolder() / "actor", "woman"),
                                  actorSession(4, 0, kActorDistance), folder / "actor",
                                  {.size = kSize, .samples = 1});
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    capture.source["heads"] = "as the face looks";
    capture.source["keypoints"] = "blazepose heavy";
    FitPreset preset = presetByName("ci").fit;
    preset.size = kSize;
    preset.passes = 60;
    // Where heads end in the picture across, a mean, with faces so many pixels beside them.
    const auto headsAt = [&](float beside) {
        Capture fitted = capture;
        fitted.keypoints = {"openpose25", 25, std::vector<float>(capture.size() * 75)};
        for (size_t f = 0; f < capture.size(); ++f) {
            const FacePoints points =
                faceOf(body, capture.theta[f], capture.trans[f], capture.frames[f].camera);
            for (size_t k = 0; k < points.size(); ++k) {
                float* value =
                    &fitted.keypoints->values[75 * f + 3 * keypointFace("openpose25")[k]];
                std::ranges::copy(points[k], value);
                value[0] += beside;
            }
        }
        fitCapture(testDevice(), body, fitted, {.preset = preset, .loop = {.seed = 1}});
        double across = 0;
        for (size_t f = 0; f < capture.size(); ++f) {
            const glm::dvec3 head =
                jointPlaces(body, fitted.betas, fitted.theta[f], fitted.trans[f])[joint::kHead];
            across += capture.frames[f].camera.project({head.x, head.y, head.z})[0] /
                      double(capture.size());
            EXPECT_LT(degreesBetween(headOf(body, capture.theta[f]), headOf(body, fitted.theta[f])),
                      .01);
        }
        return across;
    };
    const double left = headsAt(-4), right = headsAt(4);
    std::cout << "heads 4 pixels to both sides end " << right - left << " pixels apart\n";
    EXPECT_GT(right - left, 1);
}

// What the network makes of a picture that a formula gives, beside the same file run with NumPy in
// double precision.
TEST(FaceFinder, TheNetworkComputesWhatItsFileSays) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!FaceFinder::isThere(models)) GTEST_SKIP() << "scripts/setup --models fetches the network";
    constexpr int kSide = 192;
    std::vector<float> rgb;
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < kSide; ++y)
            for (int x = 0; x < kSide; ++x)
                rgb.push_back(float(.5 + .5 * std::sin(.05 * x * (c + 1) + .03 * y + .7 * c)));
    PictureNet net(testDevice(), models / "face_landmark.tflite", kSide,
                   {3 * FaceMesh::kPoints, 1});
    const auto raw = net.run(rgb);
    const std::vector<uint8_t> bytes =
        readWholeFile(test::sourceFolder() / "tests/data/blazepose/face_formula.f32");
    ASSERT_EQ(bytes.size(), 4 * (3 * FaceMesh::kPoints + 1));
    double largest = 0;
    for (size_t i = 0; i < 3 * FaceMesh::kPoints; ++i)
        largest =
            std::max(largest, std::abs(double(raw[0][i]) - double(loadAt<float>(bytes.data(), i))));
    std::cout << "largest difference " << largest << " of 192 pixels\n";
    EXPECT_LT(largest, 2e-3);
    EXPECT_NEAR(raw[1][0], loadAt<float>(bytes.data(), 3 * FaceMesh::kPoints), 1e-3);
    EXPECT_EQ(net.run(rgb), raw);
}

TEST(FaceFinder, ActorsLookWhereTheirHeadsDo) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Full, models) || !FaceFinder::isThere(models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    const Capture actor = renderActor(testDevice(), readActor(assetFolder() / "actor", "woman"),
                                      actorSession(8, 0, kActorDistance), folder / "actor",
                                      {.size = 640, .samples = 2});
    const Poses truth = readPoses(folder / "actor/truth.npz", false);
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    BlazePose pose(testDevice(), PoseNet::Full, models);
    FaceFinder faces(testDevice(), models);
    const BodyPoser3d poser(body);
    int seen = 0;
    double off = 0;
    for (size_t f = 0; f < actor.size(); ++f) {
        const Image picture = readImage(actor.frames[f].image);
        const auto people = pose.detect(picture);
        ASSERT_FALSE(people.empty()) << f;
        const PersonLandmarks person = pose.landmarks(picture, people[0].roi());
        const auto face = faces(picture, person);
        const glm::dmat3 head = headOf(body, truth.theta[f]);
        const double away = degreesBetween(head, kFacing);
        if (away > 120) {
            EXPECT_FALSE(face) << f << ", turned by " << away;
        }
        if (away < 50) {
            EXPECT_TRUE(face) << f << ", turned by " << away;
        }
        if (!face) continue;
        const BodyStart start = poser(person, actor.frames[f].camera, face->axes());
        off += degreesBetween(headOf(body, start.theta), head);
        ++seen;
    }
    ASSERT_GT(seen, 2);
    std::cout << seen << " faces of " << actor.size() << ", off by " << off / seen << " degrees\n";
    EXPECT_LT(off / seen, 10);
}

// Poses whose heads are turned away from where they look come back, as far as pictures tell; bodies
// that stand elsewhere than the person keep theirs.
TEST(SeenHeads, GivenHeadsTurnToWhereFacesLook) {
    if (!poseModelsAreThere(PoseNet::Full) || !FaceFinder::isThere())
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    Capture capture = renderActor(testDevice(), readActor(assetFolder() / "actor", "woman"),
                                  actorSession(8, 0, kActorDistance), folder / "actor",
                                  {.size = 640, .samples = 2});
    const Poses truth = readPoses(folder / "actor/truth.npz", false);
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    for (Theta& theta : capture.theta)
        setJointRotation(theta, joint::kHead,
                         jointRotation(theta, joint::kHead) * quaternionOf({.1, .5, 0}));
    capture.trans[7][0] += 1.5f;
    const auto off = [&](const Capture& now, size_t f) {
        return degreesBetween(headOf(body, now.theta[f]), headOf(body, truth.theta[f]));
    };
    ImportRequest request;
    request.net = PoseNet::Full;
    request.device = &testDevice();
    request.body = &body;
    request.givenHeads = true;
    Capture found = capture;
    takeSeenHeads(found, request);
    EXPECT_EQ(found.theta, capture.theta);
    EXPECT_FALSE(found.source.contains("heads"));
    ASSERT_EQ(found.faces.size(), capture.size());
    EXPECT_TRUE(found.faces[7].empty());  // the person is elsewhere
    EXPECT_GT(std::ranges::count_if(found.faces, [](const auto& f) { return !f.empty(); }), 1);
    request.givenHeads = false;
    takeSeenHeads(found, request);
    EXPECT_EQ(found.theta[7], capture.theta[7]);
    EXPECT_EQ(found.trans, capture.trans);
    EXPECT_NE(found.source.at("heads").find(", as given in 1"), std::string::npos)
        << found.source.at("heads");
    double before = 0, after = 0;
    for (size_t f = 0; f < 7; ++f) {
        before += off(capture, f) / 7, after += off(found, f) / 7;
        for (size_t j = 0; j < joint::kCount; ++j) {  // only neck and head move
            if (j == joint::kNeck || j == joint::kHead) continue;
            EXPECT_EQ(jointRotation(found.theta[f], j), jointRotation(capture.theta[f], j));
        }
    }
    std::cout << "heads off by " << before << ", then by " << after
              << " degrees: " << found.source.at("heads") << "\n";
    EXPECT_GT(before, 25);
    EXPECT_LT(after, before / 2);
}

}  // namespace
}  // namespace doppel
