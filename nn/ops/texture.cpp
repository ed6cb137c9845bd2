#include "nn/ops/texture.h"

#include <algorithm>
#include <cstdlib>

#include "engine/files/numbers.h"
#include "nn/core/op.h"
#include "texture/params.h"

namespace doppel {

std::vector<Tensor> interleave(Graph& graph, const Tensor& x) {
    CHECK(x.shape.size() == 4, "an image batch is [N,C,H,W], not {}", toString(x.shape));
    InterleaveParams params{u32(x.dim(1)), u32(x.dim(2) * x.dim(3))};
    std::vector<Tensor> textures;
    graph.beginOp("interleave");
    for (int64_t n = 0; n < x.dim(0); ++n) {
        textures.push_back(graph.temporary({x.dim(2), x.dim(3), x.dim(1)}));
        graph.dispatch("texture/interleave.forward", {{"x", x.slice(n, 1)}, {"y", textures.back()}},
                       params, params.pixels);
    }
    graph.differentiate({x}, textures, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        for (size_t n = 0; n < textures.size(); ++n)
            graph.dispatch(
                "texture/interleave.backward",
                {{"x", graph.gradient(textures[n])}, {"y", dx.slice(static_cast<int64_t>(n), 1)}},
                params, params.pixels);
    });
    return textures;
}

Tensor binomialMean(Graph& graph, const Tensor& x) {
    CHECK(x.shape.size() == 3, "a texture is [H,W,C], not {}", toString(x.shape));
    const BinomialMeanParams params{u32(x.elements()), u32(x.dim(1) * x.dim(2)), u32(x.dim(0)),
                                    u32(x.dim(2))};
    Tensor y = graph.temporary(x.shape);
    graph.beginOp("binomial_mean");
    graph.dispatch("texture/binomial_mean.forward", {{"x", x}, {"y", y}}, params, params.n);
    graph.differentiate({x}, {y}, [=, &graph] {
        graph.dispatch("texture/binomial_mean.forward",
                       {{"x", graph.gradient(y)}, {"y", graph.gradientTarget(x)}}, params,
                       params.n);
    });
    return y;
}

std::vector<float> binomialMean(const std::vector<float>& x, int64_t height, int64_t width,
                                int64_t channels) {
    std::vector<float> y(x.size());
    for (int64_t row = 0; row < height; ++row)
        for (int64_t column = 0; column < width; ++column)
            for (int64_t c = 0; c < channels; ++c) {
                float sum = 0;
                for (int64_t v = std::max<int64_t>(row - 1, 0); v <= std::min(row + 1, height - 1);
                     ++v)
                    for (int64_t u = std::max<int64_t>(column - 1, 0);
                         u <= std::min(column + 1, width - 1); ++u)
                        sum += static_cast<float>((2 - std::abs(u - column)) *
                                                  (2 - std::abs(v - row))) *
                               x[static_cast<size_t>((v * width + u) * channels + c)];
                y[static_cast<size_t>((row * width + column) * channels + c)] = sum / 16;
            }
    return y;
}

static const Op kInterleave{{
    .name = "interleave",
    .inputs = "x[C,H,W]",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            Tensor x = c["x"];
            Tensor batch = x.reshaped({1, x.dim(0), x.dim(1), x.dim(2)});
            c.result("y", interleave(c.graph, batch).at(0));
        },
}};

static const Op kBinomialMean{{
    .name = "binomial_mean",
    .inputs = "x[H,W,C]",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", binomialMean(c.graph, c["x"])); },
}};

}  // namespace doppel
