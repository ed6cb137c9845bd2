// y = the mean of the 3x3 texels around each, weighted by 1 2 1 along either axis, / 16; those beyond
// the border are zero. The same both ways: dx is this of dy. Textures [H,W,C].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "texture/params.h"
PARAMS(BinomialMeanParams, 2)
BUFFER(0, readonly, float, x);   // [H,W,C]; backward: dy
BUFFER(1, writeonly, float, y);  // [H,W,C]; backward: dx

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint row = i / params.line, column = i - row * params.line;  // elements: C to a texel
    float sum = 0;
    for (int v = -1; v <= 1; ++v)
        for (int u = -1; u <= 1; ++u) {
            int r = int(row) + v, c = int(column) + u * int(params.channels);
            if (r < 0 || r >= int(params.height) || c < 0 || c >= int(params.line)) continue;
            sum += float((2 - abs(u)) * (2 - abs(v))) * x.d[uint(r) * params.line + uint(c)];
        }
    y.d[i] = sum / 16;
}
