#include "nn/ops/optim.h"

#include <cmath>

#include "engine/files/numbers.h"
#include "nn/core/blocks.h"
#include "nn/core/op.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/linalg.h"
#include "optim/params.h"

namespace doppel {

namespace {

AdamWParams paramsOf(const AdamWOptions& o, int64_t n, int64_t rows) {
    return {u32(n), u32(rows), o.beta1, o.beta2, o.epsilon, o.weightDecay, o.rateScale, 0, {}};
}

Tensor whole(Graph& graph, const Parameters& parameters, Parameters::Section section) {
    return graph.attach(parameters.section(section), {static_cast<int64_t>(parameters.elements())});
}

// Gradients of several tensors in one array: what lies between them is made zero, as far as kernels
// reach behind a tensor.
void clearPadding(Graph& graph, const Parameters& parameters) {
    constexpr uint64_t kReach = 4;  // kernels end at a multiple of so many elements
    std::vector<int32_t> padding;
    for (const Parameters::Entry& entry : parameters.entries()) {
        uint64_t end = entry.offset / 4 + static_cast<uint64_t>(elementCount(entry.shape));
        for (uint64_t i = end; i < alignUp(end, kReach); ++i)
            padding.push_back(static_cast<int32_t>(i));
    }
    if (padding.empty()) return;
    auto count = static_cast<int64_t>(padding.size());
    ClipParams params{u32(count), 0, 0};
    graph.dispatch("optim/clip.clear_padding",
                   {{"elements", whole(graph, parameters, Parameters::kGradient)},
                    {"padding", graph.constant(std::span<const int32_t>(padding), {count})}},
                   params, params.n);
}

void dispatchAdamW(Graph& graph, const Tensor& value, const Tensor& gradient, const Tensor& moment1,
                   const Tensor& moment2, const Tensor& step, const AdamWOptions& options) {
    auto dispatch = [&](int64_t first, int64_t n) {
        AdamWParams params = paramsOf(options, n, 1);
        params.firstPair = u32(first / 2);
        const Places places = placesOf(graph.device(), static_cast<uint64_t>(n));
        graph.dispatchGroups("optim/adamw.all",
                             {{"values", value},
                              {"gradients", gradient},
                              {"moments1", moment1},
                              {"moments2", moment2},
                              {"step", step}},
                             params, places.groups, places.spec, places.invocations);
    };
    int64_t n = value.elements();
    int64_t rest = blockLanes(graph.device()) > 0 ? n % kPlacesWhole : 0;
    if (n > rest) dispatch(0, n - rest);
    if (rest > 0) dispatch(n - rest, rest);
}

}  // namespace

StepParams adamwStepParams(uint32_t step, float learningRate, const AdamWOptions& options) {
    CHECK(step > 0, "steps count from 1");
    StepParams params{.step = step};
    params.learningRate = learningRate;
    params.beta1Correction = static_cast<float>(1 - std::pow(double{options.beta1}, step));
    params.beta2Correction = static_cast<float>(1 - std::pow(double{options.beta2}, step));
    return params;
}

void adamw(Graph& graph, const Tensor& value, const Tensor& gradient, const Tensor& moment1,
           const Tensor& moment2, const AdamWOptions& options) {
    CHECK(value.elements() == gradient.elements() && value.elements() == moment1.elements() &&
              value.elements() == moment2.elements(),
          "value, gradient and moments have the same number of elements");
    Tensor step = graph.step();
    graph.beginOp("adamw");
    dispatchAdamW(graph, value, gradient, moment1, moment2, step, options);
}

void adamwStep(Graph& graph, const Parameters& parameters, const AdamWOptions& options) {
    graph.beginOp("adamw");
    clearPadding(graph, parameters);
    adamw(graph, whole(graph, parameters, Parameters::kValues),
          whole(graph, parameters, Parameters::kGradient),
          whole(graph, parameters, Parameters::kMoment1),
          whole(graph, parameters, Parameters::kMoment2), options);
}

void adamwRow(Graph& graph, const Tensor& table, const Tensor& gradient, const Tensor& moment1,
              const Tensor& moment2, const AdamWOptions& options, const Tensor& ownStep) {
    int64_t rows = table.dim(0), n = gradient.elements();
    CHECK(rows > 0 && table.elements() == rows * n && moment1.elements() == rows * n &&
              moment2.elements() == rows * n,
          "a table {}, its moments and a gradient {} fit", toString(table.shape),
          toString(gradient.shape));
    Tensor step = ownStep ? ownStep : graph.step();
    graph.beginOp("adamw_row");
    graph.dispatch("optim/adamw.row",
                   {{"value", table},
                    {"gradient", gradient},
                    {"moment1", moment1},
                    {"moment2", moment2},
                    {"step", step}},
                   paramsOf(options, n, rows), static_cast<uint64_t>(n));
}

std::vector<Tensor> rowGradients(Graph& graph, const std::vector<Tensor>& rows) {
    std::vector<Tensor> gradients;
    for (const Tensor& row : rows) gradients.push_back(graph.gradient(row));
    if (!graph.ranks() || rows.empty()) return gradients;
    const int64_t count = std::ssize(rows), n = rows[0].elements(), ranks = graph.ranks()->size();
    Tensor mine = graph.temporary({count, n});
    graph.beginOp("row_gradients");
    for (int64_t i = 0; i < count; ++i)
        graph.copy(gradients[size_t(i)], mine.slice(i, 1).reshaped({n}));
    Tensor all = scaleShift(graph, graph.ofAllRanks(mine).reshaped({ranks * count, n}),
                            1 / static_cast<float>(ranks), 0);
    gradients.clear();
    graph.beginOp("row_gradients");
    for (int64_t i = 0; i < ranks * count; ++i) {  // kernels take what is aligned
        gradients.push_back(graph.temporary({n}));
        graph.copy(all.slice(i, 1).reshaped({n}), gradients.back());
    }
    return gradients;
}

void uniformAdam(Graph& graph, const Tensor& value, const Tensor& gradient, const Tensor& moment1,
                 const Tensor& moment2, const std::function<Tensor(const Tensor&)>& precondition,
                 const AdamWOptions& options) {
    CHECK(value.shape.size() == 2 && value.dim(1) == 3 && gradient.shape == value.shape &&
              moment1.shape == value.shape,
          "value, gradient and moment1 are [n,3]");
    const UniformAdamParams params{static_cast<uint32_t>(value.dim(0)), options.beta1,
                                   options.beta2, options.rateScale};
    Tensor step = graph.step(), largest = graph.temporary({1}, ElementType::I32);
    Tensor smooth = precondition(gradient);
    graph.beginOp("uniform_adam");
    graph.fill(largest);
    graph.dispatchGroups("optim/uniform_adam.moments",
                         {{"gradient", smooth}, {"moment1", moment1}, {"largest", largest}}, params,
                         {16, 1, 1});
    graph.dispatch("optim/uniform_adam.update", {{"moment2", moment2}, {"largest", largest}},
                   params, 1);
    Tensor direction = precondition(moment1);
    graph.beginOp("uniform_adam");
    graph.dispatch(
        "optim/uniform_adam.apply",
        {{"moment2", moment2}, {"direction", direction}, {"value", value}, {"step", step}}, params,
        params.rows);
}

Tensor clipNorm(Graph& graph, const Tensor& gradient, float maxNorm) {
    constexpr uint32_t kPartLength = 512;
    auto n = u32(gradient.elements());
    uint32_t parts = (n + kPartLength - 1) / kPartLength;
    ClipParams params{n, parts, maxNorm};
    Tensor partial = graph.temporary({parts}), squares = graph.temporary({1}),
           norm = graph.temporary({1});
    graph.beginOp("clip_norm");
    graph.dispatch("optim/clip.squares", {{"gradient", gradient}, {"partial", partial}}, params,
                   parts);
    sumAxis(graph, partial, 1, parts, 1, squares);
    graph.dispatch("optim/clip.scale",
                   {{"gradient", gradient}, {"squares", squares}, {"norm", norm}}, params,
                   pairInvocations(n));
    return norm;
}

Tensor clipGradientNorm(Graph& graph, const Parameters& parameters, float maxNorm) {
    graph.beginOp("clip_norm");
    clearPadding(graph, parameters);
    return clipNorm(graph, whole(graph, parameters, Parameters::kGradient), maxNorm);
}

// ---- for op_runner ------------------------------------------------------------------------------

namespace {

AdamWOptions optionsOf(const OpCall& c) {
    return {c.f("beta1"), c.f("beta2"), c.f("eps"), c.f("weight_decay")};
}

// A copy that may be changed; inputs are written once and stay as the host gave them.
Tensor changeable(Graph& graph, const Tensor& input) {
    Tensor copy = graph.temporary(input.shape);
    graph.copy(input, copy);
    return copy;
}

Tensor zeros(Graph& graph, const Shape& shape) {
    Tensor tensor = graph.temporary(shape);
    graph.fill(tensor);
    return tensor;
}

Tensor stepConstant(Graph& graph, const StepParams& params) {
    std::vector<int32_t> words(sizeof(StepParams) / 4);
    std::memcpy(words.data(), &params, sizeof(params));
    return graph.constant(std::span<const int32_t>(words), {int64_t(words.size())});
}

}  // namespace

static const Op kAdamW{{
    .name = "adamw",
    .inputs = "param[n] grad[steps,n]",
    .attributes = "lr beta1=0.5 beta2=0.999 eps=1e-8 weight_decay=1e-2",
    .outputs = "param_out",
    .build =
        [](OpCall& c) {
            Graph& graph = c.graph;
            AdamWOptions options = optionsOf(c);
            graph.beginOp("adamw");
            Tensor value = changeable(graph, c["param"]), g = graph.temporary(value.shape);
            Tensor m = zeros(graph, value.shape), v = zeros(graph, value.shape);
            for (int64_t s = 0; s < c["grad"].dim(0); ++s) {
                graph.copy(c["grad"].slice(s, 1).reshaped(g.shape), g);
                StepParams step = adamwStepParams(u32(s + 1), c.f("lr"), options);
                dispatchAdamW(graph, value, g, m, v, stepConstant(graph, step), options);
            }
            c.result("param_out", value);
        },
}};

static const Op kAdamWRow{{
    .name = "adamw_row",
    .inputs = "table[R,n] grad[n] moment1[R,n] moment2[R,n]",
    .attributes = "row updates lr beta1=0.5 beta2=0.999 eps=1e-8 weight_decay=1e-2",
    .outputs = "table_out moment1_out moment2_out",
    .build =
        [](OpCall& c) {
            Graph& graph = c.graph;
            AdamWOptions options = optionsOf(c);
            if (c.u("row") >= c["table"].dim(0))
                throwInput("attr_row: the table has {} rows, found {}", c["table"].dim(0),
                           c.u("row"));
            if (c.u("updates") == 0) throwInput("attr_updates: expected 1 or more, found 0");
            graph.beginOp("adamw_row");
            Tensor table = changeable(graph, c["table"]);
            Tensor m = changeable(graph, c["moment1"]), v = changeable(graph, c["moment2"]);
            adamwRow(graph, table, c["grad"], m, v, options);
            StepParams step = adamwStepParams(c.u("updates"), c.f("lr"), options);
            step.frame = c.u("row");
            graph.setStep(step);
            c.result("table_out", table);
            c.result("moment1_out", m);
            c.result("moment2_out", v);
        },
}};

// Preconditioned by a factor.
static const Op kUniformAdam{{
    .name = "uniform_adam",
    .inputs = "param[n,3] grad[steps,n,3]",
    .attributes = "lr factor=1 beta1=0.9 beta2=0.99",
    .outputs = "param_out",
    .build =
        [](OpCall& c) {
            Graph& graph = c.graph;
            const AdamWOptions options{.beta1 = c.f("beta1"), .beta2 = c.f("beta2")};
            graph.beginOp("uniform_adam");
            Tensor value = changeable(graph, c["param"]), g = graph.temporary(value.shape);
            Tensor m = zeros(graph, value.shape), v = zeros(graph, {1});
            if (c["grad"].dim(0) != 1)
                throwInput("grad: expected the gradients of one step, found {}", c["grad"].dim(0));
            graph.copy(c["grad"].reshaped(g.shape), g);
            graph.setStep(adamwStepParams(1, c.f("lr"), options));
            const float factor = c.f("factor");
            uniformAdam(
                graph, value, g, m, v,
                [&](const Tensor& x) { return scaleShift(graph, x, factor, 0); }, options);
            c.result("param_out", value);
        },
}};

static const Op kClipNorm{{
    .name = "clip_norm",
    .inputs = "grad",
    .attributes = "max_norm",
    .outputs = "grad_out norm",
    .build =
        [](OpCall& c) {
            c.graph.beginOp("clip_norm");
            Tensor g = changeable(c.graph, c["grad"]);
            Tensor norm = clipNorm(c.graph, g, c.f("max_norm"));
            c.result("grad_out", g);
            c.result("norm", norm.reshaped({}));
        },
}};

}  // namespace doppel
