// The device's ceilings, to which the ops' figures are compared: y = sum of eight chains s = s a +
// 1/2 of multiply-adds over x [n], four floats each (64 flops a round), and y = x, 32 bytes moved
// each.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "bench/params.h"
PARAMS(CeilingParams, 2)
BUFFER(0, readonly, vec4, x);   // [n]
BUFFER(1, writeonly, vec4, y);  // [n]

// 8 independent chains of vec4 multiply-adds: 64 flops a round, no memory.
ENTRY(fma) {
    uint i = linearIndex();
    if (i >= params.n) return;
    vec4 a = x.d[i], s[8];
    for (int k = 0; k < 8; ++k) s[k] = a + float(k);
    for (uint round = 0; round < params.rounds; ++round)
        for (int k = 0; k < 8; ++k) s[k] = fma(s[k], a, vec4(0.5));
    y.d[i] = s[0] + s[1] + s[2] + s[3] + s[4] + s[5] + s[6] + s[7];
}

// 32 bytes moved per element.
ENTRY(copy) {
    uint i = linearIndex();
    if (i >= params.n) return;
    y.d[i] = x.d[i];
}
