#include <algorithm>

#include "conv/params.h"
#include "nn/core/blocks.h"
#include "nn/core/op.h"
#include "nn/ops/conv/conv.h"
#include "nn/ops/conv/windows.h"

namespace doppel {

namespace {

// A layer and how its passes are dispatched. Where ranks share a batch (nn/core/ranks.h), the
// statistics are the whole batch's: the sums of all ranks are joined by each. On CPUs small images
// go through all passes in one dispatch (wholeChannels), and larger ones of even sizes by whole
// vectors (byBlocks); pixels go in pairs there, where their number is even.
struct BatchNormLayer {
    Tensor x, weight, bias, y, mean, deviation;
    RunningStatistics running;
    bool training;
    int64_t images, channels, pixels;
    int64_t ranks;  // that share the batch whose statistics these are
    BatchNormParams params;
    bool wholeChannels, byBlocks;
    std::string variant;  // of the kernels
    uint32_t lanes;
    int64_t chunks;
    BatchNormBlocksParams blocksParams;
    // Workgroups for sums, for passes of four elements per invocation, and for blocks of both.
    Specialisation forSums, forPasses, forBlocks;
    Groups sums, passes, blocks;

    BatchNormLayer(Graph& graph, const Tensor& x_, const Tensor& weight_, const Tensor& bias_,
                   const BatchNormOptions& options, const RunningStatistics& running_,
                   bool training_)
        : x(x_),
          weight(weight_),
          bias(bias_),
          y(graph.temporary(x_.shape)),
          mean(graph.temporary({x_.dim(1)})),
          deviation(graph.temporary({x_.dim(1)})),
          running(running_),
          training(training_),
          images(x_.dim(0)),
          channels(x_.dim(1)),
          pixels(x_.dim(2) * x_.dim(3)),
          ranks(training ? sizeOf(graph.ranks()) : 1) {
        const KernelPath& path = graph.device().kernelPath();
        const bool pairs = path.texels && pixels % 2 == 0;
        if (!pairs) variant = "@plain";
        int64_t elements = pairs ? pixels / 2 : pixels;
        int64_t threads = std::min<int64_t>(elements, 64);
        params = {u32(images),     u32(channels),    u32(pixels),  u32(threads),
                  options.epsilon, options.momentum, options.slope};
        sums = planes(threads, channels, 1, forSums);
        passes = planes((elements + 3) / 4, channels, images, forPasses);

        constexpr int64_t kSmall = 4096;
        lanes = path.vectorLanes;
        wholeChannels = lanes > 0 && ranks == 1 && images * pixels <= kSmall;
        chunks = pixels / kChunkElements;
        uint32_t together = chunks % 16 == 0 ? 16 : 4;
        byBlocks = blockLanes(graph.device()) > 0 && !wholeChannels && channels <= 4096 &&
                   pixels % (int64_t{kChunkElements} * together) == 0;
        blocksParams = {.channels = u32(channels),
                        .chunks = u32(chunks),
                        .slope = options.slope,
                        .all = 1 / static_cast<float>(ranks * images * pixels)};
        blocks = {u32(chunks / together), u32(channels), u32(images)};
        forBlocks = {{"local_size", lanes * together},
                     {"kLanes", lanes},
                     {"kDigits", blockDigits(uint64_t(images * channels * chunks))}};
    }

    uint32_t keepsRunning() const { return running.mean ? 1 : 0; }
    Tensor runningMean(Graph& graph) const { return running.mean ? running.mean : graph.none(); }
    Tensor runningVariance(Graph& graph) const {
        return running.mean ? running.variance : graph.none();
    }

    // All passes over each channel at once.
    void channel(Graph& graph, const std::string& entry, std::initializer_list<Argument> arguments,
                 Specialisation spec) const {
        spec.insert({{"local_size", lanes}, {"kLanes", lanes}});
        const std::string kernel = "conv/batch_norm_channel." + entry + variant;
        graph.dispatchGroups(kernel.c_str(), arguments, params, {u32(channels), 1, 1}, spec);
    }

    enum class Pass { Sum, Elements };
    void pass(Graph& graph, Pass kind, const std::string& entry,
              std::initializer_list<Argument> arguments, Specialisation spec = {}) const {
        const bool sum = kind == Pass::Sum;
        const Specialisation& own = byBlocks ? forBlocks : sum ? forSums : forPasses;
        spec.insert(own.begin(), own.end());
        if (byBlocks)
            graph.dispatchGroups(("conv/batch_norm_blocks." + entry).c_str(), arguments,
                                 blocksParams, blocks, spec);
        else
            graph.dispatchGroups(("conv/batch_norm_passes." + entry + variant).c_str(), arguments,
                                 params, sum ? sums : passes, spec);
    }

    // Sums of `count` ranks of each channel, [rows,n], side by side.
    Tensor gathered(Graph& graph, const Tensor& partial, int64_t rows) const {
        return ranks > 1 ? graph.ofAllRanks(partial, rows) : partial;
    }
    BatchNormParams of(int64_t count) const {
        BatchNormParams all = params;
        all.images = u32(count * images);
        all.threads = u32(count * int64_t{params.threads});
        return all;
    }

    // What joins the sums of blocks' chunks, of so many ranks.
    void join(Graph& graph, const char* kernel, std::initializer_list<Argument> arguments,
              int64_t count, Specialisation spec = {}) const {
        BatchNormParams joined = of(count);
        joined.threads = u32(count * images * chunks);
        spec["local_size"] = lanes;
        graph.dispatch(kernel, arguments, joined, uint64_t(channels), spec);
    }

    // dweight and dbias [C] from the gradients' sums of so many ranks.
    void parameterGradients(Graph& graph, const Tensor& partial, int64_t count,
                            const Tensor& dweight, const Tensor& dbias) const {
        if (byBlocks)
            join(graph, "conv/batch_norm.chunk_parameters",
                 {{"chunkSums", partial}, {"dweight", dweight}, {"dbias", dbias}}, count);
        else
            graph.dispatch("conv/batch_norm.parameters",
                           {{"sums", partial}, {"dweight", dweight}, {"dbias", dbias}}, of(count),
                           uint64_t(channels));
    }

    void forward(Graph& graph) const {
        if (wholeChannels && training) {
            channel(graph, "forward",
                    {{"x", x},
                     {"y", y},
                     {"mean", mean},
                     {"deviation", deviation},
                     {"weight", weight},
                     {"bias", bias},
                     {"runningMean", runningMean(graph)},
                     {"runningVariance", runningVariance(graph)}},
                    {{"kRunning", keepsRunning()}});
            return;
        }
        if (training)
            statistics(graph);
        else
            graph.dispatch("conv/batch_norm.running",
                           {{"mean", mean},
                            {"deviation", deviation},
                            {"runningMean", running.mean},
                            {"runningVariance", running.variance}},
                           params, uint64_t(channels));
        pass(graph, Pass::Elements, "normalise",
             {{"x", x},
              {"mean", mean},
              {"deviation", deviation},
              {"weight", weight},
              {"bias", bias},
              {"y", y}});
    }

    // Mean and deviation of each channel; the running ones follow.
    void statistics(Graph& graph) const {
        const Specialisation spec{{"kRunning", keepsRunning()}};
        if (byBlocks) {
            Tensor partial = graph.temporary({channels, images * chunks, 2});
            pass(graph, Pass::Sum, "sum_values", {{"x", x}, {"partial", partial}});
            join(graph, "conv/batch_norm.chunk_statistics",
                 {{"chunkSums", gathered(graph, partial, channels)},
                  {"mean", mean},
                  {"deviation", deviation},
                  {"runningMean", runningMean(graph)},
                  {"runningVariance", runningVariance(graph)}},
                 ranks, spec);
            return;
        }
        auto summed = [&](uint32_t centred) {
            Tensor partial = graph.temporary({channels, int64_t{params.threads}});
            pass(graph, Pass::Sum, "sum_values", {{"x", x}, {"partial", partial}, {"mean", mean}},
                 {{"kCentred", centred}});
            return gathered(graph, partial, channels);
        };
        graph.dispatch("conv/batch_norm.mean",
                       {{"sums", summed(0)}, {"mean", mean}, {"runningMean", runningMean(graph)}},
                       of(ranks), uint64_t(channels), spec);
        graph.dispatch("conv/batch_norm.deviation",
                       {{"sums", summed(1)},
                        {"deviation", deviation},
                        {"runningVariance", runningVariance(graph)}},
                       of(ranks), uint64_t(channels), spec);
    }

    void backward(Graph& graph) const {
        Tensor dy = graph.gradient(y);
        auto target = [&](const Tensor& input) {
            return graph.wantsGradient(input) ? graph.gradientTarget(input)
                                              : graph.temporary({channels});
        };
        Tensor dweight = target(weight), dbias = target(bias);
        const Specialisation spec{{"kTraining", training}};
        if (wholeChannels && graph.wantsGradient(x)) {
            channel(graph, "backward",
                    {{"x", x},
                     {"dy", dy},
                     {"y", graph.gradientTarget(x)},
                     {"mean", mean},
                     {"deviation", deviation},
                     {"weight", weight},
                     {"bias", bias},
                     {"dweight", dweight},
                     {"dbias", dbias}},
                    spec);
            return;
        }
        Tensor partial = byBlocks ? graph.temporary({channels, images * chunks, 2})
                                  : graph.temporary({2, channels, int64_t{params.threads}});
        const bool atOnce = byBlocks && !training && graph.wantsGradient(x);
        if (atOnce)
            pass(graph, Pass::Elements, "gradients",
                 {{"x", x},
                  {"dy", dy},
                  {"mean", mean},
                  {"deviation", deviation},
                  {"weight", weight},
                  {"bias", bias},
                  {"partial", partial},
                  {"y", graph.gradientTarget(x)}});
        else
            pass(graph, Pass::Sum, "sum_gradients",
                 {{"x", x},
                  {"dy", dy},
                  {"mean", mean},
                  {"deviation", deviation},
                  {"weight", weight},
                  {"bias", bias},
                  {"partial", partial}});
        parameterGradients(graph, partial, 1, dweight, dbias);
        if (atOnce || !graph.wantsGradient(x)) return;
        BatchNormLayer all = *this;
        all.params = of(ranks);  // which counts the elements of all
        if (ranks > 1) {         // this rank's part was the parameters' gradient; x depends on all
            dweight = graph.temporary({channels}), dbias = graph.temporary({channels});
            parameterGradients(graph, graph.ofAllRanks(partial, byBlocks ? channels : 2 * channels),
                               ranks, dweight, dbias);
        }
        all.pass(graph, Pass::Elements, "input_gradient",
                 {{"x", x},
                  {"dy", dy},
                  {"mean", mean},
                  {"deviation", deviation},
                  {"weight", weight},
                  {"bias", bias},
                  {"dweight", dweight},
                  {"dbias", dbias},
                  {"y", graph.gradientTarget(x)}},
                 byBlocks ? Specialisation() : spec);
    }
};

Tensor batchNorm(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
                 const BatchNormOptions& options, const RunningStatistics& running, bool training) {
    int64_t C = x.dim(1);
    CHECK(weight.elements() == C && bias.elements() == C, "weight and bias have {} channels", C);
    CHECK(!running.mean || (running.mean.elements() == C && running.variance.elements() == C),
          "running statistics have {} channels", C);
    CHECK(training || running.mean, "evaluation has running statistics");
    CHECK(options.slope >= 0, "the slope {} is not negative", options.slope);
    BatchNormLayer layer(graph, x, weight, bias, options, running, training);
    graph.beginOp(training ? "batch_norm2d" : "batch_norm2d_evaluation");
    layer.forward(graph);
    graph.differentiate({x, weight, bias}, {layer.y}, [=, &graph] { layer.backward(graph); });
    return layer.y;
}

}  // namespace

Tensor batchNorm2d(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
                   const BatchNormOptions& options, const RunningStatistics& running) {
    return batchNorm(graph, x, weight, bias, options, running, true);
}

Tensor batchNorm2dEvaluation(Graph& graph, const Tensor& x, const Tensor& weight,
                             const Tensor& bias, const BatchNormOptions& options,
                             const RunningStatistics& running) {
    return batchNorm(graph, x, weight, bias, options, running, false);
}

// ---- for op_runner ------------------------------------------------------------------------------

namespace {

void checkPositive(const OpCall& c) {
    if (c.attribute("slope") < 0)
        throwInput("attr_slope: expected 0 or more, found {}", c.attribute("slope"));
    if (c.attribute("eps") <= 0)
        throwInput("attr_eps: expected a positive number, found {}", c.attribute("eps"));
    if (c["x"].elements() == 0) throwInput("x: expected pixels, found {}", toString(c["x"].shape));
}

}  // namespace

static const Op kBatchNorm2d{{
    .name = "batch_norm2d",
    .inputs = "x[N,C,H,W] weight[C] bias[C]",
    .attributes = "eps slope=1",
    .outputs = "y",
    .differentiable = "x weight bias",
    .build =
        [](OpCall& c) {
            checkPositive(c);
            c.result("y", batchNorm2d(c.graph, c["x"], c["weight"], c["bias"],
                                      {.epsilon = c.f("eps"), .slope = c.f("slope")}));
        },
}};
static const Op kBatchNorm2dEvaluation{{
    .name = "batch_norm2d_evaluation",
    .inputs = "x[N,C,H,W] weight[C] bias[C] running_mean[C] running_variance[C]",
    .attributes = "eps slope=1",
    .outputs = "y",
    .differentiable = "x weight bias",
    .build =
        [](OpCall& c) {
            checkPositive(c);
            c.result("y", batchNorm2dEvaluation(c.graph, c["x"], c["weight"], c["bias"],
                                                {.epsilon = c.f("eps"), .slope = c.f("slope")},
                                                {c["running_mean"], c["running_variance"]}));
        },
}};

}  // namespace doppel
