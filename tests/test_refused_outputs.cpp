// The program as a user meets it when its output or the machine is in the way, or it is stopped: no
// file of anybody's is lost.
#include "tests/refusals.h"

namespace doppel {
namespace {

using namespace test;

// ---- the output is in the way of somebody's files -----------------------------------------------

TEST_F(Refusals, OutputsOverInputs) {
    for (auto [words, out] : {std::pair{import(at("source")), "source"},
                              {import(at("source/c")), "source"},
                              {fit(at("capture")), "capture"},
                              {fit(at("capture/images")), "capture"},
                              {fit(folder_->path().string()), "capture"},
                              {train(at("capture"), "fit"), "capture"},
                              {train(at("capture/a"), "fit"), "capture"},
                              {render(at("capture")), "capture"},
                              {render(at("avatar/r")), "avatar"},
                              {eval(at("avatar")), "avatar"},
                              {eval(at("capture/images")), "capture"}})
        refuses(words, "expected a place apart from the input " + at(out), 2);
    refuses({"import", at("capture"), "--out", at("capture"), "--frames", "0:2"},
            "found the input itself", 2);
    fs::create_directories(*this / "plates");
    write(*this / "plates/room.png", "a picture");
    for (const char* flag : {"--plate", "--matting", "--poses"})
        for (const char* command : {"import", "avatar"})
            refuses({command, at("source"), "--out", at("plates"), flag, at("plates/room.png")},
                    "expected a place apart from the input " + at("plates/room.png"), 2);
    refuses({"ablate", at("capture"), "--out", at("capture/o")}, "a place inside the input", 2);
    // What is behind, in front and heard.
    for (const char* flag : {"--background", "--occluder", "--audio"}) {
        std::vector<std::string> words = render(at("plates"));
        words.insert(words.end(), {flag, at("plates/room.png")});
        refuses(words, "expected a place apart from the input " + at("plates/room.png"), 2);
        write(*this / "room.mov", "a film");
        words = render(at("room.mov"));
        words.insert(words.end(), {flag, at("room.mov")});
        refuses(words, "expected a file apart from the input " + at("room.mov"), 2);
    }
    // The clip that a capture was made of, and files beside the motion's; a film whose name is a
    // picture's would be taken for a frame.
    write(*this / "clip.mov", "a film");
    fs::copy(*this / "capture", *this / "filmed", fs::copy_options::recursive);
    write(*this / "filmed/capture.toml",
          "name = \"filmed\"\n[source]\nfolder = \"" + at("clip.mov") + "\"\n");
    const auto of = [&](const char* motion, std::vector<std::string> words) {
        std::ranges::replace(words, at("capture"), at(motion));
        return words;
    };
    for (const char* motion : {"filmed", "filmed/poses.npz"})
        refuses(of(motion, render(at("clip.mov"))),
                "expected a file apart from the input " + at("clip.mov"), 2);
    refuses(of("filmed", render(at("filmed/images/0.webp"))), "a place inside the input", 2);
    refuses({"retarget", at("capture/poses.npz"), "--avatar", at("avatar"), "--out",
             at("capture/cameras.npz")},
            "expected a place apart from the input " + at("capture"), 2);
    refuses({"mix", at("avatar"), "--top", at("avatar"), "--out", at("avatar")},
            "found the input itself", 2);
    // By way of links, for folders and files.
    fs::create_directory_symlink(*this / "capture", *this / "alias");
    refuses(fit(at("alias")), "found the input itself", 2);
    fs::create_symlink(*this / "capture/poses.npz", *this / "out.glb");
    refuses(exporting(at("out.glb")), "expected a place apart from the input", 2);
    for (const char* out : {"capture/poses.npz", "avatar/body.npz", "avatar/me.glb"})
        refuses(exporting(at(out)), "a place inside the input", 2);
    refuses({"export", at("avatar"), "--motion", at("capture/poses.npz"), "--out",
             at("capture/cameras.npz")},
            "a place inside the input", 2);
    fs::create_symlink(*this / "avatar/texture.png", *this / "out.mp4");
    refuses(render(at("out.mp4")), "expected a file apart from the input", 2);
}

TEST_F(Refusals, OutputsOverSomebodysFiles) {
    // A trained avatar is no place for a mix, which takes that of an earlier one.
    fs::copy(*this / "avatar", *this / "trained", fs::copy_options::recursive);
    refuses({"mix", at("avatar"), "--top", at("trained"), "--hair", at("avatar"), "--out",
             at("trained")},
            "found the input itself", 2);
    fs::copy(*this / "avatar", *this / "friend", fs::copy_options::recursive);
    refuses({"mix", at("avatar"), "--top", at("friend"), "--out", at("trained")},
            "found an avatar that was trained; name another folder", 2);
    // Nor is a mix one for a training.
    Avatar mixed = readAvatar(*this / "friend");
    mixed.provenance["mixed"] = "avatar";
    writeAvatar(*this / "friend", mixed);
    refuses(train(at("friend"), "fit"), "found a mix of avatars; name another folder", 2);
    // A file, and links, where a training is to write.
    write(*this / "notes.txt", "mine");
    refuses(train(at("notes.txt"), "fit"), "found a file in the way; name another place", 2);
    fs::create_symlink("notes.txt", *this / "link");
    fs::create_symlink("nowhere", *this / "dangling");
    for (const char* name : {"link", "dangling"})
        refuses(train(at(name), "fit"), "expected a folder or nothing", 2);
    // Folders of somebody's, in which names agree by chance.
    struct Case {
        std::vector<std::string> words;
        const char* file;
    };
    const fs::path own = *this / "own";
    for (const Case& one :
         {Case{train(own.string(), "fit"), "body.npz"},
          Case{train(own.string(), "fit"), "checkpoints/model.safetensors"},
          Case{train(own.string(), "fit"), "log/events/fit/mine"},
          Case{import(own.string()), "capture.toml"}, Case{fit(own.string()), "raw.mp4"},
          Case{render(own.string()), "0000.png"}, Case{eval(own.string()), "f1.png"},
          Case{{"eval", at("avatar"), at("capture"), "--out", own.string()}, "results.csv"},
          Case{{"demo", "--out", own.string()}, "metrics.json"},
          Case{{"ablate", at("capture"), "--out", own.string()}, "ablation.md"}}) {
        fs::create_directories((own / one.file).parent_path());
        write(own / one.file, "mine");
        refuses(one.words, fs::path(one.file).begin()->string(), 2, false);
        fs::remove_all(own);
    }
    // Our own capture, with a recording of somebody's beside it.
    ASSERT_EQ(doppel(fit(at("results/f"))).status, 0);
    ASSERT_EQ(doppel(fit(at("results/f"))).status, 0) << "our own is replaced";
    write(*this / "results/f/raw.mp4", "mine");
    refuses(fit(at("results/f")), "found raw.mp4: name another place", 2);
    refuses(render(at("results/f")), "found what Doppel wrote as capture: name another", 2);
    refuses(train(at("results/f"), "fit"), "found what Doppel wrote as capture; name", 2);
}

// ---- finished, stopped, killed ------------------------------------------------------------------

TEST_F(Refusals, AFinishedTrainingStays) {
    const std::vector<std::string> words = train(at("results/a"), "fit,mesh");
    ASSERT_EQ(doppel(words).status, 0);
    const auto before = tree(*this / "results");
    const Outcome again = doppel(words);
    EXPECT_EQ(again.status, 0);
    EXPECT_NE(again.out.find("it was finished before, and stays as it is"), std::string::npos);
    EXPECT_EQ(tree(*this / "results"), before);
    std::vector<std::string> other = words;
    other.insert(other.end(), {"--set", "mesh.steps=3"});
    refuses(other, "it has mesh already, trained with mesh.steps = 2, and this run has 3", 2);
    other.push_back("--restart");
    EXPECT_EQ(doppel(other).status, 0);
    EXPECT_NE(tree(*this / "results"), before);
    EXPECT_EQ(doppel(train(at("results/a"), "texture")).status, 0) << "a stage is added";
}

TEST_F(Refusals, SignalsLeaveACheckpoint) {
    struct Case {
        std::vector<int> signals;
        int status;
    };
    for (const Case& one : {Case{{SIGINT}, 130}, Case{{SIGTERM}, 143}, Case{{SIGHUP}, 129},
                            Case{{SIGINT, SIGINT}, 130}}) {
        std::vector<std::string> words = train(at("results/a"), "mesh");
        words.insert(words.end(), {"--set", "mesh.steps=100000"});
        const fs::path curve = *this / "results/a/log/losses_mesh.csv";
        const Outcome outcome = doppel(words, nullptr, [&](pid_t child) {
            while (std::ranges::count(bytesOf(curve), '\n') < 3 &&
                   waitpid(child, nullptr, WNOHANG) == 0)
                usleep(20000);
            for (int number : one.signals) kill(child, number);
        });
        EXPECT_EQ(outcome.status, one.status) << outcome.err;
        EXPECT_NE(outcome.sentence().find("interrupted; kept: checkpoint"), std::string::npos)
            << outcome.err;
        EXPECT_TRUE(fs::exists(*this / "results/a/checkpoints/mesh.safetensors"));
        fs::remove_all(*this / "results/a");
    }
}

// ---- the machine is in the way ------------------------------------------------------------------

TEST_F(Refusals, AFileWhereAFolderShouldBe) {
    write(*this / "results/file", "x");
    std::string below = at("results/file/out");
    for (const auto& words :
         {import(below), fit(below), train(below, "fit"), render(below), eval(below)})
        refuses(words, "expected a folder or nothing, found a file in the way; name another", 2);
    refuses(render(below + ".mp4"), "results/file", 2);
    refuses(exporting(below + ".glb"), "results/file", 2);
}

// Whoever runs the tests, the program runs as somebody who may not write here.
void becomeNobody() {
    setenv("MESA_SHADER_CACHE_DISABLE", "true", 1);  // else it says where it may not keep one
    if (geteuid() != 0) return;
    if (setgid(65534) != 0 || setuid(65534) != 0) _exit(125);
}

TEST_F(Refusals, NoPermissionToWrite) {
    if (doppel({"--version"}, becomeNobody).status != 0)
        GTEST_SKIP() << "the program cannot be started by another user here";
    fs::permissions(*this / "results", fs::perms(0555));
    auto before = tree(folder_->path());
    for (const auto& words :
         {import(at("results/c")), fit(at("results/f")), train(at("results/a"), "fit,mesh"),
          render(at("results/r")), render(at("results/film.mp4")), exporting(at("results/a.glb")),
          eval(at("results/p"))}) {
        Outcome outcome = doppel(words, becomeNobody);
        EXPECT_EQ(outcome.status, 1) << words[0] << "\n" << outcome.err;
        EXPECT_NE(outcome.sentence().find("results"), std::string::npos) << outcome.err;
        EXPECT_NE(outcome.sentence().find("Permission denied"), std::string::npos) << outcome.err;
        // Known at once, not after the work.
        EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << words[0] << "\n" << outcome.err;
    }
    EXPECT_EQ(tree(folder_->path()), before);
    fs::permissions(*this / "results", fs::perms(0755));
}

// Runs with a file system of so many kilobytes at results/, which goes with the command. out: what
// is left on it, a line each. Status 99: none can be mounted here.
Outcome onASmallDisk(const std::vector<std::string>& words, const std::string& folder,
                     int kilobytes) {
    const char* script =
        "mount -t tmpfs -o size=$1k doppel \"$2\" 2> /dev/null || exit 99\n"
        "folder=$2; shift 2; printf x > \"$folder/full\"\n"  // which takes a page
        "\"$@\" > /dev/null; status=$?\n"
        "cd \"$folder\" && find . -mindepth 1 ! -name full -printf '%P %s\\n'\n"
        "exit $status";
    std::vector<std::string> all{"unshare",
                                 geteuid() == 0 ? "-m" : "-Urm",
                                 "sh",
                                 "-c",
                                 script,
                                 "sh",
                                 fmt::format("{}", kilobytes),
                                 folder,
                                 program().string()};
    all.insert(all.end(), words.begin(), words.end());
    return start(all);
}

TEST_F(Refusals, NoSpaceLeft) {
    struct Case {
        std::vector<std::string> words;
        int kilobytes;
    };
    std::vector<std::string> film = render(at("results/film.mp4"));
    for (const Case& one : {Case{import(at("results/c")), 16}, Case{fit(at("results/f")), 16},
                            Case{render(at("results/r")), 8}, Case{film, 4},
                            Case{exporting(at("results/a.glb")), 64}}) {
        Outcome outcome = onASmallDisk(one.words, at("results"), one.kilobytes);
        if (outcome.status == 99 || outcome.status == 127)
            GTEST_SKIP() << "no small file system can be mounted here";
        EXPECT_EQ(outcome.status, 1) << one.words[0] << "\n" << outcome.err;
        EXPECT_NE(outcome.sentence().find("No space left"), std::string::npos) << outcome.err;
        EXPECT_NE(outcome.sentence().find(at("results")), std::string::npos) << outcome.err;
        EXPECT_EQ(outcome.out, "") << one.words[0];
    }
    // An avatar grows as its stages finish; what is there is whole.
    for (int kilobytes : {4, 20, 64, 600, 1000}) {
        Outcome outcome =
            onASmallDisk(train(at("results/a"), "fit,mesh,texture"), at("results"), kilobytes);
        EXPECT_EQ(outcome.status, 1) << kilobytes << "\n" << outcome.err;
        EXPECT_NE(outcome.sentence().find("results/a"), std::string::npos) << outcome.err;
        std::istringstream lines(outcome.out);
        for (std::string line; std::getline(lines, line);) {
            std::string name = fs::path(line.substr(0, line.rfind(' '))).filename().string();
            EXPECT_FALSE(name.starts_with('.') && name != ".doppel-files")
                << kilobytes << " kB: " << line;
            if (fs::path(name).extension() != ".csv") {
                EXPECT_FALSE(line.ends_with(" 0")) << kilobytes << " kB: " << line;
            }
        }
    }
}

}  // namespace
}  // namespace doppel
