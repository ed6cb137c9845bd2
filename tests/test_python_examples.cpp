// The lines of Python in docs/formats.md, each run on files that Doppel wrote.
#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>

#include "engine/files/npz.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/avatar.h"
#include "trainer/commands/batch/page.h"
#include "trainer/commands/cli.h"
#include "trainer/data/capture_writer.h"
#include "trainer/import/quality.h"
#include "trainer/stages/train.h"
#include "viewer/pose/take.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

// What runs the examples: the first python3 with NumPy, Pillow and tomllib; empty: none.
std::string python() {
    for (const char* program : {"python3", "/usr/bin/python3"})
        if (std::system(
                fmt::format("{} -c 'import numpy, PIL, tomllib' 2>/dev/null", program).c_str()) ==
            0)
            return program;
    return {};
}

struct Example {
    int line = 0;
    std::string text;
};

std::vector<Example> examples() {
    std::istringstream lines(test::bytesOf(test::sourceFolder() / "docs/formats.md"));
    std::vector<Example> found;
    bool inside = false;
    int number = 0;
    for (std::string line; std::getline(lines, line);) {
        ++number;
        if (line == "```python") {
            found.push_back({number, {}});
            inside = true;
        } else if (line == "```") {
            inside = false;
        } else if (inside) {
            found.back().text += line + "\n";
        }
    }
    return found;
}

void run(std::vector<std::string> words) {
    std::ostringstream out, errors;
    EXPECT_EQ(runCommandLine(words, out, errors), 0) << words[0] << ": " << errors.str();
}

// As an import of a clip leaves them.
void writeNotesOfClip(const fs::path& capture, int64_t frames) {
    const auto f32 = [&](Shape shape) {
        shape.insert(shape.begin(), frames);
        const auto count = static_cast<size_t>(elementCount(shape));
        return Array::f32(shape, std::vector<float>(count, .5f));
    };
    Npz seen;
    seen.set("number", Array::i32({frames}, std::vector<int32_t>(static_cast<size_t>(frames))));
    for (const char* name : {"time", "presence"}) seen.set(name, f32({}));
    seen.set("roi", f32({4}));
    for (const char* name : {"picture", "world"}) seen.set(name, f32({33, 3}));
    for (const char* name : {"visibility", "in_picture"}) seen.set(name, f32({33}));
    writeNpz(capture / "landmarks.npz", seen, false);
    ClipQuality quality;
    quality.frames = {{.name = "000000", .presence = 1, .flicker = {}},
                      {.name = "000001", .flicker = {}, .cutOff = true}};
    writeQuality(capture / "quality.json", quality);
}

// Every file of docs/formats.md, under the names that it has there.
void writeFiles(const fs::path& in) {
    Capture capture = test::tinyCapture(in / "plain");
    capture.keypoints = Keypoints{};
    capture.keypoints->scheme = "openpose25";
    capture.keypoints->count = 25;
    capture.keypoints->values.assign(capture.size() * 25 * 3, 1);
    writeCapture(capture, in / "capture");
    writeNotesOfClip(in / "capture", static_cast<int64_t>(capture.size()));

    fs::create_directories(in / "film/truth");
    fs::copy(in / "capture/masks", in / "film/truth/masks", fs::copy_options::recursive);
    Npz truth = readNpz(in / "capture/poses.npz");
    truth.set("joints", Array::f32({static_cast<int64_t>(capture.size()), 24, 3},
                                   std::vector<float>(capture.size() * 72)));
    writeNpz(in / "film/truth/poses.npz", truth, false);

    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = test::tinyPreset();
    avatar.preset.refine.steps = 5;
    TrainSettings settings;
    settings.out = in / "avatar";
    settings.stages = {"fit", "mesh", "texture", "refine"};
    settings.pictureSeconds = 0;
    trainAvatar(testDevice(), avatar, capture, settings);

    const std::string me = in / "avatar", motion = in / "capture";
    for (const char* name :
         {"avatar.glb", "avatar.usda", "motion.bvh", "motion.npz", "motion.json"})
        run({"export", me, "--motion", motion, "--out", in / name});
    run({"export", me, "--out", in / "avatar.obj"});
    run({"export", me, "--networks", in / "networks"});
    run({"retarget", in / "motion.bvh", "--avatar", me, "--out", in / "fitted.npz"});
    run({"eval", me, motion, "--out", in / "tables"});

    fs::create_directories(in / "people");
    const batch::Person anna{
        .name = "anna", .input = "anna.mp4", .motion = {}, .flags = {}, .format = {}};
    batch::Job job;
    job.person = "anna";
    job.step = "avatar";
    const batch::Outcome done{.state = batch::State::Done, .seconds = 3, .message = {}};
    batch::writeSummary(in / "people", {&anna, 1}, {&job, 1}, {&done, 1});

    Take take;
    take.keys.resize(2);
    take.keys[1].time = 10;
    writeTake(in / "edited.npz", take, 30);
}

TEST(PythonExamples, ReadEveryFile) {
    const std::string program = python();
    if (program.empty())
        GTEST_SKIP()
            << "no python3 of 3.11 or later with NumPy and Pillow: python3-numpy, python3-pil";
    test::Folder folder;
    writeFiles(folder / "files");
    // ONNX Runtime is Python's own where it is there, else node's behind the same words.
    std::string beside;
    bool hasRuntime =
        std::system(fmt::format("{} -c 'import onnxruntime' 2>/dev/null", program).c_str()) == 0;
    if (!hasRuntime) {
        beside = fmt::format("PYTHONPATH='{}' ", (test::sourceFolder() / "tests/onnx").string());
        hasRuntime = std::system("node -e \"require('onnxruntime-node')\" 2>/dev/null") == 0;
    }
    const std::vector<Example> all = examples();
    EXPECT_GT(all.size(), 12u);
    for (const Example& example : all) {
        if (!hasRuntime && example.text.find("import onnxruntime") != std::string::npos) {
            fmt::print("line {}: not run, for there is no ONNX Runtime\n", example.line);
            continue;
        }
        // Some write files, which the next one should not find.
        const fs::path place = folder / std::to_string(example.line);
        fs::copy(folder / "files", place, fs::copy_options::recursive);
        folder.write("example.py", example.text);
        EXPECT_EQ(
            std::system(fmt::format("cd '{}' && PYTHONDONTWRITEBYTECODE=1 {}{} '{}' > '{}' 2>&1",
                                    place.string(), beside, program,
                                    (folder / "example.py").string(), (folder / "log").string())
                            .c_str()),
            0)
            << "docs/formats.md, line " << example.line << ":\n"
            << test::bytesOf(folder / "log");
        fs::remove_all(place);
    }
}

}  // namespace
}  // namespace doppel
