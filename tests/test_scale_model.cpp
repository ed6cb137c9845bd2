// scripts/scale-model: what its tables say of figures that are known.
#include <gmock/gmock.h>

#include "tests/refusals.h"

namespace doppel::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class ScaleModel : public ::testing::Test {
protected:
    void SetUp() override {
        if (std::system("python3 -c '' > /dev/null 2>&1") != 0)
            GTEST_SKIP() << "python3 is missing, in which the script is written";
    }
    static Outcome model(std::vector<std::string> words) {
        words.insert(words.begin(), {"python3", (sourceFolder() / "scripts/scale-model").string()});
        return start(words);
    }
    std::string measured(const std::string& text) const {
        write(folder_ / "measured.json", text);
        return (folder_ / "measured.json").string();
    }
    Folder folder_;
};

TEST_F(ScaleModel, SaysWhatStepsAndLinksMake) {
    // 10 steps of .2 s and .1 s a frame; a million bytes in one bucket.
    const std::string file = measured(
        R"({"preset": "mine", "stages": {"mesh": {"steps": 10, "bytes": 1e6, "each": 0.1, "once": 0.2}}})");
    const Outcome run = model({"--from", file, "--batch", "4", "--devices", "1,2,8", "--links",
                               "0.001", "--latency", "0.5", "--people", "16"});
    ASSERT_EQ(run.status, 0) << run.err;
    // Alone 10 (.2 + .4). Two: .2 + .2, a second of wire that nothing hides, and two latencies.
    EXPECT_THAT(run.out, HasSubstr("| 1 | 4 | 0.0 KiB | 6 s |"));
    EXPECT_THAT(run.out, HasSubstr("| 2 | 4 | 976.6 KiB | 24 s |"));
    // Eight frames in five steps: .2 + .1, 1.75 s, 1 s.
    EXPECT_THAT(run.out, HasSubstr("| 8 | 8 | 1709.0 KiB | 15.2 s |"));
    EXPECT_THAT(run.out, HasSubstr("past 2 devices there is little to gain"));
    EXPECT_THAT(run.out, HasSubstr("| 8 | 12 s | 4.07 min |"));
    // A stage that goes by epochs: ten frames in all, of four a step.
    EXPECT_THAT(
        model({"--from",
               measured(R"({"preset": "mine", "stages": {"mesh": {"steps": 10, "epochs": true,)"
                        R"("bytes": 1e6, "each": 0.1, "once": 0.2}}})"),
               "--batch", "4", "--devices", "1"})
            .out,
        HasSubstr("| 1 | 4 | 0.0 KiB | 1.8 s |"));
    measured(
        R"({"preset": "mine", "stages": {"mesh": {"steps": 10, "bytes": 1e6, "each": 0.1, "once": 0.2}}})");
    // Devices ten times as fast are ten times as fast alone.
    EXPECT_THAT(model({"--from", file, "--batch", "4", "--devices", "1", "--faster", "10"}).out,
                HasSubstr("| 1 | 4 | 0.0 KiB | 600 ms |"));
}

// Each process sends its sums over the batch to each other one, and waits for theirs.
TEST_F(ScaleModel, CountsSumsOverTheBatch) {
    const std::string file = measured(
        R"({"preset": "mine", "stages": {"texture": {"steps": 10, "bytes": 0, "sums": 102400,)"
        R"("exchanges": 4, "each": 0.1, "once": 0.2}}})");
    // 10 (.2 + .1 + 3 * .1024 + 4 * 2 * .01) of four, whose wire takes a megabyte in a second.
    EXPECT_THAT(model({"--from", file, "--batch", "4", "--devices", "1,4", "--links", "0.001",
                       "--latency", "0.01"})
                    .out,
                HasSubstr("| 4 | 4 | 300.0 KiB | 7.07 s |"));
}

// What four processes sent of texture's 7,508 KiB and two's sums of 348 (docs/scale.md).
TEST_F(ScaleModel, SaysWhatFourWereMeasuredToSend) {
    const std::string file = measured(
        R"({"preset": "ci", "stages": {"texture": {"steps": 50, "bytes": 7688192, "sums": 356352,)"
        R"("each": 0.1, "once": 0.2}}})");
    const std::string tables =
        model({"--from", file, "--batch", "4", "--devices", "1,2,4", "--links", "10"}).out;
    EXPECT_THAT(tables, HasSubstr("| 2 | 4 | 7856.0 KiB |"));
    EXPECT_THAT(tables, HasSubstr("| 4 | 4 | 12306.0 KiB |"));
}

// Stages that go by epochs take the steps of as many frames, and of a thousand at most.
TEST_F(ScaleModel, TellsOfLongerRecordings) {
    const std::string file = measured(
        R"({"preset": "mine", "recorded": 50, "stages": {"mesh": {"steps": 100, "epochs": true,)"
        R"("bytes": 1e6, "each": 0.1, "once": 0}, "texture": {"steps": 10, "bytes": 1e6,)"
        R"("each": 0.1, "once": 0}}})");
    const Outcome run =
        model({"--from", file, "--batch", "1", "--devices", "1", "--recording", "7200"});
    EXPECT_THAT(run.out, HasSubstr("### mesh: 2000 steps"));
    EXPECT_THAT(run.out, HasSubstr("### texture: 10 steps"));
    EXPECT_THAT(model({"--from", file, "--batch", "1", "--devices", "1", "--recording", "100"}).out,
                HasSubstr("### mesh: 200 steps"));
}

TEST_F(ScaleModel, RefusesWhatItCannotRead) {
    const Outcome broken = model({"--from", measured("{")});
    EXPECT_NE(broken.status, 0);
    EXPECT_THAT(broken.err, HasSubstr("measured.json"));
    EXPECT_THAT(broken.err, Not(HasSubstr("Traceback")));
    EXPECT_NE(model({}).status, 0);
}

}  // namespace
}  // namespace doppel::test
