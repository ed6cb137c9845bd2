// Optimisers. They read the learning rate and the bias corrections of the step from graph.step().
#pragma once

#include "nn/core/graph.h"

namespace doppel {

struct AdamWOptions {
    float beta1 = 0.5f, beta2 = 0.999f, epsilon = 1e-8f;
    float weightDecay = 1e-2f;
    float rateScale = 1;  // times the step's learning rate
};

// What setStep() needs besides seed and frame: the step counts from 1.
StepParams adamwStepParams(uint32_t step, float learningRate, const AdamWOptions& options = {});

// value -= rate (m̂ / (√v̂ + ε) + weightDecay value) on all parameters at once, in place. Comes after
// graph.backward(); a parameter whose gradient nothing wrote still decays.
void adamwStep(Graph& graph, const Parameters& parameters, const AdamWOptions& options = {});

// The same on any tensors of one shape.
void adamw(Graph& graph, const Tensor& value, const Tensor& gradient, const Tensor& moment1,
           const Tensor& moment2, const AdamWOptions& options = {});

// The same on one row of tables [rows, n]: the row of StepParams.frame, from gradient [n]. The
// other rows and their moments stay as they are, so the corrections in StepParams are those of how
// often this row has been updated. step: StepParams of this row's own; empty: graph.step().
void adamwRow(Graph& graph, const Tensor& table, const Tensor& gradient, const Tensor& moment1,
              const Tensor& moment2, const AdamWOptions& options = {}, const Tensor& step = {});

// The gradients of a batch's rows [n], in the batch's order: where ranks share the batch, `rows`
// are this rank's, and those of the others follow from them; each is what it is to the mean over
// all.
std::vector<Tensor> rowGradients(Graph& graph, const std::vector<Tensor>& rows);

// Adam with one second moment for all rows of value [n,3], so that they keep their directions and
// relative lengths (shaders/optim/uniform_adam.comp). precondition: a symmetric positive map of
// [n,3], applied to the gradient and once more to the step, as if what it maps to value were
// optimised. moment1 [n,3]; moment2 [1] or more, of which the first number is used. No weight
// decay.
void uniformAdam(Graph& graph, const Tensor& value, const Tensor& gradient, const Tensor& moment1,
                 const Tensor& moment2, const std::function<Tensor(const Tensor&)>& precondition,
                 const AdamWOptions& options = {});

// gradient *= min(1, maxNorm / (‖gradient‖ + 1e-6)) over all parameters together, as PyTorch's
// clip_grad_norm_; returns ‖gradient‖ before [1]. Sums in a fixed order. Between backward() and the
// optimiser's step.
Tensor clipGradientNorm(Graph& graph, const Parameters& parameters, float maxNorm);
Tensor clipNorm(Graph& graph, const Tensor& gradient, float maxNorm);

}  // namespace doppel
