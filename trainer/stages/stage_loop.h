// The loop around the steps of every training stage: it goes on from a checkpoint, draws curves and
// pictures, and stops at Ctrl-C so that a later run ends with the bytes of one never stopped.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "nn/steps/adamw_numbers.h"
#include "nn/steps/losses.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/progress.h"
#include "trainer/stages/training_frames.h"

namespace doppel {

class Checkpoint;

struct LoopSettings {
    std::filesystem::path out;  // checkpoints/ and log/ are in here; empty: nothing is kept
    uint64_t seed = 1;
    bool resume = false;             // go on from the checkpoint, if there is one
    double checkpointSeconds = 180;  // a checkpoint this often; 0: only at Ctrl-C
    double pictureSeconds = 60;      // a picture of the state this often; 0: none
    // > 0: run so many steps of each stage, print the time per op, keep nothing.
    int profileSteps = 0;
    // Processes that train together (nn/core/ranks.h); null: this one trains alone. All of them see
    // the same folder, and rank 0 alone writes.
    Ranks* ranks = nullptr;
    // Told of every step that was taken, before Ctrl-C and checkpoints are looked at. May throw.
    std::function<void(const std::string& stage, int64_t done)> afterStep;

    bool hasFolder() const { return !out.empty() && profileSteps == 0; }
    bool keeps() const { return hasFolder() && rankOf(ranks) == 0; }
    // Those that share batches of so many frames; null where they cannot, so that each of them
    // takes every step whole.
    Ranks* sharing(int batch) const;
};

// A stage as the loop sees it. What must survive a stop is all of: parameters with their moments
// (trained), running statistics (statistics), and what `draw` changes. A step must depend on
// nothing else but its number: random numbers come from it and the seed (StepParams).
//
//     StageLoop loop{.stage = "mesh", .steps = steps};
//     loop.follow(step.graph, step.losses);
//     loop.trained = {{"net", &net}};
//     loop.draw = [&] { return sampler.next(batch); };
//     loop.submit = [&](int64_t i, const std::vector<size_t>& drawn) {
//         for (size_t frame : partOf(loop.sharing, drawn)) graph.write(...);
//         graph.setStep(...); graph.submit();
//     };
//     if (!loop.run(settings)) return;   // profiled
//     avatar.meshNet = readWeights(net);
struct StageLoop {
    std::string stage;
    int64_t steps = 0;
    std::map<std::string, std::string> identity = {};  // what must agree for a run to go on
    std::vector<std::pair<std::string, Parameters*>> trained = {}, statistics = {};
    // The frames of the next step. A resumed run calls it for the steps that were done before, so
    // that samplers stand where they stood.
    std::function<std::vector<size_t>()> draw = {};
    std::function<std::string(size_t frame)> frameName = {};  // for errors; may be empty
    // Starts a step; steps count from 0.
    std::function<void(int64_t step, const std::vector<size_t>& drawn)> submit = {};
    // The columns of log/losses_STAGE.csv, the first of which are in the progress line, and what a
    // step that was started gave for each; waits for it. While it is asked about a step, the next
    // one may have been started already (back = 1), so that the device never waits for us; before
    // anything is kept the newest one is asked about (back = 0).
    std::vector<std::string> columns = {};
    std::function<std::vector<double>(int64_t step, int back)> values = {};
    std::function<void()> picture = {};  // draws the present state; may be empty
    Ranks* sharing = nullptr;            // those that share its batches
    Graph* graph = nullptr;              // whose plan and times are printed where a run profiles

    // Columns and values of a step's losses, and its graph.
    void follow(Graph& stepGraph, const Losses& losses);

    // True once all steps are done; false after profiling. The checkpoint of a finished stage stays
    // until the caller has written the stage's result (removeTrainingState, or Checkpoint::remove).
    // Throws Interrupted with the checkpoint on disk; MachineError naming stage, loss term, step
    // and frames where a loss is not finite, of which nothing is kept.
    bool run(const LoopSettings& settings);

private:
    int64_t start(const LoopSettings& settings, Checkpoint& checkpoint) const;
    void checkFinite(int64_t step, const std::vector<double>& found,
                     const std::vector<size_t>& drawn) const;
};

// Steps of a stage that goes by epochs over so many frames, unless its preset says how many.
template <typename Preset>
int64_t stepsOf(const Preset& preset, size_t frames) {
    int64_t perEpoch = (static_cast<int64_t>(frames) + preset.batch - 1) / preset.batch;
    return preset.steps > 0 ? preset.steps : preset.epochs * perEpoch;
}

// Of step i of `steps`, counting from 0, at the rate that the preset schedules for it.
template <typename Preset>
StepParams stepParams(const Preset& preset, int64_t i, int64_t steps, uint64_t seed) {
    double rate = scheduledRate(preset.lr, preset.constantPart, i, steps);
    StepParams params = adamwStepParams(static_cast<uint32_t>(i + 1), static_cast<float>(rate),
                                        adamwOptions(preset));
    params.seed = static_cast<uint32_t>(seed);
    return params;
}

// A step's own numbers as the graph's inputs have them.
std::vector<int32_t> wordsOf(const StepParams& params);

// Sizes and numbers of a stage, for checkpoints of it: the body's, and the preset's.
std::map<std::string, std::string> stageIdentity(const Avatar& avatar, const std::string& stage);

}  // namespace doppel
