#include "nn/ops/fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "engine/files/numbers.h"
#include "fit/params.h"
#include "nn/core/op.h"

namespace doppel {

Tensor selectRow(Graph& graph, const Tensor& table, const Tensor& index, uint32_t word,
                 int32_t offset) {
    CHECK(word < u32(index.elements()), "index has an element {}", word);
    Tensor row = graph.temporary({table.dim(1)});
    graph.beginOp("select_row");
    auto length = u32(table.dim(1));
    graph.dispatch("fit/select_row.forward", {{"table", table}, {"index", index}, {"row", row}},
                   SelectRowParams{u32(table.dim(0)), length, word, offset}, length);
    return row;
}

static const Op kSelectRow{{
    .name = "select_row",
    .inputs = "table[R,N] index:i32[K]",
    .attributes = "word=0 offset=0",
    .outputs = "row",
    .build =
        [](OpCall& c) {
            auto offset = static_cast<int32_t>(c.attribute("offset"));
            if (c.u("word") >= c.ints("index").size())
                throwInput("attr_word: index has {} elements, found {}", c.ints("index").size(),
                           c.u("word"));
            c.result("row", selectRow(c.graph, c["table"], c["index"], c.u("word"), offset));
        },
}};

std::vector<float> correctedPoses(std::vector<float> start, const std::vector<float>& corrections,
                                  float transScale) {
    for (size_t i = 0; i < start.size(); ++i)
        start[i] += i % kPoseRow < kThetaSize ? corrections[i] : transScale * corrections[i];
    return start;
}

Pose poseCorrection(Graph& graph, const Tensor& start, const Tensor& correction, float transScale) {
    Pose pose{graph.temporary({kThetaSize}), graph.temporary({3})};
    PoseCorrectionParams params{transScale};
    graph.beginOp("pose_correction");
    graph.dispatch("fit/pose_correction.forward",
                   {{"start", start},
                    {"correction", correction},
                    {"theta", pose.theta},
                    {"trans", pose.trans}},
                   params, kPoseRow);
    graph.differentiate({correction}, {pose.theta, pose.trans}, [=, &graph] {
        graph.dispatch("fit/pose_correction.backward",
                       {{"dtheta", graph.gradient(pose.theta)},
                        {"dtrans", graph.gradient(pose.trans)},
                        {"dcorrection", graph.gradientTarget(correction)}},
                       params, kPoseRow);
    });
    return pose;
}

static const Op kPoseCorrection{{
    .name = "pose_correction",
    .inputs = "start[75] correction[75]",
    .attributes = "trans_scale",
    .outputs = "theta trans",
    .differentiable = "correction",
    .build =
        [](OpCall& c) {
            Pose pose = poseCorrection(c.graph, c["start"], c["correction"], c.f("trans_scale"));
            c.result("theta", pose.theta);
            c.result("trans", pose.trans);
        },
}};

std::vector<float> startBends(std::span<const float> start, float transScale) {
    std::vector<float> bends(start.size());
    const size_t row = kPoseRow;
    constexpr float kTurnAtCut = .6f, kWayAtCut = .3f;
    for (size_t at = row; at + 2 * row <= start.size(); at += row) {
        const auto bend = [&](size_t k) {
            return start[at + k] - (start[at + k - row] + start[at + k + row]) / 2;
        };
        const size_t t = kThetaSize;
        if (std::hypot(bend(0), bend(1), bend(2)) > kTurnAtCut ||
            std::hypot(bend(t), bend(t + 1), bend(t + 2)) > kWayAtCut)
            continue;
        for (size_t k = 0; k < row; ++k) bends[at + k] = k < t ? bend(k) : bend(k) / transScale;
    }
    return bends;
}

Tensor posePrior(Graph& graph, const Tensor& correction, const Tensor& before, const Tensor& after,
                 const Tensor& bend, const Tensor& jointWeight, const Tensor& beta,
                 const PosePriorWeights& weights) {
    Tensor loss = graph.temporary({});
    PosePriorParams params{weights.pose, weights.trans, weights.smooth, weights.shape};
    graph.beginOp("pose_prior");
    graph.dispatch("fit/pose_prior.forward",
                   {{"correction", correction},
                    {"before", before},
                    {"after", after},
                    {"start_bend", bend},
                    {"joint_weight", jointWeight},
                    {"beta", beta},
                    {"loss", loss}},
                   params, 1);
    graph.differentiate({correction, beta}, {loss}, [=, &graph] {
        // One kernel writes both; the one that nobody wants goes to a temporary.
        auto target = [&](const Tensor& input) {
            return graph.wantsGradient(input) ? graph.gradientTarget(input)
                                              : graph.temporary(input.shape);
        };
        Tensor dcorrection = target(correction), dbeta = target(beta);
        graph.dispatch("fit/pose_prior.backward",
                       {{"correction", correction},
                        {"before", before},
                        {"after", after},
                        {"start_bend", bend},
                        {"joint_weight", jointWeight},
                        {"beta", beta},
                        {"dloss", graph.gradient(loss)},
                        {"dcorrection", dcorrection},
                        {"dbeta", dbeta}},
                       params, kPoseRow);
    });
    return loss;
}

static const Op kPosePrior{{
    .name = "pose_prior",
    .inputs = "correction[75] before[75] after[75] start_bend[75] joint_weight[24] beta[10]",
    .attributes = "pose trans smooth shape",
    .outputs = "loss",
    .differentiable = "correction beta",
    .build =
        [](OpCall& c) {
            PosePriorWeights weights{c.f("pose"), c.f("trans"), c.f("smooth"), c.f("shape")};
            c.result("loss", posePrior(c.graph, c["correction"], c["before"], c["after"],
                                       c["start_bend"], c["joint_weight"], c["beta"], weights));
        },
}};

Tensor poseLikelihood(Graph& graph, const Tensor& theta, const Tensor& angles, float likely,
                      float limits) {
    Tensor loss = graph.temporary({});
    PoseLikelihoodParams params{likely, limits};
    graph.beginOp("pose_likelihood");
    graph.dispatch("fit/pose_likelihood.forward",
                   {{"theta", theta}, {"angles", angles}, {"loss", loss}}, params, 1);
    graph.differentiate({theta}, {loss}, [=, &graph] {
        graph.dispatch("fit/pose_likelihood.backward",
                       {{"theta", theta},
                        {"angles", angles},
                        {"dloss", graph.gradient(loss)},
                        {"dtheta", graph.gradientTarget(theta)}},
                       params, kThetaSize);
    });
    return loss;
}

static const Op kPoseLikelihood{{
    .name = "pose_likelihood",
    .inputs = "theta[72] angles[72,4]",
    .attributes = "likely limits",
    .outputs = "loss",
    .differentiable = "theta",
    .build =
        [](OpCall& c) {
            c.result("loss", poseLikelihood(c.graph, c["theta"], c["angles"], c.f("likely"),
                                            c.f("limits")));
        },
}};

Tensor balanceLoss(Graph& graph, const Tensor& joints, const Tensor& shares, const Tensor& up,
                   float deviation, float level) {
    CHECK(deviation > 0, "the deviation {} is positive", deviation);
    Tensor loss = graph.temporary({});
    BalanceParams params{u32(joints.dim(0)), deviation, level};
    graph.beginOp("balance_loss");
    graph.dispatch("fit/balance_loss.forward",
                   {{"joints", joints}, {"shares", shares}, {"up", up}, {"loss", loss}}, params, 1);
    graph.differentiate({joints, up}, {loss}, [=, &graph] {
        // One kernel writes both; the one that nobody wants goes to a temporary.
        auto target = [&](const Tensor& input) {
            return graph.wantsGradient(input) ? graph.gradientTarget(input)
                                              : graph.temporary(input.shape);
        };
        Tensor djoints = target(joints), dup = target(up);
        graph.dispatch("fit/balance_loss.backward",
                       {{"joints", joints},
                        {"shares", shares},
                        {"up", up},
                        {"dloss", graph.gradient(loss)},
                        {"djoints", djoints},
                        {"dup", dup}},
                       params, params.joints);
    });
    return loss;
}

static const Op kBalanceLoss{{
    .name = "balance_loss",
    .inputs = "joints[J,3] shares[J] up[2]",
    .attributes = "deviation level",
    .outputs = "loss",
    .differentiable = "joints up",
    .build =
        [](OpCall& c) {
            if (c.attribute("deviation") <= 0)
                throwInput("attr_deviation: expected metres above 0, found {}",
                           c.attribute("deviation"));
            c.result("loss", balanceLoss(c.graph, c["joints"], c["shares"], c["up"],
                                         c.f("deviation"), c.f("level")));
        },
}};

// Of one to four terms, as many as the kernel takes.
static Tensor sumOfFew(Graph& graph, std::span<const WeightedTerm> terms) {
    // Missing terms repeat the first one with weight 0.
    std::array<Tensor, 4> t;
    std::array<float, 4> w{};
    for (size_t i = 0; i < 4; ++i) {
        t[i] = terms[i < terms.size() ? i : 0].term;
        w[i] = i < terms.size() ? terms[i].weight : 0.0f;
    }
    Tensor loss = graph.temporary({});
    WeightedSumParams params{w[0], w[1], w[2], w[3]};
    graph.beginOp("weighted_sum");
    graph.dispatch("fit/weighted_sum.forward",
                   {{"a", t[0]}, {"b", t[1]}, {"c", t[2]}, {"d", t[3]}, {"loss", loss}}, params, 1);
    std::vector<Tensor> inputs(t.begin(), t.begin() + static_cast<long>(terms.size()));
    graph.differentiate(inputs, {loss}, [=, &graph] {
        for (size_t i = 0; i < inputs.size(); ++i) {
            if (!graph.wantsGradient(inputs[i])) continue;
            graph.dispatch(
                "fit/weighted_sum.backward",
                {{"dloss", graph.gradient(loss)}, {"dterm", graph.gradientTarget(inputs[i])}},
                WeightedSumParams{w[i], 0, 0, 0}, 1);
        }
    });
    return loss;
}

Tensor weightedSum(Graph& graph, const std::vector<WeightedTerm>& terms) {
    CHECK(!terms.empty(), "a weighted sum has terms");
    auto rest = std::span(terms);
    Tensor sum = sumOfFew(graph, rest.first(std::min<size_t>(4, rest.size())));
    for (rest = rest.subspan(std::min<size_t>(4, rest.size())); !rest.empty();) {
        std::vector<WeightedTerm> next{{sum, 1}};
        size_t count = std::min<size_t>(3, rest.size());
        next.insert(next.end(), rest.begin(), rest.begin() + static_cast<long>(count));
        sum = sumOfFew(graph, next);
        rest = rest.subspan(count);
    }
    return sum;
}

static const Op kWeightedSum{{
    .name = "weighted_sum",
    .inputs = "a[] b[]? c[]? d[]?",
    .attributes = "weight_a=1 weight_b=1 weight_c=1 weight_d=1",
    .outputs = "loss",
    .differentiable = "a b c d",
    .build =
        [](OpCall& c) {
            std::vector<WeightedTerm> terms;
            for (std::string name : {"a", "b", "c", "d"})
                if (c[name]) terms.push_back({c[name], c.f("weight_" + name)});
            c.result("loss", weightedSum(c.graph, terms));
        },
}};

}  // namespace doppel
