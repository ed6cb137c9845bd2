#include "trainer/eval/measures.h"

namespace doppel {

Measures::Measures(Device& device, const MeasureOptions& options) {
    LpipsNet net = lpipsNetByName(options.lpipsNet, "--lpips-net");
    if (!options.lpips.empty()) lpips = std::make_unique<Lpips>(device, net, options.lpips);
    if (!options.fvd.empty()) videoFeatures = std::make_unique<VideoFeatures>(device, options.fvd);
}

std::vector<std::string> Measures::remarks(size_t clips) const {
    std::vector<std::string> remarks;
    if (!lpips)
        remarks.emplace_back(
            "LPIPS was left out: it takes --lpips BACKBONE,HEADS, the weights of torchvision's "
            "network and of LPIPS 0.1's heads (.safetensors or .pth)");
    if (!videoFeatures)
        remarks.emplace_back(
            "FVD was left out: it takes --fvd FILE, the weights of Inception-3D (RGB, Kinetics; "
            ".safetensors or .pt)");
    else if (clips < 2)
        remarks.push_back(
            fmt::format("FVD was left out: it takes two clips or more, {} frames of one capture",
                        VideoFeatures::kFrames + kClipStride));
    return remarks;
}

}  // namespace doppel
