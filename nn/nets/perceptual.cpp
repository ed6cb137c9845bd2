#include "nn/nets/perceptual.h"

#include <array>

#include "nn/ops/conv/conv.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/features.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

struct LpipsSpec {
    const char* name;
    std::vector<int64_t> channels;
    int64_t smallest;
};

const LpipsSpec& specOf(LpipsNet net) {
    static const std::array<LpipsSpec, 3> specs{{
        {"alex", {64, 192, 384, 256, 256}, 31},
        {"vgg", {64, 128, 256, 512, 512}, 16},
        {"squeeze", {64, 128, 256, 384, 384, 512, 512}, 25},
    }};
    return specs[static_cast<size_t>(net)];
}

struct Builder {
    Graph& graph;
    const WeightSource& weights;

    Tensor conv(const Tensor& x, const std::string& name, int64_t out, int64_t kernel,
                uint32_t stride, uint32_t padding) const {
        Tensor weight = weights(name + ".weight", {out, x.dim(1), kernel, kernel});
        Tensor bias = weights(name + ".bias", {out});
        return relu(graph, conv2d(graph, x, weight, bias, stride, padding));
    }

    std::vector<Tensor> alex(Tensor x) const {
        std::vector<Tensor> taps;
        taps.push_back(conv(x, "features.0", 64, 11, 4, 2));
        taps.push_back(conv(maxPool2d(graph, taps.back(), 3, 2), "features.3", 192, 5, 1, 2));
        taps.push_back(conv(maxPool2d(graph, taps.back(), 3, 2), "features.6", 384, 3, 1, 1));
        taps.push_back(conv(taps.back(), "features.8", 256, 3, 1, 1));
        taps.push_back(conv(taps.back(), "features.10", 256, 3, 1, 1));
        return taps;
    }

    std::vector<Tensor> vgg(Tensor x) const {
        // Each group: numbers of its convolutions among torchvision's layers.
        const std::vector<std::vector<int>> groups{
            {0, 2}, {5, 7}, {10, 12, 14}, {17, 19, 21}, {24, 26, 28}};
        std::vector<Tensor> taps;
        for (size_t i = 0; i < groups.size(); ++i) {
            if (i > 0) x = maxPool2d(graph, x, 2, 2);
            for (int layer : groups[i])
                x = conv(x, fmt::format("features.{}", layer), specOf(LpipsNet::vgg).channels[i], 3,
                         1, 1);
            taps.push_back(x);
        }
        return taps;
    }

    Tensor fire(const Tensor& x, int layer, int64_t squeezed, int64_t expanded) const {
        std::string name = fmt::format("features.{}", layer);
        Tensor s = conv(x, name + ".squeeze", squeezed, 1, 1, 0);
        return concat(graph, conv(s, name + ".expand1x1", expanded, 1, 1, 0),
                      conv(s, name + ".expand3x3", expanded, 3, 1, 1));
    }

    std::vector<Tensor> squeeze(Tensor x) const {
        auto pooled = [&](const Tensor& t) { return maxPool2d(graph, t, 3, 2, 0, true); };
        std::vector<Tensor> taps{conv(x, "features.0", 64, 3, 2, 0)};
        taps.push_back(fire(fire(pooled(taps.back()), 3, 16, 64), 4, 16, 64));
        taps.push_back(fire(fire(pooled(taps.back()), 6, 32, 128), 7, 32, 128));
        taps.push_back(fire(pooled(taps.back()), 9, 48, 192));
        taps.push_back(fire(taps.back(), 10, 48, 192));
        taps.push_back(fire(taps.back(), 11, 64, 256));
        taps.push_back(fire(taps.back(), 12, 64, 256));
        return taps;
    }
};

// ---- Inception-3D -------------------------------------------------------------------------------

struct Inception {
    Graph& graph;
    const WeightSource& weights;

    // Convolution, normalisation, ReLU. TensorFlow's epsilon is 1e-3.
    Tensor unit(const Tensor& x, const std::string& name, int64_t out, Extent3 kernel,
                Extent3 stride = {1, 1, 1}) const {
        Tensor y = conv3d(
            graph, x,
            weights(name + ".conv3d.weight", {out, x.dim(1), kernel[0], kernel[1], kernel[2]}), {},
            stride);
        auto of = [&](const char* what) { return weights(name + ".bn." + what, {out}); };
        return batchNorm2dEvaluation(graph, y, of("weight"), of("bias"),
                                     {.epsilon = 1e-3f, .slope = 0},
                                     {of("running_mean"), of("running_var")});
    }

    // Four branches: 1x1x1; 1x1x1 and 3x3x3, twice; pooling and 1x1x1.
    Tensor mixed(const Tensor& x, const std::string& name,
                 const std::array<int64_t, 6>& features) const {
        Tensor b0 = unit(x, name + ".b0", features[0], {1, 1, 1});
        Tensor b1 = unit(unit(x, name + ".b1a", features[1], {1, 1, 1}), name + ".b1b", features[2],
                         {3, 3, 3});
        Tensor b2 = unit(unit(x, name + ".b2a", features[3], {1, 1, 1}), name + ".b2b", features[4],
                         {3, 3, 3});
        Tensor b3 =
            unit(maxPool3d(graph, x, {3, 3, 3}, {1, 1, 1}), name + ".b3b", features[5], {1, 1, 1});
        return concat(graph, concat(graph, b0, b1), concat(graph, b2, b3));
    }
};

}  // namespace

LpipsNet lpipsNetByName(std::string_view name, std::string_view where) {
    for (LpipsNet net : {LpipsNet::alex, LpipsNet::vgg, LpipsNet::squeeze})
        if (name == specOf(net).name) return net;
    throwInput("{}: expected alex, vgg or squeeze, found \"{}\"", where, name);
}

const char* lpipsNetName(LpipsNet net) { return specOf(net).name; }
const std::vector<int64_t>& lpipsChannels(LpipsNet net) { return specOf(net).channels; }
int64_t lpipsSmallestSide(LpipsNet net) { return specOf(net).smallest; }

std::vector<Tensor> lpipsFeatures(Graph& graph, LpipsNet net, const Tensor& x,
                                  const WeightSource& weights) {
    CHECK(x.shape.size() == 4 && x.dim(1) == 3 &&
              std::min(x.dim(2), x.dim(3)) >= lpipsSmallestSide(net),
          "pictures [N,3,H,W] of at least {} pixels, not {}", lpipsSmallestSide(net),
          toString(x.shape));
    Builder builder{graph, weights};
    switch (net) {
        case LpipsNet::alex:
            return builder.alex(x);
        case LpipsNet::vgg:
            return builder.vgg(x);
        case LpipsNet::squeeze:
            return builder.squeeze(x);
    }
    CHECK(false, "the network is one of three");
    return {};
}

Tensor inception3dLogits(Graph& graph, const Tensor& x, int64_t classes,
                         const WeightSource& weights) {
    CHECK(x.shape.size() == 4 && x.dim(1) == 3, "a video is [T,3,H,W], not {}", toString(x.shape));
    Inception net{graph, weights};
    Tensor h = net.unit(x, "Conv3d_1a_7x7", 64, {7, 7, 7}, {2, 2, 2});
    h = maxPool3d(graph, h, {1, 3, 3}, {1, 2, 2});
    h = net.unit(h, "Conv3d_2b_1x1", 64, {1, 1, 1});
    h = net.unit(h, "Conv3d_2c_3x3", 192, {3, 3, 3});
    h = maxPool3d(graph, h, {1, 3, 3}, {1, 2, 2});
    h = net.mixed(h, "Mixed_3b", {64, 96, 128, 16, 32, 32});
    h = net.mixed(h, "Mixed_3c", {128, 128, 192, 32, 96, 64});
    h = maxPool3d(graph, h, {3, 3, 3}, {2, 2, 2});
    h = net.mixed(h, "Mixed_4b", {192, 96, 208, 16, 48, 64});
    h = net.mixed(h, "Mixed_4c", {160, 112, 224, 24, 64, 64});
    h = net.mixed(h, "Mixed_4d", {128, 128, 256, 24, 64, 64});
    h = net.mixed(h, "Mixed_4e", {112, 144, 288, 32, 64, 64});
    h = net.mixed(h, "Mixed_4f", {256, 160, 320, 32, 128, 128});
    h = maxPool3d(graph, h, {2, 2, 2}, {2, 2, 2});
    h = net.mixed(h, "Mixed_5b", {256, 160, 320, 32, 128, 128});
    h = net.mixed(h, "Mixed_5c", {384, 192, 384, 48, 128, 128});
    int64_t frames = h.dim(0), features = h.dim(1), pixels = h.dim(2) * h.dim(3);
    Tensor perFrame = graph.temporary({frames, features}), mean = graph.temporary({1, features});
    graph.beginOp("mean over the video");
    sumAxis(graph, h, frames * features, pixels, 1, perFrame);
    sumAxis(graph, perFrame, 1, frames, features, mean);
    mean = scaleShift(graph, mean, 1 / static_cast<float>(frames * pixels), 0);
    Tensor weight = weights("logits.conv3d.weight", {classes, features, 1, 1, 1});
    return linear(graph, mean, weight.reshaped({classes, features}),
                  weights("logits.conv3d.bias", {classes}));
}

}  // namespace doppel
