// The frames that training sees: the same pixels however they are kept, and drawn as foretold.
#include "trainer/stages/training_frames.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/motion/synthetic.h"

namespace doppel {
namespace {

TEST(FrameSampler, ForetellsWhatItDraws) {
    for (std::vector<double> weights : {std::vector<double>{}, {1, 2, 3, 4, 5}}) {
        FrameSampler sampler(5, 7, weights);
        for (int round = 0; round < 4; ++round)
            for (int count : {1, 3, 7}) {
                std::vector<size_t> foretold = sampler.peek(count), drawn;
                for (int i = 0; i < count; ++i) drawn.push_back(sampler.next());
                EXPECT_EQ(foretold, drawn);
            }
    }
}

TEST(TrainingFrames, AreTheSameCompressedAndPrepared) {
    Actor actor = readActor(assetFolder() / "actor", "woman");
    SyntheticOptions options;
    options.size = 96;
    options.samples = 1;
    test::Folder folder;
    Capture capture = renderActor(testDevice(), actor, actorSession(3, 0, kActorDistance),
                                  folder / "capture", options);
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    FrameCache cache(capture);
    TrainingFrames raw(testDevice(), body, capture, cache, 64, {.colours = true});
    TrainingFrames packed(testDevice(), body, capture, cache, 64,
                          {.colours = true, .memoryBudget = 1000});
    EXPECT_FALSE(raw.compressed());
    EXPECT_EQ(raw.bytesKept(), capture.size() * 64 * 64 * 4);
    EXPECT_TRUE(packed.compressed());
    EXPECT_LT(packed.bytesKept(), raw.bytesKept() / 2);  // much of a crop is plain
    // What is more than the budget even so is in a file.
    EXPECT_EQ(raw.bytesInMemory(), raw.bytesKept());
    EXPECT_GT(packed.bytesKept(), 1000u);
    EXPECT_LE(packed.bytesInMemory(), 1000u);
    std::vector<size_t> some{2, 0, 2};
    for (int round = 0; round < 2; ++round) {
        for (size_t i = 0; i < capture.size(); ++i) {
            EXPECT_EQ(raw.mask(i), packed.mask(i));
            EXPECT_EQ(raw.image(i), packed.image(i));
        }
        packed.prepare(some);
    }
}

TEST(ByteStore, KeepsWhatItIsGivenWithinItsBudget) {
    ByteStore store(1000);
    std::vector<std::vector<uint8_t>> given;
    for (size_t i = 0; i < 50; ++i) {
        given.emplace_back(i * 7, static_cast<uint8_t>(i));
        EXPECT_EQ(store.add(given.back()), i);
    }
    const ByteStore moved = std::move(store);
    for (size_t i = 0; i < given.size(); ++i) EXPECT_EQ(moved.read(i), given[i]);
    EXPECT_LE(moved.bytesInMemory(), 1000u);
    EXPECT_EQ(moved.bytesInMemory() + moved.bytesInFile(), 7u * 49 * 50 / 2);
}

TEST(ByteStore, SaysWhereItCannotPutMore) {
    const char* before = std::getenv("TMPDIR");
    const std::string kept = before ? before : "";
    setenv("TMPDIR", "/nowhere/at/all", 1);
    ByteStore store(10);
    store.add(std::vector<uint8_t>(10));
    const std::string refusal =
        test::messageOf<MachineError>([&] { store.add(std::vector<uint8_t>(1)); });
    before ? setenv("TMPDIR", kept.c_str(), 1) : unsetenv("TMPDIR");
    EXPECT_EQ(refusal.find("/nowhere/at/all: no file can be made"), 0u) << refusal;
}

// Where edges are compared a small frame is cut at its own pixels, and what is behind the person is
// there.
TEST(TrainingFrames, KeepTheFramesOwnPixels) {
    Actor actor = readActor(assetFolder() / "actor", "woman");
    SyntheticOptions options;
    options.size = 96;
    options.samples = 1;
    test::Folder folder;
    Capture capture = renderActor(testDevice(), actor, actorSession(4, 0, kActorDistance),
                                  folder / "capture", options);
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    FrameCache cache(capture);
    const BackgroundPlates scene(capture, cache);
    constexpr int kSide = 128;  // the body's box fits
    TrainingFrames frames(testDevice(), body, capture, cache, kSide,
                          {.colours = true, .edges = true, .scene = &scene});
    for (size_t i = 0; i < capture.size(); ++i) {
        const auto picture = cache.load(i);
        const std::vector<float> image = frames.image(i), inside = frames.inside(i);
        const std::vector<float> background = frames.background(i), mask = frames.mask(i);
        const Camera& camera = frames.camera(i);
        EXPECT_EQ(camera.fx, capture.frames[i].camera.fx);
        const int left = int(std::lround(capture.frames[i].camera.cx - camera.cx));
        const int top = int(std::lround(capture.frames[i].camera.cy - camera.cy));
        int within = 0, alike = 0, outside = 0;
        for (int y = 0; y < kSide; ++y)
            for (int x = 0; x < kSide; ++x) {
                const int u = x + left, v = y + top;
                const bool there = u >= 0 && v >= 0 && u < 96 && v < 96;
                const auto at = size_t(y * kSide + x);
                EXPECT_EQ(inside[at], there ? 1 : 0);
                if (!there) continue;
                ++within;
                for (size_t c = 0; c < 3; ++c)
                    EXPECT_EQ(std::lround(255 * image[3 * at + c]),
                              picture->rgb[3 * size_t(v * 96 + u) + c]);
                if (mask[at] > 0) continue;
                ++outside;
                alike += std::abs(background[3 * at] - image[3 * at]) < .02f;
            }
        EXPECT_GT(within, 96 * 60);
        EXPECT_GT(alike, outside * 9 / 10);
    }
}

}  // namespace
}  // namespace doppel
