// loss = wA a + wB b + wC c + wD d of up to four scalar terms; backward gives one term's gradient,
// wA dloss, wA being that term's weight.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "fit/params.h"
PARAMS(WeightedSumParams, 7)
BUFFER(0, readonly, float, a);       // [1] each
BUFFER(1, readonly, float, b);
BUFFER(2, readonly, float, c);
BUFFER(3, readonly, float, d);
BUFFER(4, writeonly, float, loss);   // [1]
BUFFER(5, readonly, float, dloss);   // [1]
BUFFER(6, writeonly, float, dterm);  // [1], of the term with weightA

ENTRY(forward) {
    if (linearIndex() > 0) return;
    loss.d[0] = params.weightA * a.d[0] + params.weightB * b.d[0] + params.weightC * c.d[0] +
                params.weightD * d.d[0];
}

ENTRY(backward) {
    if (linearIndex() > 0) return;
    dterm.d[0] = params.weightA * dloss.d[0];
}
