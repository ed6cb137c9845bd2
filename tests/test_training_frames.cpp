// The frames that training sees: the same pixels however they are kept, and drawn as foretold.
#include "trainer/stages/training_frames.h"

#include <gtest/gtest.h>

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
    TrainingFrames raw(testDevice(), body, capture, cache, 64, true);
    TrainingFrames packed(testDevice(), body, capture, cache, 64, true, 1, 1000);
    EXPECT_FALSE(raw.compressed());
    EXPECT_EQ(raw.bytesKept(), capture.size() * 64 * 64 * 4);
    EXPECT_TRUE(packed.compressed());
    EXPECT_LT(packed.bytesKept(), raw.bytesKept() / 2);  // much of a crop is plain
    std::vector<size_t> some{2, 0, 2};
    for (int round = 0; round < 2; ++round) {
        for (size_t i = 0; i < capture.size(); ++i) {
            EXPECT_EQ(raw.mask(i), packed.mask(i));
            EXPECT_EQ(raw.image(i), packed.image(i));
        }
        packed.prepare(some);
    }
}

}  // namespace
}  // namespace doppel
