// Folders that Doppel writes: nobody's files are lost, killed runs leave nothing for long, and two
// runs do not spoil each other's work.
#include "trainer/data/output_folder.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::Folder;
using test::messageOf;

void put(const fs::path& path, const std::string& text) {
    fs::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << text;
}

void writeFolder(const fs::path& target, const std::string& text,
                 const std::string& kind = "capture") {
    OutputFolder output(target, kind);
    put(output.folder() / "a.txt", text);
    put(output.folder() / "images" / "b.txt", text);
    output.commit();
}

bool says(const std::string& sentence, const std::string& part) {
    EXPECT_NE(sentence.find(part), std::string::npos) << sentence;
    return sentence.find(part) != std::string::npos;
}

// Another process, which does something, says so, and lives until it is killed.
class Other {
public:
    explicit Other(const std::function<void()>& act) {
        int ready[2] = {-1, -1};
        if (pipe(ready) != 0) std::abort();
        child_ = fork();
        if (child_ == 0) {
            act();
            if (write(ready[1], "x", 1) != 1) _exit(1);
            while (true) pause();
        }
        char byte = 0;
        EXPECT_EQ(read(ready[0], &byte, 1), 1);
        close(ready[0]);
        close(ready[1]);
    }
    ~Other() { end(); }
    void end() {
        if (child_ == 0) return;
        kill(child_, SIGKILL);
        waitpid(child_, nullptr, 0);
        child_ = 0;
    }

private:
    pid_t child_ = 0;
};

TEST(OutputFolder, ReplacesWhatItWroteAndNothingElse) {
    Folder folder;
    const fs::path out = folder / "out";
    writeFolder(out, "one");
    writeFolder(out, "two");
    EXPECT_EQ(bytesOf(out / "images/b.txt"), "two");
    EXPECT_EQ(folder.names(), std::vector<std::string>{"out"});
    // Another kind is another's work.
    says(messageOf<InputError>([&] { writeFolder(out, "three", "render"); }),
         "out: expected an empty folder or one that Doppel wrote as render, which would be "
         "replaced; found what Doppel wrote as capture: name another place");
    // Whatever came in since is named, wherever it lies and whatever it is.
    const std::vector<std::pair<std::string, std::function<void(const fs::path&)>>> strangers{
        {"raw.mp4", [](const fs::path& path) { put(path, "film"); }},
        {"images/c.txt", [](const fs::path& path) { put(path, "x"); }},
        {"notes/", [](const fs::path& path) { fs::create_directory(path); }},
        {"link", [](const fs::path& path) { fs::create_symlink("/nowhere", path); }}};
    for (const auto& [name, make] : strangers) {
        make(out / name);
        const bool foreign = says(messageOf<InputError>([&] { writeFolder(out, "three"); }),
                                  "would be replaced; found " + name + ": name another place");
        EXPECT_TRUE(foreign) << name;
        EXPECT_NE(fs::symlink_status(out / name).type(), fs::file_type::not_found) << name;
        EXPECT_EQ(bytesOf(out / "a.txt"), "two");
        fs::remove(out / (name.ends_with('/') ? name.substr(0, name.size() - 1) : name));
    }
    // What comes in while it is written counts as well.
    {
        OutputFolder output(out, "capture");
        put(out / "late.txt", "x");
        EXPECT_THROW(output.commit(), InputError);
    }
    EXPECT_EQ(bytesOf(out / "late.txt"), "x");
    EXPECT_EQ(bytesOf(out / "a.txt"), "two");
    fs::remove(out / "late.txt");
    writeFolder(out, "four");
    EXPECT_EQ(bytesOf(out / "a.txt"), "four");
    EXPECT_EQ(folder.names(), std::vector<std::string>{"out"});
    // A folder without a list is somebody's, whatever the names in it.
    put(folder / "theirs/capture.toml", "");
    says(messageOf<InputError>([&] { writeFolder(folder / "theirs", "x"); }),
         "found capture.toml: name another place");
    // Links: to a folder it is followed, to nothing it is refused.
    folder.link(out, "alias");
    writeFolder(folder / "alias", "five");
    EXPECT_TRUE(fs::is_symlink(folder / "alias"));
    EXPECT_EQ(bytesOf(out / "a.txt"), "five");
    folder.link("nothing", "dangling");
    EXPECT_THROW(writeFolder(folder / "dangling", "x"), InputError);
    EXPECT_TRUE(fs::is_symlink(folder / "dangling"));
}

TEST(OutputFolder, GrowingFoldersKeepWhatIsNotTheirs) {
    Folder folder;
    const fs::path out = folder / "out";
    put(out / "body.npz", "theirs");
    says(messageOf<InputError>([&] {
             claimFiles(out, "avatar", {"a.toml", "body.npz"});
         }),
         "out/body.npz: expected nothing, or what Doppel wrote, found something else");
    EXPECT_FALSE(fs::exists(out / ".doppel-files"));
    fs::remove(out / "body.npz");
    put(out / "notes.txt", "theirs");
    claimFiles(out, "avatar", {"a.toml", "body.npz"});
    put(out / "body.npz", "ours");
    claimFiles(out, "avatar", {"body.npz", "log"});
    says(messageOf<InputError>([&] { claimFiles(out, "avatar", {"notes.txt"}); }), "notes.txt");
    says(messageOf<InputError>([&] { claimFiles(out, "eval", {"results.md"}); }),
         "expected a folder for eval, found what Doppel wrote as avatar");
    removeOutputFolder(out, "avatar");  // which has notes.txt
    EXPECT_EQ(bytesOf(out / "notes.txt"), "theirs");
    fs::remove(out / "notes.txt");
    removeOutputFolder(out, "avatar");
    EXPECT_TRUE(folder.names().empty());
}

TEST(OutputFolder, OutputsLieApartFromInputs) {
    Folder folder;
    put(folder / "c/images/a.png", "x");
    put(folder / "motion.bvh", "x");
    folder.link("c", "alias");
    const std::vector<fs::path> inputs{folder / "c", folder / "motion.bvh", "", folder / "gone"};
    for (const char* name : {"c", "alias", "c/", "c/../c", "c/out", "alias/out/deep", "."})
        EXPECT_THROW(requireApart(folder / name, inputs), InputError) << name;
    EXPECT_THROW(requireApart(folder / "motion.bvh", inputs), InputError);
    for (const char* name : {"out", "cc", "gone", "c.out"})
        EXPECT_NO_THROW(requireApart(folder / name, inputs)) << name;
    // Files beside an input are no harm; inputs themselves, and links into them, are.
    folder.link("c/images/a.png", "film.mp4");
    folder.link("motion.bvh", "out.glb");
    for (const char* name : {"motion.bvh", "film.mp4", "out.glb"})
        EXPECT_THROW(requireFileApart(folder / name, inputs), InputError) << name;
    for (const char* name : {"c/dance.mp4", "dance.mp4"})
        EXPECT_NO_THROW(requireFileApart(folder / name, inputs)) << name;
}

TEST(OutputFolder, WhatKilledRunsLeaveGoesWithTheNextRun) {
    Folder folder;
    const fs::path out = folder / "out", file = folder / "a.bin";
    put(folder / ".out.doppel-abcdef/mine.txt", "somebody's");
    Other other([&] {
        static OutputFolder output(out, "capture");
        put(output.folder() / "a.txt", "half");
        static AtomicFile half(file);
        half.write("half");
    });
    EXPECT_EQ(folder.names().size(), 3u);
    // While it lives it is left alone.
    says(messageOf<InputError>([&] { writeFolder(out, "x"); }),
         "out: another run of Doppel is writing it; wait for it, or name another place");
    writeWholeFile(file, std::vector<uint8_t>{'n'});
    EXPECT_EQ(folder.names().size(), 4u);
    other.end();
    EXPECT_EQ(folder.names().size(), 4u);
    writeFolder(out, "x");
    writeWholeFile(file, std::vector<uint8_t>{'n'});
    EXPECT_EQ(folder.names(), (std::vector<std::string>{".out.doppel-abcdef", "a.bin", "out"}));
    EXPECT_EQ(bytesOf(folder / ".out.doppel-abcdef/mine.txt"), "somebody's");
}

TEST(OutputFolder, LongWorkGoesOn) {
    Folder folder;
    const fs::path out = folder / "out";
    {
        Other other([&] {
            static OutputFolder output(out, "capture", "clip, every 3");
            put(output.folder() / "a.txt", "half");
        });
        says(messageOf<InputError>([&] { OutputFolder again(out, "capture", "clip, every 3"); }),
             "out: another run of Doppel is writing it; wait for it, or name another place");
        other.end();
    }
    const std::vector<std::string> left = folder.names();
    ASSERT_EQ(left.size(), 1u);
    {
        OutputFolder output(out, "capture", "clip, every 3");
        EXPECT_TRUE(output.goesOn());
        EXPECT_EQ(output.folder(), folder / left[0]);
        EXPECT_EQ(bytesOf(output.folder() / "a.txt"), "half");
        put(output.folder() / "b.txt", "more");
        output.leave();
    }
    EXPECT_EQ(folder.names(), left);
    {
        OutputFolder output(out, "capture", "clip, every 3");
        EXPECT_TRUE(output.goesOn());
        output.commit();
    }
    EXPECT_EQ(folder.names(), std::vector<std::string>{"out"});
    EXPECT_EQ(bytesOf(out / "a.txt") + bytesOf(out / "b.txt"), "halfmore");
    EXPECT_FALSE(fs::exists(out / ".doppel-work"));
    // Other work, another kind, and what cannot go on begin anew; what fails leaves nothing.
    for (const auto& [kind, work] : {std::pair{"capture", "clip, every 4"},
                                     {"capture", "clip"},
                                     {"capture", ""},
                                     {"motion", "clip, every 3"}}) {
        const fs::path place = folder / "place";
        {
            OutputFolder output(place, "capture", "clip, every 3");
            EXPECT_FALSE(output.goesOn());
            output.leave();
        }
        EXPECT_FALSE(OutputFolder(place, kind, work).goesOn()) << kind << work;
        EXPECT_EQ(folder.names(), std::vector<std::string>{"out"});
    }
}

TEST(OutputFolder, ALockEndsWithItsProcess) {
    Folder folder;
    {
        Other other([&] { static FolderLock lock(folder.path()); });
        says(messageOf<InputError>([&] { FolderLock lock(folder.path()); }),
             "another run of Doppel is at work in it; wait for it, or name another place");
    }
    FolderLock lock(folder.path());
    EXPECT_THROW(FolderLock{folder.path()}, InputError);
}

}  // namespace
}  // namespace doppel
