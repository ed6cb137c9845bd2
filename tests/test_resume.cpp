// Trainings that are stopped, killed, watched, resumed and repeated.
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/stages/train.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <fstream>
#include <numeric>

#include "engine/io/image.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/rendering.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/commands/train.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/synthetic.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::tinyCapture;
using test::tinyPreset;

// Few steps of everything that has a state: moments, running statistics, dropout, two samplers
// that draw more than a frame per step, and a texture network that sees the frame's pose.
Preset restlessPreset() {
    Preset preset = tinyPreset();
    preset.fit.passes = 2;
    preset.shape.steps = 7;
    preset.texels.steps = 7;
    preset.shape.coarse = .3;
    preset.texels.size = 64;
    preset.texels.coarse = .3;
    preset.texels.fine = .4;
    preset.mesh.steps = 7;
    preset.mesh.batch = 2;
    preset.mesh.balanceHeadings = true;
    preset.texture.steps = 8;
    preset.texture.batch = 2;
    preset.texture.dropout = 0.5;
    preset.texture.constantInput = false;
    preset.texture.region = Region::Union;
    preset.refine.steps = 8;
    preset.refine.batch = 2;
    preset.refine.dropout = 0.5;
    return preset;
}

TrainOptions restlessOptions(const fs::path& capture, const fs::path& out) {
    TrainOptions options;
    options.capture = capture;
    options.out = out;
    options.body = "default";
    options.stages = {"fit", "shape", "texels", "mesh", "texture", "refine"};
    options.preset = restlessPreset();
    options.pictureSeconds = 0;
    return options;
}

// As the program does it, with a hand at the switch.
void trainUntil(const TrainOptions& options, bool resume, double checkpointSeconds,
                const std::function<void(const std::string& stage, int64_t done)>& afterStep,
                const std::function<void()>& opened = {}) {
    Avatar avatar;
    if (resume && !readRunRecord(options.out)->done.empty()) {
        avatar = readAvatar(options.out);
    } else {
        avatar.bodyArrays = readBodyArrays(options.body);
        avatar.body = bodyFromNpz(avatar.bodyArrays);
    }
    avatar.preset = options.preset;
    TrainSettings settings;
    settings.stages = options.stages;
    settings.out = options.out;
    settings.pictureSeconds = opened ? 1e-9 : 0;  // of one who watches: after every step
    settings.opened = opened;
    settings.resume = resume;
    settings.checkpointSeconds = checkpointSeconds;
    settings.afterStep = afterStep;
    trainAvatar(testDevice(), std::move(avatar), readCapture(options.capture), settings);
}

void expectSameResult(const fs::path& a, const fs::path& b) {
    for (const char* name :
         {"body.npz", "texels.png", "mesh_net.safetensors", "texture_net.safetensors",
          "texture.png", "refine_net.safetensors", "texture_baked.png", "preview.png",
          "log/losses_fit.csv", "log/losses_shape.csv", "log/losses_texels.csv",
          "log/losses_mesh.csv", "log/losses_texture.csv", "log/losses_refine.csv"}) {
        std::string bytes = bytesOf(a / name);
        EXPECT_FALSE(bytes.empty()) << name;
        EXPECT_EQ(bytes, bytesOf(b / name)) << name;
    }
    EXPECT_FALSE(fs::exists(a / "checkpoints"));
    EXPECT_FALSE(fs::exists(b / "checkpoints"));
}

class Resume : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<test::Folder>();
        tinyCapture(capture());
        runTrain(restlessOptions(capture(), whole()));
    }
    static void TearDownTestSuite() { folder_.reset(); }
    static fs::path capture() { return folder_->path() / "capture"; }
    static fs::path whole() { return folder_->path() / "whole"; }
    static std::unique_ptr<test::Folder> folder_;
};
std::unique_ptr<test::Folder> Resume::folder_;

TEST_F(Resume, EndsWithTheSameBytesAfterCtrlCInEveryStage) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "stopped");
    const std::vector<std::pair<std::string, int64_t>> stops{
        {"fit", 5},  {"fit", 12},    {"shape", 3},  {"texels", 1}, {"texels", 5},
        {"mesh", 3}, {"texture", 6}, {"refine", 1}, {"refine", 5}};
    for (size_t k = 0; k < stops.size(); ++k) {
        const auto& [stage, step] = stops[k];
        catchInterrupts();
        std::string kept;
        try {
            trainUntil(options, k > 0, 0, [&](const std::string& at, int64_t done) {
                if (at == stops[k].first && done == stops[k].second) raise(SIGINT);
            });
            ADD_FAILURE() << "nobody stopped at step " << step << " of " << stage;
        } catch (const Interrupted& stop) {
            kept = stop.kept;
        }
        EXPECT_NE(kept.find(stage + ".safetensors"), std::string::npos) << kept;
        EXPECT_TRUE(fs::exists(options.out / "checkpoints" / (stage + ".safetensors")));
    }
    catchInterrupts();
    signal(SIGINT, SIG_DFL);

    // Another run is not mistaken for this one.
    TrainOptions other = options;
    other.common.seed = 2;
    expectInputError([&] { runTrain(other); },
                     "an unfinished run is there, with seed = 1, and this one has 2");
    TrainOptions mixed = options;
    mixed.common.precision = "mixed";
    expectInputError([&] { runTrain(mixed); },
                     "an unfinished run is there, with precision = fp32, and this one has mixed");
    mixed.common.precision = "bf16";
    expectInputError([&] { runTrain(mixed); }, "--precision: expected fp32 or mixed");
    other = options;
    other.preset.texture.lr *= 2;
    expectInputError([&] { runTrain(other); }, "with texture.lr = ");
    other = options;
    other.frames = "0:5";
    expectInputError([&] { runTrain(other); },
                     "an unfinished run is there, with capture_frames = ");

    // The same command goes on, without a flag.
    runTrain(options);
    expectSameResult(options.out, whole());
    // Now there is nothing more to go on with.
    options.resume = true;
    expectInputError([&] { runTrain(options); }, "expected an unfinished run to go on with");
}

TEST_F(Resume, EndsWithTheSameBytesAfterBeingKilledBetweenCheckpoints) {
    struct Killed {};
    TrainOptions options = restlessOptions(capture(), folder_->path() / "killed");
    fs::path aside = folder_->path() / "aside.safetensors";
    const std::vector<std::string> stages{"fit", "shape", "texels", "mesh", "texture", "refine"};
    for (size_t k = 0; k < stages.size(); ++k) {
        // A checkpoint after each step; the one of step 3 is what a kill during step 6 finds.
        fs::path checkpoint = options.out / "checkpoints" / (stages[k] + ".safetensors");
        auto kill = [&](const std::string& stage, int64_t done) {
            if (stage != stages[k]) return;
            if (done == 4) fs::copy_file(checkpoint, aside, fs::copy_options::overwrite_existing);
            if (done == 6) throw Killed{};
        };
        EXPECT_THROW(trainUntil(options, k > 0, 1e-9, kill), Killed);
        fs::rename(aside, checkpoint);
    }
    options.resume = true;
    runTrain(options);
    expectSameResult(options.out, whole());
}

TEST_F(Resume, EndsWithTheSameBytesWhenItIsWatched) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "watched");
    bool opened = false;
    std::map<std::string, int> states;
    auto look = [&](const std::string& stage, int64_t done) {
        if (stage == "fit" || done % 3 != 0) return;
        Avatar live = readAvatar(liveFolder(options.out));
        ++states[stage];
        const std::optional<StageRecord> record = readStageRecord(options.out);
        ASSERT_TRUE(record);
        EXPECT_EQ(record->stage, stage);
        EXPECT_EQ(record->device, testDevice().info().name);
        EXPECT_GE(record->steps, done);
        const bool surface = stage == "shape" || stage == "texels";
        EXPECT_FALSE(live.body.offsets.empty());
        EXPECT_EQ(live.texels.empty(), stage == "shape");
        EXPECT_EQ(live.meshNet.empty(), surface);
        EXPECT_EQ(live.textureNet.empty(), surface || stage == "mesh");
        EXPECT_EQ(live.refineNet.empty(), stage != "refine");
    };
    trainUntil(options, false, 0, look, [&] {
        opened = true;
        Avatar live = readAvatar(liveFolder(options.out));
        EXPECT_TRUE(live.meshNet.empty());
        EXPECT_TRUE(live.texture.empty());
    });
    EXPECT_TRUE(opened);
    EXPECT_EQ(states,
              (std::map<std::string, int>{
                  {"shape", 2}, {"texels", 2}, {"mesh", 2}, {"texture", 2}, {"refine", 2}}));
    expectSameResult(options.out, whole());
}

TEST_F(Resume, StartsOverWhenAsked) {
    struct Killed {};
    TrainOptions options = restlessOptions(capture(), folder_->path() / "restarted");
    auto kill = [&](const std::string& stage, int64_t done) {
        if (stage == "mesh" && done == 2) throw Killed{};
    };
    TrainOptions other = options;
    other.preset.fit.lrTheta *= 0.5;
    EXPECT_THROW(trainUntil(other, false, 1e-9, kill), Killed);
    options.restart = true;
    runTrain(options);
    expectSameResult(options.out, whole());
}

// What the run before had begun is not gone on with by the run that takes its place.
TEST_F(Resume, StartsOverWithoutWhatWasBegun) {
    struct Killed {};
    TrainOptions options = restlessOptions(capture(), folder_->path() / "begun");
    TrainOptions other = options;
    other.preset.fit.lrTheta *= 0.5;
    EXPECT_THROW(trainUntil(other, false, 1e-9,
                            [](const std::string& stage, int64_t done) {
                                if (stage == "shape" && done == 4) throw Killed{};
                            }),
                 Killed);
    EXPECT_THROW(trainUntil(options, false, 1e-9,
                            [](const std::string& stage, int64_t done) {
                                if (stage == "fit" && done == 2) throw Killed{};
                            }),
                 Killed);
    options.resume = true;
    runTrain(options);
    expectSameResult(options.out, whole());
}

TEST_F(Resume, RemovesTheStateOfAllStages) {
    const fs::path folder = folder_->path() / "state";
    for (const std::string& stage : stageNames()) {
        fs::create_directories(folder / "checkpoints");
        std::ofstream(folder / "checkpoints" / (stage + ".safetensors")) << "something";
    }
    writeStageRecord(folder, {.stage = "mesh", .device = "a device", .steps = 4, .began = 1});
    removeTrainingState(folder);
    EXPECT_FALSE(fs::exists(folder / "checkpoints"));
}

TEST_F(Resume, StagesThatAreNotTrainedKeepTheirNetworksAndNumbers) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "again");
    fs::copy(whole(), options.out, fs::copy_options::recursive);
    options.stages = {"texture"};
    options.preset.mesh.hidden = 8;
    options.preset.texture.steps = 1;
    options.preset.texture.width = 8;
    options.restart = true;
    runTrain(options);
    for (const char* name : {"body.npz", "mesh_net.safetensors"})
        EXPECT_EQ(bytesOf(options.out / name), bytesOf(whole() / name)) << name;
    Avatar avatar = readAvatar(options.out);
    EXPECT_EQ(avatar.preset.mesh.hidden, 16);
    EXPECT_EQ(avatar.preset.texture.width, 8);
    AvatarRenderer renderer(testDevice(), avatar);  // all shapes agree

    options.stages = {"fit"};
    options.preset.fit.passes = 1;
    options.preset.texture.width = 4;
    runTrain(options);
    EXPECT_EQ(bytesOf(options.out / "mesh_net.safetensors"),
              bytesOf(whole() / "mesh_net.safetensors"));
    EXPECT_EQ(readAvatar(options.out).preset.texture.width, 8);
    EXPECT_NE(readAvatar(options.out).betas, avatar.betas);
}

// What training found of the frames' poses is there for eval, and for stages that go on.
TEST_F(Resume, KeepsThePosesThatItFound) {
    const Capture given = readCapture(capture());
    Capture seen = given;
    EXPECT_EQ(takeTrainingPoses(whole(), seen), given.size());
    for (size_t f = 0; f < given.size(); ++f) EXPECT_NE(seen.theta[f], given.theta[f]);
    std::vector<size_t> last{given.size() - 1};
    Capture part = given.subset(last);
    part.theta.push_back(given.theta[0]);
    part.theta.back()[5] += .1f;  // a frame that it was not trained on
    part.trans.push_back(given.trans[0]);
    part.frames.push_back(given.frames[0]);
    EXPECT_EQ(takeTrainingPoses(whole(), part), 1u);
    EXPECT_EQ(part.theta[0], seen.theta.back());
    EXPECT_EQ(part.theta[1][5], given.theta[0][5] + .1f);

    // Whoever moves is told likewise, however the motion is called.
    Motion motion = readMotion(capture());
    motion.name = "another name";
    Motion found = motion;
    takeTrainingPoses(trainedFrames(whole(), found), found);
    EXPECT_EQ(found.theta, seen.theta);
    EXPECT_EQ(found.trans, seen.trans);
    const Avatar person = readAvatar(whole());
    const Retargeted shown = performed(person, whole(), readMotion(capture()), {});
    EXPECT_EQ(shown.motion.theta, seen.theta);
    EXPECT_NE(shown.summary.find("--retarget off"), std::string::npos) << shown.summary;
    const Retargeted asGivenTo = performed(person, whole(), readMotion(capture()), {.on = false});
    EXPECT_EQ(asGivenTo.motion.theta, given.theta);
    EXPECT_EQ(asGivenTo.summary, "");
    const std::vector<TrainedFrame> known = trainedFrames(whole(), motion.subset(last));
    ASSERT_EQ(known.size(), 1u);
    EXPECT_EQ(known[0].frame, 0u);
    EXPECT_EQ(known[0].theta, seen.theta.back());
    Motion others = motion;
    for (Theta& theta : others.theta) theta[5] += .1f;
    EXPECT_TRUE(trainedFrames(whole(), others).empty());
    // A frame between two that were seen is corrected by what lies between their corrections, one
    // that is a second away from them is not.
    Motion between = motion.subset(std::vector<size_t>{0, 0, 1, 1, 1});
    between.fps = 3;
    between.trans[1] = {9, 9, 9};
    between.trans[3] = between.trans[4] = {5, 5, 5};
    takeTrainingPoses(trainedFrames(whole(), between), between);
    EXPECT_EQ(between.theta[0], seen.theta[0]);
    EXPECT_EQ(between.theta[2], seen.theta[1]);
    for (size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(
            between.trans[1][k],
            9 + (seen.trans[0][k] - given.trans[0][k] + seen.trans[1][k] - given.trans[1][k]) / 2,
            1e-5);
    const auto turnOf = [](const Theta& from, const Theta& to, size_t j) {
        return glm::inverse(jointRotation(from, j)) * jointRotation(to, j);
    };
    for (size_t j = 0; j < kJointCount; ++j) {
        const glm::dquat first = turnOf(given.theta[0], seen.theta[0], j),
                         second = turnOf(given.theta[1], seen.theta[1], j),
                         own = turnOf(given.theta[0], between.theta[1], j);
        EXPECT_NEAR(std::abs(glm::dot(own, glm::slerp(first, second, .5))), 1, 1e-9) << j;
    }
    EXPECT_NE(between.theta[3], given.theta[1]);
    EXPECT_EQ(between.theta[4], given.theta[1]);
    EXPECT_EQ(between.trans[4][0], 5);
    motion.cameras.clear();
    EXPECT_TRUE(trainedFrames(whole(), motion).empty());

    const double asGiven =
        meanMetrics(evaluateAvatar(testDevice(), readAvatar(whole()), given)).iou;
    const double asFound = meanMetrics(evaluateAvatar(testDevice(), readAvatar(whole()), seen)).iou;
    EXPECT_GT(asFound, asGiven + .02);

    const fs::path copy = folder_->path() / "damaged-poses";
    fs::copy(whole(), copy, fs::copy_options::recursive);
    Npz arrays = readNpz(copy / "poses.npz");
    arrays.set("given", Array::f32({2, 3}, std::vector<float>(6)));
    writeNpz(copy / "poses.npz", arrays, true);
    expectInputError([&] { takeTrainingPoses(copy, seen); }, "poses.npz: given: expected shape");
}

// Coarse steps are those over crops of half the size, and a stage of nothing else ends as one over
// such crops does.
TEST_F(Resume, CoarseStepsAreOverCropsOfHalfTheSize) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "coarse");
    options.stages = {"fit", "shape"};
    options.preset.shape.coarse = 1;
    runTrain(options);
    options.out = folder_->path() / "half";
    options.preset.shape.coarse = 0;
    options.preset.shape.size /= 2;
    runTrain(options);
    options.out = folder_->path() / "full";
    options.preset.shape.size *= 2;
    runTrain(options);
    for (const char* name : {"body.npz", "log/losses_shape.csv"}) {
        const std::string half = bytesOf(folder_->path() / "half" / name);
        EXPECT_EQ(bytesOf(folder_->path() / "coarse" / name), half) << name;
        EXPECT_NE(bytesOf(folder_->path() / "full" / name), half) << name;
    }
}

// Texels that are trained again take what was painted over the old ones with them.
TEST_F(Resume, NewTexelsEndTheTextureThatWasPaintedOverTheOldOnes) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "texels");
    fs::copy(whole(), options.out, fs::copy_options::recursive);
    options.stages = {"texels"};
    options.restart = true;
    runTrain(options);
    const Avatar avatar = readAvatar(options.out);
    EXPECT_FALSE(avatar.texels.empty());
    EXPECT_EQ(avatar.texture, avatar.texels);
    EXPECT_TRUE(avatar.textureNet.empty());
    EXPECT_TRUE(avatar.refineNet.empty());
    EXPECT_FALSE(avatar.meshNet.empty());
    EXPECT_FALSE(avatar.trained.contains("texture"));
    AvatarRenderer renderer(testDevice(), avatar);

    // They have the texture's size, whichever stage is asked for.
    options.restart = false;
    options.preset.texture.textureSize = 32;
    options.preset.texture.depth = 4;
    expectInputError([&] { runTrain(options); }, "texels.textureSize = 64, and this run has 32");
    options.stages = {"texture"};
    options.restart = true;
    expectInputError([&] { runTrain(options); },
                     "texture.textureSize: expected 64, as the avatar's texels have, found 32");
}

// Frames of two sizes, and one that shows nobody.
TEST_F(Resume, SaysWhatIsWrongWithTrainingState) {
    struct Killed {};
    TrainOptions options = restlessOptions(capture(), folder_->path() / "damaged");
    auto kill = [&](const std::string& stage, int64_t done) {
        if (stage == "fit" && done == 4) throw Killed{};
    };
    EXPECT_THROW(trainUntil(options, false, 1e-9, kill), Killed);
    fs::path record = options.out / "checkpoints" / "run.toml";
    fs::path checkpoint = options.out / "checkpoints" / "fit.safetensors";
    std::string bytes = bytesOf(checkpoint), text = bytesOf(record);

    fs::resize_file(checkpoint, bytes.size() - 100);
    expectInputError([&] { runTrain(options); }, "fit.safetensors");
    fs::resize_file(record, text.find('=', text.size() / 2) + 1);  // within a line
    expectInputError([&] { runTrain(options); }, "run.toml");
    fs::resize_file(record, 0);
    expectInputError([&] { runTrain(options); }, "run.toml: expected a table asked");
}

// Every file with its bytes and its time.
std::map<std::string, std::pair<std::string, fs::file_time_type>> stateOf(const fs::path& folder) {
    std::map<std::string, std::pair<std::string, fs::file_time_type>> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (entry.is_regular_file())
            files[entry.path().string()] = {bytesOf(entry.path()), entry.last_write_time()};
    return files;
}

TEST_F(Resume, AFinishedTrainingIsNotReplaced) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "finished");
    fs::copy(whole(), options.out, fs::copy_options::recursive);
    const auto before = stateOf(options.out);
    // Asked for again: done already, in whole and in part.
    runTrain(options);
    options.stages = {"mesh", "texture"};
    runTrain(options);
    EXPECT_EQ(stateOf(options.out), before);
    // Asked for something else.
    TrainOptions other = options;
    other.preset.texture.lr *= 2;
    expectInputError([&] { runTrain(other); },
                     "finished: it has texture already, trained with "
                     "texture.lr = ");
    expectInputError([&] { runTrain(other); }, "--restart trains it again, another --out keeps it");
    other = options;
    other.common.seed = 2;
    expectInputError([&] { runTrain(other); }, "seed = 1, and this run has 2");
    other = options;
    other.frames = "0:5";
    expectInputError([&] { runTrain(other); }, "capture_frames = ");
    other = restlessOptions(capture(), options.out);
    other.body = "default-full";
    expectInputError([&] { runTrain(other); }, "body = ");
    EXPECT_EQ(stateOf(options.out), before);
    // A profile keeps nothing and may be made at any time.
    other = options;
    other.stages = {"mesh"};
    other.profileSteps = 1;
    runTrain(other);
    EXPECT_EQ(stateOf(options.out), before);
}

TEST_F(Resume, AStageIsAddedToWhatIsThere) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "added");
    options.stages = {"fit", "mesh"};
    runTrain(options);
    const std::string mesh = bytesOf(options.out / "mesh_net.safetensors");
    options.stages = {"fit", "mesh", "texture"};
    expectInputError([&] { runTrain(options); },
                     "it has fit, mesh already; --stages texture trains what it lacks");
    options.stages = {"texture"};
    runTrain(options);
    EXPECT_EQ(bytesOf(options.out / "mesh_net.safetensors"), mesh);
    EXPECT_FALSE(readAvatar(options.out).textureNet.empty());
    // An avatar whose record is gone is not replaced either.
    Avatar avatar = readAvatar(options.out);
    EXPECT_EQ(avatar.trained.size(), 3u);
    avatar.trained.clear();
    writeAvatar(options.out, avatar);
    expectInputError([&] { runTrain(options); }, "it has texture already, and no record");
}

TEST_F(Resume, OneRunAtATimeIsInAFolder) {
    TrainOptions options = restlessOptions(capture(), folder_->path() / "shared");
    bool tried = false;
    trainUntil(options, false, 0, [&](const std::string& stage, int64_t done) {
        if (stage != "mesh" || done != 2) return;
        tried = true;
        expectInputError([&] { runTrain(options); },
                         "another run of Doppel is at work in it; wait for it");
        TrainOptions other = options;
        other.restart = true;
        expectInputError([&] { runTrain(other); }, "another run of Doppel is at work");
    });
    EXPECT_TRUE(tried);
    expectSameResult(options.out, whole());
}

TEST_F(Resume, OnlyItsOwnTrainingStateIsRemoved) {
    const fs::path out = folder_->path() / "theirs";
    fs::create_directories(out / "checkpoints");
    std::ofstream(out / "checkpoints" / "model.safetensors") << "mine";
    TrainOptions options = restlessOptions(capture(), out);
    expectInputError([&] { runTrain(options); }, "checkpoints: expected nothing, or what Doppel");
    removeTrainingState(out);
    EXPECT_EQ(bytesOf(out / "checkpoints" / "model.safetensors"), "mine");
}

TEST_F(Resume, NetworksThatAreNotNumbersAreRefused) {
    const fs::path out = folder_->path() / "spoiled";
    fs::copy(whole(), out, fs::copy_options::recursive);
    for (const char* name :
         {"mesh_net.safetensors", "texture_net.safetensors", "refine_net.safetensors"}) {
        const Safetensors good = readSafetensors(out / name);
        Safetensors bad = good;
        bad.tensors.begin()->second.values.back() = std::nanf("");
        writeSafetensors(out / name, bad);
        expectInputError([&] { readAvatar(out); },
                         fmt::format("{}: {}: expected finite numbers, found nan", name,
                                     bad.tensors.begin()->first));
        writeSafetensors(out / name, good);
    }
    readAvatar(out);
    // In a checkpoint: values, and moments.
    struct Killed {};
    TrainOptions options = restlessOptions(capture(), folder_->path() / "spoiled run");
    EXPECT_THROW(trainUntil(options, false, 1e-9,
                            [&](const std::string& stage, int64_t done) {
                                if (stage == "mesh" && done == 4) throw Killed{};
                            }),
                 Killed);
    const fs::path path = options.out / "checkpoints" / "mesh.safetensors";
    const Safetensors good = readSafetensors(path);
    for (const char* part : {".value.", ".moment2."}) {
        Safetensors bad = good;
        for (auto& [name, tensor] : bad.tensors)
            if (name.find(part) != std::string::npos) tensor.values[0] = INFINITY;
        writeSafetensors(path, bad);
        expectInputError([&] { runTrain(options); }, "expected finite numbers, found inf");
    }
}

}  // namespace
}  // namespace doppel
