// Twice the height and width by bilinear interpolation, pixel centres at a half:
//
//     y[c,i,j] = x[c, (i + 1/2) / 2 - 1/2, (j + 1/2) / 2 - 1/2] (+ more[c,i,j]),
//
// the border's values beyond the border. So an even pixel is 3/4 of its own and 1/4 of the one
// before, an odd one 1/4 of the one behind.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "inference/params.h"
PARAMS(UpsampleParams, 6)
BUFFER(0, readonly, float, x);      // [C,H,W]
BUFFER(1, readonly, float, more);   // [C,2H,2W], see kAdd
BUFFER(2, writeonly, float, y);     // [C,2H,2W]
BUFFER(3, readonly, vec4, xQuads);  // the same
BUFFER(4, readonly, vec4, moreQuads);
BUFFER(5, writeonly, vec4, yQuads);

layout(constant_id = 1) const bool kAdd = false;

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint rest = quotient(i, params.byColumns), column = remainder(i, rest, params.byColumns);
    uint channel = quotient(rest, params.byRows), row = remainder(rest, channel, params.byRows);
    uint r0 = row / 2, c0 = column / 2;
    uint r1 = row % 2 == 0 ? max(r0, 1) - 1 : min(r0 + 1, params.height - 1);
    uint c1 = column % 2 == 0 ? max(c0, 1) - 1 : min(c0 + 1, params.width - 1);
    uint base = channel * params.height * params.width;
    uint at0 = base + r0 * params.width, at1 = base + r1 * params.width;
    float near = .75 * x.d[at0 + c0] + .25 * x.d[at0 + c1];
    float far = .75 * x.d[at1 + c0] + .25 * x.d[at1 + c1];
    float v = .75 * near + .25 * far;
    y.d[i] = kAdd ? v + more.d[i] : v;
}

// Where rows of x are whole texels: an invocation makes eight columns of two rows from one texel
// and those around it.
ENTRY(forward_quads) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint rest = quotient(i, params.byColumns), texel = remainder(i, rest, params.byColumns);
    uint channel = quotient(rest, params.byRows), row = remainder(rest, channel, params.byRows);
    uint texels = params.width / 4;
    vec4 low[3], high[3];  // columns 0 to 3 and 4 to 7, of the row before, this one, the one behind
    [[unroll]] for (uint r = 0; r < 3; ++r) {
        uint at = min(max(row + r, 1) - 1, params.height - 1);
        uint start = (channel * params.height + at) * texels;
        vec4 v = xQuads.d[start + texel];
        float before = texel > 0 ? xQuads.d[start + texel - 1].w : v.x;
        float behind = texel + 1 < texels ? xQuads.d[start + texel + 1].x : v.w;
        low[r] = .75 * v.xxyy + .25 * vec4(before, v.y, v.x, v.z);
        high[r] = .75 * v.zzww + .25 * vec4(v.y, v.w, v.z, behind);
    }
    [[unroll]] for (uint r = 0; r < 2; ++r) {
        vec4 first = .75 * low[1] + .25 * low[2 * r], second = .75 * high[1] + .25 * high[2 * r];
        uint at = ((channel * 2 * params.height + 2 * row + r) * texels + texel) * 2;  // texels of y
        if (kAdd) {
            first += moreQuads.d[at];
            second += moreQuads.d[at + 1];
        }
        yQuads.d[at] = first;
        yQuads.d[at + 1] = second;
    }
}
