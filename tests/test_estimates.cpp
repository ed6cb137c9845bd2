// Other estimators' poses: files in each program's own layout, written by the test from a person
// whose poses are known, come out as those poses before the right camera.
#include "trainer/motion/estimates/estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "engine/error.h"
#include "engine/io/image.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/pickle_writer.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/body_render.h"
#include "trainer/data/capture_writer.h"
#include "trainer/import/given_poses.h"
#include "trainer/import/import.h"
#include "trainer/motion/motion.h"
#include "trainer/motion/session.h"
#include "trainer/person/body_start.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
namespace py = test::py;
using test::Folder;
using test::messageOf;

constexpr int kWidth = 240, kHeight = 180;  // of the clip
constexpr size_t kFrames = 6;
const glm::dvec3 kPelvis(kRestPelvis[0], kRestPelvis[1], kRestPelvis[2]);

std::string stem(size_t f) { return fmt::format("{:06}", f); }

// Somebody who walks across the picture, in the space of a camera.
struct Truth {
    Camera camera = cameraOfAngle(kWidth, kHeight, kGuessedAngle);
    std::vector<Theta> theta;
    std::vector<Trans> trans;
    Truth() {
        const auto session = actorSession(4, 8, 3.4f);
        for (size_t f = 0; f < kFrames; ++f) {
            const MotionFrame& frame = session[4 + f];
            theta.push_back(frame.theta);
            trans.push_back({-.5f + .2f * static_cast<float>(f), .25f, 3.6f});
        }
    }
    glm::dvec3 pelvis(size_t f) const {
        return kPelvis + glm::dvec3(trans[f][0], trans[f][1], trans[f][2]);
    }
    // As a program that sees the person on its optical axis has the first joint.
    Theta seenOnAxis(size_t f) const {
        Theta seen = theta[f];
        const glm::dvec3 ray = glm::normalize(pelvis(f)), axis(0, 0, 1);
        const glm::dvec3 about = glm::cross(axis, ray);
        const glm::dquat turn = glm::normalize(glm::dquat(1 + ray.z, about.x, about.y, about.z));
        setJointRotation(seen, 0, glm::conjugate(turn) * jointRotation(seen, 0));
        return seen;
    }
    // Where the pelvis is in the picture, and how many pixels a metre has there.
    std::array<double, 3> sight(size_t f) const {
        const glm::dvec3 p = pelvis(f);
        const auto [u, v] = camera.project({p.x, p.y, p.z});
        return {u, v, camera.fx / p.z};
    }
};

std::vector<double> numbers(const auto& values) { return {values.begin(), values.end()}; }
void add(std::vector<double>& to, const auto& values) {
    to.insert(to.end(), values.begin(), values.end());
}
std::vector<double> matrices(const Theta& theta, size_t first, size_t count) {
    std::vector<double> all;
    for (size_t j = first; j < first + count; ++j) {
        const glm::dmat3 m = glm::mat3_cast(jointRotation(theta, j));
        for (int row = 0; row < 3; ++row)
            for (int column = 0; column < 3; ++column) all.push_back(m[column][row]);
    }
    return all;
}

void write(const Folder& folder, const char* name, const py::Value& value) {
    folder.write(name, py::pickle(value));
}

// ---- a capture with masks of the truth ----------------------------------------------------------

class Scene {
public:
    explicit Scene(const fs::path& folder, const Truth& truth = {}, size_t every = 1)
        : body_(bodyFromNpz(readBodyArrays("default"))),
          poser_(testDevice(), body_),
          drawer_(testDevice(), body_) {
        CaptureWriter writer(folder);
        for (size_t f = 0; f < kFrames; f += every) {
            Frame frame;
            frame.name = stem(f);
            frame.camera = truth.camera;
            const auto mask = draw_(truth.camera, truth.theta[f], truth.trans[f], {}).mask;
            writer.addImage(frame.name, kWidth, kHeight,
                            std::vector<uint8_t>(size_t(3 * kWidth * kHeight), 90));
            writer.addMask(frame.name, kWidth, kHeight, mask);
            capture.frames.push_back(frame);
            Theta upright{};
            upright[0] = 3.14159f;
            capture.theta.push_back(upright);
            capture.trans.push_back({0, 0, 2});
        }
        capture.source["camera"] = "guessed";
        capture = writer.commit(capture);
    }
    GivenPoses take(const fs::path& poses, const fs::path& source = "clip.mp4",
                    const fs::path& workspace = {}) {
        return takeGivenPoses(capture, {poses, source, workspace}, draw_);
    }
    double overlap(size_t frame) {
        FrameCache cache(capture);
        return intersection(cache.load(frame)->mask,
                            draw_(capture.frames[frame].camera, capture.theta[frame],
                                  capture.trans[frame], capture.betas)
                                .mask);
    }

    Capture capture;

private:
    static double intersection(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
        double both = 0, any = 0;
        for (size_t i = 0; i < a.size(); ++i) both += a[i] && b[i], any += a[i] || b[i];
        return both / any;
    }
    BodyModel body_;
    BodyPoser poser_;
    MeshDrawer drawer_;
    DrawBody draw_ = [this](const Camera& camera, const Theta& theta, const Trans& trans,
                            const Betas& betas) {
        return BodyPicture{drawer_.mask(poser_.pose(theta, trans, betas).verts, camera), {}};
    };
};

double degreesApart(const Theta& a, const Theta& b) {
    double worst = 0;
    for (size_t j = 0; j < 22; ++j)
        worst = std::max(worst, glm::length(axisAngleOf(jointRotation(a, j) *
                                                        glm::conjugate(jointRotation(b, j)))));
    return worst * 180 / 3.14159265358979;
}

// The poses of the frames are the truth's. metres: a tolerance, wider where our body is moved to
// fill the mask as high, which is measured in whole pixels.
void expectTruth(Scene& scene, const Truth& truth, double metres = .06, size_t every = 1) {
    ASSERT_EQ(scene.capture.size(), (kFrames + every - 1) / every);
    for (size_t i = 0; i < scene.capture.size(); ++i) {
        const size_t f = i * every;
        SCOPED_TRACE(f);
        EXPECT_LT(degreesApart(scene.capture.theta[i], truth.theta[f]), .1);
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(scene.capture.trans[i][c], truth.trans[f][c], metres) << c;
        EXPECT_NEAR(scene.capture.frames[i].camera.fx, truth.camera.fx, 1e-6 * truth.camera.fx);
        EXPECT_GT(scene.overlap(i), .94);
    }
}

// ---- files --------------------------------------------------------------------------------------

struct Person {
    std::vector<size_t> frames;
    double across = 0;  // pixels to the right of the truth
};
const Person kTruth{{0, 1, 2, 3, 4, 5}};

// One person of VIBE: the square is enlarged behind the tracker's back.
py::Value vibePerson(const Truth& truth, const Person& person, double enlarged = 1) {
    std::vector<double> pose, cam, boxes, ids;
    for (const size_t f : person.frames) {
        const auto [u, v, pixels] = truth.sight(f);
        const double side = 130 + 3 * static_cast<double>(f), half = enlarged * side / 2;
        const double x = u + person.across + 4, y = v - 6;  // of the box
        add(pose, truth.seenOnAxis(f));
        add(cam, std::vector<double>{pixels / half, (u + person.across - x) / pixels - kPelvis.x,
                                     (v - y) / pixels - kPelvis.y});
        add(boxes, std::vector<double>{x, y, side, side});
        ids.push_back(static_cast<double>(f));
    }
    const auto count = static_cast<int64_t>(person.frames.size());
    std::vector<py::Value> idList;
    for (const double id : ids) idList.push_back(py::integer(static_cast<int64_t>(id)));
    return py::dict({{py::text("pred_cam"), py::joblibArray({count, 3}, cam)},
                     {py::text("verts"),
                      py::joblibArray({count, 2, 3}, std::vector<double>(size_t(6 * count)))},
                     {py::text("pose"), py::joblibArray({count, 72}, pose)},
                     {py::text("betas"),
                      py::joblibArray({count, 10}, std::vector<double>(size_t(10 * count), .5))},
                     {py::text("joints2d"), py::none()},
                     {py::text("bboxes"), py::joblibArray({count, 4}, boxes)},
                     {py::text("frame_ids"), py::list(idList)}});
}

TEST(Estimates, Vibe) {
    Folder folder;
    const Truth truth;
    write(folder, "vibe_output.pkl", py::dict({{py::integer(1), vibePerson(truth, kTruth)}}));
    const Estimates found = readEstimates(folder / "vibe_output.pkl");
    EXPECT_EQ(found.program, "VIBE");
    ASSERT_EQ(found.people.size(), 1u);
    EXPECT_EQ(found.people[0].name, "1");
    ASSERT_EQ(found.people[0].poses.size(), kFrames);
    // What the file says is exact; the masks move the body a little.
    for (size_t f = 0; f < kFrames; ++f) {
        const EstimatedPose& pose = found.people[0].poses[f];
        const PlacedPose placed = placePose(pose, pose.views[0], truth.camera);
        EXPECT_LT(degreesApart(placed.theta, truth.theta[f]), .01);
        for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(placed.trans[c], truth.trans[f][c], 1e-4);
    }
    Scene scene(folder / "capture");
    const GivenPoses given = scene.take(folder / "vibe_output.pkl");
    EXPECT_EQ(given.told, "VIBE, boxes as they are");
    EXPECT_EQ(given.filled, "");
    expectTruth(scene, truth);
    ASSERT_TRUE(scene.capture.sourceBetas);
    EXPECT_EQ((*scene.capture.sourceBetas)[4], .5f);
}

TEST(Estimates, TheMaskTellsWhoItIs) {
    Folder folder;
    const Truth truth;
    // Followed by two tracks one after the other, with somebody else beside all the time.
    write(folder, "vibe_output.pkl",
          py::dict({{py::integer(7), vibePerson(truth, {{0, 1, 2, 3, 4, 5}, -90})},
                    {py::integer(8), vibePerson(truth, {{0, 1, 2}})},
                    {py::integer(9), vibePerson(truth, {{3, 4, 5}})}}));
    Scene scene(folder / "capture");
    EXPECT_EQ(scene.take(folder / "vibe_output.pkl").told,
              "VIBE, person 8 and 9 of 3 people, boxes as they are");
    expectTruth(scene, truth);
}

TEST(Estimates, GapsAreFilledOrLeftOut) {
    Folder folder;
    const Truth truth;
    write(folder, "vibe_output.pkl",
          py::dict({{py::integer(1), vibePerson(truth, {{0, 1, 3, 4}})}}));
    Scene scene(folder / "capture");
    const GivenPoses given = scene.take(folder / "vibe_output.pkl");
    EXPECT_EQ(given.filled, "1 between their neighbours, frames left out, which have none: 1");
    ASSERT_EQ(scene.capture.size(), 5u);
    EXPECT_EQ(scene.capture.frames[4].name, "000004");
    EXPECT_LT(degreesApart(scene.capture.theta[2], truth.theta[2]), 15);
    EXPECT_NEAR(scene.capture.trans[2][0], truth.trans[2][0], .03);
    // What belongs to frames that are left out is gone from where the capture is made.
    {
        Scene made(folder / "made");
        const fs::path place = folder / "made";
        std::vector<float> presence{0, 1, 2, 3, 4, 5};
        Npz landmarks;
        landmarks.set("presence", Array::f32({6}, presence));
        writeNpz(place / "landmarks.npz", landmarks, false);
        made.take(folder / "vibe_output.pkl", "clip.mp4", place);
        EXPECT_TRUE(fs::exists(place / "images/000004.png"));
        EXPECT_FALSE(fs::exists(place / "images/000005.png"));
        EXPECT_FALSE(fs::exists(place / "masks/000005.png"));
        EXPECT_EQ(readNpz(place / "landmarks.npz").at("presence").toF32(),
                  (std::vector<float>{0, 1, 2, 3, 4}));
    }
    // A clip of which each second picture was taken.
    Scene half(folder / "half", truth, 2);
    EXPECT_EQ(half.take(folder / "vibe_output.pkl").filled, "1 between their neighbours");
    EXPECT_EQ(half.capture.size(), 3u);
    EXPECT_NEAR(half.capture.trans[2][0], truth.trans[4][0], .03);
}

TEST(Estimates, Wham) {
    Folder folder;
    Truth truth;
    truth.camera.fx = truth.camera.fy = std::hypot(kWidth, kHeight);
    std::vector<double> pose, trans, world, path;
    for (size_t f = 0; f < kFrames; ++f) {
        add(pose, truth.theta[f]);
        add(trans, truth.trans[f]);
        Theta standing = truth.theta[f];
        setJointRotation(standing, 0, quaternionOf({0, .1 * double(f), 0}));
        add(world, standing);
        add(path, std::vector<double>{.1 * double(f), 1, 0});
    }
    write(folder, "wham_output.pkl",
          // A defaultdict(dict), as demo.py keeps them.
          "ccollections\ndefaultdict\n(cbuiltins\ndict\ntR(" + py::integer(0) +
              py::dict({{py::text("pose"), py::joblibArray({6, 72}, pose)},
                        {py::text("trans"), py::joblibArray({6, 3}, trans)},
                        {py::text("pose_world"), py::joblibArray({6, 72}, world)},
                        {py::text("trans_world"), py::joblibArray({6, 3}, path)},
                        {py::text("betas"), py::joblibArray({6, 10}, std::vector<double>(60))},
                        {py::text("frame_ids"), py::joblibArray({6}, {0, 1, 2, 3, 4, 5})}}) +
              "u");
    Scene scene(folder / "capture", truth);
    for (Frame& frame : scene.capture.frames) frame.camera = Truth().camera;
    EXPECT_EQ(scene.take(folder / "wham_output.pkl").told, "WHAM");
    expectTruth(scene, truth, .03);
    EXPECT_EQ(scene.capture.source.at("camera"),
              "44 degrees along the longer side, as WHAM's poses were found with");

    // Where the camera is known, WHAM's guess of it is none: the body is seen where it was, as
    // large as it was, and as much from the side.
    Truth narrow = truth;
    narrow.camera.fx *= 1.6, narrow.camera.fy *= 1.6;
    Scene known(folder / "known", truth);
    for (Frame& frame : known.capture.frames) frame.camera = narrow.camera;
    known.capture.source["camera"] = "30 degrees, given";
    known.take(folder / "wham_output.pkl");
    EXPECT_EQ(known.capture.source.at("camera"), "30 degrees, given");
    for (size_t f = 0; f < kFrames; ++f) {
        EXPECT_NEAR(known.capture.frames[f].camera.fx, narrow.camera.fx, 1e-9);
        EXPECT_NEAR(known.capture.trans[f][2], 1.6 * truth.trans[f][2], .1);
        EXPECT_GT(known.overlap(f), .9);
    }

    const Motion motion = readMotion(folder / "wham_output.pkl");
    ASSERT_EQ(motion.size(), kFrames);
    EXPECT_NEAR(motion.theta[3][1], .3, 1e-5);
    EXPECT_NEAR(motion.trans[3][0], .3, 1e-5);
}

// What PHALP keeps of the pictures from `first` on, which it counts from 0; their names from 1.
py::Value phalp(const Truth& truth, size_t first) {
    const double focal = 5000. / 256 * kWidth;
    std::vector<std::pair<py::Value, py::Value>> frames;
    for (size_t f = first; f < kFrames; ++f) {
        const Theta seen = truth.seenOnAxis(f);
        const auto [u, v, pixels] = truth.sight(f);
        const double depth = focal / pixels;
        const std::vector<double> camera{(u - kWidth / 2.) / pixels - kPelvis.x,
                                         (v - kHeight / 2.) / pixels - kPelvis.y,
                                         depth - kPelvis.z};
        const auto smpl =
            py::dict({{py::text("global_orient"), py::joblibArray({1, 3, 3}, matrices(seen, 0, 1))},
                      {py::text("body_pose"), py::joblibArray({23, 3, 3}, matrices(seen, 1, 23))},
                      {py::text("betas"), py::joblibArray({10}, std::vector<double>(10))}});
        // The second track was last seen in picture 1, and is repeated with what it was there.
        const bool lost = f > 1;
        frames.push_back(
            {py::text(fmt::format("outputs/_DEMO/clip/img/{:06}.jpg", f + 1)),
             py::dict({{py::text("time"), py::integer(int64_t(f - first))},
                       {py::text("shot"), py::integer(0)},
                       {py::text("tracked_ids"), py::list({py::integer(3)})},
                       {py::text("tid"), py::list({py::integer(3), py::integer(4)})},
                       {py::text("tracked_time"),
                        py::list({py::integer(0), py::integer(lost ? int64_t(f) - 1 : 0)})},
                       {py::text("size"), py::list({py::integer(kHeight), py::integer(kWidth)})},
                       {py::text("smpl"), py::list({smpl, smpl})},
                       {py::text("camera"), py::list({py::joblibArray({3}, camera),
                                                      py::joblibArray({3}, {4, 0, depth})})}})});
    }
    return py::dict(frames);
}

TEST(Estimates, FourDHumans) {
    Folder folder;
    const Truth truth;
    write(folder, "demo_clip.pkl", phalp(truth, 0));
    const Estimates found = readEstimates(folder / "demo_clip.pkl");
    EXPECT_EQ(found.program, "4D-Humans");
    ASSERT_EQ(found.people.size(), 2u);
    EXPECT_EQ(found.people[0].poses.size(), kFrames);
    EXPECT_EQ(found.people[1].poses.size(), 2u);
    Scene scene(folder / "capture");
    EXPECT_EQ(scene.take(folder / "demo_clip.pkl").told, "4D-Humans, person 3 of 2 people");
    expectTruth(scene, truth);

    // Of the clip's second half.
    write(folder, "demo_half.pkl", phalp(truth, 3));
    Scene half(folder / "half");
    const GivenPoses given = half.take(folder / "demo_half.pkl");
    EXPECT_EQ(given.told, "4D-Humans, from picture 3 on");
    ASSERT_EQ(half.capture.size(), 3u);
    for (size_t f = 0; f < 3; ++f) {
        EXPECT_LT(degreesApart(half.capture.theta[f], truth.theta[3 + f]), .1);
        EXPECT_GT(half.overlap(f), .94);
    }
}

TEST(Estimates, Gvhmr) {
    Folder folder;
    Truth truth;
    truth.camera = {300, 300, 125, 85, kWidth, kHeight};
    std::vector<double> orient, body, transl, zeros(10 * kFrames), k;
    for (size_t f = 0; f < kFrames; ++f) {
        const auto& theta = truth.theta[f];
        add(orient, std::span(theta).subspan(0, 3));
        add(body, std::span(theta).subspan(3, 63));
        // SMPL-X's pelvis rests 13 cm lower.
        const glm::dvec3 t = truth.pelvis(f) - glm::dvec3(.0031, -.3514, .0120);
        add(transl, std::vector<double>{t.x, t.y, t.z});
        add(k, std::vector<double>{300, 0, 125, 0, 300, 85, 0, 0, 1});
    }
    py::Value damaged;
    const auto save = [&](const char* name, const std::vector<double>& bodyPose, int64_t width,
                          const char* storage = "FloatStorage") {
        py::Torch torch;
        const auto params = [&] {
            return py::dict({{py::text("body_pose"), torch.tensor({6, width}, bodyPose)},
                             {py::text("betas"), torch.tensor({6, 10}, zeros)},
                             {py::text("global_orient"), torch.tensor({6, 3}, orient, storage)},
                             {py::text("transl"), torch.tensor({6, 3}, transl)}});
        };
        torch.save(
            folder / name,
            py::dict({{py::text("smpl_params_global"), params()},
                      {py::text("smpl_params_incam"), params()},
                      {py::text("K_fullimg"), torch.tensor({6, 3, 3}, k)},
                      {py::text("net_outputs"),
                       py::dict({{py::text("model_output"),
                                  py::dict({{py::text("pred_x"),
                                             torch.tensor({1, 6}, {1, 2, 3, 4, 5, 6})}})}})}}));
    };
    save("hmr4d_results.pt", body, 63);
    Scene scene(folder / "capture", truth);
    EXPECT_EQ(scene.take(folder / "hmr4d_results.pt").told, "GVHMR");
    expectTruth(scene, truth, .03);
    EXPECT_EQ(scene.capture.frames[0].camera.cy, 85);

    body.resize(60 * kFrames);
    save("short.pt", body, 60);
    EXPECT_NE(messageOf<InputError>([&] {
                  readEstimates(folder / "short.pt");
              }).find("short.pt: smpl_params_incam: body_pose: expected 63 numbers in each of"),
              std::string::npos);
    body.resize(63 * kFrames);
    save("integers.pt", body, 63, "IntStorage");
    EXPECT_NE(messageOf<InputError>([&] {
                  readEstimates(folder / "integers.pt");
              }).find("global_orient: expected a tensor of floats"),
              std::string::npos);
}

TEST(Estimates, Romp) {
    Folder folder;
    const Truth truth;
    // Either way in which ROMP stands the body: about SMPL's origin, or about the hips.
    for (const bool hips : {false, true}) {
        const glm::dvec3 rest = hips ? glm::dvec3(0) : kPelvis;
        std::vector<std::pair<py::Value, py::Value>> pictures;
        for (size_t f = 0; f < kFrames; ++f) {
            const auto [u, v, pixels] = truth.sight(f);
            const double s = pixels / (kWidth / 2.);
            std::vector<double> thetas = numbers(truth.seenOnAxis(f)),
                                cam{s, (u - kWidth / 2.) / (kWidth / 2.) - s * rest.x,
                                    (v - kHeight / 2.) / (kWidth / 2.) - s * rest.y};
            add(thetas, thetas);
            add(cam, std::vector<double>{s, .9, .9});
            pictures.push_back(
                {py::text(fmt::format("{:08}.jpg", f)),
                 f == 3
                     ? py::dict({})
                     : py::dict({{py::text("cam"), py::array({2, 3}, cam)},
                                 {py::text("smpl_thetas"), py::array({2, 72}, thetas)},
                                 {py::text("track_ids"), py::array({2}, {5, 2})},
                                 {py::text("cam_trans"), py::array({2, 3}, {0, 0, 9, 0, 0, 9})}})});
        }
        py::savezObject(folder / "video_results.npz", "results", py::dict(pictures));
        Scene scene(folder / (hips ? "hips" : "origin"));
        const GivenPoses given = scene.take(folder / "video_results.npz");
        EXPECT_EQ(given.told, hips ? "ROMP, person 5 of 2 people, cam, about the hips"
                                   : "ROMP, person 5 of 2 people, cam, about SMPL's origin");
        EXPECT_EQ(given.filled, "1 between their neighbours");
        EXPECT_LT(degreesApart(scene.capture.theta[4], truth.theta[4]), .1);
        EXPECT_GT(scene.overlap(4), .94);
    }
}

TEST(Estimates, Spin) {
    Folder folder;
    const Truth truth;
    std::vector<float> pose, betas(10 * kFrames), camera;
    for (size_t f = 0; f < kFrames; ++f) {
        const Theta seen = truth.seenOnAxis(f);
        pose.insert(pose.end(), seen.begin(), seen.end());
        camera.insert(camera.end(), {.9f, 0, .1f});
    }
    Npz npz;
    npz.set("pose", Array::f32({6, 72}, pose));
    npz.set("betas", Array::f32({6, 10}, betas));
    npz.set("camera", Array::f32({6, 3}, camera));
    writeNpz(folder / "spin.npz", npz, false);
    // Its squares are not in the file: masks tell where the body is.
    Scene scene(folder / "capture");
    EXPECT_EQ(scene.take(folder / "spin.npz").told, "SPIN, no camera; placed by the masks");
    for (size_t f = 0; f < kFrames; ++f) {
        EXPECT_LT(degreesApart(scene.capture.theta[f], truth.theta[f]), 1.5);
        EXPECT_GT(scene.overlap(f), .9);
        EXPECT_NEAR(scene.capture.trans[f][2], truth.trans[f][2], .12);
    }
}

TEST(Estimates, AmassInCameraSpace) {
    Folder folder;
    const Truth truth;
    for (const bool up : {false, true}) {
        std::vector<double> poses, trans;
        for (size_t f = 0; f < kFrames; ++f) {
            Theta theta = truth.theta[f];
            glm::dvec3 pelvis = truth.pelvis(f);
            const glm::dquat half(0, 1, 0, 0);
            if (up) {
                setJointRotation(theta, 0, half * jointRotation(theta, 0));
                pelvis = half * pelvis;
            }
            add(poses, std::span(theta).subspan(0, 66));
            poses.insert(poses.end(), 90, 0.);  // fingers
            const glm::dvec3 t = pelvis - kPelvis;
            add(trans, std::vector<double>{t.x, t.y, t.z});
        }
        Npz npz;
        npz.set("poses", Array::f64({6, 156}, poses));
        npz.set("trans", Array::f64({6, 3}, trans));
        npz.set("betas", Array::f64({16}, std::vector<double>(16)));
        npz.set("gender", Array::text("neutral"));
        npz.set("mocap_framerate", Array::scalarF64(120));
        writeNpz(folder / "fitted.npz", npz, true);
        Scene scene(folder / (up ? "up" : "down"));
        EXPECT_EQ(scene.take(folder / "fitted.npz").told,
                  up ? "AMASS, in camera space with y up" : "AMASS, in camera space");
        expectTruth(scene, truth, .03);
        EXPECT_EQ(readMotion(folder / "fitted.npz").fps, 120);
    }
}

// A folder of JSON beside a world's cameras. The second one has not seen this clip.
TEST(Estimates, EasyMocap) {
    Folder folder;
    Truth truth;
    truth.camera = {260, 260, 118, 92, kWidth, kHeight};
    const glm::dquat toCamera = quaternionOf({.2, -.9, .3});
    const glm::dvec3 moved(.3, -.2, .5), vector = axisAngleOf(toCamera);
    folder.write("intri.yml",
                 std::string("%YAML:1.0\n---\nnames:\n   - \"01\"\n   - \"02\"\n") +
                     "K_01: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
                     "   data: [ 200., 0., 120., 0., 200., 90., 0., 0., 1. ]\n"
                     "K_02: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
                     "   data: [ 260., 0., 118., 0., 260.,\n       92., 0., 0., 1. ]\n");
    folder.write("extri.yml",
                 fmt::format("%YAML:1.0\n---\nR_01: !!opencv-matrix\n   rows: 3\n   cols: 1\n"
                             "   dt: d\n   data: [ 0., 0., 0. ]\nT_01: !!opencv-matrix\n"
                             "   rows: 3\n   cols: 1\n   dt: d\n   data: [ 0., 0., 3. ]\n"
                             "R_02: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n"
                             "   data: [ {}, {}, {} ]\nT_02: !!opencv-matrix\n   rows: 3\n"
                             "   cols: 1\n   dt: d\n   data: [ {}, {}, {} ]\n",
                             vector.x, vector.y, vector.z, moved.x, moved.y, moved.z));
    fs::create_directories(folder / "out/smpl");
    for (size_t f = 0; f < kFrames; ++f) {
        const glm::dquat turn = glm::conjugate(toCamera) * jointRotation(truth.theta[f], 0);
        const glm::dvec3 rh = axisAngleOf(turn);
        // Rh turns about the origin.
        const glm::dvec3 th = glm::conjugate(toCamera) * (truth.pelvis(f) - moved) - turn * kPelvis;
        std::string poses = "0, 0, 0";
        for (size_t k = 3; k < 72; ++k) poses += fmt::format(", {:.6f}", truth.theta[f][k]);
        const std::string person = fmt::format(
            "{{\"id\": 0, \"Rh\": [[{:.6f}, {:.6f}, {:.6f}]], \"Th\": [[{:.6f}, {:.6f}, {:.6f}]],\n"
            "\"poses\": [[{}]], \"shapes\": [[0, 0, 0, 0, 0, 0, 0, 0, 0, 0]]}}",
            rh.x, rh.y, rh.z, th.x, th.y, th.z, poses);
        // Older versions write the list, newer ones an object around it.
        folder.write(fmt::format("out/smpl/{:06}.json", f),
                     f % 2 ? "[" + person + "]" : "{\"annots\": [" + person + "]}");
    }
    Scene scene(folder / "capture", truth);
    EXPECT_EQ(scene.take(folder / "out").told, "EasyMocap, the camera 02");
    expectTruth(scene, truth, .03);
    EXPECT_EQ(readMotion(folder / "out").size(), kFrames);

    folder.write("out/smpl/000002.json", std::string("[{\"id\": 0, \"Rh\": [[1e999, 0, 0]]}]"));
    EXPECT_NE(messageOf<InputError>([&] { readEstimates(folder / "out"); }).find("000002.json: "),
              std::string::npos);
    folder.write("out/smpl/000002.json",
                 std::string("[{\"id\": 0, \"Rh\": [[1, 0, 0]], \"Th\": [[1, \"x\", 0]]}]"));
    EXPECT_NE(messageOf<InputError>([&] {
                  readEstimates(folder / "out");
              }).find("000002.json: Th: expected numbers, found string"),
              std::string::npos);
}

// A folder of pictures whose names the poses know, and pickles of one picture each.
TEST(Estimates, NamesOfPictures) {
    Folder folder;
    const Truth truth;
    fs::create_directories(folder / "poses");
    fs::create_directories(folder / "clip");
    for (size_t f = 0; f < kFrames; ++f) {
        const std::string name = fmt::format("shot{}", 10 * f);
        writeImage(folder / ("clip/" + name + ".png"), Image(kWidth, kHeight, 3));
        folder.write(
            "poses/" + name + ".jpg_body.pkl",
            py::pickle(py::dict({{py::text("pose"), py::array({72}, numbers(truth.theta[f]))},
                                 {py::text("trans"), py::array({3}, numbers(truth.trans[f]))},
                                 {py::text("betas"), py::array({10}, std::vector<double>(10, 2))},
                                 {py::text("f"), py::real(truth.camera.fx)}})));
    }
    fs::remove(folder / "poses/shot20.jpg_body.pkl");
    Scene scene(folder / "capture");
    const GivenPoses given = scene.take(folder / "poses", folder / "clip");
    EXPECT_EQ(given.told, "SPIN");
    EXPECT_EQ(given.filled, "1 between their neighbours");
    for (const size_t f : {0, 1, 3, 4, 5})
        EXPECT_LT(degreesApart(scene.capture.theta[f], truth.theta[f]), .1) << f;
}

// Pictures that were scaled on the way in: boxes are in those of the file.
TEST(Estimates, BoxesAreInTheSourcesPixels) {
    Folder folder;
    Truth large;
    const Truth truth;
    fs::create_directories(folder / "clip");
    for (size_t f = 0; f < kFrames; ++f)
        writeImage(folder / ("clip/" + stem(f) + ".png"), Image(2 * kWidth, 2 * kHeight, 3));
    large.camera = cameraOfAngle(2 * kWidth, 2 * kHeight, kGuessedAngle);
    write(folder, "vibe_output.pkl", py::dict({{py::integer(1), vibePerson(large, kTruth)}}));
    Scene scene(folder / "capture");
    scene.take(folder / "vibe_output.pkl", folder / "clip");
    expectTruth(scene, truth);
    EXPECT_EQ(scene.capture.frames[0].camera.width, kWidth);
}

TEST(Estimates, RefusesWhatDoesNotFit) {
    Folder folder;
    Truth truth;
    // Upside down in the wrong place: poses of another clip.
    Truth other;
    for (size_t f = 0; f < kFrames; ++f) other.trans[f] = {-.1f, -1.2f, 7};
    write(folder, "other.pkl", py::dict({{py::integer(1), vibePerson(other, kTruth)}}));
    Scene scene(folder / "capture");
    const std::string message = messageOf<InputError>([&] { scene.take(folder / "other.pkl"); });
    EXPECT_NE(
        message.find("other.pkl: expected poses of the person in the masks, found an overlap"),
        std::string::npos)
        << message;
    // Of pictures that the capture does not have.
    const auto late = [&](int64_t number) {
        const auto one = vibePerson(truth, {{0}});
        std::string bytes = one;
        const std::string id = py::list({py::integer(0)}), then = py::list({py::integer(number)});
        bytes.replace(bytes.rfind(id), id.size(), then);
        return py::dict({{py::integer(1), bytes}});
    };
    write(folder, "late.pkl", late(900));
    EXPECT_NE(messageOf<InputError>([&] { scene.take(folder / "late.pkl"); })
                  .find("late.pkl: expected poses of the capture's frames, found poses of other "
                        "pictures: 6 frames from 0 on, poses from picture 900 on"),
              std::string::npos);
}

TEST(Estimates, RefusesDamagedFiles) {
    Folder folder;
    const Truth truth;
    const auto expect = [&](const char* name, const std::string& sentence) {
        const std::string found = messageOf<InputError>([&] { readEstimates(folder / name); });
        EXPECT_NE(found.find(sentence), std::string::npos) << found;
        EXPECT_EQ(found.find('\n'), std::string::npos) << found;
    };
    const auto vibe = [&](const char* field, const py::Value& value) {
        std::vector<double> pose(72), box{50, 50, 20, 20};
        std::vector<std::pair<py::Value, py::Value>> fields = {
            {py::text("pose"), py::array({1, 72}, pose)},
            {py::text("pred_cam"), py::array({1, 3}, {1, 0, 0})},
            {py::text("bboxes"), py::array({1, 4}, box)},
            {py::text("frame_ids"), py::array({1}, {0})}};
        for (auto& [key, old] : fields)
            if (key == py::text(field)) old = value;
        write(folder, "a.pkl", py::dict({{py::integer(4), py::dict(fields)}}));
    };
    vibe("pose", py::array({1, 71}, std::vector<double>(71)));
    expect("a.pkl",
           "a.pkl: 4: pose: expected 72 numbers in each of one row or more, found the "
           "shape [1, 71]");
    std::vector<double> spoilt(72);
    spoilt[7] = NAN;
    vibe("pose", py::array({1, 72}, spoilt));
    expect("a.pkl", "a.pkl: 4: pose: expected finite numbers, found nan in row 0, element 7");
    vibe("pose", py::array({1, 24, 3, 3}, std::vector<double>(216, .5)));
    expect("a.pkl", "a.pkl: 4: pose: expected rotation matrices, found one that is none in row 0");
    vibe("pred_cam", py::array({2, 3}, std::vector<double>(6)));
    expect("a.pkl", "a.pkl: 4: pred_cam: expected 1 rows, one per pose, found 2");
    vibe("frame_ids", py::array({1}, {-3}));
    expect("a.pkl", "a.pkl: 4: frame_ids: expected numbers of pictures, from 0, found -3");
    vibe("bboxes", py::array({1, 4}, {5, 5, 0, 0}));
    expect("a.pkl", "a.pkl: 4: bboxes: expected boxes of some size, found 0 in row 0");
    vibe("bboxes", py::text("none"));
    expect("a.pkl", "a.pkl: 4: bboxes");
    write(folder, "b.pkl", py::dict({{py::text("x"), py::real(1)}}));
    expect("b.pkl", "b.pkl: expected poses of another program: ");
    write(folder, "code.pkl",
          py::dict({{py::integer(1), "cos\nsystem\n(" + py::text("true") + "tR"}}));
    expect("code.pkl", "code.pkl: refers to code (os.system)");
    expect("nothing.pkl", "nothing.pkl: expected poses of another program, found nothing");
    const std::string whole = test::bytesOf(folder / "a.pkl");
    folder.write("cut.pkl", whole.substr(0, whole.size() / 2));
    expect("cut.pkl", "cut.pkl");
}

// Real outputs of SPIN, where they are: what the layout's importer makes of the same files.
TEST(Estimates, RealPosesOfSpin) {
    const fs::path views = fs::path(DOPPEL_SOURCE_DIR) / "../shared/data/retargeting/8-views";
    if (!fs::exists(views)) GTEST_SKIP() << "no dataset in ../shared/data";
    Folder folder;
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    BodyPoser poser(testDevice(), body);
    MeshDrawer drawer(testDevice(), body);
    const DrawBody draw = [&](const Camera& camera, const Theta& theta, const Trans& trans,
                              const Betas& betas) {
        return BodyPicture{drawer.mask(poser.pose(theta, trans, betas).verts, camera), {}};
    };
    ImportSettings settings;
    settings.request.source = views;
    settings.overlays = false;
    settings.out = folder / "plain";
    const ImportResult plain = importCapture(settings, draw);
    settings.out = folder / "given";
    settings.request.poses = views / "smpl_pose";
    const ImportResult given = importCapture(settings, draw);
    EXPECT_EQ(given.poses, "SPIN");
    ASSERT_EQ(given.capture.size(), plain.capture.size());
    ASSERT_EQ(given.iou.size(), plain.capture.size());
    for (size_t f = 0; f < given.capture.size(); ++f) {
        EXPECT_LT(degreesApart(given.capture.theta[f], plain.capture.theta[f]), .01);
        EXPECT_EQ(given.capture.frames[f].camera, plain.capture.frames[f].camera);
    }
    EXPECT_GE(given.meanIou, plain.meanIou);
    EXPECT_GT(given.meanIou, .69);
}

}  // namespace
}  // namespace doppel
