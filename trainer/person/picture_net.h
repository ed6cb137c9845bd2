// A network from a TFLite file that looks at one square picture at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "nn/core/graph.h"

namespace doppel {

// InputError that says how to fetch it where this network is not there.
void requireNetwork(const std::filesystem::path& file);

class PictureNet {
public:
    // elements: of each output. InputError where the file is another network's, or damaged.
    PictureNet(Device& device, const std::filesystem::path& file, int side,
               const std::vector<int64_t>& elements);

    // rgb [3,side,side]; the outputs in the file's order.
    std::vector<std::vector<float>> run(const std::vector<float>& rgb);

private:
    Graph graph_;
    Tensor x_;
    std::vector<Tensor> outputs_;
};

}  // namespace doppel
