#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "optim/params.h"
PARAMS(ClipParams, 4)
BUFFER(0, readwrite, float, gradient);  // [n]
BUFFER(1, writeonly, float, partial);   // [ceil(n / partLength)]
BUFFER(2, readwrite, float, squares);   // [1], the sum of them
BUFFER(3, writeonly, float, norm);      // [1]

ENTRY(squares) {
    uint i = linearIndex(), length = params.partLength, n = params.n, first = i * length;
    if (first >= n) return;
    uint last = min(n, first + length);
    float total = 0;
    for (uint e = first; e < last; ++e) {
        float g = gradient.d[e];
        total += g * g;
    }
    partial.d[i] = total;
}

// As torch.nn.utils.clip_grad_norm_ scales.
ENTRY(scale) {
    uint i = linearIndex();
    if (i >= params.n) return;
    float length = sqrt(squares.d[0]);
    if (i == 0) norm.d[0] = length;
    gradient.d[i] *= min(1, params.maxNorm / (length + 1e-6));
}
