// What each subcommand of `doppel` is asked to do. cli.cpp fills these in from the command line and
// calls the functions; each lives in commands_<name>.cpp. Results go to stdout (as one JSON object
// with common.json), progress to stderr; failures are thrown.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/device.h"
#include "trainer/avatar/preset.h"
#include "trainer/eval/measures.h"

namespace doppel {

struct CommonOptions {
    std::string device;  // part of a name or an index; empty: the best one
    std::string precision = "fp32";
    uint64_t seed = 1;
    bool json = false;
    std::string commandLine;  // as typed, for provenance

    DeviceOptions deviceOptions() const {
        return {.name = device, .precision = precisionNamed(precision)};
    }
};

struct DevicesOptions {
    CommonOptions common;
};

struct ImportOptions {
    CommonOptions common;
    std::filesystem::path source, out;
    std::string body;  // "default", "default-full" or a file
    bool key = false;  // make masks from a green screen where none are given
    double fps = 30;
    std::string frames;  // selectFrames; empty: all
    bool overlays = true;
};

struct FitOptions {
    CommonOptions common;
    std::filesystem::path capture, out;
    std::string body, frames;
    Preset preset;
};

struct TrainOptions {
    CommonOptions common;
    std::filesystem::path capture, out;
    std::string body, frames;
    std::vector<std::string> stages;  // of "fit", "mesh", "texture", "refine", in this order
    Preset preset;
    // Ablations; runTrain applies them to the preset. refine: false takes "refine" out of stages.
    bool refine = true, gan = true, face = true, clamp = true;
    bool resume = false;   // refuse to start a new run
    bool restart = false;  // leave an unfinished run in the avatar's folder, and start over
    double checkpointSeconds = 180;  // 0: only at Ctrl-C
    double pictureSeconds = 60;      // a picture of the state this often; 0: none
    uint64_t memoryBudget = 0;       // bytes for the graph's temporaries; 0: what the device has
    int profileSteps = 0;  // > 0: time so many steps of each stage per op, and keep nothing
    bool view = false;     // open a viewer that shows the run's present state
};

struct RenderOptions {
    CommonOptions common;
    std::filesystem::path avatar, motion, out;  // out: a folder for PNGs, or FILE.mp4
    std::string frames;
    std::string camera = "capture";      // "capture", "turntable", or a cameras.npz
    std::string background = "capture";  // "capture", or a colour "#rrggbb"
    std::string texture = "best";        // a word of textureKind()
    double smooth = 0;                   // frames; see smoothed()
    int size = 0;                        // pixels of the larger side; 0: the camera's
    double fps = 0;                      // 0: the motion's
};

struct EvalOptions {
    CommonOptions common;
    std::filesystem::path avatar, capture;  // one of each, or folders of them: see findCaptures
    std::string frames;
    std::string texture = "best";  // a word of textureKind()
    bool fitTestPoses = false;
    std::filesystem::path pictures;  // a folder for render, frame and error side by side; empty: no
    std::filesystem::path out;       // a folder for tables; empty: none
    std::string scene = "frame";     // see EvaluateSettings::background
    MeasureOptions measures;
};

struct AblateOptions {
    CommonOptions common;
    std::filesystem::path capture, out;
    std::string body, frames, testFrames;  // testFrames: empty: those of the training
    bool fitTestPoses = false;
    std::vector<std::string> variants;  // some of ablationVariants(); empty: all
    Preset preset;
    std::filesystem::path pictures;  // as in EvalOptions, a folder per variant in it
    std::string scene = "frame";
    MeasureOptions measures;
    uint64_t memoryBudget = 0;
};

// "no-refine", "no-clamp", "complete", "no-gan", "no-face".
const std::vector<std::string>& ablationVariants();

struct ExportOptions {
    CommonOptions common;
    std::filesystem::path avatar, out, motion;  // motion may be empty
    std::string frames;
    std::string texture = "best";  // "baked", "coarse" or "best"
};

struct ViewOptions {
    CommonOptions common;
    std::filesystem::path avatar;
    std::filesystem::path motion;  // a capture, poses.npz or .bvh; may be empty
    std::filesystem::path pose;    // a pose's JSON to begin with; may be empty
    std::string frames;
    int width = 1280, height = 800;  // of the window
};

struct DemoOptions {
    CommonOptions common;
    std::filesystem::path out = "out/demo";
    std::string actor = "woman";  // of assets/actor: woman, man
    Preset preset;
};

void runDevices(const DevicesOptions& options);
void runImport(const ImportOptions& options);
void runFit(const FitOptions& options);
void runTrain(const TrainOptions& options);
void runRender(const RenderOptions& options);
void runEval(const EvalOptions& options);
void runAblate(const AblateOptions& options);
void runExport(const ExportOptions& options);
void runView(const ViewOptions& options);
void runDemo(const DemoOptions& options);
void runBench();

}  // namespace doppel
