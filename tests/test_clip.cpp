// Clips: which frames of a video or a folder are kept and how fast they play, masks led along
// edges, poses from landmarks, and from a film to a capture.
#include "trainer/import/clip.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <random>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/video.h"
#include "nn/body/body.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/frame_selection.h"
#include "trainer/import/import.h"
#include "trainer/motion/synthetic.h"
#include "trainer/person/body_start.h"
#include "trainer/person/mask.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

// Fine checks that move, so that pictures are sharp and differ; another scene has other colours.
Image checks(int width, int height, int shift, int scene = 0) {
    Image image(width, height, 3);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const bool light = ((x + shift) / 6 + y / 6) % 2 == 0;
            uint8_t* pixel = image.pixel(x, y);
            pixel[0] = scene ? (light ? 60 : 20) : (light ? 230 : 120);
            pixel[1] = light ? 200 : 90;
            pixel[2] = scene ? 250 : 90;
        }
    return image;
}

Image smeared(const Image& image) {
    return resize(resize(image, image.width / 12, image.height / 12), image.width, image.height);
}

fs::path film(const fs::path& file, const std::vector<Image>& pictures, double rate = 20) {
    VideoWriter video(file, pictures[0].width, pictures[0].height, rate);
    for (const Image& picture : pictures) video.add(picture);
    video.finish();
    return file;
}

std::vector<Image> moving(int count, int scene = 0) {
    std::vector<Image> pictures;
    for (int i = 0; i < count; ++i) pictures.push_back(checks(96, 120, 2 * i, scene));
    return pictures;
}

std::string kept(const std::vector<ClipFrame>& frames) {
    std::string text;
    for (const ClipFrame& frame : frames)
        text += frame.fate == Fate::Kept        ? 'k'
                : frame.fate == Fate::Outside   ? '.'
                : frame.fate == Fate::Duplicate ? 'd'
                                                : 'b';
    return text;
}

TEST(Clip, TimesStepsAndRates) {
    Folder folder;
    const fs::path file = film(folder / "a.mp4", moving(12));
    EXPECT_EQ(kept(surveyClip(file, {})), "kkkkkkkkkkkk");
    EXPECT_NEAR(keptRate(surveyClip(file, {}), 1), 20, 1e-3);
    const auto third = surveyClip(file, {.every = 3});
    EXPECT_EQ(kept(third), "k..k..k..k..");
    EXPECT_NEAR(keptRate(third, 1), 20. / 3, 1e-3);
    const auto part = surveyClip(file, {.from = .2, .to = .4, .every = 2});
    EXPECT_EQ(kept(part), "....k.k.....");
    EXPECT_NEAR(keptRate(part, 1), 10, 1e-3);
    EXPECT_EQ(kept(surveyClip(file, {.frames = "2:10:4"})), "..k...k.....");
    EXPECT_EQ(keptRate(surveyClip(file, {.frames = "3"}), 7), 7);
    EXPECT_EQ(messageOf<InputError>([&] { surveyClip(file, {.from = 5}); }),
              file.string() + ": expected pictures from 5 s on, found 12 that last 0.55 s");
}

TEST(Clip, DuplicatesBlursAndCuts) {
    Folder folder;
    std::vector<Image> pictures = moving(8);
    pictures[3] = pictures[4] = pictures[2];
    pictures[6] = smeared(pictures[6]);
    for (Image& picture : moving(4, 1)) pictures.push_back(std::move(picture));
    const fs::path file = film(folder / "a.mp4", pictures);
    const auto frames = surveyClip(file, {});
    EXPECT_EQ(kept(frames), "kkkddkbkkkkk");
    EXPECT_EQ(leftOut(frames), "2 duplicates, 1 blurred");
    EXPECT_EQ(cutsOf(frames), "0.40 s (frame 8)");
    EXPECT_NEAR(keptRate(frames, 1), 8 / .55, 1e-3);
    EXPECT_EQ(endsEarly(frames, .6), "");
    EXPECT_EQ(endsEarly(frames, 4), "at 0.55 s of 4.00 s");
    EXPECT_NEAR(Clip(file, {}).duration(), .6, 1e-3);
    EXPECT_EQ(kept(surveyClip(file, {.keepSimilar = true})), "kkkkkkkkkkkk");
}

TEST(Clip, AFolderIsLikeAVideo) {
    Folder folder;
    const std::vector<Image> pictures = moving(3);
    for (const auto& [name, i] : {std::pair{"p10.png", 2}, {"p9.jpg", 1}, {"p1.png", 0}})
        writeImage(folder / name, pictures[size_t(i)]);
    folder.write("notes.txt", std::string("not a picture"));
    Clip clip(folder.path(), {.rows = 60, .fps = 10});
    Image picture;
    for (int i = 0; i < 3; ++i) {
        ASSERT_TRUE(clip.next(picture));
        EXPECT_EQ(picture.width, 48);
        EXPECT_EQ(picture.height, 60);
        EXPECT_NEAR(clip.time(), i / 10., 1e-9);
    }
    EXPECT_FALSE(clip.next(picture));
    EXPECT_EQ(kept(surveyClip(folder.path(), {})), "kkk");
    writeImage(folder / "p11.png", checks(20, 20, 0));
    EXPECT_NE(messageOf<InputError>([&] {
                  surveyClip(folder.path(), {});
              }).find("p11.png: expected 96×120 pixels, the size of p1.png, found 20×20"),
              std::string::npos);
}

TEST(Clip, HighPicturesAreScaled) {
    Folder folder;
    const fs::path file = film(folder / "a.mp4", moving(1));
    VideoReader video(file, 60);
    EXPECT_EQ(video.width(), 48);
    EXPECT_EQ(video.height(), 60);
    EXPECT_EQ(video.storedSize(), (ImageSize{96, 120}));
    Image picture;
    ASSERT_TRUE(video.next(picture));
    EXPECT_EQ(picture.width, 48);
    EXPECT_EQ(picture.height, 60);
}

TEST(Clip, PixelsBecomeSquare) {
    Folder folder;
    std::vector<uint8_t> bytes = readWholeFile(film(folder / "a.mp4", moving(1)));
    // "pasp": across and down, which the writer leaves at 1:1. Without one there is nothing to
    // change, and the track header's width and height, behind its matrix, say the same.
    const std::string_view name = "tkhd";
    const auto header = std::search(bytes.begin(), bytes.end(), name.begin(), name.end());
    ASSERT_NE(header, bytes.end());
    const auto width = header + 4 + 76;
    ASSERT_EQ(int(width[0]) * 256 + int(width[1]), 96);
    width[0] = 0, width[1] = 192;  // shown twice as wide
    const std::string_view aspect = "pasp";
    const auto box = std::search(bytes.begin(), bytes.end(), aspect.begin(), aspect.end());
    if (box != bytes.end()) box[4 + 3] = 2, box[8 + 3] = 1;
    folder.write("wide.mp4", bytes);
    VideoReader video(folder / "wide.mp4");
    EXPECT_EQ(video.width(), 192);
    EXPECT_EQ(video.height(), 120);
}

TEST(Clip, SelectionsKeepTheSpeed) {
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{0, 4, 8, 12}), 7.5);
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{5, 6, 7}), 30);
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{0, 1, 8}), 7.5);
    EXPECT_EQ(selectedRate(30, std::vector<size_t>{9}), 30);
    Capture capture;
    capture.fps = 24;
    for (int i = 0; i < 9; ++i) {
        capture.frames.push_back({});
        capture.theta.push_back({});
        capture.trans.push_back({});
    }
    EXPECT_EQ(capture.subset(std::vector<size_t>{0, 3, 6}).fps, 8);
}

// ---- masks --------------------------------------------------------------------------------------

// A disc before a background, and a square in which the network saw it.
struct Disc {
    Image picture{160, 120, 3, 40};
    std::vector<uint8_t> truth = std::vector<uint8_t>(160 * 120);
    PersonLandmarks person;

    Disc() {
        for (int y = 0; y < 120; ++y)
            for (int x = 0; x < 160; ++x) {
                if (std::hypot(x + .5 - 70, y + .5 - 60) > 30) continue;
                truth[size_t(y * 160 + x)] = 255;
                std::fill_n(picture.pixel(x, y), 3, uint8_t{200});
            }
        person.roi = {{75, 55}, 110, .3};
        person.mask.resize(size_t(kRoiMaskSide) * kRoiMaskSide);
        for (int v = 0; v < kRoiMaskSide; ++v)
            for (int u = 0; u < kRoiMaskSide; ++u) {
                const Point2 at =
                    person.roi.toPicture({(u + .5) / kRoiMaskSide, (v + .5) / kRoiMaskSide});
                // As blurred as a network's, and two pixels too small.
                person.mask[size_t(v * kRoiMaskSide + u)] =
                    float(2 * (28 - std::hypot(at[0] - 70, at[1] - 60)));
            }
    }
};

double overlap(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
    double both = 0, any = 0;
    for (size_t i = 0; i < a.size(); ++i) both += a[i] && b[i], any += a[i] || b[i];
    return both / any;
}

TEST(PersonMask, GoesBackToThePicture) {
    const Disc disc;
    const std::vector<float> share = personShare(disc.person, 160, 120);
    EXPECT_NEAR(share[60 * 160 + 70], 1, 1e-3);
    EXPECT_EQ(share[119 * 160 + 159], 0);  // outside of the square
    std::vector<uint8_t> mask(share.size());
    for (size_t i = 0; i < share.size(); ++i) mask[i] = share[i] >= .5f;
    EXPECT_NEAR(overlap(mask, disc.truth), 28. * 28 / 900, .02);
}

TEST(PersonMask, FollowsThePicturesEdges) {
    const Disc disc;
    const std::vector<float> led =
        guidedFilter(disc.picture, personShare(disc.person, 160, 120), 4, 1e-4);
    std::vector<uint8_t> mask(led.size());
    for (size_t i = 0; i < led.size(); ++i) mask[i] = led[i] >= .5f;
    EXPECT_GT(overlap(mask, disc.truth), .95);  // of .87 before
}

TEST(PersonMask, AGuidedFilterKeepsWhatIsFlat) {
    const Image flat(20, 10, 3, 90);
    std::vector<float> share(200);
    for (size_t i = 0; i < share.size(); ++i) share[i] = i % 20 < 10 ? 1.f : 0.f;
    // Without edges it is a mean of means.
    const auto led = guidedFilter(flat, share, 2, 1e-4);
    EXPECT_NEAR(led[5 * 20 + 3], 1, 1e-5);
    EXPECT_NEAR(led[5 * 20 + 9] + led[5 * 20 + 10], 1, 1e-5);
    EXPECT_NEAR(led[5 * 20 + 16], 0, 1e-5);
}

TEST(PersonMask, IslandsAreLeftOut) {
    Disc disc;
    for (int v = 0; v < 12; ++v)
        for (int u = 0; u < 12; ++u) disc.person.mask[size_t((v + 20) * kRoiMaskSide + u + 20)] = 9;
    const auto mask = personMask(disc.person, disc.picture);
    const Point2 island = disc.person.roi.toPicture({26. / kRoiMaskSide, 26. / kRoiMaskSide});
    EXPECT_EQ(mask[size_t(int(island[1]) * 160 + int(island[0]))], 0);
    EXPECT_GT(overlap(mask, disc.truth), .86);
}

// ---- poses --------------------------------------------------------------------------------------

// Joints of a posed body in camera space, by the definition in nn/ops/body.h.
std::array<glm::dvec3, joint::kCount> jointsOf(const BodyModel& body, const Theta& theta,
                                               const Trans& trans) {
    const auto flat = restJoints(body, std::vector<double>(10));
    const auto rest = [&](size_t j) {
        return glm::dvec3(flat[3 * j], flat[3 * j + 1], flat[3 * j + 2]);
    };
    std::array<glm::dvec3, joint::kCount> place;
    std::array<glm::dquat, joint::kCount> turned;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const int parent = body.parents[j];
        turned[j] = jointRotation(theta, j);
        if (parent < 0) {
            place[j] = rest(j) + glm::dvec3(trans[0], trans[1], trans[2]);
            continue;
        }
        const auto p = size_t(parent);
        turned[j] = turned[p] * turned[j];
        place[j] = place[p] + turned[p] * (rest(j) - rest(p));
    }
    return place;
}

// What a perfect network would see of a body, on a scale of its own.
PersonLandmarks landmarksOfBody(const std::array<glm::dvec3, joint::kCount>& joints,
                                const glm::dquat& head, const Camera& camera) {
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
    put(landmark::kLeftEar, centre + head * glm::dvec3(.07, .08, 0));
    put(landmark::kRightEar, centre + head * glm::dvec3(-.07, .08, 0));
    put(landmark::kNose, centre + head * glm::dvec3(0, .055, .1));
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
        const auto joints = jointsOf(body, theta, trans);
        glm::dquat head = jointRotation(theta, joint::kPelvis);
        const BodyStart start = poser(landmarksOfBody(joints, head, camera), camera);
        const auto found = jointsOf(body, start.theta, start.trans);
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

// Networks see how deep a foot reaches by less than half, and not at all from behind: it is known
// from how long feet are. Legs that are nearly straight are turned with their feet.
TEST(BodyPoser3d, FeetPointWhereTheyAreSeenToWhateverTheirDepth) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    const Camera camera = cameraOfAngle(600, 1080, kGuessedAngle);
    for (int side = 0; side < 8; ++side) {
        Theta theta{};
        const double heading = 2 * M_PI * side / 8;
        setJointRotation(theta, joint::kPelvis,
                         quaternionOf({M_PI, 0, 0}) * quaternionOf({0, heading, 0}));
        setJointRotation(theta, joint::kLeftHip, quaternionOf({0, .25, 0}));
        setJointRotation(theta, joint::kRightHip, quaternionOf({0, -.25, 0}));
        const auto joints = jointsOf(body, theta, {0, .1f, 3.2f});
        PersonLandmarks person =
            landmarksOfBody(joints, jointRotation(theta, joint::kPelvis), camera);
        std::array<glm::dvec3, 2> forward, truth;  // of the rest pose, of this one
        for (const bool left : {true, false}) {
            const glm::dquat turned =
                jointRotation(theta, joint::kPelvis) *
                jointRotation(theta, left ? joint::kLeftHip : joint::kRightHip);
            const auto rest = restJoints(body, std::vector<double>(10));
            const double* from = &rest[3 * (left ? joint::kLeftAnkle : joint::kRightAnkle)];
            const double* to = &rest[3 * (left ? joint::kLeftFoot : joint::kRightFoot)];
            forward[left] = glm::normalize(glm::dvec3(to[0] - from[0], 0, to[2] - from[2]));
            truth[left] = turned * forward[left];
            const glm::dvec3 heel = joints[left ? joint::kLeftAnkle : joint::kRightAnkle] +
                                    turned * glm::dvec3(0, -.06, -.05),
                             tip = heel + .22 * truth[left];
            Landmark& seenHeel = person.points[left ? landmark::kLeftHeel : landmark::kRightHeel];
            Landmark& seenTip =
                person.points[left ? landmark::kLeftFootTip : landmark::kRightFootTip];
            const auto u = camera.project({heel.x, heel.y, heel.z}),
                       v = camera.project({tip.x, tip.y, tip.z});
            seenHeel.picture = {u[0], u[1], 0};
            seenTip.picture = {v[0], v[1], 0};
            seenTip.world = seenHeel.world;
            if (truth[left].z < 0) seenTip.world[2] += .85 * .4 * .22 * truth[left].z;
        }
        const BodyStart start = poser(person, camera);
        for (const bool left : {true, false}) {
            const glm::dquat thigh =
                jointRotation(start.theta, joint::kPelvis) *
                jointRotation(start.theta, left ? joint::kLeftHip : joint::kRightHip);
            const glm::dquat foot =
                thigh * jointRotation(start.theta, left ? joint::kLeftKnee : joint::kRightKnee) *
                jointRotation(start.theta, left ? joint::kLeftAnkle : joint::kRightAnkle);
            const auto angle = [&](const glm::dquat& q) {
                return glm::degrees(
                    std::acos(std::clamp(glm::dot(q * forward[left], truth[left]), -1., 1.)));
            };
            EXPECT_LT(angle(foot), 10) << side << (left ? " left" : " right");
            EXPECT_LT(angle(thigh), 15) << side << (left ? " left" : " right");
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
    const auto joints = jointsOf(body, theta, {0, .2f, 4});
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
    const PersonLandmarks person = landmarksOfBody(jointsOf(body, theta, {0, .2f, 4}),
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

// ---- all of it ----------------------------------------------------------------------------------

ImportSettings settingsFor(const fs::path& source, const fs::path& out, const BodyModel& body) {
    ImportSettings settings;
    settings.request.source = source;
    settings.request.net = PoseNet::Lite;
    settings.request.device = &testDevice();
    settings.request.body = &body;
    settings.out = out;
    settings.overlays = false;
    return settings;
}

BodyPicture noBody(const Camera& camera, const Theta&, const Trans&, const Betas&) {
    return {std::vector<uint8_t>(size_t(camera.width) * size_t(camera.height)), {}};
}

TEST(ImportClip, AFilmBecomesACapture) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Lite, models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    // A drawn figure, which moves to the right before a grey wall.
    const Image scene = readImage(test::sourceFolder() / "tests/data/blazepose/scene_512.png");
    std::vector<Image> pictures;
    for (int i = 0; i < 6; ++i) {
        Image picture(640, 512, 3, 128);
        for (int y = 0; y < 512; ++y)
            std::copy_n(scene.pixel(0, y), scene.rowBytes(), picture.pixel(20 * i, y));
        pictures.push_back(std::move(picture));
    }
    const fs::path file = film(folder / "walk.mp4", pictures, 10);
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    ImportSettings settings = settingsFor(file, folder / "capture", body);
    settings.request.clip.every = 2;
    settings.request.fov = 50;
    settings.request.height = 1.8;
    const ImportResult result = importCapture(settings, noBody);
    EXPECT_EQ(result.layout, "video");
    const Capture capture = readCapture(folder / "capture");
    EXPECT_EQ(capture.name, "walk");
    ASSERT_EQ(capture.size(), 3u);
    EXPECT_NEAR(capture.fps, 5, 1e-3);
    EXPECT_EQ(capture.frames[1].name, "000002");
    EXPECT_TRUE(capture.hasMasks());
    EXPECT_EQ(capture.source.at("camera"), "50 degrees along the longer side, given");
    EXPECT_EQ(capture.source.at("height"), "1.8 m, given");
    EXPECT_NEAR(capture.frames[0].camera.fx, 320 / std::tan(25 * M_PI / 180), 1e-3);
    EXPECT_EQ(capture.betas, betasOfHeight(body, 1.8));
    ASSERT_TRUE(capture.keypoints);
    // The figure moves by 40 pixels from picture to picture, and so does all that was found.
    const auto nose = [&](size_t f) { return double(capture.keypoints->values[75 * f]); };
    EXPECT_NEAR(nose(2) - nose(0), 80, 8);
    const Npz landmarks = readNpz(folder / "capture/landmarks.npz");
    EXPECT_EQ(landmarks.at("world").shape, (std::vector<int64_t>{3, 33, 3}));
    EXPECT_EQ(landmarks.at("number").toF64(), (std::vector<double>{0, 2, 4}));
    EXPECT_NEAR(landmarks.at("time").toF64()[2], .4, 1e-3);
    const Image mask = readMask(*capture.frames[0].mask);
    const Image wanted =
        readMask(test::sourceFolder() / "tests/data/blazepose/scene_mask_tflite_c0.png");
    ASSERT_EQ(mask.width, 640);
    std::vector<uint8_t> figure;
    for (int y = 0; y < 512; ++y) figure.insert(figure.end(), mask.row(y), mask.row(y) + 512);
    EXPECT_GT(overlap(figure, wanted.data), .9);
}

// A drawn person whose joints are known.
TEST(ImportClip, ASyntheticActorsJointsAreFound) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Heavy, models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    const Capture actor = renderActor(testDevice(), readActor(assetFolder() / "actor", "man"),
                                      actorSession(8, 4, kActorDistance), folder / "actor",
                                      {.size = 512, .samples = 2});
    const Poses truth = readPoses(folder / "actor/truth.npz", false);
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const BodyPoser3d poser(body);
    BlazePose pose(testDevice(), PoseNet::Heavy, models);
    double off = 0, iou = 0;
    for (size_t f = 0; f < actor.size(); ++f) {
        const Image picture = readImage(actor.frames[f].image);
        const std::vector<Detection> people = pose.detect(picture);
        ASSERT_FALSE(people.empty()) << f;
        const PersonLandmarks person = pose.landmarksBothWays(picture, people[0].roi());
        iou += overlap(personMask(person, picture), readMask(*actor.frames[f].mask).data) /
               double(actor.size());
        const Camera& camera = actor.frames[f].camera;
        const BodyStart start = poser(poser.atJoints(person, camera), camera);
        const auto got = jointsOf(body, start.theta, start.trans);
        const auto want = jointsOf(body, truth.theta[f], truth.trans[f]);
        for (size_t j = 0; j < joint::kCount; ++j)
            if (landmarkOfJoint(j))
                off += glm::length((got[j] - got[0]) - (want[j] - want[0])) / 12. /
                       double(actor.size());
    }
    std::cout << "joints " << 1000 * off << " mm, masks' IoU " << iou << "\n";
    EXPECT_LT(off, .08);
    EXPECT_GT(iou, .965);
}

TEST(ImportClip, BrokenFilesAreRefused) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Lite, models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const auto refusal = [&](const fs::path& source) {
        return messageOf<InputError>(
            [&] { importCapture(settingsFor(source, folder / "out", body), noBody); });
    };
    folder.write("empty.mp4", std::string());
    EXPECT_EQ(refusal(folder / "empty.mp4"),
              (folder / "empty.mp4").string() + ": is an empty file");
    folder.write("text.mp4", std::string("not a film"));
    EXPECT_NE(refusal(folder / "text.mp4").find("text.mp4: expected a video (MP4,"),
              std::string::npos);
    const std::vector<uint8_t> whole = readWholeFile(film(folder / "a.mp4", moving(20)));
    folder.write("cut.mp4", std::span(whole).first(whole.size() * 2 / 3));
    EXPECT_NE(refusal(folder / "cut.mp4").find("cut.mp4: "), std::string::npos);
    EXPECT_NE(refusal(folder / "a.mp4").find("a.mp4: expected a person in its"), std::string::npos);
    EXPECT_NE(refusal(folder / "none.mp4").find("expected a video or a folder to import"),
              std::string::npos);
    EXPECT_FALSE(fs::exists(folder / "out"));
}

}  // namespace
}  // namespace doppel
