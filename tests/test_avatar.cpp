// `doppel avatar`: from what was recorded to an avatar with one command, which can be given again.
#include <gtest/gtest.h>

#include <fstream>
#include <glm/gtc/quaternion.hpp>
#include <sstream>

#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/commands/cli.h"
#include "trainer/import/coverage.h"
#include "trainer/motion/synthetic.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::Folder;

struct Outcome {
    int status;
    std::string err;
};

Outcome run(std::vector<std::string> words) {
    for (const char* number :
         {"fit.size=64", "fit.passes=2", "shape.size=64", "shape.steps=2", "texels.size=64",
          "texels.steps=2", "texels.samples=1", "texture.textureSize=64", "texture.depth=5",
          "texture.width=2", "texture.size=64", "texture.steps=2", "refine.depth=5"})
        words.insert(words.end(), {"--set", number});
    // Networks of minutes have no part in what is tried here.
    words.insert(words.end(), {"--preset", "ci", "--set", "mesh.hidden=8", "--set", "mesh.steps=2",
                               "--set", "refine.steps=1", "--set", "refine.width=2", "--set",
                               "refine.discriminatorWidth=2", "--set", "refine.size=64"});
    std::ostringstream out, err;
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    const int status = runCommandLine(words, out, err);
    testing::internal::GetCapturedStdout();
    const std::string said = testing::internal::GetCapturedStderr();
    return {status, said + err.str()};
}

TEST(AvatarCommand, FromARecordingToAnAvatarAndAgain) {
    Folder folder;
    SyntheticOptions synthetic;
    synthetic.size = 64;
    synthetic.samples = 1;
    renderActor(testDevice(), readActor(assetFolder() / "actor", "woman"),
                actorSession(5, 0, kActorDistance), folder / "recording", synthetic);
    const fs::path out = folder / "person";
    const std::vector<std::string> words{"avatar", (folder / "recording").string(), "--out",
                                         out.string(), "--no-overlays"};
    const Outcome first = run(words);
    ASSERT_EQ(first.status, 0) << first.err;
    EXPECT_FALSE(readAvatar(out / "avatar").texture.empty());
    EXPECT_FALSE(readAvatar(out / "avatar").meshNet.empty());
    EXPECT_EQ(first.err.find("synthetic people"), std::string::npos);
    EXPECT_EQ(readCapture(out / "capture").size(), 5u);
    EXPECT_EQ(first.err.find("no frame shows"), std::string::npos);  // she turns once

    const std::string body = bytesOf(out / "avatar/body.npz");
    const auto made = fs::last_write_time(out / "capture/capture.toml");
    const Outcome again = run(words);
    ASSERT_EQ(again.status, 0) << again.err;
    EXPECT_NE(again.err.find("it is there from an earlier run"), std::string::npos);
    EXPECT_EQ(fs::last_write_time(out / "capture/capture.toml"), made);
    EXPECT_EQ(bytesOf(out / "avatar/body.npz"), body);

    // Another request does not take over what this one made, unless that is asked for.
    std::vector<std::string> other = words;
    other.insert(other.end(), {"--frames", "0:2"});
    const Outcome refused = run(other);
    EXPECT_EQ(refused.status, 2);
    EXPECT_NE(refused.err.find("--restart starts over"), std::string::npos) << refused.err;
    EXPECT_EQ(readCapture(out / "capture").size(), 5u);
    // An import that fails leaves the capture and whose it is.
    std::vector<std::string> wrong = words;
    wrong.insert(wrong.end(), {"--frames", "0:99", "--restart"});
    EXPECT_EQ(run(wrong).status, 2);
    wrong.pop_back();
    const Outcome still = run(wrong);
    EXPECT_EQ(still.status, 2);
    EXPECT_NE(still.err.find("--restart starts over"), std::string::npos) << still.err;
    EXPECT_EQ(run(words).status, 0);
    EXPECT_EQ(readCapture(out / "capture").size(), 5u);

    other.push_back("--restart");
    const Outcome restarted = run(other);
    ASSERT_EQ(restarted.status, 0) << restarted.err;
    EXPECT_EQ(readCapture(out / "capture").size(), 2u);
    EXPECT_NE(restarted.err.find("no frame shows"), std::string::npos);
    // Of two frames networks learn nothing, those of the five are gone, and the cast tells.
    EXPECT_NE(restarted.err.find("from 2 frames: synthetic people"), std::string::npos);
    const Avatar few = readAvatar(out / "avatar");
    EXPECT_TRUE(few.meshNet.empty() && few.textureNet.empty() && few.refineNet.empty());
    EXPECT_TRUE(few.trained.at("texels").contains("texels.prior"));
    other.insert(other.end(), {"--prior", "none"});
    const Outcome alone = run(other);
    ASSERT_EQ(alone.status, 0) << alone.err;
    EXPECT_FALSE(readAvatar(out / "avatar").trained.at("texels").contains("texels.prior"));
}

// Before the recording is looked at, and with nothing written.
TEST(AvatarCommand, RefusesWhoIsNotKnown) {
    Folder folder;
    for (const auto& [prior, more] :
         {std::pair<std::string, std::vector<std::string>>{"nobody", {}},
          {"cast", {"--set", "shape.steps=0", "--set", "texels.steps=0"}}}) {
        std::vector<std::string> words{"avatar",  (folder / "clip.mp4").string(),
                                       "--out",   (folder / "person").string(),
                                       "--prior", prior};
        std::ofstream(folder / "clip.mp4") << "no clip";
        words.insert(words.end(), more.begin(), more.end());
        std::ostringstream out, err;
        EXPECT_EQ(runCommandLine(words, out, err), 2);
        EXPECT_NE(err.str().find("--prior: "), std::string::npos) << err.str();
        EXPECT_FALSE(fs::exists(folder / "person"));
    }
}

// Headings by the picture: 0 towards the camera, 90 to its right.
Capture facing(const std::vector<double>& headings) {
    Capture capture;
    for (double heading : headings) {
        Theta theta{};
        const std::array<float, 3> front = uprightOrientation(0);
        std::ranges::copy(front, theta.begin());
        setJointRotation(
            theta, 0,
            glm::angleAxis(glm::radians(-heading), glm::dvec3(0, 1, 0)) * jointRotation(theta, 0));
        capture.theta.push_back(theta);
    }
    return capture;
}

TEST(Coverage, SaysWhichSideIsMissing) {
    EXPECT_EQ(whatIsNotSeen(facing({0, 90, 180, 270})), "");
    EXPECT_EQ(whatIsNotSeen(facing({10, 100, 200, 300})), "");
    EXPECT_EQ(whatIsNotSeen(facing({30, 150, -90})), "");
    EXPECT_EQ(whatIsNotSeen(facing({0, 60, -60, 100, -100})).find("no frame shows the back: "), 0u);
    EXPECT_EQ(whatIsNotSeen(facing({180, 110, -110})).find("no frame shows the front: "), 0u);
    EXPECT_EQ(whatIsNotSeen(facing({0, 180, -90})).find("no frame shows the right side: "), 0u);
    EXPECT_EQ(whatIsNotSeen(facing({0, 180, 90})).find("no frame shows the left side: "), 0u);
    EXPECT_EQ(whatIsNotSeen(facing({0})).find(
                  "no frame shows the back, the right side, the left side: "),
              0u);
    EXPECT_EQ(whatIsNotSeen(Capture{}), "");
}

}  // namespace
}  // namespace doppel
