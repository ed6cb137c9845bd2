// The rim of masks, where a person's pixels have colours of what is behind.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/background.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/frame_cache.h"
#include "trainer/eval/evaluate.h"
#include "trainer/stages/rim.h"
#include "trainer/stages/train.h"
#include "trainer/stages/training_frames.h"

namespace doppel {
namespace {

// Someone of two colours before a wall of another, which shines into them: so much, by the distance
// from the outside.
constexpr std::array<double, 3> kLuma{.5, .2, 0}, kChroma{.6, .3, .15};

struct Scene {
    Picture clean, mixed;
};
Scene scene(int seed) {
    constexpr int kSide = 80;
    Scene scene;
    for (Picture* picture : {&scene.clean, &scene.mixed}) picture->width = picture->height = kSide;
    std::mt19937 random(static_cast<unsigned>(seed));
    std::uniform_int_distribution<int> noise(-6, 6);
    for (int y = 0; y < kSide; ++y)
        for (int x = 0; x < kSide; ++x) {
            const int depth = std::min({x - 19, 60 - x, y - 19, 60 - y});  // 1: outermost
            const std::array<double, 3> wall{60, 200., 50},
                shirt = y < 40 ? std::array<double, 3>{120, 60, 70}
                               : std::array<double, 3>{40, 50, 120};
            std::array<double, 3> colour = depth > 0 ? shirt : wall;
            for (double& value : colour) value += noise(random);
            std::array<double, 3> seen = colour;
            if (depth >= 1 && depth <= 3) {
                const auto d = static_cast<size_t>(depth - 1);
                const auto luma = [](const std::array<double, 3>& c) {
                    return .299 * c[0] + .587 * c[1] + .114 * c[2];
                };
                for (size_t c = 0; c < 3; ++c)
                    seen[c] = (1 - kLuma[d]) * luma(colour) + kLuma[d] * luma(wall) +
                              (1 - kChroma[d]) * (colour[c] - luma(colour)) +
                              kChroma[d] * (wall[c] - luma(wall));
            }
            for (Picture* picture : {&scene.clean, &scene.mixed}) {
                picture->mask.push_back(depth > 0 ? 255 : 0);
                for (double value : picture == &scene.clean ? colour : seen)
                    picture->rgb.push_back(static_cast<uint8_t>(std::lround(value)));
            }
        }
    return scene;
}

TEST(Rim, IsMeasuredAndTakenAway) {
    const test::Folder folder;
    CaptureWriter writer(folder / "capture");
    Capture capture;
    capture.name = "rim";
    for (int f = 0; f < 3; ++f) {
        const Scene frame = scene(f);
        const std::string name = fmt::format("{}", f);
        writer.addImage(name, 80, 80, frame.mixed.rgb);
        writer.addMask(name, 80, 80, frame.mixed.mask);
        capture.frames.push_back({name, {}, {}, {80, 80, 40, 40, 80, 80}});
        capture.theta.push_back({});
        capture.trans.push_back({0, 0, 3});
    }
    capture = writer.commit(capture);
    FrameCache frames(capture);
    const RimProfile rim = measureRim(capture, frames, 5);
    ASSERT_EQ(rim.luma.size(), 5u);
    for (size_t d = 0; d < 5; ++d) {
        EXPECT_NEAR(rim.luma[d], d < 3 ? kLuma[d] : 0, .05) << d;
        EXPECT_NEAR(rim.chroma[d], d < 3 ? kChroma[d] : 0, .05) << d;
    }
    const Scene frame = scene(0);
    const std::vector<uint8_t> found = unmixed(frame.mixed, rim);
    double before = 0, after = 0;
    for (size_t i = 0; i < found.size(); ++i) {
        if (!frame.mixed.mask[i / 3]) {
            EXPECT_EQ(found[i], frame.mixed.rgb[i]) << "outside";
            continue;
        }
        before += std::abs(frame.mixed.rgb[i] - frame.clean.rgb[i]);
        after += std::abs(found[i] - frame.clean.rgb[i]);
    }
    EXPECT_LT(after, before / 5);
    EXPECT_EQ(unmixed(frame.mixed, measureRim(capture, frames, 0)), frame.mixed.rgb);
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
    const Avatar with = trained(3, "with"), without = trained(0, "without");
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

TEST_F(GreenScreen, TrainingSeesFramesWithoutTheRim) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    FrameCache cache(green_);
    const TrainingFrames as(testDevice(), body, green_, cache, 160,
                            {.colours = true, .edges = true}),
        filled(testDevice(), body, green_, cache, 160, {.colours = true, .edges = true, .rim = 3});
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
