#include "nn/ops/texture.h"

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

}  // namespace doppel
