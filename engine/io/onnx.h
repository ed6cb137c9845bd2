// ONNX: networks as other programs' runtimes take them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "engine/io/safetensors.h"

namespace doppel {

// The version of ONNX's operations that files ask for: what is wanted is all in it, and OpenCV 4.6
// reads Clip of later ones as something else.
inline constexpr int kOnnxOpset = 10;

// The names of a network's results, in the order in which the file has them; none where it is no
// ONNX.
std::vector<std::string> onnxOutputs(std::string_view file);

// A network being put together: operations in the order in which they run, on values that are known
// by their names. Values are float32 but for lists, which are int64.
class OnnxGraph {
public:
    // name: of the network. about: what it does, for people who open the file.
    OnnxGraph(std::string name, std::string about);

    std::string input(const std::string& name, const std::vector<int64_t>& shape,
                      const std::string& about);
    // `value` becomes a result under `name`.
    void output(const std::string& name, const std::string& value,
                const std::vector<int64_t>& shape, const std::string& about);

    // Constants; each returns its name. The values are copied.
    std::string constant(const std::string& name, const Tensor32& tensor);
    std::string number(const std::string& name, float value);  // of shape []
    std::string list(const std::string& name, const std::vector<int64_t>& values,
                     const std::vector<int64_t>& shape);
    std::string list(const std::string& name, const std::vector<int64_t>& values);

    struct Attribute {
        std::string name;
        std::variant<int64_t, float, std::string, std::vector<int64_t>> value;
    };
    // One of ONNX's operations with one result, whose name it returns.
    std::string add(const std::string& operation, const std::vector<std::string>& inputs,
                    const std::vector<Attribute>& attributes = {});

    // The same graph gives the same bytes. The file appears whole or not at all. InputError where
    // it were larger than the 2 GiB that ONNX allows.
    void write(const std::filesystem::path& path) const;

private:
    std::string node(const std::string& operation, const std::vector<std::string>& inputs,
                     const std::string& output, const std::vector<Attribute>& attributes);

    std::string name_, about_;
    std::vector<std::string> fields_;  // of the graph, each with its key
    int nodes_ = 0;
};

}  // namespace doppel
