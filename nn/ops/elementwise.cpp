#include "nn/ops/elementwise.h"

#include <cmath>

#include "common/pairs.h"
#include "elementwise/params.h"
#include "engine/files/numbers.h"
#include "nn/core/op.h"

namespace doppel {

namespace {

uint32_t count(const Tensor& x) { return u32(x.elements()); }
uint64_t elements(const Tensor& x) { return static_cast<uint64_t>(x.elements()); }
// Invocations of a kernel over pairs.
uint64_t pairs(const Tensor& x) { return pairInvocations(elements(x)); }

// y = f(x); backward from y and dy, so that x need not be kept.
Tensor mapOfY(Graph& graph, const char* name, const Tensor& x, const char* forward,
              const char* backward) {
    Tensor y = graph.temporary(x.shape);
    ElementParams params{count(x)};
    graph.beginOp(name);
    graph.dispatch(forward, {{"x", x}, {"y", y}}, params, pairs(x));
    graph.differentiate({x}, {y}, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        graph.dispatch(backward, {{"y", y}, {"dy", graph.gradient(y)}, {"dx", dx}}, params,
                       pairs(x));
    });
    return y;
}

}  // namespace

namespace {
// The sign of y is that of x, so that x need not be kept.
Tensor rectify(Graph& graph, const char* name, const Tensor& x, float slope) {
    Tensor y = graph.temporary(x.shape);
    LeakyReluParams params{count(x), slope};
    graph.beginOp(name);
    graph.dispatch("elementwise/leaky_relu.forward", {{"x", x}, {"y", y}}, params, pairs(x));
    graph.differentiate({x}, {y}, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        graph.dispatch("elementwise/leaky_relu.backward",
                       {{"y", y}, {"dy", graph.gradient(y)}, {"dx", dx}}, params, pairs(x));
    });
    return y;
}
}  // namespace

Tensor leakyRelu(Graph& graph, const Tensor& x, float slope) {
    CHECK(slope >= 0, "the slope {} is not negative", slope);
    return rectify(graph, "leaky_relu", x, slope);
}

Tensor relu(Graph& graph, const Tensor& x) { return rectify(graph, "relu", x, 0); }

Tensor tanh(Graph& graph, const Tensor& x) {
    return mapOfY(graph, "tanh", x, "elementwise/tanh.forward", "elementwise/tanh.backward");
}

Tensor sigmoid(Graph& graph, const Tensor& x) {
    return mapOfY(graph, "sigmoid", x, "elementwise/sigmoid.forward",
                  "elementwise/sigmoid.backward");
}

Tensor scaleShift(Graph& graph, const Tensor& x, float scale, float shift) {
    Tensor y = graph.temporary(x.shape);
    ScaleShiftParams params{count(x), scale, shift};
    graph.beginOp("scale_shift");
    graph.dispatch("elementwise/scale_shift.forward", {{"x", x}, {"y", y}}, params, pairs(x));
    graph.differentiate({x}, {y}, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        graph.dispatch("elementwise/scale_shift.backward", {{"dy", graph.gradient(y)}, {"dx", dx}},
                       params, pairs(x));
    });
    return y;
}

Tensor clamp(Graph& graph, const Tensor& x, float low, float high) {
    Tensor y = graph.temporary(x.shape);
    ClampParams params{count(x), low, high};
    graph.beginOp("clamp");
    graph.dispatch("elementwise/clamp.forward", {{"x", x}, {"y", y}}, params, pairs(x));
    graph.differentiate({x}, {y}, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        graph.dispatch("elementwise/clamp.backward",
                       {{"x", x}, {"dy", graph.gradient(y)}, {"dx", dx}}, params, pairs(x));
    });
    return y;
}

Tensor add(Graph& graph, const Tensor& a, const Tensor& b) {
    CHECK(a.shape == b.shape, "{} and {} have the same shape", toString(a.shape),
          toString(b.shape));
    Tensor y = graph.temporary(a.shape);
    graph.beginOp("add");
    graph.dispatch("elementwise/add.forward", {{"a", a}, {"b", b}, {"y", y}},
                   ElementParams{count(a)}, pairs(a));
    graph.differentiate({a, b}, {y}, [=, &graph] {
        for (const Tensor& input : {a, b})
            if (graph.wantsGradient(input))
                graph.copy(graph.gradient(y), graph.gradientTarget(input));
    });
    return y;
}

Tensor multiply(Graph& graph, const Tensor& a, const Tensor& b) {
    CHECK(a.shape == b.shape, "{} and {} have the same shape", toString(a.shape),
          toString(b.shape));
    Tensor y = graph.temporary(a.shape);
    ElementParams params{count(a)};
    auto product = [=, &graph](const Tensor& left, const Tensor& right, const Tensor& target) {
        graph.dispatch("elementwise/multiply.forward", {{"a", left}, {"b", right}, {"y", target}},
                       params, pairs(a));
    };
    graph.beginOp("multiply");
    product(a, b, y);
    graph.differentiate({a, b}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        if (graph.wantsGradient(a)) product(dy, b, graph.gradientTarget(a));
        if (graph.wantsGradient(b)) product(dy, a, graph.gradientTarget(b));
    });
    return y;
}

namespace {

// One side of a concatenation, forward or backward.
void concatPart(Graph& graph, bool backward, const Tensor& part, const Tensor& y, const Tensor& dy,
                int64_t inner, int64_t innerAll, int64_t start, bool rectified) {
    ConcatParams params{count(part), u32(innerAll), u32(start), divisorOf(uint64_t(inner))};
    const bool even = inner % 2 == 0 && innerAll % 2 == 0 && start % 2 == 0;
    Specialisation spec{{"kRelu", rectified}};
    if (even && !backward)
        graph.dispatch("elementwise/concat.forward_pairs", {{"parts", part}, {"ys", y}}, params,
                       pairs(part), spec);
    else if (even)
        graph.dispatch("elementwise/concat.backward_pairs",
                       {{"dys", dy}, {"ys", y}, {"dparts", part}}, params, pairs(part), spec);
    else if (!backward)
        graph.dispatch("elementwise/concat.forward", {{"part", part}, {"y", y}}, params,
                       elements(part), spec);
    else
        graph.dispatch("elementwise/concat.backward", {{"dy", dy}, {"y", y}, {"dpart", part}},
                       params, elements(part), spec);
}

Tensor concatenated(Graph& graph, const Tensor& a, const Tensor& b, int axis, bool rectified) {
    CHECK(axis >= 0 && size_t(axis) < a.shape.size() && a.shape.size() == b.shape.size(),
          "{} and {} have an axis {}", toString(a.shape), toString(b.shape), axis);
    Shape shape = a.shape;
    int64_t innerA = 1, innerB = 1;
    for (size_t d = 0; d < shape.size(); ++d) {
        if (d == size_t(axis))
            shape[d] += b.shape[d];
        else
            CHECK(a.shape[d] == b.shape[d], "{} and {} agree outside axis {}", toString(a.shape),
                  toString(b.shape), axis);
        if (d >= size_t(axis)) {
            innerA *= a.shape[d];
            innerB *= b.shape[d];
        }
    }
    CHECK(elementCount(shape) < (int64_t{1} << 31), "{} has less than 2^31 elements",
          toString(shape));
    Tensor y = graph.temporary(shape);
    int64_t inner = innerA + innerB;
    graph.beginOp(rectified ? "concat_relu" : "concat");
    concatPart(graph, false, a, y, {}, innerA, inner, 0, rectified);
    concatPart(graph, false, b, y, {}, innerB, inner, innerA, rectified);
    graph.differentiate({a, b}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y), kept = rectified ? y : dy;
        if (graph.wantsGradient(a))
            concatPart(graph, true, graph.gradientTarget(a), kept, dy, innerA, inner, 0, rectified);
        if (graph.wantsGradient(b))
            concatPart(graph, true, graph.gradientTarget(b), kept, dy, innerB, inner, innerA,
                       rectified);
    });
    return y;
}

}  // namespace

Tensor concat(Graph& graph, const Tensor& a, const Tensor& b, int axis) {
    return concatenated(graph, a, b, axis, false);
}
Tensor concatRelu(Graph& graph, const Tensor& a, const Tensor& b, int axis) {
    return concatenated(graph, a, b, axis, true);
}

Tensor dropout(Graph& graph, const Tensor& x, float rate, uint32_t stream) {
    CHECK(rate >= 0 && rate < 1, "a dropout rate of {} lies in [0, 1)", rate);
    Tensor y = graph.temporary(x.shape), step = graph.step();
    auto threshold = static_cast<uint32_t>(std::lround(static_cast<double>(rate) * 4294967296.0));
    // Ranks drop what one of them would have dropped of the whole batch.
    const uint32_t first = count(x) * static_cast<uint32_t>(rankOf(graph.ranks()));
    DropoutParams params{count(x), stream, threshold, 1 / (1 - rate), first};
    graph.beginOp("dropout");
    graph.dispatch("elementwise/dropout.forward", {{"x", x}, {"y", y}, {"step", step}}, params,
                   pairs(x));
    graph.differentiate({x}, {y}, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        graph.dispatch("elementwise/dropout.forward",
                       {{"x", graph.gradient(y)}, {"y", dx}, {"step", step}}, params, pairs(x));
    });
    return y;
}

// ---- for op_runner ------------------------------------------------------------------------------

namespace {

void sameShape(OpCall& c) {
    if (c["a"].shape != c["b"].shape)
        throwInput("b: expected the shape of a {}, found {}", toString(c["a"].shape),
                   toString(c["b"].shape));
}

Tensor checkedConcat(OpCall& c, bool rectified) {
    uint32_t axis = c.u("axis");
    Shape a = c["a"].shape, b = c["b"].shape;
    if (axis >= a.size() || b.size() != a.size())
        throwInput("attr_axis: {} is no axis of both {} and {}", axis, toString(a), toString(b));
    b[axis] = a[axis];
    if (a != b)
        throwInput("b: expected the shape of a {} outside axis {}, found {}", toString(a), axis,
                   toString(c["b"].shape));
    return concatenated(c.graph, c["a"], c["b"], static_cast<int>(axis), rectified);
}

Tensor checkedDropout(OpCall& c) {
    if (c.attribute("rate") < 0 || c.attribute("rate") >= 1)
        throwInput("attr_rate: expected 0 <= rate < 1, found {}", c.attribute("rate"));
    return dropout(c.graph, c["x"], c.f("rate"), c.u("stream"));
}

}  // namespace

static const Op kLeakyRelu{{
    .name = "leaky_relu",
    .inputs = "x",
    .attributes = "slope",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            if (c.attribute("slope") < 0)
                throwInput("attr_slope: expected 0 or more, found {}", c.attribute("slope"));
            c.result("y", leakyRelu(c.graph, c["x"], c.f("slope")));
        },
}};
static const Op kRelu{{
    .name = "relu",
    .inputs = "x",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", relu(c.graph, c["x"])); },
}};
static const Op kTanh{{
    .name = "tanh",
    .inputs = "x",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", tanh(c.graph, c["x"])); },
}};
static const Op kSigmoid{{
    .name = "sigmoid",
    .inputs = "x",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", sigmoid(c.graph, c["x"])); },
}};
static const Op kScaleShift{{
    .name = "scale_shift",
    .inputs = "x",
    .attributes = "scale shift",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) { c.result("y", scaleShift(c.graph, c["x"], c.f("scale"), c.f("shift"))); },
}};
static const Op kClamp{{
    .name = "clamp",
    .inputs = "x",
    .attributes = "low high",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", clamp(c.graph, c["x"], c.f("low"), c.f("high"))); },
}};
static const Op kAdd{{
    .name = "add",
    .inputs = "a b",
    .outputs = "y",
    .differentiable = "a b",
    .build =
        [](OpCall& c) {
            sameShape(c);
            c.result("y", add(c.graph, c["a"], c["b"]));
        },
}};
static const Op kMultiply{{
    .name = "multiply",
    .inputs = "a b",
    .outputs = "y",
    .differentiable = "a b",
    .build =
        [](OpCall& c) {
            sameShape(c);
            c.result("y", multiply(c.graph, c["a"], c["b"]));
        },
}};
static const Op kConcat{{
    .name = "concat",
    .inputs = "a b",
    .attributes = "axis=1",
    .outputs = "y",
    .differentiable = "a b",
    .build = [](OpCall& c) { c.result("y", checkedConcat(c, false)); },
}};
static const Op kConcatRelu{{
    .name = "concat_relu",
    .inputs = "a b",
    .attributes = "axis=1",
    .outputs = "y",
    .differentiable = "a b",
    .build = [](OpCall& c) { c.result("y", checkedConcat(c, true)); },
}};
// Seed and step are 0 here.
static const Op kDropout{{
    .name = "dropout",
    .inputs = "x",
    .attributes = "rate stream=0",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", checkedDropout(c)); },
}};

}  // namespace doppel
