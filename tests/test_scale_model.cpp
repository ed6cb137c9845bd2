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
    EXPECT_THAT(run.out, HasSubstr("| 1 | 4 | 0.0 MiB | 6 s |"));
    EXPECT_THAT(run.out, HasSubstr("| 2 | 4 | 1.0 MiB | 24 s |"));
    // Eight frames in five steps: .2 + .1, 1.75 s, 1 s.
    EXPECT_THAT(run.out, HasSubstr("| 8 | 8 | 1.7 MiB | 15.2 s |"));
    EXPECT_THAT(run.out, HasSubstr("past 2 devices there is little to gain"));
    EXPECT_THAT(run.out, HasSubstr("| 8 | 12 s | 4.07 min |"));
    // A stage that goes by epochs: ten frames in all, of four a step.
    EXPECT_THAT(
        model({"--from",
               measured(R"({"preset": "mine", "stages": {"mesh": {"steps": 10, "epochs": true,)"
                        R"("bytes": 1e6, "each": 0.1, "once": 0.2}}})"),
               "--batch", "4", "--devices", "1"})
            .out,
        HasSubstr("| 1 | 4 | 0.0 MiB | 1.8 s |"));
    measured(
        R"({"preset": "mine", "stages": {"mesh": {"steps": 10, "bytes": 1e6, "each": 0.1, "once": 0.2}}})");
    // Devices ten times as fast are ten times as fast alone.
    EXPECT_THAT(model({"--from", file, "--batch", "4", "--devices", "1", "--faster", "10"}).out,
                HasSubstr("| 1 | 4 | 0.0 MiB | 600 ms |"));
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
