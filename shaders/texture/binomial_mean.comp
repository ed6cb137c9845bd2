// y = the mean of the 3x3 texels around each, weighted by 1 2 1 along either axis, / 16; those beyond
// the border are zero. The same both ways: dx is this of dy. Textures [H,W,C].
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "texture/params.h"
PARAMS(BinomialMeanParams, 2)
BUFFER(0, readonly, float, x);   // [H,W,C]; backward: dy
BUFFER(1, writeonly, float, y);  // [H,W,C]; backward: dx

// Of a row around one of its elements, 1 2 1; rows beyond the border are zero.
float across(int row, uvec3 columns, vec3 weights) {
    bool inside = row >= 0 && row < int(params.height);
    uint begin = uint(clamp(row, 0, int(params.height) - 1)) * params.line;
    float sum = weights.x * x.d[begin + columns.x] + weights.y * x.d[begin + columns.y] +
                weights.z * x.d[begin + columns.z];
    return inside ? sum : 0;
}

// A column of kBinomialRows elements, whose rows are read once.
ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.columns) return;
    int first = int(i / params.line * kBinomialRows);
    uint element = i % params.line;  // C to a texel
    bool left = element >= params.channels, right = element + params.channels < params.line;
    uvec3 columns = uvec3(left ? element - params.channels : element, element,
                          right ? element + params.channels : element);
    vec3 weights = vec3(left ? 1 : 0, 2, right ? 1 : 0);
    float above = across(first - 1, columns, weights), here = across(first, columns, weights);
    [[unroll]] for (int k = 0; k < int(kBinomialRows); ++k) {
        float below = across(first + k + 1, columns, weights);
        if (first + k < int(params.height))
            y.d[uint(first + k) * params.line + element] = (above + 2 * here + below) / 16;
        above = here;
        here = below;
    }
}
