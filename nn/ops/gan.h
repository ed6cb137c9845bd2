// What adversarial training of pictures needs: losses on a discriminator's logits, crops around the
// face, regions where silhouettes disagree, and pictures as planes.
#pragma once

#include <vector>

#include "nn/core/graph.h"

namespace doppel {

// L_G by log-likelihood: mean softplus(-x) for logits that should say "real", mean softplus(x) for
// "fake": the log-likelihood loss of Goodfellow et al., -log D and -log(1 - D) with D = sigmoid(x).
// A generator takes real = true on its fakes, whose gradient does not vanish where the
// discriminator is sure. x any shape, loss []. Gradient to x.
Tensor logGanLoss(Graph& graph, const Tensor& x, bool real);
// L_G by least squares: mean (x - 1)^2 or mean x^2 (Mao et al., ICCV 2017). Likewise.
Tensor leastSquaresGanLoss(Graph& graph, const Tensor& x, bool real);

// The size x size pixels of each picture around its centre; 0 outside the picture. Windows start at
// a whole pixel, so nothing is resampled. x [N,C,H,W]; centres [N,2]: column and row in pixels,
// whose centres are at a half; y [N,C,size,size]. Gradient to x, none to the centres.
Tensor cropWindow(Graph& graph, const Tensor& x, const Tensor& centres, int64_t size);

// The method's region C: where the rendered silhouette and the real one differ, a + b - 2ab, or,
// one-sided, what is rendered but not real, a (1 - b); without the faceSize x faceSize pixels
// around row `row` of centres [N,2]. rendered, real [H,W] in [0,1]; faceSize 0: no face. No
// gradient.
Tensor misalignedRegion(Graph& graph, const Tensor& rendered, const Tensor& real,
                        const Tensor& centres, int64_t row, int64_t faceSize, bool oneSided);

// Pictures [H,W,C] as one batch of planes [N,C,H,W], the reverse of interleave(); where masks are
// given, [H,W] each, what they weight 0 may be anything. With more than one picture C H W is a
// multiple of 4. Gradient to the pictures.
Tensor planar(Graph& graph, const std::vector<Tensor>& images,
              const std::vector<Tensor>& masks = {});

// The same values, through which no gradient flows.
Tensor detach(Graph& graph, const Tensor& x);

}  // namespace doppel
