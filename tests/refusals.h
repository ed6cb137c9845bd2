// The program as a user meets it, started with copies of what a user has: a capture, an avatar,
// another program's pictures and poses.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>

#include "engine/files/npz.h"
#include "engine/io/image.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/data/capture_writer.h"
#include "trainer/motion/session.h"

namespace doppel::test {

namespace fs = std::filesystem;
constexpr int kSize = 64;
constexpr size_t kFrames = 3;

inline void write(const fs::path& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

inline void cut(const fs::path& path) { fs::resize_file(path, fs::file_size(path) * 2 / 3); }

// Every file below a folder with its bytes; folders with a slash.
inline std::map<std::string, std::string> tree(const fs::path& folder) {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
        std::string name = entry.path().lexically_relative(folder).string();
        if (entry.is_directory())
            files[name + "/"];
        else
            files[name] = bytesOf(entry.path());
    }
    return files;
}

// ---- the program --------------------------------------------------------------------------------

inline fs::path program() { return fs::read_symlink("/proc/self/exe").parent_path() / "doppel"; }

struct Outcome {
    int status = -1;
    std::string out, err;

    // The sentence in which it ends.
    std::string sentence() const {
        size_t end = err.find_last_not_of('\n');
        if (end == std::string::npos) return {};
        size_t begin = err.rfind('\n', end);
        return err.substr(begin == std::string::npos ? 0 : begin + 1, end - begin);
    }
};

// Runs a command line; `inChild` is called before it starts (only system calls), `meanwhile` while
// it runs.
inline Outcome start(const std::vector<std::string>& words, void (*inChild)() = nullptr,
                     const std::function<void(pid_t)>& meanwhile = {}) {
    Folder io;
    std::string out = (io / "out").string(), err = (io / "err").string();
    std::vector<char*> arguments;
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    pid_t child = fork();
    if (child == 0) {
        if (!freopen(out.c_str(), "w", stdout) || !freopen(err.c_str(), "w", stderr)) _exit(126);
        if (inChild) inChild();
        execvp(arguments[0], arguments.data());
        _exit(127);
    }
    int status = 0;
    if (meanwhile) meanwhile(child);
    waitpid(child, &status, 0);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status), bytesOf(out),
            bytesOf(err)};
}

inline Outcome doppel(std::vector<std::string> words, void (*inChild)() = nullptr,
                      const std::function<void(pid_t)>& meanwhile = {}) {
    words.insert(words.begin(), program().string());
    return start(words, inChild, meanwhile);
}

// ---- what a user has ----------------------------------------------------------------------------

// A pickle of plain numbers as Python 2 wrote them.
inline std::string posePickle(const Theta& theta, const Trans& trans) {
    auto list = [](const char* name, std::span<const float> values) {
        std::string text = fmt::format("S'{}'\n(", name);
        for (float value : values) text += fmt::format("F{}\n", value);
        return text + "l";
    };
    return "(" + list("pose", theta) + list("betas", Betas{}) + list("trans", trans) +
           "S'f'\nF80.0\nd.";
}

class Refusals : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        home_ = std::make_unique<Folder>();
        chmod(home_->path().c_str(), 0755);
        Avatar avatar;
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        avatar.preset = presetByName("ci");
        for (const auto& [name, value] : kNumbers)
            setPresetValue(avatar.preset, name, value, "test");
        Parameters meshNet;
        declareMeshNet(meshNet, avatar, 1);
        meshNet.allocate(testDevice());
        avatar.meshNet = readWeights(meshNet);
        avatar.textureNet = TextureNet(testDevice(), avatar, 1).weights();
        paintTexture(testDevice(), avatar);
        writeAvatar(*home_ / "avatar", avatar);

        Capture capture;
        capture.name = "three";
        CaptureWriter writer(*home_ / "capture");
        fs::path source = *home_ / "source";
        for (const char* name : {"images", "segmentations", "smpl_pose"})
            fs::create_directories(source / name);
        AvatarRenderer renderer(testDevice(), avatar);
        Camera camera{80, 80, kSize / 2.0, kSize / 2.0, kSize, kSize};
        for (size_t f = 0; f < kFrames; ++f) {
            Theta theta{};
            auto root = uprightOrientation(0.5f * static_cast<float>(f));
            std::ranges::copy(root, theta.begin());
            Trans trans{0, 0.2f, 3.2f};
            std::string name = fmt::format("f{}", f);
            std::vector<uint8_t> mask = renderer.mask(theta, trans, camera), rgb;
            for (uint8_t value : mask)
                for (int c = 0; c < 3; ++c)
                    rgb.push_back(static_cast<uint8_t>(value / 2 + rgb.size() % 97));
            writer.addImage(name, kSize, kSize, rgb);
            writer.addMask(name, kSize, kSize, mask);
            capture.frames.push_back({name, {}, {}, camera});
            capture.theta.push_back(theta);
            capture.trans.push_back(trans);
            write(source / "smpl_pose" / (name + ".png_body.pkl"), posePickle(theta, trans));
        }
        writer.commit(capture);
        for (size_t f = 0; f < kFrames; ++f) {
            std::string file = fmt::format("f{}.png", f);
            fs::copy(*home_ / "capture" / "images" / file, source / "images" / file);
            fs::copy(*home_ / "capture" / "masks" / file, source / "segmentations" / file);
        }
        fs::permissions(*home_ / "capture", fs::perms(0755));
    }
    static void TearDownTestSuite() { home_.reset(); }

    // A copy of it all, to be spoiled.
    void SetUp() override {
        folder_ = std::make_unique<Folder>();
        chmod(folder_->path().c_str(), 0755);
        fs::copy(home_->path(), folder_->path(), fs::copy_options::recursive);
        fs::create_directory(*folder_ / "results");
    }

    fs::path operator/(const char* name) const { return *folder_ / name; }
    std::string at(const char* name) const { return (*folder_ / name).string(); }

    static std::vector<std::string> withNumbers(std::vector<std::string> words) {
        for (const auto& [name, value] : kNumbers) {
            words.push_back("--set");
            words.push_back(fmt::format("{}={}", name, value));
        }
        return words;
    }
    // The six that write, with their results in `out`.
    std::vector<std::string> import(const std::string& out) const {
        return {"import", at("source"), "--out", out};
    }
    std::vector<std::string> fit(const std::string& out) const {
        return {"fit", at("capture"), "--out", out, "--set", "fit.passes=1"};
    }
    std::vector<std::string> train(const std::string& out, const std::string& stages) const {
        return withNumbers({"train", at("capture"), "--out", out, "--preset", "ci", "--stages",
                            stages, "--picture-every", "0"});
    }
    std::vector<std::string> render(const std::string& out) const {
        return {"render", at("avatar"), "--motion", at("capture"), "--out", out};
    }
    std::vector<std::string> exporting(const std::string& out) const {
        return {"export", at("avatar"), "--out", out, "--motion", at("capture")};
    }
    std::vector<std::string> eval(const std::string& pictures) const {
        return {"eval", at("avatar"), at("capture"), "--pictures", pictures};
    }

    // One line with these words, this status, and nothing new or changed on the disk.
    void refuses(const std::vector<std::string>& words, const std::string& sentence, int status,
                 bool oneLine = true) const {
        auto before = tree(folder_->path());
        Outcome outcome = doppel(words);
        std::string command = fmt::format("{} {}", words[0], words[1]);
        EXPECT_EQ(outcome.status, status) << command << "\n" << outcome.err;
        EXPECT_TRUE(outcome.out.empty()) << command << "\n" << outcome.out;
        EXPECT_TRUE(outcome.sentence().starts_with("doppel: ")) << command << "\n" << outcome.err;
        EXPECT_NE(outcome.sentence().find(sentence), std::string::npos) << command << "\n"
                                                                        << outcome.err;
        if (oneLine) {
            EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << command << "\n" << outcome.err;
        }
        auto after = tree(folder_->path());
        for (const auto& [name, bytes] : after)
            EXPECT_TRUE(before.contains(name) && before[name] == bytes) << command << ": " << name;
        EXPECT_EQ(before.size(), after.size()) << command;
    }

    // Sizes at which everything takes a moment.
    static inline const std::vector<std::pair<std::string, std::string>> kNumbers{
        {"fit.size", "64"},
        {"fit.passes", "1"},
        {"mesh.size", "64"},
        {"mesh.blocks", "1"},
        {"mesh.layers", "2"},
        {"mesh.hidden", "8"},
        {"mesh.steps", "2"},
        {"texture.size", "64"},
        {"texture.depth", "5"},
        {"texture.width", "4"},
        {"texture.textureSize", "64"},
        {"texture.steps", "2"},
        {"texture.batch", "2"},
        {"texture.constantInput", "false"},
        {"refine.depth", "5"}};
    static inline std::unique_ptr<Folder> home_;
    std::unique_ptr<Folder> folder_;
};

}  // namespace doppel::test
