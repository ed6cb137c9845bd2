// safetensors: named float32 tensors in one file with a JSON header, the format that weights travel
// in.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace doppel {

struct Tensor32 {
    std::vector<int64_t> shape;  // empty: one value
    std::vector<float> values;   // C order
};

using WeightMap = std::map<std::string, Tensor32>;  // by parameter name

struct Safetensors {
    WeightMap tensors;
    std::map<std::string, std::string> metadata;
    std::string file;  // for errors; readSafetensors fills it in

    // InputError that names the file where the tensor is missing or its shape is another one.
    const Tensor32& at(std::string_view name) const;
    const Tensor32& at(std::string_view name, std::span<const int64_t> shape) const;
};

// Tensors of integers and truth values: an error, or left out.
enum class OtherTypes : uint8_t { refuse, skip };

// float32 tensors; float16, bfloat16 and float64 ones are converted. InputError names file and
// tensor: cut short, a header that lies about sizes, tensors that overlap or leave gaps, other
// types.
Safetensors readSafetensors(const std::filesystem::path& path);
Safetensors safetensorsFromBytes(std::span<const uint8_t> file, const std::string& name,
                                 OtherTypes others = OtherTypes::refuse);

// In the order of the names; the same tensors give the same bytes. Appears whole or not at all
// (engine/files/atomic_file.h).
void writeSafetensors(const std::filesystem::path& path, const Safetensors& content);

}  // namespace doppel
