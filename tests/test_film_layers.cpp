// What a render is put together with: alpha, pictures and films behind, masks in front, a shadow,
// sound.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"
#include "tests/film_reader.h"
#include "tests/op_test.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/films/colour_match.h"
#include "trainer/avatar/films/contact_shadow.h"
#include "trainer/avatar/films/footage.h"
#include "trainer/avatar/films/layers.h"
#include "trainer/avatar/rendering.h"
#include "trainer/avatar/sheet.h"
#include "trainer/commands/render.h"
#include "trainer/data/capture_writer.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;
using test::readFilm;

constexpr int kSize = 64;
constexpr size_t kFrames = 6;
constexpr double kRate = 12;

// An avatar of one colour, and a capture in which it stands before the camera, a little more to the
// right in each frame.
struct Scene {
    Folder folder;
    RenderOptions options;

    explicit Scene(const std::string& clip = "") {
        Avatar avatar;
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        avatar.preset = presetByName("ci");
        avatar.textureSize = 16;
        for (int i = 0; i < 16 * 16; ++i)
            for (float value : {.8f, .4f, .2f}) avatar.texture.push_back(value);
        writeAvatar(folder / "avatar", avatar);
        Capture capture;
        capture.name = "standing";
        capture.fps = kRate;
        if (!clip.empty()) capture.source["folder"] = clip;
        CaptureWriter writer(folder / "capture");
        for (size_t f = 0; f < kFrames; ++f) {
            Theta theta{};
            std::ranges::copy(uprightOrientation(0), theta.begin());
            // As an import names them: by the number in the clip.
            const std::string name = fmt::format("{:06}", 10 + f);
            writer.addImage(name, kSize, kSize, std::vector<uint8_t>(3 * kSize * kSize, 90));
            writer.addMask(name, kSize, kSize, std::vector<uint8_t>(kSize * kSize, 0));
            capture.frames.push_back(
                {name, {}, {}, {60, 60, kSize / 2., kSize / 2., kSize, kSize}});
            capture.theta.push_back(theta);
            // The last but one hops.
            capture.trans.push_back({.05f * float(f), f == 4 ? .1f : .2f, 3.2f});
        }
        writer.commit(capture);
        options.avatar = folder / "avatar";
        options.motion = folder / "capture";
        options.background = "#0a50c8";
    }

    fs::path render(const char* out) {
        options.out = folder / out;
        runRender(options);
        return options.out;
    }
    std::vector<Image> pictures(const char* out, int channels) {
        const fs::path place = render(out);
        std::vector<Image> images;
        for (size_t f = 0; fs::exists(place / fmt::format("{:04}.png", f)); ++f)
            images.push_back(readImage(place / fmt::format("{:04}.png", f), channels));
        return images;
    }
};

Image over(const Image& straight, const std::array<int, 3>& colour) {
    Image image(straight.width, straight.height, 3);
    for (size_t i = 0; i < image.data.size() / 3; ++i)
        for (size_t c = 0; c < 3; ++c) {
            const double alpha = straight.data[4 * i + 3] / 255.;
            image.data[3 * i + c] =
                uint8_t(std::lround(alpha * straight.data[4 * i + c] + (1 - alpha) * colour[c]));
        }
    return image;
}

int largestDifference(const Image& a, const Image& b) {
    EXPECT_EQ(a.data.size(), b.data.size());
    int worst = 0;
    for (size_t i = 0; i < std::min(a.data.size(), b.data.size()); ++i)
        worst = std::max(worst, std::abs(a.data[i] - b.data[i]));
    return worst;
}

// A film whose pictures are grey: 20, 40, 60 …
void writeGreys(const fs::path& path, int width, int height, int frames, double rate,
                const VideoOptions& options = {}) {
    VideoWriter video(path, width, height, rate, options);
    for (int i = 0; i < frames; ++i) video.add(Image(width, height, 3, uint8_t(20 * (i + 1))));
    video.finish();
}

// ---- alpha --------------------------------------------------------------------------------------

TEST(Layers, AHalfCoveredEdgeIsStraight) {
    // Colours weighted by a cover of 1, 1/2, 1/4 and 0.
    Drawing drawing{4, 1, {}, {255, 128, 64, 0}};
    for (float cover : {1.f, .5f, .25f, 0.f})
        for (float value : {.9f, .5f, .1f}) drawing.rgb.push_back(cover * value);
    for (const bool bleed : {false, true}) {
        const Image straight = straightAlpha(drawing, bleed);
        for (int x = 0; x < (bleed ? 4 : 3); ++x) {
            EXPECT_NEAR(straight.pixel(x, 0)[0], 230, 1) << x;
            EXPECT_NEAR(straight.pixel(x, 0)[1], 128, 1) << x;
            EXPECT_NEAR(straight.pixel(x, 0)[2], 26, 1) << x;
        }
        EXPECT_EQ(straight.pixel(1, 0)[3], 128);
        EXPECT_EQ(straight.pixel(3, 0)[3], 0);
        for (const char* colour : {"#000000", "#ffffff", "#0a50c8"}) {
            const std::vector<float> behind = plainBackground(colour, {1, 1, 0, 0, 4, 1});
            std::array<int, 3> rgb;
            for (size_t c = 0; c < 3; ++c) rgb[c] = int(std::lround(255 * behind[c]));
            EXPECT_LE(
                largestDifference(over(straight, rgb),
                                  toImage(composite(drawing.rgb, drawing.mask, behind), 4, 1)),
                1)
                << colour;
        }
    }
}

TEST(Layers, ATransparentRenderOverAColourIsTheRenderOnThatColour) {
    Scene scene;
    scene.options.shadow = true;
    const std::vector<Image> onColour = scene.pictures("colour", 3);
    scene.options.background = "none";
    const std::vector<Image> clear = scene.pictures("clear", 4);
    ASSERT_EQ(clear.size(), kFrames);
    size_t edge = 0;
    for (size_t f = 0; f < kFrames; ++f) {
        EXPECT_LE(largestDifference(over(clear[f], {10, 80, 200}), onColour[f]), 1) << f;
        for (size_t i = 3; i < clear[f].data.size(); i += 4)
            edge += clear[f].data[i] > 60 && clear[f].data[i] < 200;
        EXPECT_EQ(clear[f].pixel(2, 2)[3], 0);
    }
    EXPECT_GT(edge, 50u) << "pixels that are covered by a part";
    // The same through a film for editors, whose alpha is exact.
    const test::ReadFilm film = readFilm(scene.render("clear.mov"));
    ASSERT_EQ(film.frames.size(), kFrames);
    for (size_t f = 0; f < kFrames; ++f)
        for (size_t i = 0; i < film.alpha.at(f).size(); ++i)
            ASSERT_NEAR(255. * film.alpha[f][i] / ((1 << film.alphaBits) - 1),
                        clear[f].data[4 * i + 3], .51);
    EXPECT_NE(messageOf<InputError>([&] {
                  scene.render("clear.mp4");
              }).find("clear.mp4: H.264 keeps no alpha; name a .webm, .mov, .webp or .gif"),
              std::string::npos);
    EXPECT_FALSE(fs::exists(scene.folder / "clear.mp4"));
}

// ---- footage ------------------------------------------------------------------------------------

TEST(Footage, AFilmIsShownByTimeAndHeld) {
    Folder folder;
    writeGreys(folder / "a.mp4", 32, 32, 5, 10);
    Footage film(folder / "a.mp4", 1);
    for (const auto& [time, grey] :
         {std::pair{0., 20}, {.05, 20}, {.0999, 40}, {.1, 40}, {.37, 80}, {.4, 100}, {9., 100}})
        EXPECT_NEAR(255 * film.at(time, 0, 32, 32)[0], grey, 3) << time;
    EXPECT_EQ(film.note(.5, 32, 32), "");
    EXPECT_EQ(film.note(2, 16, 16), (folder / "a.mp4").string() +
                                        ": 32×32 pixels, scaled to cover 16×16; it ends after "
                                        "0.50 s of 2.00 s and its last picture is held");
}

TEST(Footage, APictureIsScaledToCover) {
    Folder folder;
    // Red, green, blue thirds side by side: of a square, the middle third is seen.
    Image wide(60, 20, 3);
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 60; ++x) wide.pixel(x, y)[x / 20] = 255;
    writeImage(folder / "wide.png", wide);
    Footage picture(folder / "wide.png", 3);
    for (int size : {10, 20, 50}) {
        const std::vector<float> seen = picture.at(0, 0, size, size);
        ASSERT_EQ(seen.size(), size_t(3 * size * size));
        for (size_t i = 0; i < seen.size(); ++i) ASSERT_EQ(seen[i], i % 3 == 1 ? 1.f : 0.f);
    }
}

TEST(Footage, AFolderHasAPictureOfEachFrame) {
    Folder folder;
    fs::create_directory(folder / "masks");
    for (int i : {2, 10, 1})
        writeImage(folder / fmt::format("masks/m{}.png", i), Image(8, 8, 1, uint8_t(20 * i)));
    Footage masks(folder / "masks", 1);
    EXPECT_NEAR(255 * masks.at(0, 0, 8, 8)[0], 20, .1);
    EXPECT_NEAR(255 * masks.at(0, 2, 8, 8)[0], 200, .1);
    EXPECT_EQ(messageOf<InputError>([&] { masks.at(0, 3, 8, 8); }),
              (folder / "masks").string() +
                  ": it has 3 pictures, and frame 3 of the motion has none; frames count from 0");
}

TEST(Footage, AMaskThatIsCutOutIsItsAlpha) {
    Folder folder;
    Image cut(4, 4, 4, 255);
    for (int y = 0; y < 4; ++y) cut.pixel(0, y)[3] = 0, cut.pixel(1, y)[3] = 128;
    cut.pixel(3, 0)[0] = cut.pixel(3, 0)[1] = cut.pixel(3, 0)[2] = 0;  // black, and there
    writeImage(folder / "cut.png", cut);
    const std::vector<float> mask = Footage(folder / "cut.png", 1).at(0, 0, 4, 4);
    EXPECT_EQ(mask[0], 0);
    EXPECT_NEAR(mask[1], 128 / 255., 1e-6);
    EXPECT_EQ(mask[3], 1);
    // Without such alpha it is how white it is.
    for (int y = 0; y < 4; ++y) cut.pixel(0, y)[3] = cut.pixel(1, y)[3] = 255;
    writeImage(folder / "whole.png", cut);
    EXPECT_EQ(Footage(folder / "whole.png", 1).at(0, 0, 4, 4)[3], 0);
    EXPECT_EQ(Footage(folder / "whole.png", 1).at(0, 0, 4, 4)[0], 1);
}

TEST(Footage, Refusals) {
    Folder folder;
    const auto refusal = [&](const char* name) {
        return messageOf<InputError>([&] {
            Footage footage(folder / name, 3);
            for (int i = 0; i < 1000; ++i) footage.at(i, 0, 32, 32);
        });
    };
    folder.write("empty.mp4", std::string());
    EXPECT_NE(refusal("empty.mp4").find("empty.mp4: is an empty file"), std::string::npos);
    folder.write("text.mp4", std::string("not a film"));
    EXPECT_NE(refusal("text.mp4").find("text.mp4: expected a video"), std::string::npos);
    EXPECT_NE(refusal("none.mp4").find("No such file"), std::string::npos);
    fs::create_directory(folder / "letters");
    EXPECT_NE(refusal("letters").find("letters: expected pictures"), std::string::npos);
    writeGreys(folder / "whole.mp4", 32, 32, 8, 10);
    const std::vector<uint8_t> whole = readWholeFile(folder / "whole.mp4");
    folder.write("cut.mp4", std::span(whole).first(whole.size() - 40));
    EXPECT_NE(refusal("cut.mp4").find("cut.mp4: the video is damaged or cut short"),
              std::string::npos);
}

TEST(Render, StandsBeforeAFilmThatKeepsItsTime) {
    Scene scene;
    // Half the motion's rate, and of another shape.
    writeGreys(scene.folder / "behind.mp4", 96, 48, 3, kRate / 2);
    scene.options.background = scene.folder / "behind.mp4";
    const std::vector<Image> pictures = scene.pictures("out", 3);
    ASSERT_EQ(pictures.size(), kFrames);
    for (size_t f = 0; f < kFrames; ++f) {
        EXPECT_NEAR(pictures[f].pixel(1, 1)[0], 20 * (int(f) / 2 + 1), 3) << f;
        EXPECT_NEAR(pictures[f].pixel(kSize / 2 + int(f), kSize / 2)[0], 204, 2) << "the avatar";
    }
    // Frames of the motion are those of the film.
    scene.options.frames = "3:6";
    const std::vector<Image> part = scene.pictures("part", 3);
    ASSERT_EQ(part.size(), 3u);
    for (size_t f = 0; f < 3; ++f) EXPECT_EQ(part[f].data, pictures[3 + f].data) << f;
    // A picture.
    writeImage(scene.folder / "wall.png", Image(30, 90, 3, 77));
    scene.options.background = scene.folder / "wall.png";
    EXPECT_EQ(scene.pictures("wall", 3).at(0).pixel(1, 1)[0], 77);
}

TEST(Render, RefusesABrokenFilmBehindAndLeavesNothing) {
    Scene scene;
    writeGreys(scene.folder / "whole.mp4", 32, 32, 8, kRate);
    const std::vector<uint8_t> whole = readWholeFile(scene.folder / "whole.mp4");
    scene.folder.write("cut.mp4", std::span(whole).first(whole.size() - 40));
    scene.options.background = scene.folder / "cut.mp4";
    const std::vector<std::string> before = scene.folder.names();
    EXPECT_NE(messageOf<InputError>([&] { scene.render("out.mp4"); }).find("cut.mp4: the video is"),
              std::string::npos);
    EXPECT_EQ(scene.folder.names(), before);
    // What is behind is not written over.
    scene.options.background = scene.folder / "whole.mp4";
    EXPECT_NE(messageOf<InputError>([&] {
                  scene.render("whole.mp4");
              }).find("expected a file apart from the input"),
              std::string::npos);
    EXPECT_EQ(readWholeFile(scene.folder / "whole.mp4"), whole);
}

// ---- in front -----------------------------------------------------------------------------------

TEST(Render, WhatIsInFrontIsTakenOutOfTheAvatar) {
    Scene scene;
    scene.options.background = "none";
    scene.options.shadow = true;
    const std::vector<Image> free = scene.pictures("free", 4);
    // White above, half grey in the middle third, black below.
    Image mask(kSize, kSize, 1);
    for (int y = 0; y < kSize; ++y)
        std::fill_n(mask.row(y), kSize, uint8_t(y < 21 ? 255 : y < 42 ? 128 : 0));
    writeImage(scene.folder / "mask.png", mask);
    scene.options.occluder = scene.folder / "mask.png";
    const std::vector<Image> hidden = scene.pictures("hidden", 4);
    ASSERT_EQ(hidden.size(), kFrames);
    size_t covered = 0;
    for (int y = 0; y < kSize; ++y)
        for (int x = 0; x < kSize; ++x) {
            const int whole = free[0].pixel(x, y)[3], left = hidden[0].pixel(x, y)[3];
            covered += whole == 255;
            ASSERT_NEAR(left, y < 21 ? 0 : y < 42 ? whole * 127 / 255. : whole, 1) << x << " " << y;
            // Straight: colours are those of the avatar.
            if (left > 100 && whole == 255) {
                ASSERT_NEAR(hidden[0].pixel(x, y)[0], 204, 2);
            }
        }
    EXPECT_GT(covered, 100u);
}

// ---- colours ------------------------------------------------------------------------------------

// A grey square, its left half darker, its edge covered by half.
Drawing greySquare() {
    Drawing drawing{32, 32, std::vector<float>(3 * 32 * 32), std::vector<uint8_t>(32 * 32)};
    for (size_t y = 10; y < 22; ++y)
        for (size_t x = 10; x < 22; ++x) {
            const bool edge = x == 10 || x == 21;
            drawing.mask[32 * y + x] = edge ? 128 : 255;
            for (size_t c = 0; c < 3; ++c)
                drawing.rgb[3 * (32 * y + x) + c] =
                    (x < 16 ? .4f : .6f) * (edge ? 128 / 255.f : 1.f);
        }
    return drawing;
}

TEST(ColourMatch, FollowsTheTintThatIsAround) {
    std::vector<float> warm, same;
    for (size_t i = 0; i < 32 * 32; ++i) {
        warm.insert(warm.end(), {.7f, .5f, .3f});
        same.insert(same.end(), 3, i % 2 == 0 ? .4f : .6f);
    }
    Drawing drawing = greySquare();
    ColourMatch().apply(drawing, same);
    for (size_t i = 0; i < drawing.rgb.size(); ++i)
        ASSERT_NEAR(drawing.rgb[i], greySquare().rgb[i], .005) << "as it was: nothing differs";
    drawing = greySquare();
    ColourMatch match;
    match.apply(drawing, warm);
    EXPECT_GT(match.gain()[0], 1.1);
    EXPECT_LT(match.gain()[2], .9);
    EXPECT_EQ(drawing.mask, greySquare().mask);
    const size_t inside = 3 * (32 * 15 + 18), edge = 3 * (32 * 15 + 21);
    EXPECT_GT(drawing.rgb[inside], .62f);
    EXPECT_LT(drawing.rgb[inside + 2], .55f);
    for (size_t c = 0; c < 3; ++c)
        EXPECT_NEAR(drawing.rgb[edge + c] * 255 / 128, drawing.rgb[inside + c], 1e-4)
            << "weighted by the cover as before";
    // The next picture moves it by a tenth.
    const float red = match.gain()[0];
    Drawing next = greySquare();
    match.apply(next, same);
    EXPECT_NEAR(match.gain()[0], red + .1f * (1 - red), .01);
}

TEST(ColourMatch, IsGentleWhateverIsAround) {
    for (const std::array<float, 3> colour :
         {std::array{0.f, 0.f, 0.f}, {0.f, 0.f, 1.f}, {1.f, 1.f, 1.f}}) {
        std::vector<float> around;
        for (size_t i = 0; i < 32 * 32; ++i)
            around.insert(around.end(), colour.begin(), colour.end());
        Drawing drawing = greySquare();
        ColourMatch match;
        match.apply(drawing, around);
        for (float gain : match.gain()) {
            EXPECT_GE(gain, 1 / (1.25f * 1.15f) - 1e-4f);
            EXPECT_LE(gain, 1.25f * 1.15f + 1e-4f);
        }
        EXPECT_GE(match.contrast(), 1 / 1.15f - 1e-4f);
        for (size_t i = 0; i < drawing.rgb.size(); ++i)
            ASSERT_LE(drawing.rgb[i], drawing.mask[i / 3] / 255.f + 1e-6f);
    }
    // Nothing to see: nothing is done.
    Drawing nothing{4, 4, std::vector<float>(48), std::vector<uint8_t>(16)};
    ColourMatch().apply(nothing, std::vector<float>(48, .5f));
    EXPECT_EQ(nothing.rgb, std::vector<float>(48));
}

TEST(Render, MatchesColoursWhereItIsAsked) {
    Scene scene;
    const Image plain = scene.pictures("plain", 3).at(0);
    scene.options.matchColours = true;
    const Image matched = scene.pictures("matched", 3).at(0);
    EXPECT_EQ(matched.pixel(1, 1)[2], 200) << "what is behind stays";
    // Before blue: less red, more blue.
    EXPECT_LT(matched.pixel(kSize / 2, kSize / 2)[0], plain.pixel(kSize / 2, kSize / 2)[0]);
    EXPECT_GT(matched.pixel(kSize / 2, kSize / 2)[2] * plain.pixel(kSize / 2, kSize / 2)[0],
              plain.pixel(kSize / 2, kSize / 2)[2] * matched.pixel(kSize / 2, kSize / 2)[0]);
}

// ---- shadow -------------------------------------------------------------------------------------

// A level square of this side, `height` above a ground that is 1.5 m below a camera, 4 m before it.
std::vector<float> squareShadow(double side, double height, const Camera& camera) {
    std::vector<float> verts;
    for (const auto& [x, z] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}})
        for (double value : {x * side / 2, 1.5 - height, 4 + z * side / 2})
            verts.push_back(float(value));
    const std::vector<int32_t> faces{0, 1, 2, 0, 2, 3};
    return contactShadow(verts, faces, {{0, -1, 0}, -1.5}, camera);
}

TEST(ContactShadow, IsTheSkyThatASquareHides) {
    // The camera's middle pixel sees the ground 4 m away, right below the square.
    Camera camera{400, 400, 32.5, 32.5 - 400 * 1.5 / 4, 65, 65};
    double before = 1;
    for (double height : {.2, .5, 1.}) {
        // The form factor of a square seen from below its middle, by four corners.
        const double x = .4 / 2 / height, root = std::sqrt(1 + x * x);
        const double hidden = 4 / (2 * std::acos(-1.)) * 2 * (x / root * std::atan(x / root));
        const double expected = 1 - std::pow(1 - .85 * hidden, 1 / 2.2);
        const std::vector<float> shadow = squareShadow(.4, height, camera);
        EXPECT_NEAR(shadow[32 * 65 + 32], expected, .06 * expected + .002) << height;
        EXPECT_LT(shadow[32 * 65 + 32], before);
        before = shadow[32 * 65 + 32];
        EXPECT_NEAR(shadow[32 * 65 + 12], shadow[32 * 65 + 52], .01) << "as wide left as right";
    }
}

TEST(ContactShadow, LiesOnTheGroundOnly) {
    const Camera camera{60, 60, 32, 32, 64, 64};  // the horizon in the middle
    const std::vector<float> shadow = squareShadow(.4, .1, camera);
    float most = 0;
    for (size_t i = 0; i < shadow.size(); ++i) {
        if (i / 64 < 32) {
            ASSERT_EQ(shadow[i], 0) << "above the horizon";
        }
        ASSERT_TRUE(shadow[i] >= 0 && shadow[i] < 1);
        most = std::max(most, shadow[i]);
    }
    EXPECT_GT(most, .3);
    // From below the ground nothing of it is seen.
    const std::vector<float> verts{0, 0, 3, 1, 0, 3, 0, 0, 4};
    const std::vector<int32_t> faces{0, 1, 2};
    EXPECT_EQ(std::ranges::max(contactShadow(verts, faces, {{0, -1, 0}, .5}, camera)), 0);
}

TEST(ContactShadow, TheGroundIsUnderTheFeetAndStaysInAJump) {
    const Npz arrays = readBodyArrays("default");
    const BodyModel body = bodyFromNpz(arrays);
    BodyPoser poser(testDevice(), body);
    std::vector<Theta> theta(60);
    std::vector<Trans> trans(60, {0, 0, 3});
    for (size_t i = 0; i < 60; ++i) {
        std::ranges::copy(uprightOrientation(.2f * float(i)), theta[i].begin());
        if (i >= 30 && i < 36) trans[i][1] = -.4f;  // up
    }
    const PosedMesh standing = poser.pose(theta[0], trans[0], {});
    float lowest = -INFINITY;
    for (size_t k = 1; k < standing.verts.size(); k += 3)
        lowest = std::max(lowest, standing.verts[k]);
    const std::vector<Ground> grounds = groundsOf(poser, theta, trans, {});
    ASSERT_EQ(grounds.size(), 60u);
    for (const Ground& ground : grounds) {
        EXPECT_GT(-ground.up[1], .995) << "up is up";
        EXPECT_NEAR(ground.level, -lowest, .05);
    }
}

TEST(Render, TheShadowIsDarkUnderTheFeet) {
    Scene scene;
    scene.options.background = "#c8c8c8";
    const Image plain = scene.pictures("plain", 3).at(0);
    scene.options.shadow = true;
    const Image shaded = scene.pictures("shaded", 3).at(0);
    int darkest = 0, changedAbove = 0;
    for (int y = 0; y < kSize; ++y)
        for (int x = 0; x < kSize; ++x) {
            const int darker = plain.pixel(x, y)[0] - shaded.pixel(x, y)[0];
            EXPECT_GE(darker, 0);
            darkest = std::max(darkest, darker);
            if (y < kSize / 2) changedAbove += darker != 0;
        }
    EXPECT_GT(darkest, 25);
    // A part of a motion stands where the whole does.
    const std::vector<Image> all = scene.pictures("all", 3);
    scene.options.frames = "4:5";
    EXPECT_EQ(scene.pictures("part", 3).at(0).data, all.at(4).data);
    EXPECT_EQ(changedAbove, 0) << "above the horizon";
}

// ---- sound --------------------------------------------------------------------------------------

TEST(Render, TheSoundOfTheFilmBehindGoesWithIt) {
    Scene scene;
    // A tone while the motion's frames 3 to 5 are seen.
    scene.folder.write("tone.wav", test::wavOfTone(2, 3 / kRate, 2));
    writeGreys(scene.folder / "behind.mp4", 32, 32, 12, kRate,
               {.sound = SoundSource{scene.folder / "tone.wav"}});
    scene.options.background = scene.folder / "behind.mp4";
    const test::ReadFilm film = readFilm(scene.render("out.mp4"));
    EXPECT_EQ(film.sound, "aac");
    EXPECT_NEAR(film.soundEnd, kFrames / kRate, .03);
    EXPECT_LT(film.loudness(.05, .2), .02);
    EXPECT_GT(film.loudness(.3, .45), .25);
    scene.options.frames = "3:6";
    EXPECT_GT(readFilm(scene.render("part.webm")).loudness(.05, .2), .25);
    scene.options.audio = "none";
    EXPECT_EQ(readFilm(scene.render("silent.mp4")).sound, "");
    scene.options.audio = scene.folder / "tone.wav";
    scene.options.frames = "";
    scene.options.background = "#000000";
    const test::ReadFilm other = readFilm(scene.render("other.mov"));
    EXPECT_EQ(other.sound, "pcm_s16le");
    EXPECT_LT(other.loudness(.05, .2), .02);
    EXPECT_GT(other.loudness(.3, .45), .25);
    EXPECT_NE(messageOf<InputError>([&] {
                  scene.render("pictures");
              }).find("pictures: a folder of pictures keeps no sound; name a .mp4, .webm or .mov"),
              std::string::npos);
}

TEST(Render, TheSoundOfTheMotionsClipBeginsWhereItsFramesDo) {
    Folder clips;
    // The capture's frames are 10 to 15 of the clip; a tone while 12 and later are seen.
    clips.write("tone.wav", test::wavOfTone(2, 12 / kRate, 2));
    writeGreys(clips / "clip.mp4", 32, 32, 20, kRate, {.sound = SoundSource{clips / "tone.wav"}});
    Scene scene(clips / "clip.mp4");
    const test::ReadFilm film = readFilm(scene.render("out.mp4"));
    EXPECT_EQ(film.sound, "aac");
    EXPECT_LT(film.loudness(.02, .12), .03);
    EXPECT_GT(film.loudness(.22, .45), .25);
    scene.options.frames = "2:";
    EXPECT_GT(readFilm(scene.render("part.mp4")).loudness(.05, .3), .25);
    // At another speed it would not fit.
    scene.options.fps = 30;
    EXPECT_EQ(readFilm(scene.render("fast.mp4")).sound, "");
    scene.options.fps = 0;
    EXPECT_EQ(scene.pictures("pictures", 3).size(), 4u) << "a folder has none, and needs none";
}

}  // namespace
}  // namespace doppel
