// The rim of masks, where a person's pixels have colours of what is behind.
#include <gtest/gtest.h>

#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/background.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/frame_cache.h"
#include "trainer/eval/evaluate.h"
#include "trainer/stages/back_projection.h"
#include "trainer/stages/rim.h"
#include "trainer/stages/train.h"
#include "trainer/stages/training_frames.h"

namespace doppel {
namespace {

// A square of one colour with a thin arm, before a wall of another, which shines two pixels in.
Picture fringed() {
    Picture picture;
    picture.width = 24, picture.height = 20;
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 24; ++x) {
            const bool square = x >= 4 && x < 16 && y >= 4 && y < 16, arm = x >= 16 && y == 10,
                       inner = x >= 6 && x < 14 && y >= 6 && y < 14;
            picture.mask.push_back(square || arm ? 255 : 0);
            for (int colour : {40, inner ? 50 : square ? 150 : 240, 60})
                picture.rgb.push_back(static_cast<uint8_t>(colour));
        }
    return picture;
}

TEST(Rim, TakesTheColoursOfTheInside) {
    const Picture picture = fringed();
    EXPECT_EQ(withoutRim(picture, 0), picture.rgb);
    for (int beyond : {0, 1}) {
        const std::vector<uint8_t> rgb = withoutRim(picture, 2, beyond);
        for (int y = 0; y < 20; ++y)
            for (int x = 0; x < 24; ++x) {
                const auto at = static_cast<size_t>(y * 24 + x);
                const bool filled = x >= 4 - beyond && x < 16 + beyond && y >= 4 - beyond &&
                                    y < 16 + beyond,
                           // The arm is all rim; where it begins the square's inside is near.
                    arm = x >= (y == 10 ? 16 : 16 + beyond) && x < 20 && y >= 10 - beyond &&
                          y <= 10 + beyond;
                if (arm) continue;
                EXPECT_EQ(rgb[3 * at + 1], filled ? 50 : picture.rgb[3 * at + 1]) << x << " " << y;
                EXPECT_EQ(rgb[3 * at], 40);
                EXPECT_EQ(rgb[3 * at + 2], 60);
            }
    }
}

// A bar of four pixels has an inside of two, for want of a deeper one.
TEST(Rim, OfThinPartsIsTheirMiddle) {
    Picture bar;
    bar.width = 12, bar.height = 30;
    for (int y = 0; y < 30; ++y)
        for (int x = 0; x < 12; ++x) {
            const bool inside = x >= 4 && x < 8, middle = x == 5 || x == 6;
            bar.mask.push_back(inside ? 255 : 0);
            for (int c = 0; c < 3; ++c)
                bar.rgb.push_back(static_cast<uint8_t>(middle ? 90 : inside ? 150 : 200));
        }
    const std::vector<uint8_t> rgb = withoutRim(bar, 4);
    for (size_t x = 0; x < 12; ++x)
        EXPECT_EQ(rgb[3 * (15 * 12 + x)], x >= 4 && x < 8 ? 90 : 200) << x;
}

// Two pixels of hair around a face: the border has the hair's colour, not the face's.
TEST(Rim, TakesTheNearestColours) {
    constexpr int kSize = 24;
    Picture head;
    head.width = head.height = kSize;
    for (int y = 0; y < kSize; ++y)
        for (int x = 0; x < kSize; ++x) {
            const int depth = std::min({x, y, kSize - 1 - x, kSize - 1 - y}) - 3;
            head.mask.push_back(depth > 0 ? 255 : 0);
            for (int c = 0; c < 3; ++c)
                head.rgb.push_back(depth <= 0 ? 200 : depth == 1 ? 120 : depth < 4 ? 30 : 240);
        }
    for (int beyond : {0, 1}) {
        const std::vector<uint8_t> rgb = withoutRim(head, 1, beyond);
        const size_t row = 3 * kSize * 12;
        EXPECT_EQ(rgb[row + 3 * 3], beyond ? 30 : 200);
        EXPECT_EQ(rgb[row + 3 * 4], 30);
        EXPECT_EQ(rgb[row + 3 * 5], 30);
        EXPECT_EQ(rgb[row + 3 * 7], 240);
    }
}

// A turn in front of a green screen that shines two pixels into her, and the same without it.
class GreenScreen : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = new test::Folder;
        SyntheticOptions options;
        options.size = 128;
        options.samples = 2;
        options.poseNoiseDegrees = options.transNoiseMetres = 0;
        clean_ = renderActor(testDevice(), readActor(assetFolder() / "actor", "woman"),
                             actorSession(12, 0, kActorDistance), *folder_ / "clean", options);
        CaptureWriter writer(*folder_ / "green");
        FrameCache cache(clean_);
        for (size_t f = 0; f < clean_.size(); ++f) {
            Picture picture = *cache.load(f);
            std::vector<uint8_t> outside(picture.mask.size());
            for (size_t i = 0; i < outside.size(); ++i)
                outside[i] = picture.mask[i] > 127 ? 0 : 255;
            const std::vector<uint8_t> rim = dilateMask(outside, 128, 128, 2);
            constexpr std::array<int, 3> kGreen{60, 220, 40};
            for (size_t i = 0; i < rim.size(); ++i)
                for (size_t c = 0; rim[i] && c < 3; ++c) {
                    const int here = outside[i] ? kGreen[c] : picture.rgb[3 * i + c];
                    picture.rgb[3 * i + c] = static_cast<uint8_t>((here + 2 * kGreen[c]) / 3);
                }
            writer.addImage(clean_.frames[f].name, 128, 128, picture.rgb);
            writer.addMask(clean_.frames[f].name, 128, 128, picture.mask);
        }
        green_ = writer.commit(clean_);
    }
    static void TearDownTestSuite() { delete folder_; }

    Avatar trained(int rim, const char* name) {
        Avatar avatar;
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        avatar.preset = test::tinyPreset();
        avatar.preset.texture.textureSize = 128;
        avatar.preset.shape.steps = 60;
        avatar.preset.texels.samples = 1;
        avatar.preset.texels.steps = 120;
        avatar.preset.texels.rim = rim;
        TrainSettings settings;
        settings.out = *folder_ / name;
        settings.stages = {"shape", "texels"};
        settings.pictureSeconds = 1e9;
        return trainAvatar(testDevice(), std::move(avatar),
                           green_.subset(std::vector<size_t>{0, 2, 4, 6, 8, 10}), settings)
            .avatar;
    }
    // Against the frames between, which no screen shines into.
    double heldOut(const Avatar& avatar) {
        Capture unseen = clean_.subset(std::vector<size_t>{1, 3, 5, 7, 9, 11});
        unseen.betas = avatar.betas;
        return meanMetrics(evaluateAvatar(testDevice(), avatar, unseen)).psnrBody;
    }

    static inline test::Folder* folder_ = nullptr;
    static inline Capture clean_, green_;
};

TEST_F(GreenScreen, DoesNotGetIntoTheTexture) {
    const Avatar with = trained(2, "with"), without = trained(0, "without");
    EXPECT_GT(heldOut(with), heldOut(without) + .5);
    // What is greener than red and blue, which nothing of her is.
    auto green = [](const Avatar& avatar) {
        size_t count = 0;
        for (size_t i = 0; i < avatar.texture.size(); i += 3)
            count +=
                avatar.texture[i + 1] > std::max(avatar.texture[i], avatar.texture[i + 2]) + .1f;
        return count;
    };
    EXPECT_LT(green(with), green(without) / 2);
}

// Of a small picture the second pixel from the outline may be all that shows the hair at a temple.
TEST_F(GreenScreen, FirstTexelsKeepABandOfTwoPixels) {
    CaptureWriter writer(*folder_ / "band");
    FrameCache cache(clean_);
    Picture picture = *cache.load(0);
    std::vector<uint8_t> outside(picture.mask.size());
    std::ranges::transform(picture.mask, outside.begin(),
                           [](uint8_t m) { return static_cast<uint8_t>(m > 127 ? 0 : 255); });
    const std::vector<uint8_t> border = dilateMask(outside, 128, 128, 1),
                               band = dilateMask(outside, 128, 128, 2);
    constexpr std::array<uint8_t, 3> kBand{255, 0, 255};
    for (size_t i = 0; i < band.size(); ++i)
        if (band[i] && !border[i]) std::ranges::copy(kBand, &picture.rgb[3 * i]);
    writer.addImage(clean_.frames[0].name, 128, 128, picture.rgb);
    writer.addMask(clean_.frames[0].name, 128, 128, picture.mask);
    Capture capture = writer.commit(clean_.subset(std::vector<size_t>{0}));
    FrameCache frames(capture);
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const FirstTexels first = backProject(testDevice(), body, capture, frames, 128, 0);
    size_t seen = 0, ofBand = 0;
    for (size_t i = 0; i < first.origin.size(); ++i) {
        if (first.origin[i] != kFromFrames) continue;
        ++seen;
        ofBand += first.texture[3 * i + 1] < .1f && first.texture[3 * i + 2] > .8f;
    }
    EXPECT_GT(double(ofBand), .2 * double(seen));  // .45, and .02 where two pixels are painted over
}

// In other scenes frames stay as they are.
TEST_F(GreenScreen, IsToldFromAFurnishedRoom) {
    FrameCache screen(green_), room(clean_);
    EXPECT_EQ(rimBeforeScreen(green_, screen, 4), 4);
    EXPECT_EQ(rimBeforeScreen(green_, screen, 0), 0);
    EXPECT_EQ(rimBeforeScreen(clean_, room, 4), 0);
}

TEST_F(GreenScreen, TrainingSeesFramesWithoutTheRim) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    FrameCache cache(green_);
    const TrainingFrames as(testDevice(), body, green_, cache, 160,
                            {.colours = true, .edges = true}),
        filled(testDevice(), body, green_, cache, 160, {.colours = true, .edges = true, .rim = 2});
    EXPECT_EQ(as.mask(0), filled.mask(0));
    const std::vector<float> before = as.image(0), after = filled.image(0), mask = as.mask(0);
    int changed = 0;
    for (size_t i = 0; i < mask.size(); ++i) {
        const bool differs = !std::equal(&before[3 * i], &before[3 * i] + 3, &after[3 * i]);
        EXPECT_FALSE(mask[i] == 0 && differs) << "outside";
        changed += differs;
    }
    EXPECT_GT(changed, 200);
}

}  // namespace
}  // namespace doppel
