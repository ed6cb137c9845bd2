#include "trainer/person/picture_net.h"

#include "engine/error.h"
#include "engine/files/share.h"
#include "nn/nets/tflite_net.h"

namespace doppel {
namespace fs = std::filesystem;

void requireNetwork(const fs::path& file) {
    std::error_code error;
    if (fs::exists(file, error)) return;
    throwInput("{}: expected a network that finds people, found nothing; {}", file.string(),
               fetchAdvice("models", "DOPPEL_MODELS"));
}

PictureNet::PictureNet(Device& device, const fs::path& file, int side,
                       const std::vector<int64_t>& elements)
    : graph_(device) {
    const TfliteModel model = readTflite(file);
    x_ = graph_.input({1, 3, side, side});
    outputs_ = tfliteNet(graph_, model, x_);
    bool same = outputs_.size() == elements.size();
    for (size_t i = 0; same && i < elements.size(); ++i)
        same = outputs_[i].elements() == elements[i];
    if (!same) throwInput("{}: expected another network's outputs", file.string());
    for (const Tensor& output : outputs_) graph_.output(output);
    graph_.compile();
}

std::vector<std::vector<float>> PictureNet::run(const std::vector<float>& rgb) {
    graph_.write(x_, rgb);
    graph_.run();
    std::vector<std::vector<float>> raw;
    for (const Tensor& output : outputs_) raw.push_back(graph_.read(output));
    return raw;
}

}  // namespace doppel
