// `doppel avatar` of a clip, from its first frame to the avatar: what it says for programs, and
// that it goes on wherever it is stopped.
#include <thread>

#include <nlohmann/json.hpp>

#include "engine/io/video.h"
#include "tests/refusals.h"
#include "tests/small_run.h"
#include "trainer/person/blazepose.h"

namespace doppel {
namespace {

using namespace test;

class AvatarOfClip : public ::testing::Test {
protected:
    static bool canRun() {
        return poseModelsAreThere(PoseNet::Lite, sourceFolder() / "build/models");
    }
    static void SetUpTestSuite() {
        if (!canRun()) return;
        folder_ = std::make_unique<Folder>();
        folder_->write("small.toml", std::string(kSmallRun));
        // An actor who is filmed, and then stands still.
        VideoReader actor(sourceFolder() / "tests/data/clips/vfr.mp4");
        VideoWriter clip(*folder_ / "clip.mp4", actor.width(), actor.height(), 10);
        Image frame;
        for (int i = 0; i < 5 && actor.next(frame); ++i) clip.add(frame);
        for (int i = 0; i < 3; ++i) clip.add(frame);
        clip.finish();
        whole_ = avatar("whole");
    }
    static void TearDownTestSuite() { folder_.reset(); }
    void SetUp() override {
        if (!canRun()) GTEST_SKIP() << "scripts/setup --models fetches the networks";
        ASSERT_EQ(whole_.status, 0) << whole_.err;
    }

    // In a folder of its own, so that command lines are the same and what is written of them too.
    static Outcome run(const char* in, std::vector<std::string> words,
                       const std::function<void(pid_t)>& meanwhile = {}) {
        fs::create_directories(*folder_ / in);
        words.insert(words.begin(), {"env", "-C", (*folder_ / in).string(), program().string()});
        words.insert(words.end(), {"--config", "../small.toml", "--json"});
        return start(words, nullptr, meanwhile);
    }
    static Outcome avatar(const char* in, const std::function<void(pid_t)>& meanwhile = {}) {
        return run(in, {"avatar", "../clip.mp4", "--out", "me", "--pose", "lite"}, meanwhile);
    }

    static inline std::unique_ptr<Folder> folder_;
    static inline Outcome whole_;  // of a run that nobody stopped
};

nlohmann::json jsonOf(const Outcome& outcome) {
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return nlohmann::json::parse(outcome.out, nullptr, false);
}

TEST_F(AvatarOfClip, TellsProgramsWhatImportAndTrainingFound) {
    const nlohmann::json found = jsonOf(whole_);
    EXPECT_EQ(found["avatar"], "me/avatar");
    EXPECT_EQ(found["frames"], 5);
    EXPECT_EQ(found["unseen"], (std::vector<std::string>{"back", "right side", "left side"}));
    EXPECT_FALSE(found.contains("chosen"));
    EXPECT_EQ(found["import"]["out"], "me/capture");
    EXPECT_EQ(found["import"]["left_out"], "3 duplicates");
    for (const char* said : {"masks", "quality", "heads", "camera", "iou_of_frames"})
        EXPECT_TRUE(found["import"].contains(said)) << said;

    // The same as import says by itself.
    nlohmann::json alone = jsonOf(run("alone", {"import", "../clip.mp4", "--out", "me/capture",
                                                "--every", "0", "--pose", "lite"}));
    EXPECT_EQ(found["import"], alone);

    // And again where all is there from before, as far as the capture has kept it.
    const nlohmann::json again = jsonOf(avatar("whole"));
    EXPECT_EQ(again["was_finished"], true);
    EXPECT_EQ(again["import"]["was_finished"], true);
    for (const char* said : {"left_out", "masks", "quality", "heads", "camera", "frames"})
        EXPECT_EQ(again["import"][said], found["import"][said]) << said;

    const nlohmann::json few = jsonOf(run("whole", {"train", "me/capture", "--out", "few",
                                                    "--stages", "shape", "--most-frames", "3"}));
    EXPECT_EQ(few["frames"], 3);
    EXPECT_EQ(few["chosen"].size(), 3u);
    EXPECT_EQ(few["chosen"][0], "000000");
}

TEST_F(AvatarOfClip, TooLittleMemoryIsRefusedBeforeTheClipIsLookedThrough) {
    for (const char* clip : {"../clip.mp4", "../pictures"}) {
        if (clip == std::string("../pictures")) {
            fs::create_directories(*folder_ / "pictures");
            VideoReader film(*folder_ / "clip.mp4");
            Image frame;
            for (int i = 0; i < 5 && film.next(frame); ++i)
                writeImage(*folder_ / fmt::format("pictures/{}.png", i), frame);
        }
        const Outcome refused = run("little", {"avatar", clip, "--out", "me", "--memory", "2MB"});
        EXPECT_EQ(refused.status, 2) << refused.err;
        EXPECT_TRUE(refused.sentence().starts_with("doppel: --memory: stage ")) << refused.err;
        EXPECT_EQ(refused.err.find("look at frames"), std::string::npos) << refused.err;
        EXPECT_FALSE(fs::exists(*folder_ / "little/me"));
    }
    // What is there already needs none.
    const Outcome finished =
        run("whole", {"avatar", "../clip.mp4", "--out", "me", "--pose", "lite", "--memory", "2MB"});
    EXPECT_EQ(jsonOf(finished)["was_finished"], true);
}

// Waits for a file, and ends the program.
std::function<void(pid_t)> endOnce(const fs::path& file, int signal) {
    return [=](pid_t child) {
        for (int i = 0; i < 6000 && !fs::exists(file); ++i)
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        kill(child, signal);
    };
}

TEST_F(AvatarOfClip, GoesOnWhereItWasEndedAndMakesTheSame) {
    const fs::path me = *folder_ / "ended/me";
    // The request is written behind the capture.
    const Outcome killed = avatar("ended", endOnce(me / "request.txt", SIGKILL));
    EXPECT_EQ(killed.status, 1000 + SIGKILL) << killed.err;
    EXPECT_FALSE(fs::exists(me / "avatar/avatar.toml"));
    const Outcome stopped = avatar("ended", endOnce(me / "avatar/log/losses_shape.csv", SIGINT));
    EXPECT_EQ(stopped.status, 130) << stopped.err;
    EXPECT_NE(stopped.err.find("me/capture: it is there from an earlier run"), std::string::npos)
        << stopped.err;
    EXPECT_TRUE(stopped.sentence().starts_with("doppel: interrupted; kept: ")) << stopped.err;
    EXPECT_TRUE(fs::exists(me / "avatar/checkpoints/run.toml"));
    const Outcome last = avatar("ended");
    ASSERT_EQ(last.status, 0) << last.err;
    EXPECT_NE(last.err.find("going on with the unfinished run"), std::string::npos) << last.err;

    // Events have the times of their steps.
    size_t compared = 0;
    for (const auto& [name, bytes] : tree(*folder_ / "whole/me")) {
        if (name.find("/events/") != std::string::npos) continue;
        EXPECT_TRUE(fs::exists(me / name)) << name;
        if (fs::is_regular_file(me / name)) {
            EXPECT_EQ(bytesOf(me / name) == bytes, true) << name;
        }
        ++compared;
    }
    EXPECT_GT(compared, 30u);
    EXPECT_FALSE(fs::exists(me / "avatar/checkpoints"));
}

}  // namespace
}  // namespace doppel
