// The program as a user meets it when something is wrong with the input or with the machine: one
// line, the exit status that says whose fault it is, and no file that was not there before.
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

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::Folder;

constexpr int kSize = 64;
constexpr size_t kFrames = 3;

void write(const fs::path& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

void cut(const fs::path& path) { fs::resize_file(path, fs::file_size(path) * 2 / 3); }

// Every file below a folder with its bytes; folders with a slash.
std::map<std::string, std::string> tree(const fs::path& folder) {
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

fs::path program() { return fs::read_symlink("/proc/self/exe").parent_path() / "doppel"; }

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
Outcome start(const std::vector<std::string>& words, void (*inChild)() = nullptr,
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

Outcome doppel(std::vector<std::string> words, void (*inChild)() = nullptr,
               const std::function<void(pid_t)>& meanwhile = {}) {
    words.insert(words.begin(), program().string());
    return start(words, inChild, meanwhile);
}

// ---- what a user has ----------------------------------------------------------------------------

// A pickle of plain numbers as Python 2 wrote them.
std::string posePickle(const Theta& theta, const Trans& trans) {
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

    static const std::vector<std::pair<std::string, std::string>> kNumbers;
    static std::unique_ptr<Folder> home_;
    std::unique_ptr<Folder> folder_;
};
std::unique_ptr<Folder> Refusals::home_;
// Sizes at which everything takes a moment.
const std::vector<std::pair<std::string, std::string>> Refusals::kNumbers{
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

// ---- the input is wrong -------------------------------------------------------------------------

TEST_F(Refusals, NothingIsWrongWithTheUnspoiled) {
    // Otherwise the cases below would prove little.
    for (const auto& words :
         {import(at("results/c")), fit(at("results/f")), train(at("results/a"), "fit,mesh,texture"),
          render(at("results/r")), exporting(at("results/a.glb")), eval(at("results/p"))}) {
        Outcome outcome = doppel(words);
        EXPECT_EQ(outcome.status, 0) << words[0] << "\n" << outcome.err;
    }
    EXPECT_TRUE(fs::exists(*this / "results/a/texture.png"));
    EXPECT_FALSE(fs::exists(*this / "results/a/checkpoints"));
}

TEST_F(Refusals, MasksMissingOrOfAnotherSize) {
    fs::path mask = *this / "capture/masks/f1.png", segmentation = *this / "source/segmentations";
    writeImage(mask, Image(kSize / 2, kSize, 1));
    writeImage(segmentation / "f1.png", Image(kSize / 2, kSize, 1));
    const char* size = "f1.png: expected 64×64 pixels, the size of its frame, found 32×64";
    refuses(import(at("results/c")), size, 2);
    refuses(fit(at("results/f")), size, 2);
    refuses(train(at("results/a"), "fit,mesh"), size, 2);
    refuses(eval(at("results/p")), size, 2);
    fs::remove(mask);
    fs::remove(segmentation / "f1.png");
    refuses(import(at("results/c")), "expected a mask for every picture, found none for f1", 2);
    refuses(fit(at("results/f")), "expected a mask for every frame, found none for f1", 2);
    refuses(train(at("results/a"), "mesh"), "expected a mask for every frame, found none", 2);
    fs::remove_all(*this / "capture/masks");
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "mesh"), eval(at("results/p"))})
        refuses(words, "found none for f0; bring them in with the source, or make them", 2);
    // A render needs masks for the background of its capture only, and says what it does without.
    const Outcome outcome = doppel(render(at("results/r")));
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_NE(outcome.err.find("it has no masks"), std::string::npos) << outcome.err;
}

TEST_F(Refusals, CodeInAPickle) {
    fs::path mark = *this / "hacked";
    std::string code = fmt::format("cos\nsystem\n(S'touch {}'\ntR.", mark.string());
    write(*this / "source/smpl_pose/f1.png_body.pkl", code);
    refuses(import(at("results/c")), "f1.png_body.pkl: refers to code (os.system)", 2);
    write(*this / "body.pkl", code);
    std::vector<std::string> words = fit(at("results/f"));
    words.insert(words.end(), {"--body", at("body.pkl")});
    refuses(words, "body.pkl: refers to code (os.system)", 2);
    EXPECT_FALSE(fs::exists(mark));
}

TEST_F(Refusals, PosesThatAreNotNumbers) {
    Npz poses = readNpz(*this / "capture/poses.npz");
    std::vector<float> body(69 * kFrames);
    body[69 + 4] = std::nanf("");
    poses.set("body_pose", Array::f32({kFrames, 69}, body));
    writeNpz(*this / "capture/poses.npz", poses, false);
    Theta theta{};
    theta[7] = std::nanf("");
    write(*this / "source/smpl_pose/f2.png_body.pkl", posePickle(theta, {0, 0, 3}));
    const char* sentence = "poses.npz: body_pose: expected finite numbers, found nan in frame 1";
    refuses(import(at("results/c")), "f2.png_body.pkl: pose: expected finite numbers, found nan",
            2);
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "fit"), render(at("results/r")),
          exporting(at("results/a.glb")), eval(at("results/p"))})
        refuses(words, sentence, 2);
}

TEST_F(Refusals, NoFrames) {
    for (const char* folder : {"source/images", "capture/images"})
        for (const auto& entry : fs::directory_iterator(*this / folder)) fs::remove(entry);
    refuses(import(at("results/c")), "expected one picture (.jpg, .png) or more, found none", 2);
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "fit"), eval(at("results/p"))})
        refuses(words, "capture", 2);
    // A motion without a pose.
    Npz poses;
    poses.set("global_orient", Array::f32({0, 3}, std::vector<float>()));
    poses.set("body_pose", Array::f32({0, 69}, std::vector<float>()));
    poses.set("transl", Array::f32({0, 3}, std::vector<float>()));
    writeNpz(*this / "none.npz", poses, false);
    for (auto words : {render(at("results/r")), exporting(at("results/a.glb"))}) {
        for (std::string& word : words)
            if (word == at("capture")) word = at("none.npz");
        refuses(words, "none.npz: global_orient: expected", 2);
    }
}

TEST_F(Refusals, FramesThatAreNotThere) {
    for (auto words :
         {import(at("results/c")), fit(at("results/f")), train(at("results/a"), "fit"),
          render(at("results/r")), exporting(at("results/a.glb")), eval(at("results/p"))}) {
        words.insert(words.end(), {"--frames", "2:9"});
        refuses(words, "--frames", 2);
    }
}

TEST_F(Refusals, FilesCutShort) {
    // What each file is needed for.
    struct Cut {
        const char* file;
        std::vector<std::vector<std::string>> commands;
    };
    auto all = [&] {
        return std::vector<std::vector<std::string>>{fit(at("results/f")),
                                                     train(at("results/a"), "fit,mesh")};
    };
    auto shown = [&] {
        return std::vector<std::vector<std::string>>{
            render(at("results/r")), exporting(at("results/a.glb")), eval(at("results/p")),
            train(at("avatar"), "texture")};
    };
    std::vector<std::vector<std::string>> captures = all();
    captures.push_back(eval(at("results/p")));
    captures.push_back(render(at("results/r")));
    for (const Cut& cutting : {
             Cut{"source/images/f1.png", {import(at("results/c"))}},
             Cut{"source/segmentations/f1.png", {import(at("results/c"))}},
             Cut{"source/smpl_pose/f1.png_body.pkl", {import(at("results/c"))}},
             Cut{"capture/images/f1.png", captures},
             Cut{"capture/masks/f1.png", captures},
             Cut{"capture/poses.npz", captures},
             Cut{"capture/cameras.npz", captures},
             Cut{"avatar/avatar.toml", shown()},
             Cut{"avatar/body.npz", shown()},
             Cut{"avatar/mesh_net.safetensors", shown()},
             Cut{"avatar/texture_net.safetensors", shown()},
             Cut{"avatar/texture.png", shown()},
         }) {
        fs::path file = *this / cutting.file;
        std::string bytes = bytesOf(file);
        cut(file);
        for (const auto& words : cutting.commands)
            refuses(words, fs::path(cutting.file).filename().string() + ": ", 2, false);
        write(file, bytes);
    }
}

TEST_F(Refusals, PosesBeyondAllBounds) {
    Npz poses = readNpz(*this / "capture/poses.npz");
    std::vector<float> transl = poses.at("transl").toF32();
    transl[5] = 1e30f;
    poses.set("transl", Array::f32({kFrames, 3}, transl));
    writeNpz(*this / "capture/poses.npz", poses, false);
    write(*this / "source/smpl_pose/f2.png_body.pkl", posePickle(Theta{}, {0, 0, 1e30f}));
    const char* sentence =
        "poses.npz: transl: expected numbers from -1000000 to 1000000, found "
        "1e+30 in frame 1";
    for (const auto& words :
         {fit(at("results/f")), train(at("results/a"), "fit"), render(at("results/r")),
          exporting(at("results/a.glb")), eval(at("results/p"))})
        refuses(words, sentence, 2);
    refuses(import(at("results/c")), "1e+30", 2, false);
}

TEST_F(Refusals, NetworksThatAreNotNumbers) {
    Safetensors net = readSafetensors(*this / "avatar/texture_net.safetensors");
    net.tensors.begin()->second.values[0] = std::nanf("");
    writeSafetensors(*this / "avatar/texture_net.safetensors", net);
    const std::string sentence = "texture_net.safetensors: " + net.tensors.begin()->first +
                                 ": expected finite numbers, found nan in element 0";
    for (const auto& words : {render(at("results/r")), exporting(at("results/a.glb")),
                              eval(at("results/p")), train(at("avatar"), "refine")})
        refuses(words, sentence, 2);
}

TEST_F(Refusals, NamesThatLeadElsewhere) {
    for (const char* name : {"../../elsewhere", "/tmp/elsewhere", ".."})
        for (const char* key : {"motion", "actor"}) {
            write(*this / "capture/capture.toml", fmt::format("{} = \"{}\"\n", key, name));
            fs::create_directories(*this / "all/actor");
            fs::create_directory_symlink(*this / "capture", *this / "all/actor/motion");
            refuses({"eval", at("avatar"), at("all"), "--pictures", at("results/p")},
                    fmt::format("capture.toml: {}: expected a name without folder", key), 2);
            fs::remove_all(*this / "all");
        }
}

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
    // By way of links, for folders and files.
    fs::create_directory_symlink(*this / "capture", *this / "alias");
    refuses(fit(at("alias")), "found the input itself", 2);
    fs::create_symlink(*this / "capture/poses.npz", *this / "out.glb");
    refuses(exporting(at("out.glb")), "expected a file apart from the input", 2);
    fs::create_symlink(*this / "avatar/texture.png", *this / "out.mp4");
    refuses(render(at("out.mp4")), "expected a file apart from the input", 2);
}

TEST_F(Refusals, OutputsOverSomebodysFiles) {
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
