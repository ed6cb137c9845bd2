// What ranks decode of a capture: each its part, and all of them get what one process alone has.
#include "trainer/data/shared_work.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>

#include "tests/files.h"
#include "tests/thread_ranks.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/background.h"
#include "trainer/data/capture_writer.h"
#include "trainer/stages/back_projection.h"
#include "trainer/stages/fit.h"
#include "trainer/stages/rim.h"
#include "trainer/stages/telling_frames.h"
#include "trainer/stages/training_frames.h"

namespace doppel::test {
namespace {

TEST(SharedWork, ReachesAllInOrderAndIsDoneOnce) {
    for (int count : {1, 2, 3, 5})
        for (size_t things : {0u, 1u, 4u, 150u}) {
            std::atomic<size_t> made = 0;
            ThreadRanks::run(count, [&](Ranks& ranks) {
                size_t next = 0;
                shareWork(
                    &ranks, things,
                    [&](size_t i) {
                        EXPECT_TRUE(isMine(&ranks, i));
                        ++made;
                        return std::vector<uint8_t>(i % 7, static_cast<uint8_t>(i));
                    },
                    [&](size_t i, std::span<const uint8_t> bytes) {
                        EXPECT_EQ(i, next++);
                        EXPECT_EQ(bytes.size(), i % 7);
                        for (uint8_t byte : bytes) EXPECT_EQ(byte, static_cast<uint8_t>(i));
                    });
                EXPECT_EQ(next, things);
            });
            EXPECT_EQ(made, things);
        }
}

TEST(SharedWork, GathersNumbersAndSums) {
    for (int count : {1, 2, 4})
        ThreadRanks::run(count, [&](Ranks& ranks) {
            std::vector<double> mine;
            for (size_t i = 0; i < 9; ++i)
                if (isMine(&ranks, i)) mine.push_back(static_cast<double>(i) / 3);
            const std::vector<double> all = ofAllRanks(&ranks, 9, mine);
            ASSERT_EQ(all.size(), 9u);
            for (size_t i = 0; i < 9; ++i) EXPECT_EQ(all[i], static_cast<double>(i) / 3);
            std::vector<double> sums{1.0 * ranks.rank(), 2, 1e300};
            sumOverRanks(&ranks, sums);
            EXPECT_EQ(sums[0], count * (count - 1) / 2);
            EXPECT_EQ(sums[1], 2 * count);
            EXPECT_EQ(sums[2], 1e300 * count);
        });
}

TEST(SharedWork, ThrowsWhatAThreadThrew) {
    size_t taken = 0;
    EXPECT_THROW(inParallel(
                     20,
                     [](size_t i) {
                         if (i == 5) throwInput("the sixth");
                         return i;
                     },
                     [&](size_t i, size_t made) { taken += i == made; }),
                 InputError);
    EXPECT_EQ(taken, 5u);
}

class SharedFrames : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<Folder>();
        capture_ = tinyCapture(*folder_ / "capture");
        body_ = bodyFromNpz(readBodyArrays("default"));
    }
    static void TearDownTestSuite() { folder_.reset(); }

    // Runs it as one process, as two and as four. Whatever a rank finds, all find, and the same as
    // one process where `sameBits`; the pictures decoded by all of them are no more than one's.
    template <typename Find>
    static void expectShared(const Find& find, bool sameBits = true) {
        const uint64_t before = FrameCache::decoded();
        FrameCache cache(capture_);
        const std::vector<float> alone = find(testDevice(), cache, nullptr);
        const uint64_t decoded = FrameCache::decoded() - before;
        ASSERT_FALSE(alone.empty());
        ASSERT_GT(decoded, 0u);
        for (int count : {2, 4}) {
            std::vector<std::vector<float>> found(static_cast<size_t>(count)), again(found);
            const uint64_t start = FrameCache::decoded();
            auto run = [&](std::vector<std::vector<float>>& to) {
                ThreadRanks::run(count, [&](Ranks& ranks, Device& device) {
                    FrameCache own(capture_);
                    to[static_cast<size_t>(ranks.rank())] = find(device, own, &ranks);
                });
            };
            run(found);
            EXPECT_EQ(FrameCache::decoded() - start, decoded) << "by " << count;
            for (const auto& one : found) EXPECT_EQ(one, found[0]) << "of " << count;
            if (sameBits) {
                EXPECT_EQ(found[0], alone) << "of " << count;
                continue;
            }
            ASSERT_EQ(found[0].size(), alone.size());
            for (size_t i = 0; i < alone.size(); ++i) EXPECT_NEAR(found[0][i], alone[i], 1e-5);
            run(again);
            EXPECT_EQ(again[0], found[0]) << "every time";
        }
    }

    static inline std::unique_ptr<Folder> folder_;
    static inline Capture capture_;
    static inline BodyModel body_;
};

TEST_F(SharedFrames, TrainingSeesTheSameCrops) {
    for (uint64_t budget : {0u, 1000u})
        expectShared([&](Device& device, FrameCache& cache, Ranks* ranks) {
            const TrainingFrames frames(
                device, body_, capture_, cache, 64,
                {.colours = true, .memoryBudget = budget, .edges = true, .ranks = ranks});
            std::vector<float> all;
            for (size_t i = 0; i < frames.count(); ++i) {
                for (const std::vector<float>& part :
                     {frames.mask(i), frames.image(i), frames.inside(i)})
                    all.insert(all.end(), part.begin(), part.end());
                all.push_back(frames.scale(i));
                all.push_back(static_cast<float>(frames.camera(i).cx));
                all.push_back(static_cast<float>(frames.box(i).half));
            }
            return all;
        });
}

TEST_F(SharedFrames, TheBackgroundIsTheSame) {
    expectShared([&](Device&, FrameCache& cache, Ranks* ranks) {
        return BackgroundPlate(capture_, cache, ranks).plate();
    });
}

TEST_F(SharedFrames, TheScreenIsTheSame) {
    expectShared([&](Device&, FrameCache& cache, Ranks* ranks) {
        return std::vector<float>{static_cast<float>(rimBeforeScreen(capture_, cache, 4, ranks))};
    });
}

TEST_F(SharedFrames, SilhouettesAreComparedAlike) {
    expectShared([&](Device& device, FrameCache& cache, Ranks* ranks) {
        const std::vector<double> ious =
            silhouetteIous(device, body_, {&capture_}, cache, ranks)[0];
        return std::vector<float>(ious.begin(), ious.end());
    });
}

// In every second pixel, in every third: half a pixel beside them would cost almost a hundredth.
TEST_F(SharedFrames, SilhouettesOfLargeFramesAreComparedInSomePixels) {
    const Actor actor = readActor(assetFolder() / "actor", "woman");
    for (int size : {1700, 3200}) {
        const Folder folder;
        const Capture large =
            renderActor(testDevice(), actor, actorSession(2, 0, kActorDistance), folder / "capture",
                        {.size = size, .poseNoiseDegrees = 0, .transNoiseMetres = 0, .samples = 1});
        FrameCache cache(large);
        Capture lower = large;
        lower.trans[0][1] += .05f;
        const uint64_t before = FrameCache::decoded();
        const auto ious = silhouetteIous(testDevice(), actor.body, {&large, &lower}, cache);
        EXPECT_EQ(FrameCache::decoded() - before, large.size());
        for (double iou : ious[0]) EXPECT_GT(iou, .999) << size;
        EXPECT_LT(ious[1][0], .95);
    }
}

// A frame that has fewer rows than the step that its columns ask for.
TEST_F(SharedFrames, SilhouettesOfAFrameOfOneRowAreCompared) {
    const Folder folder;
    constexpr int kColumns = 4000;
    const std::vector<uint8_t> rgb(3 * kColumns), mask(kColumns, 255);
    Capture capture;
    capture.name = "a row";
    CaptureWriter writer(folder / "capture");
    writer.addImage("f0", kColumns, 1, rgb);
    writer.addMask("f0", kColumns, 1, mask);
    capture.frames.push_back({"f0", {}, {}, {4000, 4000, kColumns / 2., 0, kColumns, 1}});
    capture.theta.resize(1);
    capture.trans.push_back({0, 0, 3});
    writer.commit(capture);
    const Capture row = readCapture(folder / "capture");
    FrameCache cache(row);
    const std::vector<double> ious = silhouetteIous(testDevice(), body_, {&row}, cache)[0];
    ASSERT_EQ(ious.size(), 1u);
    EXPECT_GT(ious[0], .01);
    EXPECT_LT(ious[0], .5);
}

TEST_F(SharedFrames, TellingFramesAreTheSame) {
    // Every frame has one like it two frames away; others are not decoded.
    Capture pairs = capture_;
    for (size_t i = 0; i + 2 < pairs.size(); ++i)
        if (i / 2 % 2 == 0) pairs.theta[i + 2] = pairs.theta[i];
    expectShared([&](Device&, FrameCache& cache, Ranks* ranks) {
        const std::vector<size_t> taken = tellingFrames(pairs, cache, 3, ranks);
        return std::vector<float>(taken.begin(), taken.end());
    });
}

// Sums of what ranks saw, in the order of ranks: other roundings, and the same every time.
TEST_F(SharedFrames, FirstTexelsDifferByRounding) {
    expectShared(
        [&](Device& device, FrameCache& cache, Ranks* ranks) {
            return backProject(device, body_, capture_, cache, 64, 0, ranks).texture;
        },
        false);
}

}  // namespace
}  // namespace doppel::test
