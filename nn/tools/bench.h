// doppel-bench: cases are recorded graphs, replayed and timed by the device's own clock.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "nn/body/body.h"
#include "nn/core/graph.h"

namespace doppel::bench {

// The device chosen on the command line; opened at first use.
Device& device();

struct Ceilings {
    double flops = 0, bytes = 0;  // per second
};
// Of the device, measured at first use: a loop of multiply-adds in registers, and a copy between
// buffers larger than caches.
const Ceilings& ceilings();

// A graph compiled with timestamps. Its ops say how many flops their products take.
struct Recording {
    std::shared_ptr<void> owner;  // keeps graph and parameters alive
    Graph* graph = nullptr;
    enum class Part { Whole, Backward } part = Part::Whole;  // what is timed
    double bytes = 0;  // what this part has to read and write; 0: all that its ops are bound to
};

// Registers a case; build runs when the case does. Cases of one name prefix run in the order of
// their registration.
void add(std::string name, std::function<Recording()> build);

// Milliseconds of the fastest of some replays, by the device's clock.
double bestMilliseconds(const Recording& recording);

// Finds the variants of products that this device runs best, keeps them in the tuning cache and
// prints them.
void tune();

void addCeilings();
void addOps();
void addSteps();
void addGrowth();

// ---- what cases are fed with --------------------------------------------------------------------

// The default body, embedded in the program.
const BodyModel& defaultBody();
// A closed body of about so many vertices: a long ball with joints along it, twice as many faces as
// vertices, and an atlas.
BodyModel ballBody(int64_t vertices);

// Uniform in [low, high], the same for the same seed.
std::vector<float> randomValues(int64_t count, uint32_t seed, float low = -1, float high = 1);

// Someone standing upright three metres before the camera, the arms half lowered.
std::vector<float> standingTheta();
std::vector<float> standingTrans();
// A camera to which this person fills the picture's height, as training's crops do: it covers a
// sixth of the picture.
std::vector<float> standingCamera(int64_t size, double sigma = 1e-5, double blurRadius = 9.21e-5);
// The default body, or another one, in that pose: camera space [V,3], m.
std::vector<float> standingVerts(const BodyModel& body);

}  // namespace doppel::bench
