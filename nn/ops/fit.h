// What fitting a body to frames needs besides LBS and the rasterizer: pose tables and priors.
#pragma once

#include "nn/body/joint.h"
#include "nn/core/graph.h"

namespace doppel {

constexpr int64_t kPoseRow = kThetaSize + 3;  // a theta, then a translation

// row = table[index[word] + offset], the row's number clamped to the table.
// table [rows, n], index i32 [k], word < k; row [n]. No gradient: watch() the row where one is
// wanted, as a table that is trained row by row does.
Tensor selectRow(Graph& graph, const Tensor& table, const Tensor& index, uint32_t word,
                 int32_t offset = 0);

// theta = start[:72] + correction[:72], trans = start[72:] + transScale * correction[72:].
// start, correction [75]; theta [72] rad, trans [3] m. Gradient to correction.
struct Pose {
    Tensor theta, trans;
};
Pose poseCorrection(Graph& graph, const Tensor& start, const Tensor& correction, float transScale);
// The same on the host, for all rows of a table [rows,75].
std::vector<float> correctedPoses(std::vector<float> start, const std::vector<float>& corrections,
                                  float transScale);

// loss = Σ stay_i c_i² + smooth Σ (c_i - (before_i + after_i) / 2)² + shape Σ β_k²
// with stay = pose · jointWeight for rotations and trans for the translation: the corrected pose
// stays near its start, its correction varies slowly in time, the shape is likely.
// correction, before, after [75]; jointWeight [24]; beta [10]; loss []. Gradient to correction and
// beta; the neighbouring frames are constants.
struct PosePriorWeights {
    float pose = 0, trans = 0, smooth = 0, shape = 0;
};
Tensor posePrior(Graph& graph, const Tensor& correction, const Tensor& before, const Tensor& after,
                 const Tensor& jointWeight, const Tensor& beta, const PosePriorWeights& weights);

// loss = Σ weight · term from the first on, for one scalar term or more. loss []; gradient to every
// term.
struct WeightedTerm {
    Tensor term;
    float weight;
};
Tensor weightedSum(Graph& graph, const std::vector<WeightedTerm>& terms);

}  // namespace doppel
