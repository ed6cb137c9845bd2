// Imports of clips that are stopped or killed, and go on.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include "engine/io/image.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/refusals.h"
#include "trainer/data/digest.h"
#include "trainer/person/answer_log.h"
#include "trainer/person/blazepose.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::doppel;
using test::Folder;
using test::Outcome;

Digest questionOf(std::string_view text) {
    Digest question;
    question.addText(text);
    return question;
}

// What a log answers to a question, and whether it had to ask.
struct Heard {
    int value = 0;
    bool asked = false;
};

Heard hear(AnswerLog& log, std::string_view text, int truth, bool believes = true) {
    Heard heard;
    log(
        questionOf(text),
        [&](std::span<const std::byte> kept) {
            return believes && takeFront(kept, heard.value) && kept.empty();
        },
        [&] {
            heard = {truth, true};
            AnswerLog::Answer bytes;
            append(bytes, truth);
            return bytes;
        });
    return heard;
}

TEST(AnswerLog, AnswersAreKeptForTheNextRun) {
    Folder folder;
    const fs::path file = folder / "answers";
    {
        AnswerLog log(file);
        EXPECT_TRUE(hear(log, "one", 1).asked);
        EXPECT_TRUE(hear(log, "two", 2).asked);
        EXPECT_FALSE(hear(log, "one", 9).asked);
        EXPECT_EQ(hear(log, "one", 9).value, 1);
    }
    AnswerLog log(file);
    EXPECT_EQ(log.kept(), 2u);
    EXPECT_EQ(hear(log, "two", 9).value, 2);
    // One that cannot be used any more is asked for again, and the last one counts.
    EXPECT_TRUE(hear(log, "two", 3, false).asked);
    AnswerLog after(file);
    EXPECT_EQ(hear(after, "two", 9).value, 3);
    EXPECT_EQ(hear(after, "one", 9).value, 1);
    // Where there is none, everything is asked.
    bool asked = false;
    answer(
        nullptr, questionOf("one"), [](auto) { return true; },
        [&] {
            asked = true;
            return AnswerLog::Answer{};
        });
    EXPECT_TRUE(asked);
}

// Killed in the middle of a record, at each of its bytes; and spoilt on the disk.
TEST(AnswerLog, WhatIsNotWholeIsAskedForAgain) {
    Folder folder;
    const fs::path file = folder / "answers";
    {
        AnswerLog log(file);
        hear(log, "one", 1);
        hear(log, "two", 2);
    }
    const std::string whole = bytesOf(file);
    for (size_t length = 0; length < whole.size(); ++length) {
        std::ofstream(file, std::ios::binary) << whole.substr(0, length);
        {
            AnswerLog log(file);
            EXPECT_EQ(hear(log, "one", 1).asked, length < whole.size() / 2) << length;
            EXPECT_TRUE(hear(log, "two", 2).asked) << length;
        }
        AnswerLog log(file);
        EXPECT_FALSE(hear(log, "one", 9).asked) << length;
        EXPECT_EQ(hear(log, "two", 9).value, 2) << length;
    }
    for (size_t at = 0; at < whole.size(); ++at) {
        std::string spoilt = whole;
        spoilt[at] = char(spoilt[at] ^ 0x40);
        std::ofstream(file, std::ios::binary) << spoilt;
        AnswerLog log(file);
        EXPECT_EQ(hear(log, "one", 1).value, 1) << at;
        EXPECT_EQ(hear(log, "two", 2).value, 2) << at;
    }
}

// A drawn figure, which moves to the right before a wall that is not of one colour.
void filmFigure(const fs::path& file, int frames) {
    const Image scene = readImage(test::sourceFolder() / "tests/data/blazepose/scene_512.png");
    VideoWriter writer(file, 640, 512, 10);
    for (int i = 0; i < frames; ++i) {
        Image picture(640, 512, 3, 128);
        for (int y = 0; y < 512; ++y)
            std::copy_n(scene.pixel(0, y), scene.rowBytes(), picture.pixel(12 * i, y));
        writer.add(picture);
    }
    writer.finish();
}

size_t filesIn(const fs::path& folder) {
    std::error_code error;
    size_t count = 0;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error))
        ++count;
    return count;
}

// The folder of a run that is under way, or was.
fs::path hidden(const fs::path& out) {
    for (const auto& entry : fs::directory_iterator(out.parent_path()))
        if (entry.path().filename().string().starts_with("." + out.filename().string() +
                                                         ".doppel-"))
            return entry.path();
    return {};
}

// However a run ends, the next one has the frames that it looked at, and what is written in the
// end is what a run that nobody stopped writes.
TEST(StoppedImports, GoOnAndEndWithTheSameBytes) {
    if (!poseModelsAreThere(PoseNet::Lite, test::sourceFolder() / "build/models"))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    constexpr int kFrames = 6;
    filmFigure(folder / "clip.mp4", kFrames);
    const auto command = [&](const char* out, const char* every = "1") {
        return std::vector<std::string>{"import",  (folder / "clip.mp4").string(),
                                        "--out",   (folder / out).string(),
                                        "--pose",  "lite",
                                        "--every", every};
    };
    const Outcome whole = doppel(command("whole"));
    ASSERT_EQ(whole.status, 0) << whole.err;
    EXPECT_EQ(whole.err.find("goes on"), std::string::npos);

    const fs::path out = folder / "out";
    struct Stop {
        const char* folder;  // once so many files are in it
        size_t files;
        int signal;
    };
    bool first = true;
    for (const Stop& stop : {Stop{"images", 1, SIGKILL},
                             {"images", 3, SIGTERM},
                             {"masks", 2, SIGKILL},
                             {"overlays", 2, SIGINT}}) {
        const Outcome stopped = doppel(command("out"), nullptr, [&](pid_t child) {
            for (int i = 0; i < 6000; ++i) {
                const fs::path at = hidden(out);
                if (!at.empty() && filesIn(at / stop.folder) >= stop.files) break;
                std::this_thread::sleep_for(std::chrono::milliseconds(10));
            }
            kill(child, stop.signal);
        });
        EXPECT_EQ(stopped.status, stop.signal == SIGKILL   ? 1000 + SIGKILL
                                  : stop.signal == SIGTERM ? 143
                                                           : 130)
            << stop.folder << ": " << stopped.err;
        EXPECT_FALSE(fs::exists(out));
        ASSERT_FALSE(hidden(out).empty()) << stop.folder;
        EXPECT_EQ(stopped.err.find("goes on with what a run that was stopped has found") ==
                      std::string::npos,
                  first)
            << stopped.err;
        if (stop.signal != SIGKILL) {
            EXPECT_NE(stopped.err.find("interrupted; kept: what was found so far, " +
                                       hidden(out).string()),
                      std::string::npos)
                << stopped.err;
        }
        first = false;
    }
    // All pictures were looked at by now.
    EXPECT_GT(AnswerLog(hidden(out) / "answers").kept(), size_t{kFrames});
    const Outcome last = doppel(command("out"));
    ASSERT_EQ(last.status, 0) << last.err;
    EXPECT_TRUE(hidden(out).empty());
    size_t compared = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder / "whole")) {
        if (!entry.is_regular_file()) continue;
        const fs::path name = entry.path().lexically_relative(folder / "whole");
        ASSERT_TRUE(fs::exists(out / name)) << name;
        if (name.extension() == ".toml" || name.extension() == ".mp4")
            continue;  // tell the command
        EXPECT_EQ(bytesOf(entry.path()) == bytesOf(out / name), true) << name;
        ++compared;
    }
    EXPECT_GT(compared, 3u * kFrames);
    for (const auto& entry : fs::recursive_directory_iterator(out))
        EXPECT_TRUE(fs::exists(folder / "whole" / entry.path().lexically_relative(out)))
            << entry.path();

    // Another request does not take it over.
    doppel(command("other"), nullptr, [&](pid_t child) {
        for (int i = 0; i < 6000; ++i) {
            const fs::path at = hidden(folder / "other");
            if (!at.empty() && filesIn(at / "images") >= 2) break;
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        kill(child, SIGKILL);
    });
    ASSERT_FALSE(hidden(folder / "other").empty());
    const Outcome other = doppel(command("other", "5"));
    ASSERT_EQ(other.status, 0) << other.err;
    EXPECT_EQ(other.err.find("goes on with"), std::string::npos);
    EXPECT_EQ(filesIn(folder / "other/images"), 2u);
    EXPECT_TRUE(hidden(folder / "other").empty());
}

// A picture that was changed meanwhile is looked at as it is now.
TEST(StoppedImports, WhatChangedIsLookedAtAgain) {
    if (!poseModelsAreThere(PoseNet::Lite, test::sourceFolder() / "build/models"))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    Image picture = readImage(test::sourceFolder() / "tests/data/blazepose/scene_512.png");
    const fs::path pictures = folder / "pictures", out = folder / "out";
    fs::create_directory(pictures);
    for (const char* name : {"a.png", "b.png", "c.png"}) writeImage(pictures / name, picture);
    const std::vector<std::string> command{
        "import", pictures.string(), "--out", out.string(), "--pose", "lite", "--keep-similar"};
    doppel(command, nullptr, [&](pid_t child) {
        for (int i = 0; i < 6000; ++i) {
            const fs::path at = hidden(out);
            if (!at.empty() && filesIn(at / "overlays") >= 1) break;
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        kill(child, SIGKILL);
    });
    ASSERT_FALSE(hidden(out).empty());
    for (int y = 0; y < 40; ++y) std::fill_n(picture.pixel(0, y), 120, uint8_t{200});
    writeImage(pictures / "b.png", picture);
    const Outcome last = doppel(command);
    ASSERT_EQ(last.status, 0) << last.err;
    EXPECT_NE(last.err.find("goes on with"), std::string::npos);
    EXPECT_EQ(readImage(out / "images/000001.png").data, picture.data);
    // Masks are cut by the colours of all pictures, so all of them are cut again.
    std::vector<std::string> fresh = command;
    fresh[3] = (folder / "fresh").string();
    ASSERT_EQ(doppel(fresh).status, 0);
    for (const char* name : {"masks/000000.png", "masks/000001.png", "masks/000002.png"})
        EXPECT_EQ(bytesOf(out / name) == bytesOf(folder / "fresh" / name), true) << name;
    EXPECT_NE(readImage(out / "images/000002.png").data, picture.data);
}

}  // namespace
}  // namespace doppel
