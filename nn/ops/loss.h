// Losses and measures on pictures. Each is one number of shape []; sums have a fixed order, and an
// empty mask gives 0 with a gradient of 0.
#pragma once

#include "nn/core/graph.h"
#include "shaders/common/camera.h"

namespace doppel {

// L_s = 1 - sum p g / sum (p + g - p g) over all elements: soft intersection over union of the
// silhouettes p = Î_s and g = I_s, of one picture or of a batch. predicted, target: the same shape,
// values in [0,1]. Both empty: 0. Gradient to predicted.
Tensor silhouetteIouLoss(Graph& graph, const Tensor& predicted, const Tensor& target);

// L_pt = sum |predicted - target| mask / sum mask = ‖(Î − I) ⊗ B‖₁ / ‖B‖₁ with the mask B, and both
// terms of L_r with B and C: the mask counts pixels, the difference all channels. predicted, target
// [...,C]; mask [...]. Gradient to predicted, none where it equals the target.
Tensor maskedL1Loss(Graph& graph, const Tensor& predicted, const Tensor& target,
                    const Tensor& mask);

// Structural similarity, 1 for equal pictures: 11x11 Gaussian window of sigma 1.5, K1 .01, K2 .03,
// zero padding, mean over pixels and channels. a, b [H,W,C] in [0,1]. Gradient to a.
Tensor ssim(Graph& graph, const Tensor& a, const Tensor& b);

// loss = sum c r^2 / (r^2 + scale^2) / sum c: the robust distance (Geman, McClure) between
// projected joints and keypoints, from 0 to 1. joints [J,3] camera space, m; targets [J,3]: u, v in
// pixels and confidence c >= 0 (0: not seen, u and v may be NaN); camera as the rasterizers take it
// (nn/ops/raster.h); scale in pixels. A joint at z <= 0.001 m does not count. Gradient to joints.
Tensor keypointLoss(Graph& graph, const Tensor& joints, const Tensor& targets, const Tensor& camera,
                    float scale);

// loss = scale sum over the cell sizes l = 1, 2, 4, 8 of weight_l l^2 sum over cells and channels of
// rho(the cell's mean of counts (a - b)): pictures compared at several sizes at once, so that what is
// off by pixels is felt across them. rho(d) = d^2 where epsilon is 0, else sqrt(d^2 + epsilon^2) -
// epsilon (Charbonnier). a, b [H,W,C] or [H,W]; counts [H,W], how much a pixel counts; scale [1], one
// over the person's pixels, say. Cells at the far borders are filled with zeros. Gradient to a.
struct PyramidWeights {
    float cell1 = 1, cell2 = 0, cell4 = 0, cell8 = 0;
};
Tensor pyramidLoss(Graph& graph, const Tensor& a, const Tensor& b, const Tensor& counts,
                   const Tensor& scale, const PyramidWeights& weights, float epsilon = 0);

// y[...,H,W] = greatest of the 3x3 pixels around each, 0 beyond the border. No gradient.
Tensor dilate3(Graph& graph, const Tensor& x);

}  // namespace doppel
