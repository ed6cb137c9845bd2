#include "nn/nets/texture_unet.h"

#include <algorithm>

#include "nn/core/initialise.h"
#include "nn/ops/conv/conv.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/texture.h"

namespace doppel {

namespace {
constexpr int64_t kKernel = 4;
constexpr uint32_t kStride = 2, kPadding = 1;
constexpr float kDeviation = 0.02f, kDropout = 0.5f;

std::string numbered(const char* what, int64_t i) { return fmt::format("{}{}", what, i); }
}  // namespace

TextureUnet::TextureUnet(const TextureUnetConfig& config, std::string name,
                         std::optional<uint32_t> seed, std::vector<float> texels)
    : config_(config), name_(std::move(name)) {
    TextureUnetConfig& c = config_;
    if (c.block < 1 || c.size % c.block != 0)
        throwInput("texture network: blocks of {} do not divide a size of {}", c.block, c.size);
    const int64_t side = c.size / c.block, blockChannels = c.block * c.block;
    if (c.downs == 0)
        while ((int64_t{1} << c.downs) < side) ++c.downs;
    if (c.downs < 2 || c.downs > 16 || side % (int64_t{1} << c.downs) != 0)
        throwInput("texture network: {} steps down do not divide a size of {}; use a power of two",
                   c.downs, side);
    if (c.width < 1 || c.inputChannels < 1 || c.outputChannels < 1)
        throwInput("texture network: width {} and channels {}, {} must be positive", c.width,
                   c.inputChannels, c.outputChannels);
    if (!texels.empty()) {
        const auto pixels = static_cast<size_t>(c.size * c.size);
        CHECK(c.outputChannels == 3 && texels.size() == 3 * pixels, "texels are [{},{},3]", c.size,
              c.size);
        texels_ = planesOf(texels);
    }
    int64_t n = c.downs;
    for (int64_t i = 1; i <= n; ++i) {
        int64_t in = i == 1 ? blockChannels * (c.inputChannels + (texels_.empty() ? 0 : 3))
                            : features(i - 1);
        declare(numbered("enc", i), {features(i), in, kKernel, kKernel}, i > 1 && i < n,
                features(i), seed);
    }
    for (int64_t j = 1; j <= n; ++j) {
        int64_t in = j == 1 ? features(n) : 2 * features(n + 1 - j);
        int64_t out = j == n ? blockChannels * c.outputChannels : features(n - j);
        declare(numbered("dec", j), {in, out, kKernel, kKernel}, j < n, out, seed);
    }
}

std::vector<float> TextureUnet::planesOf(const std::vector<float>& texels) {
    const size_t pixels = texels.size() / 3;
    std::vector<float> planes(texels.size());
    for (size_t i = 0; i < texels.size(); ++i) planes[i % 3 * pixels + i / 3] = 2 * texels[i] - 1;
    return planes;
}

int64_t TextureUnet::features(int64_t step) const {
    return config_.width * (int64_t{1} << std::min<int64_t>(step - 1, 3));
}

void TextureUnet::declare(const std::string& layer, Shape weight, bool normalised, int64_t out,
                          std::optional<uint32_t> seed) {
    auto normal = [&](const std::string& parameter, const Shape& shape, float mean) {
        int64_t count = elementCount(shape);
        parameters_.add(parameter, shape,
                        seed ? normalValues(*seed, name_ + "." + parameter, count, mean, kDeviation)
                             : constantValues(count, 0));
    };
    normal(layer + ".weight", weight, 0);
    if (!normalised) {
        parameters_.add(layer + ".bias", {out}, constantValues(out, 0));
        return;
    }
    normal(layer + "_bn.weight", {out}, 1);
    parameters_.add(layer + "_bn.bias", {out}, constantValues(out, 0));
    statistics_.add(layer + "_bn.running_mean", {out}, constantValues(out, 0));
    statistics_.add(layer + "_bn.running_var", {out}, constantValues(out, 1));
}

void TextureUnet::allocate(Device& device) {
    parameters_.allocate(device);
    statistics_.allocate(device);
}

Tensor TextureUnet::parameter(Graph& graph, const std::string& name, Mode mode) const {
    if (!mode.frozen) return graph.parameter(parameters_, name);
    const Parameters::Entry* entry = parameters_.find(name);
    CHECK(entry, "there is a parameter {}", name);
    return graph.attach(parameters_.view(*entry, Parameters::kValues), entry->shape);
}

Tensor TextureUnet::normalise(Graph& graph, const Tensor& x, const std::string& layer, float slope,
                              Mode mode) const {
    auto attached = [&](const std::string& what) {
        const Parameters::Entry* entry = statistics_.find(layer + what);
        CHECK(entry, "{} has running statistics", layer);
        return graph.attach(statistics_.view(*entry, Parameters::kValues), entry->shape);
    };
    RunningStatistics running{attached("_bn.running_mean"), attached("_bn.running_var")};
    Tensor weight = parameter(graph, layer + "_bn.weight", mode);
    Tensor bias = parameter(graph, layer + "_bn.bias", mode);
    BatchNormOptions options{.slope = slope};
    return mode.training ? batchNorm2d(graph, x, weight, bias, options, running)
                         : batchNorm2dEvaluation(graph, x, weight, bias, options, running);
}

Tensor TextureUnet::forward(Graph& graph, const Tensor& x, Mode mode) const {
    const TextureUnetConfig& c = config_;
    CHECK((x.shape == Shape{x.dim(0), c.inputChannels, c.size, c.size}),
          "the network takes [N,{},{},{}], not {}", c.inputChannels, c.size, c.size,
          toString(x.shape));
    int64_t n = c.downs;
    auto weight = [&](const std::string& layer) {
        return parameter(graph, layer + ".weight", mode);
    };
    auto bias = [&](const std::string& layer) {
        return parameters_.find(layer + ".bias") ? parameter(graph, layer + ".bias", mode)
                                                 : Tensor{};
    };
    std::vector<Tensor> encoded;
    Tensor h = x, under;
    if (!texels_.empty()) {
        Tensor one = graph.constant(std::span<const float>(texels_), {1, 3, c.size, c.size});
        under = one;
        for (int64_t k = 1; k < x.dim(0); ++k) under = concat(graph, under, one, 0);
        h = concat(graph, under, x);
    }
    if (c.block > 1) h = pixelUnshuffle(graph, h, c.block);
    for (int64_t i = 1; i <= n; ++i) {
        std::string layer = numbered("enc", i);
        h = conv2d(graph, h, weight(layer), bias(layer), kStride, kPadding);
        if (i == n) break;
        // The step up applies a ReLU, for which a leaky one before makes no difference.
        h = i == 1 ? leakyRelu(graph, h, kSlope) : normalise(graph, h, layer, kSlope, mode);
        encoded.push_back(h);
    }
    for (int64_t j = 1; j <= n; ++j) {
        std::string layer = numbered("dec", j);
        h = j > 1 ? concatRelu(graph, h, encoded[size_t(n - j)]) : relu(graph, h);
        h = convTranspose2d(graph, h, weight(layer), bias(layer), kStride, kPadding);
        if (j == n) break;
        h = normalise(graph, h, layer, 1, mode);
        if (mode.dropout && j >= 2 && j <= 5)
            h = dropout(graph, h, kDropout, streamOf(name_ + "." + layer));
    }
    h = tanh(graph, h);
    if (c.block > 1) h = pixelShuffle(graph, h, c.block);
    if (!under) return h;
    return clamp(graph, add(graph, under, scaleShift(graph, h, kTexelResidual, 0)), -1, 1);
}

}  // namespace doppel
