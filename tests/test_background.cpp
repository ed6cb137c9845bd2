// Background plates against a wall that is known.
#include "trainer/avatar/background.h"

#include <gtest/gtest.h>

#include <functional>

#include "engine/error.h"
#include "engine/io/image.h"
#include "tests/files.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

constexpr int kWidth = 40, kHeight = 24;
constexpr uint8_t kSkin = 250;  // no wall is as bright

uint8_t wall(int x, int y, int c) { return static_cast<uint8_t>(4 * x + 2 * y + 10 * c); }

struct Box {
    int left, top, right, bottom;  // right and bottom are outside
    bool has(int x, int y, int grown = 0) const {
        return x >= left - grown && x < right + grown && y >= top - grown && y < bottom + grown;
    }
};

// Frames before `wall`, the person a bright box that its mask gives exactly.
Capture walk(const Folder& folder, const std::vector<Box>& boxes,
             const std::function<void(size_t, Image&)>& disturb = {}) {
    Capture capture;
    capture.folder = folder.path();
    for (size_t f = 0; f < boxes.size(); ++f) {
        Image image(kWidth, kHeight, 3), mask(kWidth, kHeight, 1);
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                bool person = boxes[f].has(x, y);
                *mask.pixel(x, y) = person ? 255 : 0;
                for (int c = 0; c < 3; ++c) image.pixel(x, y)[c] = person ? kSkin : wall(x, y, c);
            }
        if (disturb) disturb(f, image);
        std::string name = fmt::format("{:03}", f);
        Frame frame{name,
                    folder / (name + ".png"),
                    folder / (name + "_mask.png"),
                    {30, 30, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight}};
        writeImage(frame.image, image);
        writeImage(*frame.mask, mask);
        capture.frames.push_back(frame);
    }
    capture.theta.resize(boxes.size());
    capture.trans.resize(boxes.size());
    return capture;
}

int byteAt(const std::vector<float>& plate, int x, int y, int c) {
    return static_cast<int>(
        std::lround(255 * plate.at(static_cast<size_t>(3 * (y * kWidth + x) + c))));
}

// Pixels of the plate, in bytes, that are not the wall's.
size_t wrongPixels(const std::vector<float>& plate, const std::function<bool(int, int)>& counts) {
    size_t wrong = 0;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
            for (int c = 0; c < 3; ++c)
                if (counts(x, y) && byteAt(plate, x, y, c) != wall(x, y, c)) ++wrong;
    return wrong;
}
constexpr auto kEverywhere = [](int, int) { return true; };

TEST(BackgroundPlate, IsTheWallThatAPersonWalksAlong) {
    Folder folder;
    std::vector<Box> boxes;
    for (int f = 0; f < 5; ++f) boxes.push_back({8 * f, 6, 8 * f + 8, 20});
    // A shine around the person that the mask does not know of; a lamp that is on in one frame.
    Capture capture = walk(folder, boxes, [&](size_t f, Image& image) {
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                bool shine = boxes[f].has(x, y, 2) && !boxes[f].has(x, y);
                bool lamp = f == 2 && y < 2;
                for (int c = 0; c < 3 && (shine || lamp); ++c) image.pixel(x, y)[c] = 200;
            }
    });
    FrameCache frames(capture);
    BackgroundPlate plate(capture, frames);
    EXPECT_EQ(plate.width(), kWidth);
    EXPECT_EQ(plate.height(), kHeight);
    ASSERT_EQ(plate.plate().size(), size_t{3} * kWidth * kHeight);
    EXPECT_EQ(wrongPixels(plate.plate(), kEverywhere), 0u);

    // Behind frame 2: its own lamp, but neither the person nor the shine.
    std::vector<float> behind = plate.behind(*frames.load(2));
    EXPECT_EQ(byteAt(behind, 30, 1, 1), 200);
    EXPECT_EQ(wrongPixels(behind, [](int, int y) { return y >= 2; }), 0u);
}

TEST(BackgroundPlate, TakesItsFramesFromTheWholeCapture) {
    // The light is off in the first third.
    Folder folder;
    std::vector<Box> boxes(96, Box{0, 0, 0, 0});
    Capture capture = walk(folder, boxes, [](size_t f, Image& image) {
        if (f < 32) std::ranges::fill(image.data, uint8_t{3});
    });
    FrameCache frames(capture);
    EXPECT_EQ(wrongPixels(BackgroundPlate(capture, frames).plate(), kEverywhere), 0u);
}

TEST(BackgroundPlate, FillsInWhatNobodyEverSees) {
    Folder folder;
    Box still{16, 8, 24, 16};
    Capture capture = walk(folder, {still, still, still});
    FrameCache frames(capture);
    BackgroundPlate plate(capture, frames);
    auto hidden = [&](int x, int y) { return still.has(x, y, 3); };
    EXPECT_EQ(wrongPixels(plate.plate(), [&](int x, int y) { return !hidden(x, y); }), 0u);
    // Inside, colours of the wall nearby: within the range of the ring of four pixels around it.
    for (int c = 0; c < 3; ++c) {
        int low = wall(still.left - 7, still.top - 7, c),
            high = wall(still.right + 6, still.bottom + 6, c);
        for (int y = still.top - 3; y < still.bottom + 3; ++y)
            for (int x = still.left - 3; x < still.right + 3; ++x) {
                ASSERT_GE(byteAt(plate.plate(), x, y, c), low) << x << " " << y;
                ASSERT_LE(byteAt(plate.plate(), x, y, c), high) << x << " " << y;
            }
    }

    Folder all;
    Capture covered = walk(all, {Box{0, 0, kWidth, kHeight}});
    FrameCache coveredFrames(covered);
    BackgroundPlate nothing(covered, coveredFrames);
    for (float value : nothing.plate()) ASSERT_EQ(value, 0.5f);
}

TEST(BackgroundPlate, NeedsMasksAndOneSize) {
    Folder folder;
    Capture capture = walk(folder, {Box{0, 0, 4, 4}, Box{8, 8, 12, 12}});
    FrameCache frames(capture);
    Capture sizes = capture;
    sizes.frames[1].camera.width = 41;
    EXPECT_NE(messageOf<InputError>([&] {
                  BackgroundPlate(sizes, frames);
              }).find("frame 001 is 41×24, the first is 40×24; frames of one size"),
              std::string::npos);
    Capture bare = capture;
    bare.frames[1].mask.reset();
    EXPECT_NE(messageOf<InputError>([&] { BackgroundPlate(bare, frames); }).find("001"),
              std::string::npos);
}

TEST(Composite, LetsTheBackgroundThroughWhereTheRenderIsThin) {
    // Nothing, half, and all of a pixel covered by white.
    std::vector<float> rgb{0, 0, 0, 0.6f, 0.6f, 0.6f, 1, 1, 1};
    std::vector<float> background{0.1f, 0.2f, 0.3f, 0.5f, 1, 0, 0.7f, 0.7f, 0.7f};
    std::vector<float> result = composite(rgb, {0, 153, 255}, background);
    const std::vector<float> expected{0.1f, 0.2f, 0.3f, 0.8f, 1, 0.6f, 1, 1, 1};
    for (size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(result[i], expected[i], 1e-6) << i;
}

TEST(DilateMask, GrowsBySquares) {
    std::vector<uint8_t> mask(7 * 5);
    mask[2 * 7 + 0] = 255;  // at the left border
    mask[4 * 7 + 6] = 9;    // in the lower right corner
    std::vector<uint8_t> grown = dilateMask(mask, 7, 5, 1);
    for (int y = 0; y < 5; ++y)
        for (int x = 0; x < 7; ++x) {
            int expected = x <= 1 && y >= 1 && y <= 3 ? 255 : x >= 5 && y >= 3 ? 9 : 0;
            EXPECT_EQ(grown[static_cast<size_t>(y * 7 + x)], expected) << x << " " << y;
        }
    EXPECT_EQ(dilateMask(mask, 7, 5, 0), mask);
    EXPECT_EQ(dilateMask(mask, 7, 5, 100), std::vector<uint8_t>(35, 255));
}

}  // namespace
}  // namespace doppel
