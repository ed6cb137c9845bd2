// How an op is tested: against a plain double-precision function, and its backward against finite
// differences of a random projection of that function. A difference along a random direction
// covers all elements of an input with two evaluations; a few elements are checked on their own.
//
//     checkOp("leaky_relu", {.inputs = {{"x", random({13})}}, .attributes = {{"slope", 0.2}},
//                            .reference = [](const Values& v) -> Values { ... }});
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "nn/core/op.h"

namespace doppel {

// An array in double precision.
struct Value {
    Shape shape;
    std::vector<double> data;
};
using Values = std::map<std::string, Value>;  // inputs; attributes as 0-d values; outputs

struct OpCase {
    Values inputs;
    std::map<std::string, Value> integers;  // index arrays, given as whole numbers
    std::map<std::string, double> attributes;
    // Outputs by name from inputs, integers and attributes (all in one map).
    std::function<Values(const Values&)> reference;
    // ‖got - expected‖ / max(‖expected‖, floor), per array.
    double forwardTolerance = 2e-5, gradientTolerance = 1e-3;
    double floor = 1e-6;
    // |<gradient, d> - difference along d| / max(‖gradient‖, floor), where d has a random sign and
    // a magnitude of 1/2 to 1 in each element.
    double directionTolerance = 2e-5;
    // h of (f(x + h d) - f(x - h d)) / 2h.
    double differenceStep = 1e-6;
    Precision precision = Precision::Single;  // of the device that it runs on
    // Elements of each input whose derivative is checked alone: the first, the last, random ones.
    int samples = 6;
    // True for elements to leave out (kinks, discontinuities): input name, element.
    std::function<bool(const std::string&, int64_t)> skip;
    // Outputs through which no gradient flows (indices, masks).
    std::vector<std::string> constantOutputs;
};

// Runs the op on the test device with NaN-filled outputs; every output and gradient is compared.
void checkOp(const std::string& op, const OpCase& testCase);

// Expects an InputError whose text contains the given words.
void expectInputError(const std::function<void()>& run, const std::string& words);

// Sizes that reach every edge of what works on `tile` elements at once: 1, one less than a tile, a
// tile, one more, and several tiles with a tail of about half a tile; ascending, without repeats.
std::vector<int64_t> edgeSizes(int64_t tile);

// Normal numbers, or uniform in [low, high); the same for the same seed.
Value random(Shape shape, uint32_t seed = 1);
Value uniform(Shape shape, double low, double high, uint32_t seed = 1);
Value indices(Shape shape, std::vector<int> values);

// ‖a - b‖ / max(‖b‖, floor)
double relativeError(const std::vector<double>& a, const std::vector<double>& b, double floor);

// One device of each precision for all tests of a process; validation is on and a message fails
// the test.
Device& testDevice(Precision precision = Precision::Single);

// Devices of their own for `count` ranks that are threads of this process. The validation layer
// looks a device up in a map that it does not lock (1.3.239: GetLayerDataPtr), so a device must not
// be made or destroyed while another thread works with one: these are made here, one after
// another, and live as long as testDevice().
std::vector<Device*> rankDevices(int count);

}  // namespace doppel
