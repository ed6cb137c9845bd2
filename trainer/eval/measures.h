// The figures that need somebody else's networks, from the command line's files.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "trainer/eval/fvd.h"
#include "trainer/eval/lpips.h"

namespace doppel {

struct MeasureOptions {
    std::vector<std::filesystem::path> lpips;  // files of weights; none: LPIPS is left out
    std::string lpipsNet = "alex";             // see lpipsNetByName
    std::filesystem::path fvd;                 // empty: FVD is left out
};

struct Measures {
    std::unique_ptr<Lpips> lpips;
    std::unique_ptr<VideoFeatures> videoFeatures;

    Measures() = default;
    Measures(Device& device, const MeasureOptions& options);

    // What was left out, and what it takes; clips: how many there were.
    std::vector<std::string> remarks(size_t clips) const;
};

}  // namespace doppel
