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

// A place on the ring about the view's own depth, which is a circle about the joint, where nothing
// else is; and the mouse's way along it, per radian.
std::pair<glm::dvec2, glm::dvec2> onViewRing(Viewer& viewer, size_t joint) {
    const glm::dvec2 centre = viewer.jointOnScreen(joint);
    for (double angle = .5; angle < 7; angle += .1) {
        const glm::dvec2 out(std::cos(angle), std::sin(angle)), on = centre + 74. * out;
        bool free = std::abs(out.x) > .3 && std::abs(out.y) > .3 && on.x > 80 && on.y > 80;
        for (size_t j = 0; j < joint::kCount; ++j)
            free &= glm::distance(glm::dvec2(viewer.jointOnScreen(j)), on) > 20;
        if (free) return {on, 74. * glm::dvec2(-out.y, out.x)};
    }
    ADD_FAILURE() << "no free place on the ring";
    return {};
}

TEST_F(ViewerTest, ARingSaysHowFarItTurnsAndTurnsBySteps) {
    Viewer& viewer = open();
    viewer.settings().ringAxes = RingAxes::Views;
    viewer.settings().limits = false;
    const Pose before = viewer.editor().pose();
    const auto turnBy = [&](size_t joint, double degrees, bool control) {
        const glm::dvec2 place = at(joint);
        drag(place, place);
        EXPECT_EQ(viewer.selected(), joint);
        EXPECT_EQ(viewer.turnedText(), "");
        const auto [on, way] = onViewRing(viewer, joint);
        screen_->move(on.x, on.y);
        turn();
        if (control) screen_->keyDown("Control_L");
        screen_->press(1);
        turn();
        const glm::dvec2 to = on + way * (degrees * std::numbers::pi / 180);
        screen_->move(to.x, to.y);
        turn(4);
        const std::string said = viewer.turnedText();
        screen_->release(1);
        turn();
        if (control) screen_->keyUp("Control_L");
        settle();
        return said;
    };
    // About the view's depth, which is the world's z from the front.
    const auto turned = [&](size_t joint) {
        const Skeleton& skeleton = viewer.skeleton();
        const glm::dmat3 now = viewer.posed().rotation[joint],
                         was = forwardKinematics(skeleton, before).rotation[joint];
        return axisAngleOf(glm::quat_cast(now * glm::transpose(was))) * 180. / std::numbers::pi;
    };
    const std::string freely = turnBy(joint::kLeftElbow, 33, false);
    EXPECT_NEAR(std::stod(freely), 33, 1.5);
    EXPECT_NE(freely.find("\u00b0"), std::string::npos);
    EXPECT_LT(glm::distance(turned(joint::kLeftElbow), {0, 0, std::stod(freely)}), .1);
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose(), before);

    EXPECT_EQ(turnBy(joint::kLeftElbow, -33, true), "-35.0\u00b0");
    EXPECT_LT(glm::distance(turned(joint::kLeftElbow), {0, 0, -35}), 1e-6);
    keyWith("Control_L", "z");

    // What a joint's range cuts off is not said to have been turned.
    viewer.settings().limits = true;
    const std::string limited = turnBy(joint::kHead, 60, false);
    EXPECT_NE(limited.find("its limit"), std::string::npos) << limited;
    EXPECT_LT(std::stod(limited), 45);
    EXPECT_GT(std::stod(limited), 5);
}

TEST_F(ViewerTest, RingsTurnAboutTheAxesThatAreChosen) {
    Viewer& viewer = open();
    viewer.settings().limits = false;
    viewer.editor().setPose([&] {
        Pose pose = viewer.editor().pose();
        pose.rotation[joint::kLeftShoulder] = {.4, .3, -.6};
        pose.rotation[joint::kLeftElbow] = {0, -.9, 0};
        return pose;
    }());
    settle();
    const glm::dvec2 elbow = at(joint::kLeftElbow);
    drag(elbow, elbow);
    const Pose before = viewer.editor().pose();
    const PosedSkeleton posed = viewer.posed();
    const OrbitCamera camera = viewer.camera();
    for (const auto& [choice, axes] : {std::pair{RingAxes::Own, posed.rotation[joint::kLeftElbow]},
                                       {RingAxes::Parents, posed.rotation[joint::kLeftShoulder]},
                                       {RingAxes::Views, glm::dmat3(1)}}) {
        viewer.settings().ringAxes = choice;
        settle();
        std::set<int> met;
        for (double angle = 0; angle < 6.2 && met.size() < 3; angle += .2) {
            const glm::dvec2 out(std::cos(angle), std::sin(angle));
            for (double radius : {30., 50., 74.}) {
                const glm::dvec2 on = elbow + radius * out;
                drag(on, on + glm::dvec2(14, 14), 1, 2);
                viewer.camera() = camera;
                if (viewer.editor().pose() == before) continue;
                const glm::dvec3 turn =
                    axisAngleOf(glm::quat_cast(viewer.posed().rotation[joint::kLeftElbow] *
                                               glm::transpose(posed.rotation[joint::kLeftElbow])));
                if (viewer.selected() == size_t{joint::kLeftElbow} && glm::length(turn) > .01) {
                    int axis = 0;
                    for (int other : {1, 2})
                        if (std::abs(glm::dot(axes[other], turn)) >
                            std::abs(glm::dot(axes[axis], turn)))
                            axis = other;
                    EXPECT_NEAR(std::abs(glm::dot(axes[axis], glm::normalize(turn))), 1, 1e-6);
                    met.insert(axis);
                }
                while (viewer.editor().canUndo() && viewer.editor().pose() != before)
                    viewer.editor().undo();
                settle();
                if (viewer.selected() != size_t{joint::kLeftElbow}) drag(elbow, elbow);
            }
            if (viewer.selected() != size_t{joint::kLeftElbow}) drag(elbow, elbow);
        }
        EXPECT_GE(met.size(), 2u);
    }
}

TEST_F(ViewerTest, BothSidesAreEditedAtOnce) {
    Viewer& viewer = open();
    viewer.editor().setPose(sideCopied(viewer.editor().pose(), true));
    viewer.settings().symmetric = true;
    settle();
    const Pose before = viewer.editor().pose();
    const auto expectSame = [&](const char* what) {
        const Pose now = viewer.editor().pose(), image = mirrored(now);
        for (size_t j = 1; j < joint::kCount; ++j)
            if (oppositeJoint(j) != j) {
                EXPECT_LT(glm::distance(now.rotation[j], image.rotation[j]), 1e-12)
                    << what << ", " << jointName(j);
            }
    };
    const size_t steps = viewer.editor().steps();
    const glm::dvec2 from = at(joint::kLeftWrist), to = from + glm::dvec2(-20, -80);
    const double right = at(joint::kRightWrist).y;
    drag(from, to);
    expectSame("a drag");
    EXPECT_LT(metres(glm::distance(at(joint::kLeftWrist), to), joint::kLeftWrist), 0.02);
    EXPECT_NEAR(at(joint::kRightWrist).y, right - 80, 12);
    EXPECT_EQ(viewer.editor().steps(), steps + 1);
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose(), before);

    // A drag of one bone, and a reset.
    viewer.settings().fk[size_t(Limb::RightArm)] = true;
    const glm::dvec2 wrist = at(joint::kRightWrist);
    drag(wrist, wrist + glm::dvec2(0, -60));
    expectSame("a bone's drag");
    for (size_t j = 0; j < joint::kCount; ++j)
        EXPECT_EQ(viewer.editor().pose().rotation[j] == before.rotation[j],
                  j != joint::kLeftElbow && j != joint::kRightElbow)
            << jointName(j);
    const glm::dvec2 elbow = at(joint::kLeftElbow);
    screen_->move(elbow.x, elbow.y);
    turn();
    screen_->key("r");
    settle();
    EXPECT_EQ(viewer.editor().pose().rotation[joint::kRightElbow],
              viewer.editor().original().rotation[joint::kRightElbow]);

    // A pin holds the other side.
    const glm::dvec2 ankle = at(joint::kRightAnkle);
    screen_->move(ankle.x, ankle.y);
    turn();
    screen_->key("p");
    settle();
    const glm::dvec3 pinned = viewer.posed().position[joint::kRightAnkle];
    const glm::dvec2 other = at(joint::kLeftAnkle);
    drag(other, other + glm::dvec2(20, -40));
    EXPECT_LT(glm::distance(viewer.posed().position[joint::kRightAnkle], pinned), .01);
}

TEST_F(ViewerTest, AForwardDragPointsTheBone) {
    Viewer& viewer = open();
    viewer.settings().limits = false;
    viewer.settings().fk[size_t(Limb::LeftLeg)] = true;
    const Pose before = viewer.editor().pose();
    const glm::dvec2 ankle = at(joint::kLeftAnkle), knee = at(joint::kLeftKnee),
                     to = knee + glm::dvec2(40, 60);
    drag(ankle, to);
    for (size_t j = 0; j < joint::kCount; ++j)
        EXPECT_EQ(viewer.editor().pose().rotation[j] == before.rotation[j], j != joint::kLeftKnee)
            << jointName(j);
    const glm::dvec2 bone = glm::normalize(at(joint::kLeftAnkle) - knee);
    EXPECT_LT(glm::distance(bone, glm::normalize(to - knee)), .1);
    keyWith("Control_L", "z");
    EXPECT_EQ(viewer.editor().pose(), before);
}

// The panel's switches, and what is remembered of them.
TEST_F(ViewerTest, ThePosePanelSetsHowDragsGo) {
    ViewerOptions options;
    options.width = 980, options.height = 740;
    options.state = *folder_ / "switches";
    Viewer& viewer = open(options);
    viewer.settings().panel = true;
    settle();
    clickItem("Pose");
    clickItem("rings by 5 degrees");
    EXPECT_TRUE(viewer.preferences().snap);
    EXPECT_TRUE(readPreferences(options.state).snap);
    clickItem("both sides");
    EXPECT_TRUE(viewer.settings().symmetric);
    clickItem("drags turn one bone (FK)");
    clickItem("right leg");
    EXPECT_TRUE(viewer.settings().fk[size_t(Limb::RightLeg)]);
    viewer.editor().setPose([&] {
        Pose pose = viewer.editor().pose();
        pose.rotation[joint::kLeftElbow] = {0, -.9, 0};
        return pose;
    }());
    const Pose before = viewer.editor().pose();
    clickItem("left to right");
    EXPECT_EQ(viewer.editor().pose(), sideCopied(before, true));
    clickItem("undo");
    clickItem("right to left");
    EXPECT_EQ(viewer.editor().pose(), sideCopied(before, false));
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
        picture();  // waits until the screen shows the last one
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
