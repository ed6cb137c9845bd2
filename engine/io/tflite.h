// TensorFlow Lite models, as far as networks of convolutions need them. By FlatBuffers.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace doppel {

enum class TfliteKind : uint8_t {
    Add,            // of equal shapes
    Concatenation,  // along axis
    Conv,           // inputs: x, weight [O,kh,kw,I], bias [O]
    DepthwiseConv,  // inputs: x, weight [1,kh,kw,C], bias [C]
    DepthToSpace,   // blocks of 2x2
    Logistic,
    MaxPool,  // kernel and stride 2x2
    Pad,      // with zeros; inputs: x, [4,2] before and after in each dimension
    Prelu,    // y = x where x > 0, else slope x; inputs: x, slope [1,1,C]
    Reshape,
    ResizeBilinear,  // half-pixel centres
};

struct TfliteTensor {
    std::string name;
    std::vector<int64_t> shape;     // images: [1,H,W,C]
    std::vector<float> values;      // of a constant, C order; empty: computed
    std::vector<int32_t> integers;  // of a constant of integers
};

struct TfliteOperator {
    TfliteKind kind{};
    std::vector<int> inputs;              // tensors
    int output = 0;                       // tensor
    bool same = false;                    // padding SAME, else VALID
    bool relu6 = false;                   // y = min(max(y, 0), 6) behind it
    std::array<int64_t, 2> stride{1, 1};  // down, across
    int64_t axis = 0;
};

// Constants are folded: weights in half precision and sparse ones are plain floats.
struct TfliteModel {
    std::string file;  // for errors
    std::vector<TfliteTensor> tensors;
    std::vector<TfliteOperator> operators;  // in the order of execution
    std::vector<int> inputs, outputs;       // tensors
};

// Every offset, size and number in the file is checked before it is used: operators refer to
// tensors that are there and have been computed, constants have their shapes' elements. InputError
// names the file, what was expected and what was found; so it does where the model has an operator,
// an option or a type that is not listed above.
TfliteModel readTflite(const std::filesystem::path& path);
TfliteModel tfliteFromBytes(std::span<const uint8_t> file, const std::string& name);

}  // namespace doppel
