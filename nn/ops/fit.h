// What fitting a body to frames needs besides LBS and the rasterizer: pose tables and priors.
#pragma once

#include <span>
#include <vector>

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

// loss = Σ stay_i c_i² + smooth Σ (c_i - (before_i + after_i) / 2 + bend_i)² + shape Σ β_k²
// with stay = pose · jointWeight for rotations and trans for the translation: the corrected pose
// stays near its start, moves evenly, the shape is likely. bend is what the start's own motion
// adds, a row of startBends(). correction, before, after, bend [75]; jointWeight [24]; beta [10];
// loss []. Gradient to correction and beta; the neighbouring frames are constants.
struct PosePriorWeights {
    float pose = 0, trans = 0, smooth = 0, shape = 0;
};
Tensor posePrior(Graph& graph, const Tensor& correction, const Tensor& before, const Tensor& after,
                 const Tensor& bend, const Tensor& jointWeight, const Tensor& beta,
                 const PosePriorWeights& weights);

// How far each row of a table of poses [rows,75] is from the mean of its neighbours, in a
// correction's units; 0 in the first and the last, and where the body jumps, by more than 35
// degrees or .3 m, at a cut: there corrections alone are held to their neighbours'.
std::vector<float> startBends(std::span<const float> start, float transScale);

// loss = likely Σ_j log(1 + Σ_k ((θ_jk - mean_jk) precision_jk)²) + limits Σ max(θ - high, low - θ,
// 0)²: Cauchy's loss of each joint, whose pull fades where one is surely elsewhere, and what it is
// to be beyond limits. theta [72] rad; angles [72,4] as LikelyAngle has them
// (nn/body/likely_pose.h); loss []. Gradient to theta.
Tensor poseLikelihood(Graph& graph, const Tensor& theta, const Tensor& angles, float likely,
                      float limits);

// How far a body is out of balance:
//     loss = log(1 + |q - (q · g) g|² / deviation²) + level (a² + b²),
// q = Σ share_j p_j the way from where it stands to its centre of mass, g = (a, -1, b) / |(a, -1,
// b)| what is up. joints [J,3] camera space (y down), m; shares [J], which sum to 0; up [2] = (a,
// b), the camera's pitch and roll as slopes; deviation m. loss []. Gradient to joints and up.
Tensor balanceLoss(Graph& graph, const Tensor& joints, const Tensor& shares, const Tensor& up,
                   float deviation, float level);

// loss = Σ weight · term from the first on, for one scalar term or more. loss []; gradient to every
// term.
struct WeightedTerm {
    Tensor term;
    float weight;
};
Tensor weightedSum(Graph& graph, const std::vector<WeightedTerm>& terms);

}  // namespace doppel
