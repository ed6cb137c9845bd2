// The loop around the steps of every training stage: it goes on from a checkpoint, draws curves and
// pictures, and stops at Ctrl-C so that a later run ends with the bytes of one never stopped.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "nn/ops/optim.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/progress.h"

namespace doppel {

struct LoopSettings {
    std::filesystem::path out;  // checkpoints/ and log/ are in here; empty: nothing is kept
    uint64_t seed = 1;
    bool resume = false;             // go on from the checkpoint, if there is one
    double checkpointSeconds = 180;  // a checkpoint this often; 0: only at Ctrl-C
    double pictureSeconds = 60;      // a picture of the state this often; 0: none
    // > 0: run so many steps of each stage, print the time per op, keep nothing.
    int profileSteps = 0;
    // Told of every step that was taken, before Ctrl-C and checkpoints are looked at. May throw.
    std::function<void(const std::string& stage, int64_t done)> afterStep;

    bool keeps() const { return !out.empty() && profileSteps == 0; }
};

// A stage as the loop sees it. What must survive a stop is all of: parameters with their moments
// (trained), running statistics (statistics), and what `draw` changes. A step must depend on
// nothing else but its number: random numbers come from it and the seed (StepParams).
//
//     StageLoop loop{.stage = "mesh", .steps = steps, .columns = {"loss", "iou_loss"}};
//     loop.trained = {{"net", &net}};
//     loop.draw = [&] { drawn = ...sampler.next()...; };
//     loop.submit = [&](int64_t i) { graph.write(...); graph.setStep(...); graph.submit(); };
//     loop.report = [&](int64_t i, int back) {
//         double loss = readLoss(graph, lossTensor, "mesh", i, back);
//         return StageLoop::Report{{{"loss", loss}}, {loss, iou}};
//     };
//     if (!loop.run(settings)) return;   // profiled
//     avatar.meshNet = readWeights(net);
struct StageLoop {
    struct Report {
        Progress::Values shown;      // in the progress line
        std::vector<double> logged;  // one per column
    };

    std::string stage;
    int64_t steps = 0;
    std::vector<std::string> columns;                  // of log/losses_STAGE.csv
    std::map<std::string, std::string> identity = {};  // what must agree for a run to go on
    std::vector<std::pair<std::string, Parameters*>> trained = {}, statistics = {};
    // Takes from samplers what the next step uses. A resumed run calls it for the steps that were
    // done before, so that samplers stand where they stood.
    std::function<void()> draw = {};
    // Starts a step; steps count from 0.
    std::function<void(int64_t step)> submit = {};
    // Waits for a step that was started and says what it gave. While it is asked about a step, the
    // next one may have been started already (back = 1), so that the device never waits for us;
    // before anything is kept the newest one is asked about (back = 0). Throws MachineError where a
    // loss is not finite.
    std::function<Report(int64_t step, int back)> report = {};
    std::function<void()> picture = {};  // draws the present state; may be empty
    std::function<void()> profile = {};  // prints the time per op of the last step

    // True once all steps are done; false after profiling. The checkpoint of a finished stage stays
    // until the caller has written the stage's result (removeTrainingState, or Checkpoint::remove).
    // Throws Interrupted with the checkpoint on disk.
    bool run(const LoopSettings& settings);
};

// Of step i, counting from 0.
StepParams stepParams(int64_t i, uint64_t seed, double rate, const AdamWOptions& options);

// Sizes and numbers of a stage, for checkpoints of it: the body's, and the preset's.
std::map<std::string, std::string> stageIdentity(const Avatar& avatar, const std::string& stage);

// An output of one number, of the newest replay or of the one before (back = 1). MachineError
// naming stage and step where it is not finite.
double readLoss(Graph& graph, const Tensor& loss, const char* stage, int64_t step, int back = 0);

// Memory before the first step, and time per op, on stdout.
void printPlan(const char* stage, const Graph& graph, const Parameters& parameters);
void printProfile(const char* stage, Graph& graph);

}  // namespace doppel
