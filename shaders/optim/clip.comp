// g [n] = g min(1, maxNorm / (norm + 1e-6)), norm being the length of all of them as
// one vector, as torch.nn.utils.clip_grad_norm_ does (Pascanu, Mikolov and Bengio, On the
// difficulty of training recurrent neural networks, ICML 2013, section 3.2). linalg/sum.comp adds
// up the parts.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "optim/params.h"
PARAMS(ClipParams, 6)
BUFFER(0, readwrite, vec2, gradient);   // [n], in pairs
BUFFER(1, writeonly, float, partial);   // [parts]
BUFFER(2, readwrite, float, squares);   // [1], the sum of them
BUFFER(3, writeonly, float, norm);      // [1]
BUFFER(4, writeonly, float, elements);  // gradient again
BUFFER(5, readonly, int, padding);      // [n] elements between tensors

// Invocation i sums pairs i, i + parts and so on.
ENTRY(squares) {
    uint i = linearIndex(), pairs = (params.n + 1) / 2;
    if (i >= params.parts) return;
    vec2 total = vec2(0);
    for (uint p = i; p < pairs; p += params.parts) {
        vec2 g = gradient.d[p];
        if (2 * p + 1 == params.n) g.y = 0;  // anything lies behind the end
        total += g * g;
    }
    partial.d[i] = total.x + total.y;
}

ENTRY(scale) {
    float length = sqrt(squares.d[0]), factor = min(1, params.maxNorm / (length + 1e-6));
    if (linearIndex() == 0) norm.d[0] = length;
    EACH_PAIR(i, params.n) gradient.d[i] = gradient.d[i] * factor;
}

// Kernels that work on several elements at once leave anything behind a tensor's last one.
ENTRY(clear_padding) {
    uint i = linearIndex();
    if (i < params.n) elements.d[padding.d[i]] = 0;
}
