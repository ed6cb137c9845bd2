// Other estimators' poses: files in each program's layout, written by the test from a person whose
// poses are known, come out as those poses before the right camera.
//
// No file here was written by the programs themselves. The layouts are what we know from the
// programs' sources and descriptions, so what we have got wrong there the readers and these tests
// have got wrong alike.
#include "trainer/motion/estimates/estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "engine/error.h"
#include "engine/io/image.h"
#include "tests/estimate_scene.h"
#include "tests/estimate_writers.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using namespace test;

// ---- files --------------------------------------------------------------------------------------

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
    writeGvhmr(folder / "hmr4d_results.pt", truth);
    Scene scene(folder / "capture", truth);
    EXPECT_EQ(scene.take(folder / "hmr4d_results.pt").told, "GVHMR");
    expectTruth(scene, truth, .03);
    EXPECT_EQ(scene.capture.frames[0].camera.cy, 85);

    writeGvhmr(folder / "short.pt", truth, 60);
    EXPECT_NE(messageOf<InputError>([&] {
                  readEstimates(folder / "short.pt");
              }).find("short.pt: smpl_params_incam: body_pose: expected 63 numbers in each of"),
              std::string::npos);
    writeGvhmr(folder / "integers.pt", truth, 63, "IntStorage");
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
        writeRomp(folder / "video_results.npz", truth, rest);
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
    writeSpin(folder / "spin.npz", truth);
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

}  // namespace
}  // namespace doppel
