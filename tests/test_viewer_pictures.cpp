// What the pictures show, and how they become finer.
#include <set>

#include "nn/steps/light.h"
#include "tests/op_test.h"
#include "tests/viewer_test.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/background.h"

namespace doppel::test {
namespace {

TEST_F(ViewerTest, EverySurfaceLooksDifferent) {
    Viewer& viewer = open();
    std::vector<Image> seen;
    const char* names[] = {"texture", "clay",  "normals", "visibility",
                           "checker", "parts", "clamps"};
    for (uint32_t paint = kPaintTexture; paint <= kPaintClamps; ++paint) {
        viewer.settings().paint = paint;
        settle();
        Image now = picture();
        for (const Image& other : seen) EXPECT_GT(difference(now, other), 0.02) << names[paint];
        expectScreen(now, names[paint]);
        seen.push_back(now);
    }
    viewer.settings().paint = kPaintTexture;
    viewer.settings().light = kLightLamp;
    settle();
    expectScreen(picture(), "lit");
    EXPECT_GT(difference(picture(), seen[0]), 0.02);
    viewer.settings().light = kLightCapture;
    viewer.settings().wireframe = true;
    viewer.settings().atlas = true;
    settle();
    expectScreen(picture(), "wireframe");
    viewer.settings().wireframe = viewer.settings().atlas = false;
    viewer.settings().split = Split::Meshes;
    settle();
    ASSERT_EQ(viewer.panes().size(), 2u);
    expectScreen(picture(), "split");
}

TEST_F(ViewerTest, PaintsTheViewInTheBackground) {
    fs::path folder = *folder_ / "painted";
    {
        Device device;
        Avatar avatar = plainAvatar();
        avatar.preset.texture.constantInput = false;
        avatar.preset.texture.textureSize = kTextureSize;
        avatar.preset.texture.width = 2;
        avatar.preset.texture.depth = 3;
        avatar.textureNet = TextureNet(device, avatar, 3).weights();
        writeAvatar(folder, avatar);
    }
    ViewerOptions options;
    options.avatar = folder;
    Viewer& viewer = open(options);
    EXPECT_GT(viewer.times().paint, 0);
    Image painted = picture();  // an untrained network's grey, not the coloured texture of the file
    viewer.settings().texture = TextureKind::Baked;
    settle();
    EXPECT_GT(difference(painted, picture()), 0.02);
}

// The viewer's own shading of the shared visibility buffer, against the pictures of `doppel
// render`. farPart: of the pixels that may differ by more than rounding does.
void expectWhatRenderDraws(const Avatar& avatar, double farPart) {
    Device device;
    Motion motion = turningMotion(3);
    Camera camera{300, 300, 128, 120, 256, 240};
    Scene scene(device, avatar);
    AvatarRenderer renderer(device, avatar);
    std::vector<uint32_t> background(256 * 240, 0xff4080c0u);
    std::vector<float> backdrop;
    for (size_t i = 0; i < background.size(); ++i)
        for (int byte : {0xc0, 0x80, 0x40}) backdrop.push_back(static_cast<float>(byte) / 255.0f);
    for (size_t f = 0; f < motion.size(); ++f) {
        scene.setPose(motion.theta[f], motion.trans[f], avatar.betas);
        std::vector<uint32_t> drawn = scene.draw(MeshKind::Refined, camera, {}, {}, background, 2);
        Drawing drawing = renderer.draw(motion.theta[f], motion.trans[f], camera, 2);
        std::vector<float> rendered = composite(drawing.rgb, drawing.mask, backdrop);
        int covered = 0, far = 0, sum = 0;
        for (size_t i = 0; i < drawn.size(); ++i) {
            covered += drawing.mask[i] > 0;
            int worst = 0;
            for (size_t c = 0; c < 3; ++c)
                worst = std::max(
                    worst, std::abs(static_cast<int>(drawn[i] >> 8 * c & 0xff) -
                                    static_cast<int>(std::lround(255 * rendered[3 * i + c]))));
            far += worst > 3;
            sum += worst;
        }
        EXPECT_GT(covered, 4000);
        EXPECT_LT(far, farPart * covered) << f;
        EXPECT_LT(sum, 1.2 * covered) << f;
    }
}

TEST_F(ViewerTest, DrawsWhatRenderDraws) {
    expectWhatRenderDraws(readAvatar(*folder_ / "avatar"), 1e-9);
}

// From above and from one side, of another colour there. The texture becomes as fine as those that
// training makes, for render lights texels and the viewer pixels.
void useLight(Avatar& avatar) {
    std::vector<float>& light = avatar.light;
    light.resize(kLightNumbers);
    for (size_t c = 0; c < 3; ++c) {
        light[c] = -.12f;                                 // y
        light[6 + c] = c == 2 ? -.02f : .16f;             // x
        light[3 * 5 + c] = c == 0 ? .05f : -.03f;         // z z
        light[3 * 7 + c] = .03f * static_cast<float>(c);  // x x - y y
    }
    constexpr int kSize = 512, kTimes = kSize / kTextureSize;
    std::vector<float> fine;
    for (int y = 0; y < kSize; ++y)
        for (int x = 0; x < kSize; ++x)
            for (int c = 0; c < 3; ++c)
                fine.push_back(avatar.texture[static_cast<size_t>(
                    3 * (y / kTimes * kTextureSize + x / kTimes) + c)]);
    avatar.texture = std::move(fine);
    avatar.textureSize = kSize;
}

// As the person looks before the camera that recorded her, whose light training has learned.
TEST_F(ViewerTest, DrawsTheCapturesLightAsRenderDoes) {
    Avatar avatar = readAvatar(*folder_ / "avatar");
    useLight(avatar);
    expectWhatRenderDraws(avatar, .05);  // fingers, which have few texels
}

// In the window, from where its camera stands, until somebody chooses another light.
TEST_F(ViewerTest, TheCapturesLightIsThereFromTheStart) {
    Avatar avatar = plainAvatar();
    const fs::path flat = *folder_ / "flat", lit = *folder_ / "lit";
    useLight(avatar);
    writeAvatar(lit, avatar);
    Avatar unlit = avatar;
    unlit.light.clear();
    writeAvatar(flat, unlit);
    ViewerOptions options;
    options.avatar = flat;
    open(options).settings().joints = false;
    settle();
    const Image without = picture();
    viewer_.reset();
    options.avatar = lit;
    Viewer& viewer = open(options);
    viewer.settings().joints = false;
    viewer.camera().yaw = .7;
    settle();
    const Image with = picture();

    const Pane& pane = viewer.panes()[0];
    const Camera camera = viewer.camera().camera(pane.width, pane.height);
    const ViewTransform view = viewer.camera().view();
    Device device;
    MeshDrawer drawer(device, avatar.body, avatar.light);
    Scene scene(device, avatar);
    const Pose pose = viewer.editor().pose();
    scene.setPose(thetaOf(pose), transOf(pose), avatar.betas);
    const Drawing drawing = drawer.draw(scene.vertices(MeshKind::Body, view), camera,
                                        avatar.texture, avatar.textureSize, 4);
    double sum = 0;
    int covered = 0;
    for (int y = 0; y < with.height; ++y)
        for (int x = 0; x < with.width; ++x) {
            const auto at = static_cast<size_t>(y * with.width + x);
            if (drawing.mask[at] < 255) continue;
            ++covered;
            for (size_t c = 0; c < 3; ++c)
                sum += std::abs(with.pixel(x, y)[c] - 255 * std::min(1.f, drawing.rgb[3 * at + c]));
        }
    EXPECT_GT(covered, 4000);
    EXPECT_LT(sum / (3 * covered), 1);

    viewer.camera().yaw = 0;
    settle();
    EXPECT_GT(difference(picture(), without), .02);
    for (uint32_t expected : {kLightFlat, kLightLamp, kLightCapture}) {
        screen_->key("l");
        settle();
        EXPECT_EQ(viewer.settings().light, expected);
        if (expected == kLightFlat) {
            EXPECT_LT(difference(picture(), without), .001);
        }
    }
}

// Shifts that leave no stretch of the pixel out, and add up to nothing after every second one.
TEST_F(ViewerTest, RefinementsCoverThePixelEvenly) {
    std::set<int> columns, rows, squares;
    glm::dvec2 sum(0);
    for (int k = 0; k < kRefinements; ++k) {
        glm::dvec2 shift = refinementShift(k), unit = shift + 0.5;
        columns.insert(static_cast<int>(16 * unit.x));
        rows.insert(static_cast<int>(16 * unit.y));
        squares.insert(static_cast<int>(4 * unit.x) + 4 * static_cast<int>(4 * unit.y));
        sum += shift;
        if (k == 0) {
            EXPECT_LT(glm::length(shift), 0.05);
        }
        if (k % 2 == 1) {
            EXPECT_EQ(glm::length(sum), 0) << k;
        }
    }
    for (const std::set<int>& seen : {columns, rows, squares}) {
        EXPECT_EQ(seen.size(), 16u);
        EXPECT_EQ(*seen.begin(), 0);
        EXPECT_EQ(*seen.rbegin(), 15);
    }
}

TEST_F(ViewerTest, WhatIsAddedUpIsTheMeanOfTheSinglePictures) {
    Device device;
    Avatar avatar = readAvatar(*folder_ / "avatar");
    std::vector<float> dark = avatar.texture;
    for (float& value : dark) value *= 0.4f;
    Motion motion = turningMotion(2);
    const Camera camera{300, 300, 128, 120, 256, 240};
    std::vector<uint32_t> background(256 * 240);
    for (size_t i = 0; i < background.size(); ++i)
        background[i] = 0xff000000u | static_cast<uint32_t>(i * 2654435761u >> 8 & 0xffffff);
    Scene scene(device, avatar), single(device, avatar);
    auto expectMean = [&](const std::vector<std::array<int, 3>>& sums, int count,
                          const std::vector<uint32_t>& mean) {
        double worst = 0;
        for (size_t i = 0; i < mean.size(); ++i)
            for (size_t c = 0; c < 3; ++c)
                worst = std::max(worst, std::abs(static_cast<double>(sums[i][c]) / count -
                                                 (mean[i] >> 8 * c & 0xff)));
        EXPECT_LE(worst, 0.501) << count;
    };
    ShadeOptions options;
    options.light = kLightLamp;
    options.wireframe = true;
    // Side by side, as two panes are, with nothing between them but their places; then anew in
    // another pose.
    for (size_t pose : {0, 1}) {
        scene.setPose(motion.theta[pose], motion.trans[pose], avatar.betas);
        single.setPose(motion.theta[pose], motion.trans[pose], avatar.betas);
        std::vector<std::array<int, 3>> sums[2];
        std::vector<uint32_t> means[2];
        for (int k = 0; k < kRefinements; ++k)
            for (int place : {0, 1}) {
                for (Scene* with : {&scene, &single})
                    with->setTexture(place ? dark : avatar.texture);
                Camera shifted = camera;
                shifted.cx += refinementShift(k).x, shifted.cy += refinementShift(k).y;
                std::vector<uint32_t> one =
                    single.draw(MeshKind::Refined, shifted, {}, options, background);
                if (k == 0) sums[place].resize(one.size());
                for (size_t i = 0; i < one.size(); ++i)
                    for (size_t c = 0; c < 3; ++c)
                        sums[place][i][c] += static_cast<int>(one[i] >> 8 * c & 0xff);
                means[place] = scene.refine(MeshKind::Refined, camera, {}, options, background,
                                            place, k, std::move(means[place]));
                expectMean(sums[place], k + 1, means[place]);
                if (k == 0) {
                    EXPECT_EQ(means[place], one);
                }
            }
        EXPECT_NE(means[0], means[1]);
    }
}

// The picture becomes finer turn by turn once all is at rest; then the device has nothing to do.
TEST_F(ViewerTest, BecomesFinerAtRestAndThenStops) {
    Viewer& viewer = open();
    viewer.settings().joints = false;
    auto turnUntilRefined = [&](int count) {
        for (int i = 0; i < 2000 && viewer.refinements() != count; ++i) viewer.frame();
        ASSERT_EQ(viewer.refinements(), count);
    };
    auto expectAnew = [&](const std::string& what) {
        uint64_t pictures = viewer.pictureCount();
        viewer.frame();
        EXPECT_EQ(viewer.refinements(), 0) << what;
        EXPECT_EQ(viewer.pictureCount(), pictures + 1) << what;
        Image moving = picture();
        turnUntilRefined(1);
        EXPECT_LT(difference(moving, picture()), 0.003) << what;
        turnUntilRefined(2);
        turnUntilRefined(3);  // and is disturbed there
    };
    settle();
    EXPECT_EQ(viewer.refinements(), kRefinements);
    uint64_t submissions = viewer.device().submissions(), pictures = viewer.pictureCount();
    rest();
    screen_->move(20, 20);  // over nothing
    rest();
    // Where the device composes the window, that is all it does.
    if (!viewer.window().directly()) {
        EXPECT_EQ(viewer.device().submissions(), submissions);
    }
    EXPECT_EQ(viewer.pictureCount(), pictures);
    EXPECT_EQ(viewer.refinements(), kRefinements);

    viewer.camera().yaw = 0.3;
    expectAnew("the camera");
    Pose pose = viewer.editor().pose();
    pose.rotation[joint::kHead] = {0, 0.25, 0};
    viewer.editor().setPose(pose);
    expectAnew("the pose");
    viewer.settings().light = kLightLamp;
    expectAnew("the light");
    viewer.settings().split = Split::Meshes;
    expectAnew("two panes");
    settle();
    EXPECT_EQ(viewer.refinements(), kRefinements);
}

// Where there is time for it: four samples of a pixel are nearer to its mean than one.
TEST_F(ViewerTest, EdgesAreSmoothWhileSomethingMoves) {
    std::array<double, 2> far{};
    for (const bool fast : {false, true}) {
        ViewerOptions options;
        options.smoothWithin = fast ? 1e9 : 0;
        Viewer& viewer = open(options);
        viewer.settings().joints = false;
        for (double yaw = .1; yaw < .7; yaw += .1) {
            viewer.camera().yaw = yaw;
            viewer.frame();
        }
        settle();
        viewer.camera().yaw = 1;
        viewer.frame();
        ASSERT_EQ(viewer.refinements(), 0);
        const Image moving = picture();
        settle();
        far[fast] = difference(moving, picture());
    }
    EXPECT_GT(far[0], 0);
    EXPECT_LT(far[1], .7 * far[0]);
}

// The figure in the corner is of new pictures, however often the window shows one.
TEST_F(ViewerTest, FramesPerSecondAreOfPictures) {
    Viewer& viewer = open();
    const auto move = [&] {
        viewer.camera().yaw += .05;
        turn(4);
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    };
    for (int i = 0; i < 20; ++i) move();
    // After a pause the count begins anew.
    for (int i = 0; i < 100 && viewer.times().fps == 0; ++i) move();
    EXPECT_GT(viewer.times().fps, 0);
    EXPECT_LT(viewer.times().fps, 100) << "10 ms are slept for each";
}

TEST(MovingSamples, GrowBetweenMovementsWhereTheDeviceIsFast) {
    MovingSamples samples(5);
    const auto move = [&](double milliseconds, int pictures) {
        for (int i = 0; i < pictures; ++i) samples.drawn(milliseconds);
    };
    move(1, 3);
    samples.rested();
    EXPECT_EQ(samples.now(), 1) << "three pictures say too little";
    move(90, 1);  // kernels are compiled
    move(1, 4);
    EXPECT_EQ(samples.now(), 1) << "not in the middle of a movement";
    samples.rested();
    samples.rested();
    EXPECT_EQ(samples.now(), 2);
    move(90, 1);
    move(4, 3);
    move(30, 2);  // the machine was busy
    EXPECT_EQ(samples.now(), 2);
    move(6, 4);
    EXPECT_EQ(samples.now(), 1) << "it takes six times as long";
    move(1, 6);
    samples.rested();
    EXPECT_EQ(samples.now(), 1) << "and that is remembered";
    move(.8, 6);
    samples.rested();
    EXPECT_EQ(samples.now(), 2);
}

TEST(MovingSamples, StaySingleOnASlowDevice) {
    MovingSamples samples(5);
    for (int movement = 0; movement < 3; ++movement) {
        for (int i = 0; i < 10; ++i) samples.drawn(1.3);
        samples.rested();
        EXPECT_EQ(samples.now(), 1);
    }
}

// While a limb moves, the rest of the picture stays as it was drawn.
TEST_F(ViewerTest, DrawsAgainOnlyWhereSomethingMoved) {
    Device device;
    Avatar avatar = readAvatar(*folder_ / "avatar");
    Camera camera{600, 600, 256, 240, 512, 480};
    std::vector<uint32_t> background(512 * 480, 0xff4080c0u), other(512 * 480, 0xff102030u);
    Motion motion = turningMotion(1);
    Theta bent = motion.theta[0];
    bent[3 * 18 + 1] += 0.6f;
    for (bool lit : {false, true}) {
        Scene scene(device, avatar), fresh(device, avatar);
        ShadeOptions options;
        options.paint = lit ? kPaintClay : kPaintTexture;
        options.light = lit ? kLightLamp : kLightFlat;
        auto draw = [&](Scene& with, const Theta& theta, std::vector<uint32_t> reused,
                        const std::vector<uint32_t>& behind) {
            with.setPose(theta, motion.trans[0], avatar.betas);
            return with.draw(MeshKind::Refined, camera, {}, options, behind, 1, std::move(reused));
        };
        auto differences = [](std::span<const uint32_t> a, std::span<const uint32_t> b) {
            int count = 0;
            for (size_t i = 0; i < a.size(); ++i) count += a[i] != b[i];
            return count;
        };
        std::vector<uint32_t> picture = draw(scene, motion.theta[0], {}, background);
        std::vector<uint32_t> whole = draw(fresh, bent, {}, background);
        EXPECT_GT(differences(picture, whole), 500);
        picture[0] = 0xff0000ffu;  // far from the arm
        picture = draw(scene, bent, std::move(picture), background);
        EXPECT_EQ(picture[0], 0xff0000ffu) << "this corner was drawn again";
        picture[0] = whole[0];
        // Elsewhere on the picture positions are rounded in another way.
        EXPECT_LE(differences(picture, whole), 20);
        // Another background, or view, is drawn as a whole.
        picture = draw(scene, bent, std::move(picture), other);
        EXPECT_EQ(differences(picture, draw(fresh, bent, {}, other)), 0);
        picture[0] = 0xff0000ffu;
        camera.cx += 3;
        picture = draw(scene, bent, std::move(picture), other);
        EXPECT_EQ(differences(picture, draw(fresh, bent, {}, other)), 0);
        camera.cx -= 3;
    }
}

}  // namespace
}  // namespace doppel::test
