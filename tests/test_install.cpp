// What `cmake --install` makes: programs that find their files wherever the prefix is moved to, and
// that know nothing of the machine on which they were built.
#include "tests/refusals.h"

namespace doppel {
namespace {

using namespace test;

// The build, installed into a folder that has then been moved.
class Install : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<Folder>();
        const Outcome outcome = start({"cmake", "--install", program().parent_path().string(),
                                       "--strip", "--prefix", (*folder_ / "first").string()});
        ASSERT_EQ(outcome.status, 0) << outcome.err;
        fs::rename(*folder_ / "first", prefix());
    }
    static void TearDownTestSuite() { folder_.reset(); }

    static fs::path prefix() { return *folder_ / "moved"; }

    // The installed program in a home without anything, where variables do not help it.
    static Outcome installed(std::vector<std::string> words) {
        const std::vector<std::string> start{"env",
                                             "-u",
                                             "DOPPEL_ASSETS",
                                             "-u",
                                             "DOPPEL_MODELS",
                                             "-u",
                                             "XDG_DATA_HOME",
                                             "HOME=" + (*folder_ / "home").string(),
                                             (prefix() / "bin/doppel").string()};
        words.insert(words.begin(), start.begin(), start.end());
        return test::start(words);
    }

    static inline std::unique_ptr<Folder> folder_;
};

TEST_F(Install, HasProgramsAssetsLicencesAndTheDesktopsFiles) {
    for (const char* file :
         {"bin/doppel", "bin/doppel-bench", "share/doppel/body/default.npz",
          "share/doppel/actor/woman.npz", "share/doppel/actor/woman.png",
          "share/doc/doppel/LICENSE", "share/doc/doppel/assets/NOTICE",
          "share/doc/doppel/docs/formats.md", "share/applications/doppel.desktop",
          "share/icons/hicolor/scalable/apps/doppel.svg"})
        EXPECT_TRUE(fs::exists(prefix() / file)) << file;
}

TEST_F(Install, KnowsNoFolderOfTheBuild) {
    for (const std::string& folder :
         {std::string(DOPPEL_SOURCE_DIR), program().parent_path().string()})
        for (const auto& [name, bytes] : tree(prefix()))
            EXPECT_EQ(bytes.find(folder), bytes.npos) << folder << " in " << name;
}

TEST_F(Install, FindsItsAssets) {
    const Outcome outcome = installed({"demo", "--help"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_NE(outcome.out.find("{long-hair,man,skirt,woman}"), std::string::npos) << outcome.out;
    EXPECT_NE(installed({"bench"}).out.find((prefix() / "bin/doppel-bench").string()),
              std::string::npos);
}

TEST_F(Install, SaysWhereNetworksAreLookedFor) {
    const fs::path pictures = *folder_ / "pictures";
    fs::create_directory(pictures);
    for (const char* name : {"1.png", "2.png"}) writeImage(pictures / name, Image(kSize, kSize, 3));
    const std::vector<std::string> words{"import", pictures.string(), "--out",
                                         (*folder_ / "capture").string()};
    const std::string users = (*folder_ / "home/.local/share/doppel/models").string(),
                      everyones = (prefix() / "share/doppel/models").string();
    Outcome outcome = installed(words);
    EXPECT_EQ(outcome.status, 2) << outcome.err;
    EXPECT_TRUE(outcome.sentence().starts_with("doppel: " + users + "/pose_detection.tflite: "))
        << outcome.err;
    EXPECT_NE(outcome.sentence().find("copy that folder to " + users + " or " + everyones),
              std::string::npos)
        << outcome.err;
    fs::create_directory(everyones);
    EXPECT_TRUE(installed(words).sentence().starts_with("doppel: " + everyones));
    fs::create_directories(users);
    EXPECT_TRUE(installed(words).sentence().starts_with("doppel: " + users));
}

}  // namespace
}  // namespace doppel
