// Masks that are kept as runs: the same pixels, of the file as it is now, within a budget.
#include "trainer/data/pictures/mask_runs.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <random>

#include "tests/files.h"

namespace doppel::test {
namespace {

namespace fs = std::filesystem;

// Runs of so many pixels in the mean, the first of the person or not.
Image patches(int width, int height, double length, bool startsWithPerson, uint32_t seed) {
    Image mask(width, height, 1);
    std::mt19937 random(seed);
    std::geometric_distribution<int> runs(1 / length);
    bool person = startsWithPerson;
    int left = 1 + runs(random);
    for (uint8_t& pixel : mask.data) {
        if (left-- == 0) person = !person, left = runs(random);
        pixel = person ? 255 : 0;
    }
    return mask;
}

TEST(MaskRuns, AreTheMask) {
    for (double length : {1.5, 20., 300., 40000.})
        for (bool person : {false, true})
            for (int width : {1, 7, 640}) {
                const Image mask = patches(width, 480, length, person, 3);
                const Image back = maskOfRuns(maskRuns(mask), width, 480);
                EXPECT_EQ(back.data, mask.data) << length << " " << person << " " << width;
                EXPECT_EQ(back.width, width);
                EXPECT_EQ(back.channels, 1);
            }
    for (uint8_t all : {uint8_t{0}, uint8_t{255}}) {
        const Image mask(3840, 2160, 1, all);
        EXPECT_LE(maskRuns(mask).size(), 5u);
        EXPECT_EQ(maskOfRuns(maskRuns(mask), 3840, 2160).data, mask.data);
    }
}

TEST(MaskRuns, AreOfTheFileAsItIsNow) {
    const Folder folder;
    const fs::path file = folder / "mask.png";
    const Image mask = patches(64, 48, 9, false, 1);
    KeptMasks masks(size_t{1} << 20);
    EXPECT_FALSE(masks.find(file));
    masks.keep(file, mask);  // which is not there
    EXPECT_FALSE(masks.find(file));
    writeImage(file, mask);
    masks.keep(file, mask);
    ASSERT_TRUE(masks.find(file));
    EXPECT_EQ(masks.find(file)->data, mask.data);
    EXPECT_FALSE(masks.find(folder / "other.png"));
    fs::last_write_time(file, fs::last_write_time(file) + std::chrono::seconds(1));
    EXPECT_FALSE(masks.find(file));
}

TEST(MaskRuns, AreTheLatestWithinTheBudget) {
    const Folder folder;
    const Image mask = patches(64, 48, 9, false, 1);
    const size_t size = maskRuns(mask).size();
    KeptMasks masks(3 * size);
    auto file = [&](int i) { return folder / fmt::format("{}.png", i); };
    for (int i = 0; i < 4; ++i) writeImage(file(i), mask);
    for (int i = 0; i < 3; ++i) masks.keep(file(i), mask);
    EXPECT_TRUE(masks.find(file(0)));  // 1 is the oldest now
    masks.keep(file(3), mask);
    EXPECT_TRUE(masks.find(file(0)));
    EXPECT_FALSE(masks.find(file(1)));
    EXPECT_TRUE(masks.find(file(2)));
    EXPECT_TRUE(masks.find(file(3)));
    masks.keep(file(2), mask);  // again: it is there once
    EXPECT_TRUE(masks.find(file(0)));
    EXPECT_TRUE(masks.find(file(3)));
    masks.keep(file(1), patches(640, 480, 3, true, 2));  // larger than the budget
    for (int i = 0; i < 4; ++i) EXPECT_FALSE(masks.find(file(i))) << i;
}

}  // namespace
}  // namespace doppel::test
