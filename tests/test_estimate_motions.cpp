// Other programs' poses as motions: files that are valid, of each layout, drive with the poses that
// they hold. As in tests/test_estimates.cpp the files are written as we know the layouts.
#include <gtest/gtest.h>

#include <functional>

#include "engine/files/npz.h"
#include "tests/estimate_writers.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace {

using namespace test;

// Of the truth: the pelvis' turn, the body's other joints (as many as SMPL-X has without hands),
// all of SMPL's, and where the body is.
struct Rows {
    std::vector<double> root, body, poses, trans;
    explicit Rows(const Truth& truth) {
        for (size_t f = 0; f < kFrames; ++f) {
            add(root, std::span(truth.theta[f]).subspan(0, 3));
            add(body, std::span(truth.theta[f]).subspan(3, 63));
            add(poses, truth.theta[f]);
            add(trans, truth.trans[f]);
        }
    }
};

void writeAmass(const std::filesystem::path& file,
                std::initializer_list<std::pair<const char*, Array>> arrays) {
    Npz npz;
    for (const auto& [name, array] : arrays) npz.set(name, array);
    writeNpz(file, npz, true);
}

void writeByParts(const Folder& folder, const Truth& truth) {
    const Rows rows(truth);
    writeAmass(folder / "by-parts.npz",
               {{"root_orient", Array::f64({6, 3}, rows.root)},
                {"pose_body", Array::f64({6, 63}, rows.body)},
                {"trans", Array::f64({6, 3}, rows.trans)},
                {"mocap_frame_rate", Array::scalarF64(120)},
                {"betas", Array::f64({16}, std::vector<double>(16, .25))}});
}

struct Layout {
    const char* file;
    std::function<void(const Folder&, const Truth&)> write;
    const char* note;
    double fps = 30;
    // The file has the body in a world and not before a camera whose picture a motion does not
    // know.
    bool inWorld = false;
    bool expressive = false;  // its body is SMPL-X's, which hangs lower from its origin
};

const std::vector<Layout> kLayouts{
    {"demo_clip.pkl",
     [](const Folder& folder, const Truth& truth) {
         write(folder, "demo_clip.pkl", phalp(truth, 0));
     },
     "4D-Humans, person 3 of 2 people, who has most poses, taken to be 30 a second"},
    {"hmr4d_results.pt",
     [](const Folder& folder, const Truth& truth) {
         writeGvhmr(folder / "hmr4d_results.pt", truth);
     },
     "GVHMR, taken to be 30 a second", 30, true},
    {"video_results.npz",
     [](const Folder& folder, const Truth& truth) {
         writeRomp(folder / "video_results.npz", truth, kPelvis);
     },
     "ROMP, person 2 of 2 people, who has most poses, taken to be 30 a second"},
    {"vibe_output.pkl",
     [](const Folder& folder, const Truth& truth) {
         write(folder, "vibe_output.pkl",
               py::dict({{py::integer(1), vibePerson(truth, {{1, 2}})},
                         {py::integer(7), vibePerson(truth, kTruth)}}));
     },
     "VIBE, person 7 of 2 people, who has most poses, taken to be 30 a second"},
    {"spin.npz",
     [](const Folder& folder, const Truth& truth) { writeSpin(folder / "spin.npz", truth); },
     "SPIN, taken to be 30 a second"},
    {"by-parts.npz", writeByParts, "AMASS, 120 a second", 120, true},
    {"smplx-parts.npz",
     [](const Folder& folder, const Truth& truth) {
         const Rows rows(truth);
         writeAmass(folder / "smplx-parts.npz",
                    {{"root_orient", Array::f64({6, 3}, rows.root)},
                     {"pose_body", Array::f64({6, 63}, rows.body)},
                     {"pose_jaw", Array::f64({6, 3}, std::vector<double>(18))},
                     {"transl", Array::f64({6, 3}, rows.trans)},
                     {"fps", Array::scalarF64(25)},
                     {"surface_model_type", Array::text("smplx")}});
     },
     "AMASS, 25 a second", 25, true, true},
    {"smpl.npz",
     [](const Folder& folder, const Truth& truth) {
         const Rows rows(truth);
         writeAmass(folder / "smpl.npz", {{"poses", Array::f64({6, 72}, rows.poses)},
                                          {"trans", Array::f64({6, 3}, rows.trans)}});
     },
     "AMASS, taken to be 30 a second", 30, true},
    // AIST++ has centimetres or what else its scaling says.
    {"gBR_sBM_cAll_d04.pkl",
     [](const Folder& folder, const Truth& truth) {
         Rows rows(truth);
         for (double& value : rows.trans) value *= 90;
         write(folder, "gBR_sBM_cAll_d04.pkl",
               py::dict({{py::text("smpl_loss"), py::real(1.5)},
                         {py::text("smpl_poses"), py::array({6, 72}, rows.poses)},
                         {py::text("smpl_scaling"), py::array({1}, {90})},
                         {py::text("smpl_trans"), py::array({6, 3}, rows.trans)}}));
     },
     "AMASS, 60 a second", 60, true}};

TEST(EstimateMotions, DriveWithThePosesThatTheyHold) {
    const Truth truth;
    for (const Layout& layout : kLayouts) {
        SCOPED_TRACE(layout.file);
        Folder folder;
        layout.write(folder, truth);
        ASSERT_TRUE(isMotion(folder / layout.file));
        const Motion motion = readMotion(folder / layout.file);
        EXPECT_EQ(motion.note, layout.note);
        EXPECT_EQ(motion.fps, layout.fps);
        ASSERT_EQ(motion.size(), kFrames);
        const double lower = layout.expressive ? -.3514 - kRestPelvis[1] : 0;
        for (size_t f = 0; f < kFrames; ++f) {
            if (std::string_view(layout.file) == "video_results.npz" && f == 3) continue;
            Theta found = motion.theta[f];
            if (!layout.inWorld) {
                // Turned as seen where the picture's middle is taken to be.
                EXPECT_LT(
                    glm::length(axisAngleOf(jointRotation(found, 0) *
                                            glm::conjugate(jointRotation(truth.theta[f], 0)))),
                    .8);
                std::copy_n(truth.theta[f].begin(), 3, found.begin());
                EXPECT_GT(motion.trans[f][2], 1);
            } else {
                EXPECT_NEAR(motion.trans[f][0], truth.trans[f][0], .005);
                EXPECT_NEAR(motion.trans[f][1], truth.trans[f][1] + lower, 1e-4);
                EXPECT_NEAR(motion.trans[f][2], truth.trans[f][2], .03);
            }
            EXPECT_LT(degreesApart(found, truth.theta[f]), .1) << f;
        }
    }
}

// A picture without the person is filled between its neighbours, and betas are told apart.
TEST(EstimateMotions, FillGapsAndSayWhoseShapeItIs) {
    Folder folder;
    const Truth truth;
    writeRomp(folder / "video_results.npz", truth, kPelvis);
    const Motion romp = readMotion(folder / "video_results.npz");
    const Theta between = thetaBetween(romp.theta[2], romp.theta[4], .5);
    EXPECT_LT(degreesApart(romp.theta[3], between), 1e-3);

    writeByParts(folder, truth);
    EXPECT_EQ(readMotion(folder / "by-parts.npz").shape, ShapeSpace::Smpl);
    EXPECT_EQ(readMotion(folder / "by-parts.npz").betas[9], .25f);
    writeGvhmr(folder / "hmr4d_results.pt", truth);
    EXPECT_EQ(readMotion(folder / "hmr4d_results.pt").shape, ShapeSpace::SmplX);
}

}  // namespace
}  // namespace doppel
