// A VRM avatar as three-vrm shows it in Debian's chromium, beside what `doppel render` draws.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "engine/io/image.h"
#include "tests/browser.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/striped_avatar.h"
#include "trainer/avatar/export.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Browser;

constexpr int kSize = 384;
constexpr double kFocal = 450;

// Where scripts/setup --tools has put a package; empty where it has not.
fs::path package(const char* name) {
    const char* folder = std::getenv("NODE_PATH");
    const fs::path path = fs::path(folder ? folder : "") / name;
    return folder && fs::exists(path / "package.json") ? path : fs::path();
}

class InThreeVrm : public ::testing::Test {
protected:
    void SetUp() override {
        const fs::path three = package("three"), vrm = package("@pixiv/three-vrm");
        if (three.empty() || vrm.empty() || test::chromium().empty())
            GTEST_SKIP() << "no chromium, or no packages three and @pixiv/three-vrm "
                            "(scripts/setup --tools)";
        fs::create_directory_symlink(three, folder_ / "three");
        fs::create_directory_symlink(vrm / "lib", folder_ / "three-vrm");
        fs::copy_file(test::sourceFolder() / "tests/three/vrm.html", folder_ / "index.html");
        exportAvatar(testDevice(), avatar_, folder_ / "me.vrm", nullptr, {.author = "Ada"});
    }

    // Somebody upright before the camera.
    static constexpr Trans kPlace{.1f, .1f, 3.3f};

    // turns: VRM's name of a bone, SMPL's joint and its turn in the body's axes.
    struct Turn {
        const char* bone;
        size_t joint;
        std::array<float, 3> turn;
    };
    void expectTheSame(const std::vector<Turn>& turns) {
        Theta theta{};
        std::ranges::copy(uprightOrientation(0), theta.begin());
        nlohmann::json pose = nlohmann::json::object();
        for (const auto& [bone, joint, turn] : turns) {
            std::ranges::copy(turn, theta.begin() + ptrdiff_t(3 * joint));
            pose[bone] = turn;
        }
        // The file's world is the T-pose's own, set on the ground. The camera sees it turned by
        // half a turn about x and the pelvis.
        const std::vector<double> rest = restJoints(avatar_.body, std::vector<double>(10));
        double ground = INFINITY;
        for (size_t v = 1; v < avatar_.body.templateVertices.size(); v += 3)
            ground = std::min(ground, double{avatar_.body.templateVertices[v]});
        const nlohmann::json asked{
            {"model", "me.vrm"},
            {"size", kSize},
            {"fov", 2 * std::atan(kSize / 2. / kFocal) * 180 / std::acos(-1.)},
            {"camera",
             {-double{kPlace[0]}, double{kPlace[1]} - ground + 2 * rest[1],
              double{kPlace[2]} + 2 * rest[2]}},
            {"pose", pose}};
        Browser browser(kSize + 40, kSize + 40, folder_.path());
        browser.open(Browser::kServer);
        const std::string address = browser.value(fmt::format("show({})", asked.dump()));
        const std::vector<uint8_t> png = test::fromBase64(address.substr(address.find(',') + 1));
        EXPECT_EQ(browser.complaints, std::vector<std::string>());
        test::expectShows(decodeImage(png, "canvas", 4), avatar_, theta, kPlace, kFocal);
    }

    test::Folder folder_;
    Avatar avatar_ = test::stripedAvatar();
};

TEST_F(InThreeVrm, AVrmIsWhatRenderDraws) { expectTheSame({}); }

TEST_F(InThreeVrm, ItsBonesAreTurnedAsJointsAre) {
    expectTheSame({{"leftUpperArm", joint::kLeftShoulder, {0, .3f, -.9f}},
                   {"rightUpperArm", joint::kRightShoulder, {0, 0, 1.1f}},
                   {"leftLowerLeg", joint::kLeftKnee, {.9f, 0, 0}},
                   {"head", joint::kHead, {0, .6f, 0}}});
}

}  // namespace
}  // namespace doppel
