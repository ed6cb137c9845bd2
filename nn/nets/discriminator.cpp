#include "nn/nets/discriminator.h"

#include "nn/core/initialise.h"
#include "nn/ops/conv/conv.h"
#include "nn/ops/elementwise.h"

namespace doppel {

namespace {
constexpr int64_t kKernel = 4;
constexpr uint32_t kPadding = 1;
constexpr float kDeviation = 0.02f, kSlope = 0.2f;

std::string layerName(int64_t i) { return fmt::format("conv{}", i); }
}  // namespace

PatchDiscriminatorConfig imageDiscriminator(int64_t d) {
    return {.width = d, .strided = 3, .level = 2};
}
PatchDiscriminatorConfig faceDiscriminator(int64_t d) {
    return {.width = 2 * d, .strided = 2, .level = 1};
}

PatchDiscriminator::PatchDiscriminator(const PatchDiscriminatorConfig& config, std::string name,
                                       uint32_t seed)
    : config_(config) {
    if (config.width < 1 || config.inputChannels < 1 || config.strided < 1 || config.level < 0)
        throwInput("{}: width {}, channels {} and layers {} + {} must be positive", name,
                   config.width, config.inputChannels, config.strided, config.level);
    auto normal = [&](const std::string& parameter, const Shape& shape, float mean) {
        parameters_.add(
            parameter, shape,
            normalValues(seed, name + "." + parameter, elementCount(shape), mean, kDeviation));
    };
    int64_t in = config.inputChannels;
    for (int64_t i = 1; i <= layers(); ++i) {
        std::string layer = layerName(i);
        int64_t out = i == layers() ? 1 : config.width << (i - 1);
        normal(layer + ".weight", {out, in, kKernel, kKernel}, 0);
        if (i == 1 || i == layers()) {
            parameters_.add(layer + ".bias", {out}, constantValues(out, 0));
        } else {
            normal(layer + "_bn.weight", {out}, 1);
            parameters_.add(layer + "_bn.bias", {out}, constantValues(out, 0));
        }
        in = out;
    }
}

int64_t PatchDiscriminator::smallestPicture() const {
    // One logit, and one pixel more per layer of stride 1.
    return (2 + config_.level) << config_.strided;
}

PatchDiscriminator::Tensors PatchDiscriminator::trained(Graph& graph) const {
    Tensors tensors;
    for (const Parameters::Entry& entry : parameters_.entries())
        tensors[entry.name] = graph.parameter(parameters_, entry.name);
    return tensors;
}

PatchDiscriminator::Tensors PatchDiscriminator::frozen(Graph& graph) const {
    Tensors tensors;
    for (const Parameters::Entry& entry : parameters_.entries())
        tensors[entry.name] =
            graph.attach(parameters_.view(entry, Parameters::kValues), entry.shape);
    return tensors;
}

Tensor PatchDiscriminator::forward(Graph& graph, const Tensors& parameters, const Tensor& x) const {
    CHECK(x.shape.size() == 4 && x.dim(1) == config_.inputChannels,
          "the discriminator takes [N,{},H,W], not {}", config_.inputChannels, toString(x.shape));
    int64_t least = smallestPicture();
    if (x.dim(2) < least || x.dim(3) < least)
        throwInput("discriminator: pictures must have {}x{} pixels or more, found {}x{}", least,
                   least, x.dim(3), x.dim(2));
    Tensor h = x;
    for (int64_t i = 1; i <= layers(); ++i) {
        std::string layer = layerName(i);
        auto bias = parameters.find(layer + ".bias");
        h = conv2d(graph, h, parameters.at(layer + ".weight"),
                   bias == parameters.end() ? Tensor{} : bias->second, i <= config_.strided ? 2 : 1,
                   kPadding);
        if (i == layers()) break;
        h = i == 1 ? leakyRelu(graph, h, kSlope)
                   : batchNorm2d(graph, h, parameters.at(layer + "_bn.weight"),
                                 parameters.at(layer + "_bn.bias"), {.slope = kSlope});
    }
    return h;
}

}  // namespace doppel
