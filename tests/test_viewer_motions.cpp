// Motions, keys, films, exports, and an avatar in training.
#include <thread>

#include "engine/error.h"
#include "engine/io/video.h"
#include "tests/viewer_test.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/rendering.h"

namespace doppel::test {
namespace {

TEST_F(ViewerTest, PlaysMotions) {
    Motion motion = turningMotion(9);
    fs::path poses = *folder_ / "poses.npz";
    Npz arrays = posesArrays(motion.theta, motion.trans, {});
    arrays.set("fps", Array::f32({}, std::array{20.0f}));
    writeNpz(poses, arrays, false);
    ViewerOptions options;
    options.motion = poses;
    Viewer& viewer = open(options);
    EXPECT_EQ(viewer.frameCount(), 9);
    Pose first = viewer.editor().pose();
    screen_->key("Right");
    settle();
    EXPECT_EQ(viewer.timeline(), 1);
    EXPECT_NE(viewer.editor().pose(), first);
    screen_->key("space");
    double sum = 0, last = viewer.timeline();
    await("the motion to play", [&] {
        viewer.frame();
        sum += std::abs(viewer.timeline() - last);
        last = viewer.timeline();
        return sum > 1;
    });
    screen_->key("space");
    settle();
    screen_->key("Left");
    settle();
    EXPECT_EQ(viewer.timeline(), std::floor(viewer.timeline()));
    // At the end it starts over.
    for (int i = 0; i < 10; ++i) {
        screen_->key("Right");
        turn(2);
    }
    settle();
    ASSERT_EQ(viewer.timeline(), 8);
    screen_->key("space");
    await("the motion to play from its start", [&] {
        viewer.frame();
        return viewer.timeline() < 8;
    });
    screen_->key("space");
    settle();
    EXPECT_EQ(messageOf<InputError>([&] { viewer.loadMotion(*folder_ / "none.npz"); }).empty(),
              false);
    EXPECT_EQ(viewer.frameCount(), 9);  // the old one is still there
}

TEST_F(ViewerTest, GhostsShowTheFramesAround) {
    Motion motion = turningMotion(9);
    for (size_t f = 0; f < motion.size(); ++f) {  // to the right, without turning
        std::ranges::copy(uprightOrientation(0), motion.theta[f].begin());
        motion.trans[f][0] = .25f * (float(f) - 4);
    }
    ViewerOptions options;
    options.motion = *folder_ / "walks";
    writeColouredCapture(options.motion, motion);
    Viewer& viewer = open(options);
    for (int f = 0; f < 4; ++f) {
        screen_->key("Right");
        turn(2);
    }
    viewer.settings().joints = false;
    viewer.camera().distance *= 1.6;
    settle();
    ASSERT_EQ(viewer.timeline(), 4);
    const Image alone = picture();
    viewer.settings().ghosts = 2;
    viewer.settings().ghostSpacing = 2;
    settle();
    const Image ghosts = picture();
    // Where the body is in those frames; the avatar itself is as it was.
    const auto pixelAt = [&](const Image& image, double metres) {
        glm::dvec3 chest = viewer.posed().position[joint::kSpine3];
        chest.x += metres;
        const Pane& pane = viewer.panes().back();
        const glm::dvec3 place = projected(chest, viewer.camera().view(),
                                           viewer.camera().camera(pane.width, pane.height));
        const uint8_t* rgb = image.pixel(static_cast<int>(place.x), static_cast<int>(place.y));
        return glm::ivec3(rgb[0], rgb[1], rgb[2]);
    };
    EXPECT_EQ(pixelAt(ghosts, 0), pixelAt(alone, 0));
    const int plain = pixelAt(alone, -1).x;
    for (double before : {-.5, -1.}) {
        const glm::ivec3 seen = pixelAt(ghosts, before);
        EXPECT_GT(seen.x, plain + 15) << before;
        EXPECT_GT(seen.x, seen.z) << before;
        EXPECT_GT(pixelAt(ghosts, -before).z, pixelAt(ghosts, -before).x) << "after";
    }
    EXPECT_GT(pixelAt(ghosts, -.5).x, pixelAt(ghosts, -1).x + 10) << "the further one is fainter";
    // At the first frame there are none before.
    for (int f = 0; f < 4; ++f) {
        screen_->key("Left");
        turn(2);
    }
    settle();
    const Image first = picture();
    EXPECT_GT(pixelAt(first, .5).z, pixelAt(first, .5).x);
    EXPECT_LE(pixelAt(first, -.5).x, plain);
}

TEST_F(ViewerTest, LooksThroughTheCapturesCamera) {
    ViewerOptions options;
    options.motion = *folder_ / "capture";
    writeColouredCapture(options.motion, turningMotion(2));
    Viewer& viewer = open(options);
    screen_->key("0");
    settle();
    ASSERT_TRUE(viewer.settings().captureCamera);
    // The frame is as large as the pane allows, 533 by 400 in the middle of 560 by 400.
    const Pane& pane = viewer.panes().back();
    double scale = pane.height / 60.0, left = (pane.width - 80 * scale) / 2;
    PosedSkeleton body = viewer.posed();
    glm::dvec3 head = body.position[joint::kHead];
    EXPECT_NEAR(at(joint::kHead).x, left + scale * (75 * head.x / head.z + 40), 1e-6);
    EXPECT_NEAR(at(joint::kHead).y, scale * (75 * head.y / head.z + 30), 1e-6);
    for (int f : {0, 1}) {
        Image now = picture();
        const uint8_t* inside = now.pixel(static_cast<int>(left) + 20, 30);
        EXPECT_NEAR(inside[f], 200, 2) << f;
        EXPECT_NEAR(inside[1 - f], 40, 2) << f;
        EXPECT_LT(now.pixel(4, 30)[f], 100) << f;  // beside the frame
        screen_->key("Right");
        settle();
    }
    // Orbiting begins where the capture's camera stood.
    glm::dvec2 before = at(joint::kHead);
    drag({30, 300}, {30, 300}, 2, 1);
    EXPECT_FALSE(viewer.settings().captureCamera);
    EXPECT_LT(glm::distance(at(joint::kHead), before), 2);
}

TEST_F(ViewerTest, TheFrameIsSeenInFrontOrAsADifference) {
    ViewerOptions options;
    options.motion = *folder_ / "in front";
    writeColouredCapture(options.motion, turningMotion(2));
    Viewer& viewer = open(options);
    viewer.settings().joints = false;
    screen_->key("0");
    settle();
    const Image behind = picture();
    const glm::ivec2 body = glm::round(at(joint::kPelvis)), beside{60, 30};
    constexpr std::array<int, 3> kFrame{200, 40, 40};
    const auto expectAt = [&](const Image& image, const glm::ivec2& place,
                              const std::array<int, 3>& expected, const std::string& what) {
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(image.pixel(place.x, place.y)[c], expected[c], 3) << what << ", " << c;
    };
    const uint8_t* own = behind.pixel(body.x, body.y);
    viewer.settings().backdrop = Backdrop::Overlay;
    for (double opacity : {0., .5, 1.}) {
        viewer.settings().frameOpacity = opacity;
        settle();
        std::array<int, 3> expected{};
        for (size_t c = 0; c < 3; ++c)
            expected[c] = int(std::lround(std::lerp(own[c], kFrame[c], opacity)));
        expectAt(picture(), body, expected, fmt::format("opacity {}", opacity));
        expectAt(picture(), beside, kFrame, "beside the avatar");
    }
    viewer.settings().backdrop = Backdrop::Difference;
    for (int times : {1, 3}) {
        viewer.settings().differenceTimes = times;
        settle();
        std::array<int, 3> expected{};
        for (size_t c = 0; c < 3; ++c)
            expected[c] = std::min(255, times * std::abs(own[c] - kFrame[c]));
        const Image seen = picture();
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(seen.pixel(body.x, body.y)[c], expected[c], 3 * times) << times;
        expectAt(seen, beside, {0, 0, 0}, "beside the avatar");
    }
    // Pictures and films as the window.
    const Image seen = picture();
    viewer.saveScreenshot(*folder_ / "difference.png");
    viewer.startFilm(*folder_ / "differences");
    for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
    for (const char* name : {"difference.png", "differences/0000.png"}) {
        const Image saved = readImage(*folder_ / name);
        expectAt(saved, beside, {0, 0, 0}, name);
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(saved.pixel(body.x, body.y)[c], seen.pixel(body.x, body.y)[c], 9) << name;
    }
    // Without the capture's camera there is no frame to be in front.
    viewer.settings().captureCamera = false;
    settle();
    EXPECT_GT(picture().pixel(beside.x, beside.y)[0], 10);
}

TEST(Backdrop, ADifferenceShowsThePersonWhereTheAvatarIsNot) {
    Picture frame{4, 2, std::vector<uint8_t>(24, 100), {0, 255, 255, 0, 0, 0, 0, 0}};
    BackdropSource source{.frame = &frame};
    const std::vector<uint32_t> front = backdropPixels(4, 2, source);
    source.marksPerson = true;
    std::vector<uint32_t> picture = backdropPixels(4, 2, source);
    putInFront(picture, front, {.as = Backdrop::Difference});
    for (size_t i = 0; i < 8; ++i)
        EXPECT_EQ(picture[i], frame.mask[i] ? 0xff808080u : 0xff000000u) << i;
}

TEST_F(ViewerTest, KeyframesAreSavedAndReadAgain) {
    Viewer& viewer = open();
    screen_->key("k");
    settle();
    Pose first = viewer.editor().pose();
    for (int i = 0; i < 10; ++i) {
        screen_->key("Right");
        turn(2);
    }
    ASSERT_EQ(viewer.timeline(), 10);
    glm::dvec2 from = at(joint::kRightWrist);
    drag(from, from + glm::dvec2(20, -80));
    EXPECT_EQ(viewer.frameCount(), 11) << "an edit where there are keys is one";
    fs::path poses = *folder_ / "keys.npz";
    viewer.savePoses(poses);
    Motion motion = readMotion(poses);
    ASSERT_EQ(motion.size(), 2u);
    for (size_t k = 0; k < 72; ++k)
        EXPECT_NEAR(motion.theta[1][k], thetaOf(viewer.editor().poseAt(10))[k], 1e-6);
    screen_->key("Left");
    settle();
    EXPECT_EQ(viewer.timeline(), 9);
    EXPECT_EQ(viewer.editor().pose(), viewer.editor().poseAt(9));
    EXPECT_EQ(viewer.editor().poseAt(0), first);
    // The file is a motion to others, and keys to the viewer.
    viewer.loadMotion(poses);
    settle();
    EXPECT_EQ(viewer.editor().keyframes().size(), 2u);
    EXPECT_EQ(viewer.frameCount(), 11);
}

TEST_F(ViewerTest, FilmsWhatIsShown) {
    fs::path poses = *folder_ / "film.npz";
    Motion motion = turningMotion(5);
    writeNpz(poses, posesArrays(motion.theta, motion.trans, {}), false);
    ViewerOptions options;
    options.motion = poses;
    Viewer& viewer = open(options);
    fs::path film = *folder_ / "film.mp4", frames = *folder_ / "frames";
    const fs::path page = *folder_ / "film.webm";
    for (const fs::path& out : {film, frames, page}) {
        viewer.startFilm(out, {.size = 200});
        for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
        ASSERT_FALSE(viewer.working());
    }
    EXPECT_NEAR(VideoReader(page).duration(), VideoReader(film).duration(), 1e-3);
    VideoReader reader(film);
    EXPECT_EQ(reader.frameCount(), 5);
    EXPECT_EQ(reader.width(), 200);
    Image first, last;
    reader.next(first);
    for (int i = 1; i < 5; ++i) reader.next(last);
    EXPECT_GT(difference(first, last), 0.02);
    EXPECT_LT(difference(resize(readImage(frames / "0004.png"), last.width, last.height), last),
              0.1);
    // Some of the frames, with nothing behind.
    viewer.startFilm(*folder_ / "some", {.size = 120, .first = 1, .last = 3, .clear = true});
    for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
    EXPECT_TRUE(fs::exists(*folder_ / "some/0002.png"));
    EXPECT_FALSE(fs::exists(*folder_ / "some/0003.png"));
    const Image clear = readImage(*folder_ / "some/0000.png", 4),
                seen = resize(readImage(frames / "0001.png"), clear.width, clear.height);
    size_t covered = 0, near = 0;
    for (size_t i = 0; i < clear.data.size() / 4; ++i) {
        if (clear.data[4 * i + 3] < 255) continue;
        ++covered;
        near += std::abs(int(clear.data[4 * i + 1]) - int(seen.data[3 * i + 1])) < 24;
    }
    EXPECT_EQ(clear.pixel(0, 0)[3], 0);
    EXPECT_GT(covered, clear.data.size() / 4 / 50);
    EXPECT_LT(covered, clear.data.size() / 4 / 2);
    EXPECT_GT(near, covered * 9 / 10);
    EXPECT_EQ(viewer.timeline(), 0);
    EXPECT_EQ(messageOf<InputError>([&] { viewer.startFilm(*folder_ / "avatar"); }).empty(), false);
}

// The camera of a turntable goes round as that of `doppel render` does, and a still pose is filmed
// from all sides.
TEST_F(ViewerTest, FilmsOnATurntable) {
    Viewer& viewer = open();
    const fs::path round = *folder_ / "round";
    viewer.startFilm(round, {.size = 160, .samples = 4, .turntable = true, .turnSeconds = 1});
    for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
    EXPECT_TRUE(fs::exists(round / "0029.png"));
    EXPECT_FALSE(fs::exists(round / "0030.png"));
    const Image front = readImage(round / "0000.png"), aside = readImage(round / "0010.png");
    EXPECT_GT(difference(front, aside), .02);

    // The body turned about what the camera looks at is the same picture.
    Device device;
    const Avatar avatar = readAvatar(*folder_ / "avatar");
    const Pose pose = viewer.editor().pose();
    Shot shot{thetaOf(pose), transOf(pose), viewer.camera().camera(front.width, front.height)};
    const glm::dvec3 pelvis = viewer.posed().position[joint::kPelvis];
    viewer.camera().target = {pelvis.x, viewer.camera().target.y, pelvis.z};
    viewer.startFilm(*folder_ / "about",
                     {.size = 160, .samples = 4, .turntable = true, .turnSeconds = 1});
    for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
    shot = turned(shot, 10 / 30.);
    Scene scene(device, avatar);
    scene.setPose(shot.theta, shot.trans, avatar.betas);
    ShadeOptions shade;
    const std::vector<uint32_t> background =
        backdropPixels(front.width, front.height, {viewer.settings().colour});
    const std::vector<uint32_t> drawn =
        scene.draw(MeshKind::Refined, shot.camera, viewer.camera().view(), shade, background, 4);
    Image expected(front.width, front.height, 3);
    for (size_t i = 0; i < drawn.size(); ++i)
        for (size_t c = 0; c < 3; ++c)
            expected.data[3 * i + c] = static_cast<uint8_t>(drawn[i] >> 8 * c);
    EXPECT_LT(difference(readImage(*folder_ / "about/0010.png"), expected), .002);
}

TEST_F(ViewerTest, SavesLargeAndClearPictures) {
    Viewer& viewer = open();
    const fs::path out = *folder_ / "clear.png";
    settle();
    const double shown = shareOfAvatar(picture());  // before a message lies over it
    viewer.drawPicture(out, {.size = 900, .clear = true});
    for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
    EXPECT_NE(viewer.message().find("picture in"), std::string::npos) << viewer.message();
    const Image clear = readImage(out, 4);
    EXPECT_EQ(std::max(clear.width, clear.height), 900);
    size_t covered = 0;
    for (size_t i = 3; i < clear.data.size(); i += 4) covered += clear.data[i] == 255;
    EXPECT_EQ(clear.pixel(0, 0)[3], 0);
    EXPECT_NEAR(double(covered) / double(clear.data.size() / 4), shown, .03);
}

TEST_F(ViewerTest, WhatCannotBeReadIsSaid) {
    ViewerOptions options;
    options.motion = *folder_ / "damaged";
    writeColouredCapture(options.motion, turningMotion(3));
    Viewer& viewer = open(options);
    screen_->key("0");
    settle();
    EXPECT_GT(picture().pixel(33, 300)[0], 150);
    const std::string missing = readCapture(options.motion).frames[1].image.string();
    fs::remove(missing);
    screen_->key("Right");
    settle();
    EXPECT_NE(viewer.message().find(missing), std::string::npos) << viewer.message();
    const Image without = picture();
    EXPECT_EQ(without.pixel(33, 300)[0], without.pixel(4, 300)[0]) << "in place of the frame";
    screen_->key("Right");
    settle();
    EXPECT_GT(picture().pixel(33, 300)[2], 150) << "the others are there";

    // A film would have a hole.
    viewer.startFilm(*folder_ / "hole.mp4", {.size = 64});
    for (int i = 0; i < 500 && viewer.working(); ++i) viewer.frame();
    EXPECT_NE(viewer.message().find(missing), std::string::npos) << viewer.message();
    EXPECT_FALSE(fs::exists(*folder_ / "hole.mp4"));
    EXPECT_EQ(viewer.timeline(), 2) << "as before the film";
    settle();
    EXPECT_EQ(viewer.editor().pose(), motionPose(*viewer.editor().motion(), 2));
}

// It is drawn in the background, as everything was when it was asked for.
TEST_F(ViewerTest, NothingDisturbsAFilm) {
    const Motion motion = turningMotion(8);
    ViewerOptions options;
    options.motion = *folder_ / "busy.npz";
    options.width = 900, options.height = 700;
    writeNpz(options.motion, posesArrays(motion.theta, motion.trans, {}), false);
    Viewer& viewer = open(options);
    viewer.settings().floor = true;
    viewer.settings().ghosts = 1;
    settle();
    viewer.startFilm(*folder_ / "calm", {.size = 120});
    await("the film", [&] { return viewer.frame() && !viewer.working(); });

    viewer.startFilm(*folder_ / "busy", {.size = 120});
    EXPECT_THROW(viewer.startFilm(*folder_ / "second", {.size = 120}), InputError);
    viewer.settings().colour = {1, 1, 1};
    viewer.settings().floor = false;
    screen_->key("w");
    screen_->key("3");
    turn();
    // What was drawn last is in the corner: dark, while the window is white by now.
    await("a picture in the corner", [&] {
        turn(1);
        const Canvas drawn = viewer.window().drawn();
        const Pane& pane = viewer.panes().back();
        const auto at = [&](int x, int y) { return drawn.row(y)[static_cast<size_t>(x)] & 0xff; };
        return !viewer.working() || (at(pane.width - 20, 20) < 120 && at(40, 200) > 250);
    });
    ASSERT_TRUE(viewer.working()) << "the film is too short for this test";
    const glm::dvec2 wrist = at(joint::kLeftWrist);
    screen_->move(wrist.x, wrist.y);
    turn();
    screen_->press(1);
    turn();
    screen_->move(wrist.x + 30, wrist.y - 50);
    turn(2);
    screen_->release(1);
    turn();
    EXPECT_FALSE(viewer.editor().keyframes().empty()) << "posing goes on meanwhile";
    viewer.closeMotion();
    await("the film", [&] { return viewer.frame() && !viewer.working(); });
    EXPECT_NE(viewer.message().find("film in"), std::string::npos) << viewer.message();
    EXPECT_TRUE(viewer.settings().wireframe);
    for (int i = 0; i < 8; ++i) {
        const std::string name = fmt::format("000{}.png", i);
        EXPECT_EQ(readImage(*folder_ / "calm" / name).data,
                  readImage(*folder_ / "busy" / name).data)
            << name;
    }
}

TEST_F(ViewerTest, AFilmIsGivenUpOnlyIfThatIsMeant) {
    const Motion motion = turningMotion(3000);
    ViewerOptions options;
    options.motion = *folder_ / "long.npz";
    writeNpz(options.motion, posesArrays(motion.theta, motion.trans, {}), false);
    Viewer& viewer = open(options);
    viewer.startFilm(*folder_ / "half.mp4");
    turn(2);
    screen_->key("Escape");
    turn();
    ASSERT_NE(viewer.question(), "");
    screen_->key("Escape");
    turn();
    EXPECT_EQ(viewer.question(), "");
    EXPECT_TRUE(viewer.working()) << "Escape goes on";
    screen_->key("Escape");
    turn();
    viewer.answer("Give it up");
    settle();
    EXPECT_FALSE(viewer.working());

    viewer.startFilm(*folder_ / "never.mp4", {.size = 64});
    viewer.editor().setBetas({1});
    screen_->closeWindow();
    turn();
    viewer.answer("Do not save");
    turn();
    ASSERT_NE(viewer.question().find("of the film"), std::string::npos) << viewer.question();
    viewer.answer("Cancel");
    turn();
    EXPECT_TRUE(viewer.working());
    screen_->closeWindow();
    turn();
    viewer.answer("Give it up");
    await("the window to close", [&] { return !viewer.frame(); });
    viewer_.reset();
    for (const std::string& name : folder_->names()) {
        EXPECT_EQ(name.find("never"), std::string::npos) << name;
        EXPECT_EQ(name.find("half"), std::string::npos) << name;
    }

    Viewer& other = open();  // of one picture
    const fs::path out = *folder_ / "closing.mp4";
    other.startFilm(out, {.size = 64});
    screen_->closeWindow();
    turn();
    if (!other.question().empty()) other.answer("Finish it, then close");
    await("the window to close", [&] { return !other.frame(); });
    EXPECT_EQ(VideoReader(out).frameCount(), 1);
}

TEST_F(ViewerTest, AWindowThatIsClosedFinishesItsExport) {
    Viewer& viewer = open();
    const fs::path out = *folder_ / "last.glb";
    viewer.startExport(out);
    screen_->closeWindow();
    await("the window to close", [&] { return !viewer.frame(); });
    EXPECT_FALSE(viewer.working());
    EXPECT_TRUE(fs::exists(out)) << viewer.message();

    Viewer& other = open();
    fs::create_directory(*folder_ / "folder.glb");
    other.startExport(*folder_ / "folder.glb");
    screen_->closeWindow();
    for (int i = 0; i < 3000 && other.working(); ++i) ASSERT_TRUE(other.frame());
    EXPECT_NE(other.message().find("folder.glb"), std::string::npos);
    settle();
    EXPECT_FALSE(other.window().closed()) << "whoever closed it hears of what went wrong";
}

TEST_F(ViewerTest, ExportsWhatIsShown) {
    Viewer& viewer = open();
    glm::dvec2 from = at(joint::kLeftWrist);
    drag(from, from + glm::dvec2(0, -60));
    fs::path out = *folder_ / "pose.glb";
    viewer.startExport(out);
    for (int i = 0; i < 3000 && viewer.working(); ++i) viewer.frame();
    ASSERT_TRUE(fs::exists(out)) << viewer.message();
    EXPECT_GT(fs::file_size(out), 100'000u);
    EXPECT_NE(messageOf<InputError>([&] { viewer.startExport("a.obj"); }).find(".glb"),
              std::string::npos);
}

TEST_F(ViewerTest, FollowsATrainingAndOutlivesItsFolder) {
    fs::path folder = *folder_ / "training";
    Avatar avatar = plainAvatar();
    writeAvatar(folder, avatar);
    ViewerOptions options;
    options.avatar = folder;
    Viewer& viewer = open(options);
    Image before = picture();
    for (float& value : avatar.texture) value = 1 - value;
    writeRunRecord(folder, {{{"stages", "shape,texels,mesh"}}, {"shape"}});
    writeAvatar(liveFolder(folder), avatar);
    fs::last_write_time(liveFolder(folder) / "avatar.toml",
                        fs::last_write_time(folder / "avatar.toml") + std::chrono::seconds(2));
    for (int i = 0; i < 100 && viewer.message().empty(); ++i) viewer.frame();
    settle();
    EXPECT_EQ(viewer.message(), "the training's present state: stage texels, 2 of 3");
    EXPECT_EQ(screen_->title(), "training (in training: stage texels, 2 of 3) - Doppel");
    EXPECT_GT(difference(before, picture()), 0.02);

    fs::remove_all(folder);
    turn(5);
    glm::dvec2 from = at(joint::kLeftWrist);
    drag(from, from + glm::dvec2(0, -60));
    EXPECT_TRUE(viewer.editor().canUndo());
    viewer.startExport(*folder_ / "orphan.glb");
    for (int i = 0; i < 3000 && viewer.working(); ++i) viewer.frame();
    EXPECT_TRUE(fs::exists(*folder_ / "orphan.glb")) << viewer.message();
}

TEST_F(ViewerTest, SaysHowFarATrainingIs) {
    const fs::path folder = *folder_ / "on its way";
    writeAvatar(folder, plainAvatar());
    ViewerOptions options;
    options.avatar = folder;
    Viewer& viewer = open(options);
    EXPECT_TRUE(viewer.trainingLines().empty());
    const Image before = picture();

    // 19 steps in as many seconds, the next of which is being written.
    const auto now = std::chrono::system_clock::now();
    const double seconds = std::chrono::duration<double>(now.time_since_epoch()).count();
    writeStageRecord(
        folder,
        {.stage = "mesh", .device = "a device", .steps = 149, .first = 0, .began = seconds - 19});
    const fs::path curve = folder / "log/losses_mesh.csv";
    std::string rows = "step,loss,edges\n";
    for (int i = 0; i < 19; ++i) rows += fmt::format("{},{},{}\n", i, 8. / (i + 2), .25);
    const auto append = [&](const std::string& text) {
        fs::create_directories(curve.parent_path());
        std::ofstream(curve, std::ios::binary | std::ios::app) << text;
        fs::last_write_time(curve, std::chrono::file_clock::from_sys(now));
    };
    append(rows + "19,0.");
    const auto showsAStep = [&](int step) {
        const std::string words = fmt::format("step {} of", step);
        for (int i = 0; i < 2000; ++i) {
            const auto lines = viewer.trainingLines();
            if (!lines.empty() && lines[0].find(words) != std::string::npos) return true;
            viewer.frame();
        }
        return false;
    };
    ASSERT_TRUE(showsAStep(19));
    turn(3);
    EXPECT_EQ(viewer.trainingLines(),
              (std::vector<std::string>{"stage mesh: step 19 of 149, 2:10 left",
                                        "loss 0.4   edges 0.25", "a device"}));
    EXPECT_EQ(screen_->title(), "on its way (in training: stage mesh) - Doppel");
    // The curve falls, and its width is the stage's.
    const std::vector<glm::vec2> plot = viewer.trainingPlot();
    ASSERT_EQ(plot.size(), 19u);
    for (size_t i = 1; i < plot.size(); ++i) {
        EXPECT_GT(plot[i].x, plot[i - 1].x);
        EXPECT_GT(plot[i].y, plot[i - 1].y);
    }
    const double share = 19. / 149;
    EXPECT_LT(plot.back().x - plot[0].x, share * .4 * kWidth);
    EXPECT_GT(plot.back().x - plot[0].x, share * .3 * kWidth);
    EXPECT_GT(difference(before, picture()), 0.002);
    if (const char* keep = std::getenv("DOPPEL_KEEP_SCREENS"))
        writeImage(fs::path(keep) / "training.png", picture());

    append("4\n20,nan,0.5\n");  // the row that was cut has a column too few
    append("20,0.3,0.5\n");
    ASSERT_TRUE(showsAStep(21));
    viewer.settings().training = false;
    turn(3);
    EXPECT_TRUE(viewer.trainingPlot().empty());

    // A run that stands still, and one that goes on after it.
    writeStageRecord(folder, {"mesh", "a device", 149, 0, seconds - 10'000});
    fs::last_write_time(curve, std::chrono::file_clock::from_sys(now - std::chrono::hours(1)));
    for (int i = 0; i < 2000 && viewer.trainingLines()[0].find("no step for") == std::string::npos;
         ++i)
        viewer.frame();
    EXPECT_NE(viewer.trainingLines()[0].find("; no step for 1:00:"), std::string::npos)
        << viewer.trainingLines()[0];
    writeStageRecord(folder, {"texture", "a device", 5, 0, seconds});
    ASSERT_TRUE(showsAStep(0));
    EXPECT_EQ(viewer.trainingLines()[1], "before its first step");

    // Between two stages the one that ended stays, until the run ends.
    const fs::path texture = folder / "log/losses_texture.csv";
    std::ofstream(texture) << "step,loss\n0,1\n1,1\n2,1\n3,1\n4,1\n";
    ASSERT_TRUE(showsAStep(5));
    writeRunRecord(folder, {{{"preset", "ci"}}, {"texture"}});
    fs::remove(folder / "checkpoints/stage.toml");
    std::this_thread::sleep_for(std::chrono::milliseconds(600));  // it reads twice a second
    turn(3);
    ASSERT_FALSE(viewer.trainingLines().empty());
    EXPECT_EQ(viewer.trainingLines()[0], "stage texture: step 5 of 5; preparing what follows");
    fs::remove(folder / "checkpoints/run.toml");
    for (int i = 0; i < 2000 && !viewer.trainingLines().empty(); ++i) viewer.frame();
    EXPECT_TRUE(viewer.trainingLines().empty());

    // A name that leads elsewhere, where there is such a file.
    std::ofstream(folder / "elsewhere.csv") << rows;
    fs::create_directory(folder / "log/losses_");
    StageRecord hostile{"/../../elsewhere", "a device", 149, 0, seconds};
    writeStageRecord(folder, hostile);
    EXPECT_THROW(readStageRecord(folder), InputError);
    hostile = {"mesh", "a device", int64_t{1} << 62, 0, -1e300};
    writeStageRecord(folder, hostile);
    EXPECT_THROW(readStageRecord(folder), InputError);
    for (int i = 0; i < 2000 && !viewer.trainingLines().empty(); ++i) viewer.frame();
    EXPECT_TRUE(viewer.trainingLines().empty());
}

}  // namespace
}  // namespace doppel::test
