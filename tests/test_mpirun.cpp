// Trainings that mpirun starts, as people do.
#include <gmock/gmock.h>

#include <chrono>
#include <regex>
#include <thread>

#include "tests/refusals.h"

namespace doppel::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class MpiRun : public Refusals {
protected:
    void SetUp() override {
        if (std::system("mpirun --version > /dev/null 2>&1") != 0 ||
            !fs::exists(program().parent_path() / "doppel-mpi.so"))
            GTEST_SKIP() << "mpirun or doppel-mpi.so is missing: libopenmpi-dev and openmpi-bin";
        Refusals::SetUp();
        for (const char* name : {"OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"})
            setenv(name, "1", 1);  // as build machines run tests
        // Nor do containers let processes read each other's memory, or have a shell on others.
        setenv("OMPI_MCA_btl_vader_single_copy_mechanism", "none", 1);
        setenv("OMPI_MCA_plm_rsh_agent", "", 1);
        // Seconds between SIGTERM and SIGKILL: a busy machine may take one for a step.
        setenv("OMPI_MCA_odls_base_sigkill_timeout", "5", 1);
    }
    static Outcome mpirun(int count, std::vector<std::string> words,
                          const std::function<void(pid_t)>& meanwhile = {}) {
        words.insert(words.begin(), {"mpirun", "-q", "--oversubscribe", "-n", std::to_string(count),
                                     program().string()});
        return start(words, nullptr, meanwhile);
    }
    std::vector<std::string> train(const char* out, const std::string& steps = "4") const {
        std::vector<std::string> words{"train",    at("capture"), "--out",           at(out),
                                       "--preset", "ci",          "--picture-every", "0"};
        auto set = [&](const std::string& name, const std::string& value) {
            words.insert(words.end(), {"--set", name + "=" + value});
        };
        for (const auto& [name, value] : kNumbers) set(name, value);
        set("fit.batch", "2"), set("shape.steps", "4"), set("texels.steps", "4");
        set("shape.size", "64"), set("texels.size", "64");
        set("mesh.batch", "2"), set("mesh.steps", steps);
        set("texture.batch", "2"), set("texture.steps", "4");
        words.push_back("--no-refine");
        return words;
    }
};

TEST_F(MpiRun, TrainsWithTheSameBitsEveryTime) {
    std::string first;
    for (const char* out : {"a", "b"}) {
        const Outcome run = mpirun(2, train(out));
        ASSERT_EQ(run.status, 0) << run.err;
        EXPECT_THAT(run.err, HasSubstr("2 processes train together by Open MPI"));
        EXPECT_EQ(run.out, "silhouette IoU" + run.out.substr(14)) << "rank 0 alone speaks";
        EXPECT_EQ(std::ranges::count(run.out, '\n'), 2) << run.out;
        // Three frames, of which one has two and the other one.
        std::smatch decoded;
        ASSERT_TRUE(std::regex_search(run.err, decoded,
                                      std::regex("each process decoded (\\d+) to (\\d+) pictures")))
            << run.err;
        EXPECT_LE(std::stoi(decoded[2]), 2 * std::stoi(decoded[1])) << decoded[0];
    }
    for (const char* name : {"body.npz", "texels.png", "mesh_net.safetensors",
                             "texture_net.safetensors", "texture.png"}) {
        EXPECT_FALSE(bytesOf(*this / "a" / name).empty()) << name;
        EXPECT_EQ(bytesOf(*this / "a" / name), bytesOf(*this / "b" / name)) << name;
    }
    // It is an avatar like any other.
    EXPECT_EQ(
        doppel({"render", at("a"), "--motion", at("capture"), "--out", at("results/a.png")}).status,
        0);
    EXPECT_THAT(doppel(train("a")).out, HasSubstr("it was finished before"));
}

// scripts/scale-model: of n processes each sends 2 (n - 1) / n of the gradients and n - 1 times the
// sums over the batch, which two of them have shown.
TEST_F(MpiRun, FourSendWhatTheModelSaysOfTwo) {
    auto numbers = [&](const char* out) {
        std::vector<std::string> words = train(out);
        for (const char* number : {"fit.batch=4", "mesh.batch=4", "texture.batch=4"})
            words.insert(words.end(), {"--set", number});
        return words;
    };
    auto found = [](const std::string& text, const std::string& pattern) {
        std::smatch match;
        EXPECT_TRUE(std::regex_search(text, match, std::regex(pattern))) << pattern << "\n" << text;
        return match.empty() ? 0 : std::stod(match[1]);
    };
    std::vector<std::string> profile = numbers("alone");
    profile.insert(profile.end(), {"--stages", "mesh,texture", "--profile", "1"});
    const Outcome one = doppel(profile);
    ASSERT_EQ(one.status, 0) << one.err;
    const Outcome two = mpirun(2, numbers("two")), four = mpirun(4, numbers("four"));
    ASSERT_EQ(two.status, 0) << two.err;
    ASSERT_EQ(four.status, 0) << four.err;
    // Of a mesh network as small as this one most of the memory lies between parameters.
    const double gradients =
        found(one.out, "stage texture:.*gradients and moments ([0-9.]+) MiB") * 1024 / 4;
    const double byTwo = found(two.err, "texture: process 0 of 2 sent ([0-9.]+) KiB to the others");
    const double byFour =
        found(four.err, "texture: process 0 of 4 sent ([0-9.]+) KiB to the others");
    const double sums = byTwo - gradients;
    EXPECT_GT(sums, .05 * gradients);
    EXPECT_NEAR(byFour, 1.5 * gradients + 3 * sums, .05 * byFour);
}

TEST_F(MpiRun, ARankThatDiesEndsAllAndOneProcessGoesOn) {
    std::vector<std::string> words = train("a", "100000");
    words.insert(words.end(), {"--checkpoint-every", ".2"});
    const fs::path checkpoint = *this / "a/checkpoints/mesh.safetensors";
    const Outcome killed = mpirun(2, words, [&](pid_t) {
        for (int i = 0; i < 1200 && !fs::exists(checkpoint); ++i)
            std::this_thread::sleep_for(std::chrono::milliseconds(50));
        // The second of the two, by its own command line.
        const std::string find = fmt::format(
            "for p in $(pgrep -f 'doppel train {}'); do tr '\\0' '\\n' < /proc/$p/environ | grep "
            "-qx "
            "OMPI_COMM_WORLD_RANK=1 && kill -KILL $p; done",
            at("capture"));
        EXPECT_GE(std::system(find.c_str()), 0);
    });
    EXPECT_NE(killed.status, 0);
    // mpirun itself is quiet.
    EXPECT_EQ(killed.sentence(),
              "doppel: stopped, and waits for the other processes; if one of them has ended, the "
              "same command goes on from the newest checkpoint");
    EXPECT_EQ(std::ranges::count(killed.err.substr(killed.err.find("doppel: ")), '\n'), 1);
    ASSERT_TRUE(fs::exists(checkpoint));
    std::this_thread::sleep_for(std::chrono::seconds(1));  // until the lock is free
    const Outcome alone =
        doppel(words, nullptr, [&, kept = fs::last_write_time(checkpoint)](pid_t child) {
            for (int i = 0; i < 1200 && fs::last_write_time(checkpoint) == kept; ++i)
                std::this_thread::sleep_for(std::chrono::milliseconds(50));
            kill(child, SIGINT);
        });
    EXPECT_EQ(alone.status, 130) << alone.err;
    EXPECT_THAT(alone.err, AllOf(HasSubstr("mesh: going on after step"), HasSubstr("kept: ")));
}

TEST_F(MpiRun, SaysThingsOnce) {
    const Outcome missing = mpirun(2, {"train", at("nothing"), "--out", at("b")});
    EXPECT_EQ(missing.status, 2);
    const size_t said = missing.err.find("nothing");
    ASSERT_NE(said, std::string::npos) << missing.err;
    EXPECT_EQ(missing.err.find("doppel: ", missing.err.find("doppel: ") + 1), std::string::npos)
        << missing.err;
    // One that fails alone is heard, and ends the other, which waits for it.
    std::vector<std::string> apart = train("b");
    apart.insert(apart.end(),
                 {":", "-n", "1", program().string(), "train", at("results"), "--out", at("b")});
    const Outcome alone = mpirun(1, apart);
    EXPECT_EQ(alone.status, 2);
    EXPECT_THAT(alone.err, AllOf(HasSubstr("of 2 processes, number 1: doppel: "),
                                 HasSubstr("results/images: expected")));
    const Outcome other = mpirun(2, {"render", at("avatar")});
    EXPECT_EQ(other.status, 2);
    EXPECT_THAT(other.err, HasSubstr("several processes train one avatar"));
    // Batches that two cannot share are taken whole by each, which is said.
    std::vector<std::string> words = train("c");
    words.insert(words.end(), {"--set", "mesh.batch=1"});
    const Outcome whole = mpirun(2, words);
    EXPECT_EQ(whole.status, 0) << whole.err;
    EXPECT_THAT(whole.err, AllOf(HasSubstr("mesh: its batches cannot be shared by 2 processes"),
                                 Not(HasSubstr("texture: its batches"))));
}

}  // namespace
}  // namespace doppel::test
