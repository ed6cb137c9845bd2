// Joints dragged, pinned and turned.
#include <numbers>

#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

TEST_F(ViewerTest, DraggingTheLeftWristMovesTheHandToTheCursor) {
    Viewer& viewer = open();
    Pose before = viewer.editor().pose();
    glm::dvec2 from = at(joint::kLeftWrist), to = from + glm::dvec2(-30, -90);
    double depth = viewer.jointOnScreen(joint::kLeftWrist).z;
    drag(from, to);
    EXPECT_LT(metres(glm::distance(at(joint::kLeftWrist), to), joint::kLeftWrist), 0.02);
    EXPECT_NEAR(viewer.jointOnScreen(joint::kLeftWrist).z, depth, 0.02);
    EXPECT_EQ(viewer.selected(), size_t{joint::kLeftWrist});
    EXPECT_NE(viewer.editor().pose(), before);
    // The other side stays to the last bit.
    for (size_t j : {joint::kRightShoulder, joint::kRightElbow, joint::kLeftKnee})
        EXPECT_EQ(viewer.editor().pose().rotation[j], before.rotation[j]);

    Pose after = viewer.editor().pose();
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose(), before);
    keyWith("Control_L", "y");
    EXPECT_EQ(viewer.editor().pose(), after);
    EXPECT_EQ(viewer.editor().steps(), 1u);
    expectScreen(picture(), "wrist");
}

TEST_F(ViewerTest, EscapeGivesADragUp) {
    Viewer& viewer = open();
    Pose before = viewer.editor().pose();
    glm::dvec2 from = at(joint::kRightAnkle);
    screen_->move(from.x, from.y);
    turn();
    screen_->press(1);
    turn();
    screen_->move(from.x + 40, from.y - 60);
    turn(4);
    EXPECT_NE(viewer.editor().pose(), before);
    screen_->key("Escape");
    turn(4);
    EXPECT_EQ(viewer.editor().pose(), before);
    screen_->release(1);
    settle();
    EXPECT_EQ(viewer.editor().pose(), before);
    EXPECT_FALSE(viewer.editor().canUndo());
}

TEST_F(ViewerTest, PinnedFeetStayWhereTheyAre) {
    Viewer& viewer = open();
    for (size_t foot : {joint::kLeftAnkle, joint::kRightAnkle}) {
        glm::dvec2 place = at(foot);
        screen_->move(place.x, place.y);
        turn();
        screen_->key("p");
        settle();
    }
    PosedSkeleton before = viewer.posed();
    glm::dvec2 from = at(joint::kPelvis);
    drag(from, from + glm::dvec2(0, 25));
    PosedSkeleton after = viewer.posed();
    EXPECT_GT(glm::distance(after.position[joint::kPelvis], before.position[joint::kPelvis]), 0.05);
    for (size_t foot : {joint::kLeftAnkle, joint::kRightAnkle})
        EXPECT_LT(glm::distance(after.position[foot], before.position[foot]), 0.01);
}

TEST_F(ViewerTest, ARingTurnsTheSelectedJoint) {
    Viewer& viewer = open();
    glm::dvec2 elbow = at(joint::kLeftElbow);
    screen_->move(elbow.x, elbow.y);
    turn();
    screen_->click(1);
    settle();
    ASSERT_EQ(viewer.selected(), size_t{joint::kLeftElbow});
    Pose before = viewer.editor().pose();
    // Somewhere on a circle of the gizmo's size a ring is met, whichever way the rings lie.
    bool turned = false;
    for (double angle = 0; angle < 6.2 && !turned; angle += 0.1) {
        glm::dvec2 on = elbow + 74.0 * glm::dvec2(std::cos(angle), std::sin(angle));
        if (on.x < 4 || on.y < 4 || on.x > kWidth - 4) continue;
        OrbitCamera camera = viewer.camera();
        drag(on, on + 25.0 * glm::dvec2(-std::sin(angle), std::cos(angle)));
        turned = viewer.editor().pose() != before;
        viewer.camera() = camera;
        settle();
    }
    ASSERT_TRUE(turned);
    Pose after = viewer.editor().pose();
    for (size_t j = 0; j < joint::kCount; ++j)
        EXPECT_EQ(after.rotation[j] == before.rotation[j], j != joint::kLeftElbow) << jointName(j);
    screen_->key("r");
    settle();
    EXPECT_EQ(viewer.editor().pose(), before);
}

// What a move of the mouse asks for is on the picture of the turn that takes it.
TEST_F(ViewerTest, EachMoveIsOnTheNextPicture) {
    Viewer& viewer = open();
    for (bool orbits : {false, true}) {
        glm::dvec2 from = orbits ? glm::dvec2(40, 300) : at(joint::kLeftWrist);
        screen_->move(from.x, from.y);
        turn();
        screen_->press(orbits ? 2 : 1);
        turn();
        for (int i = 1; i <= 40; ++i) {
            uint64_t pictures = viewer.pictureCount();
            double yaw = viewer.camera().yaw;
            glm::dvec2 to = from + glm::dvec2(i % 2 ? 20 : -20, -1.5 * i);
            screen_->move(to.x, to.y);
            await("the move to reach the window", [&] {
                viewer.frame();
                return viewer.window().touched();
            });
            EXPECT_EQ(viewer.pictureCount(), pictures + 1) << i;
            if (orbits)
                EXPECT_NE(viewer.camera().yaw, yaw) << i;
            else
                EXPECT_LT(glm::distance(at(joint::kLeftWrist), to), 4) << i;
        }
        screen_->release(orbits ? 2 : 1);
        settle();
    }
}

// A hand that is faster than the window, and one that takes its time.
TEST_F(ViewerTest, TheMousesSpeedDoesNotMatter) {
    Viewer& viewer = open();
    const glm::dvec2 home = at(joint::kRightAnkle);
    for (bool pelvis : {false, true}) {
        if (pelvis)
            for (size_t foot : {joint::kLeftAnkle, joint::kRightAnkle}) {
                glm::dvec2 place = at(foot);
                screen_->move(place.x, place.y);
                turn();
                screen_->key("p");
                settle();
            }
        const size_t joint = pelvis ? joint::kPelvis : joint::kRightAnkle;
        const glm::dvec2 from = at(joint),
                         to = from + (pelvis ? glm::dvec2(16, 48) : glm::dvec2(-60, -70));
        std::optional<Pose> first;
        for (int steps : {1, 4, 40}) {
            drag(from, to, 1, steps);
            const Pose pose = viewer.editor().pose();
            EXPECT_LT(metres(glm::distance(at(joint), to), joint), 0.02) << jointName(joint);
            if (!first) first = pose;
            for (size_t j = 0; j < joint::kCount; ++j)
                EXPECT_LT(
                    glm::length(axisAngleOf(quaternionOf(pose.rotation[j]) *
                                            glm::conjugate(quaternionOf(first->rotation[j])))),
                    0.1 * std::numbers::pi / 180)
                    << steps << " steps, " << jointName(j);
            keyWith("Control_L", "z");
        }
        EXPECT_LT(glm::distance(at(joint::kRightAnkle), home), 1);
    }
}

// Shape coefficients are called by what they do, as it is measured.
TEST(ShapeNames, SayWhatACoefficientDoes) {
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    for (const ShapeName& own : shapeNames(body)) {
        EXPECT_FALSE(own.name.empty());
        EXPECT_NE(own.effect.find("height "), std::string::npos) << own.effect;
    }
    // Directions of which it is known.
    std::ranges::fill(body.shapeDirections, 0.f);
    const auto hip =
        static_cast<float>(restJoints(body, std::vector<double>(10))[3 * joint::kLeftHip + 1]);
    for (size_t v = 0; v < body.templateVertices.size() / 3; ++v)
        for (size_t c = 0; c < 3; ++c) {
            const float x = body.templateVertices[3 * v + c];
            float* of = &body.shapeDirections[10 * (3 * v + c)];
            of[0] = .04f * x;               // all of it larger
            of[1] = -.03f * x;              // smaller
            of[2] = c == 2 ? .05f * x : 0;  // deeper
            of[3] = body.part[v] >= kLeftThigh && body.part[v] <= kRightFoot && c == 1
                        ? .1f * (x - hip)  // legs that reach further down
                        : 0;
        }
    const auto names = shapeNames(body);
    EXPECT_EQ(names[0].name, "taller");
    EXPECT_EQ(names[1].name, "shorter");
    EXPECT_EQ(names[2].name, "heavier");
    EXPECT_EQ(names[2].effect.find("height +0.0 cm"), 0u) << names[2].effect;
    EXPECT_NE(names[3].name.find("longer legs"), std::string::npos) << names[3].name;
    EXPECT_EQ(names[4].name, "fine form");
    const ShapeMeasures mean = measured(body, std::vector<double>(10));
    EXPECT_GT(mean.height, 1.5);
    EXPECT_LT(mean.height, 1.9);
    EXPECT_GT(mean.girth, .6);
    EXPECT_LT(mean.girth, 1.2);
    EXPECT_GT(mean.legs, mean.arms);
}

}  // namespace
}  // namespace doppel::test
