// `doppel train`.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "trainer/avatar/preset.h"
#include "trainer/commands/common_options.h"
#include "trainer/stages/prior/people.h"
#include "trainer/stages/stage.h"

namespace doppel {

struct TrainOptions {
    CommonOptions common;
    std::filesystem::path capture, out;
    std::string body, frames;
    // Of those, the ones that tell most; 0: all; nothing: framesWorthLearning() of the preset.
    std::optional<size_t> mostFrames;
    std::vector<std::string> stages;  // of "fit", "mesh", "texture", "refine", in this order
    Preset preset;
    // Ablations; runTrain applies them to the preset. refine: false takes "refine" out of stages.
    bool refine = true, gan = true, face = true, clamp = true;
    // Who tells what the frames do not show (readPeople()); "none": nobody; empty: the cast, of
    // four frames or fewer.
    std::vector<std::string> prior;
    // What is in `out` plays no part, as where all stages are trained.
    bool replaces = false;
    bool resume = false;   // refuse to start a new run
    bool restart = false;  // leave an unfinished run in the avatar's folder, and start over
    double checkpointSeconds = 180;  // 0: only at Ctrl-C
    double pictureSeconds = 60;      // a picture of the state this often; 0: none
    uint64_t memoryBudget = 0;       // bytes of device memory for a stage; 0: what the device has
    int profileSteps = 0;  // > 0: time so many steps of each stage per op, and keep nothing
    bool view = false;     // open a viewer that shows the run's present state
};

// What a training found.
struct Learnt {
    bool before = false;              // an earlier run had finished it; nothing else is told then
    size_t frames = 0;                // that were learnt from
    std::vector<std::string> chosen;  // their names, where they were chosen from more
    std::vector<std::string> unseen;  // sides that none of them shows (unseenSides())
    std::optional<FitResult> fit;
};

// Nothing: of a profile, which says itself what it found.
std::optional<Learnt> learn(const TrainOptions& options);
void printLearnt(const TrainOptions& options, const Learnt& learnt);
nlohmann::ordered_json learntJson(const TrainOptions& options, const Learnt& learnt);
void runTrain(const TrainOptions& options);

// So many frames that stage texels, where there is one, takes each often enough to set its pose and
// to learn what it shows, but not so few that they miss a side; a thousand without.
size_t framesWorthLearning(const Preset& preset);

// Who tells what so many frames do not show. InputError for a prior that readPeople() refuses, and
// for one that none of the stages asks.
KnownPeople knownPeople(const TrainOptions& options, size_t frames, const BodyModel& body);

}  // namespace doppel
