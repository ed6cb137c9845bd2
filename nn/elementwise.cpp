#include "nn/elementwise.h"

#include "elementwise/params.h"
#include "nn/op.h"

namespace doppel {

Tensor leakyRelu(Graph& graph, const Tensor& x, float slope) {
    Tensor y = graph.temporary(x.shape);
    auto n = static_cast<uint32_t>(x.elements());
    LeakyReluParams params{n, slope};
    graph.beginOp("leaky_relu");
    graph.dispatch("elementwise/leaky_relu.forward", {{"x", x}, {"y", y}}, params, n);
    graph.differentiate({x}, {y}, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        graph.dispatch("elementwise/leaky_relu.backward",
                       {{"x", x}, {"dy", graph.gradient(y)}, {"dx", dx}}, params, n);
    });
    return y;
}

static const Op kLeakyRelu{{
    .name = "leaky_relu",
    .inputs = "x",
    .attributes = "slope",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", leakyRelu(c.graph, c["x"], c.f("slope"))); },
}};

void addInto(Graph& graph, const Tensor& total, const Tensor& more) {
    auto n = static_cast<uint32_t>(total.elements());
    graph.dispatch("elementwise/add.into", {{"total", total}, {"more", more}}, AddParams{n}, n);
}

}  // namespace doppel
