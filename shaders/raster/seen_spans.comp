// spans [1+n] = n, and the first pixels of the stretches of kSpan pixels, in reading order, in
// which a face is seen at any sample: what is to be shaded. A CPU's vectors would walk through the
// shading of all others too. The list's order depends on the moment; the picture does not.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "raster/params.h"
layout(constant_id = 1) const uint samples = 1;  // per pixel and axis
layout(constant_id = 2) const uint keys = 0;     // 1: of two numbers each
PARAMS(SeenSpansParams, 2)
BUFFER(0, readonly, uint, index);   // [H samples,W samples,1 + keys] NearestFaces::index
BUFFER(1, readwrite, uint, spans);  // [1+H W/kSpan] count, and the first pixel of each; unordered

// One invocation for each span.
ENTRY(list) {
    uint first = linearIndex() * kSpan;
    if (first >= params.width * params.height) return;
    uint y = quotient(first, params.byWidth), x = remainder(first, y, params.byWidth);
    bool found = false;
    [[unroll]] for (uint p = 0; p < kSpan; ++p) {
        [[unroll]] for (uint k = 0; k < samples * samples; ++k) {
            uint row = min(y, params.height - 1) * samples + k / samples;
            uint at = row * params.width * samples + x * samples + k % samples;
            found = found || int(keys == 0 ? index.d[at] : ~index.d[2 * at]) >= 0;
        }
        ++x;
        if (x == params.width) {
            x = 0;
            ++y;
        }
    }
    if (found) spans.d[1 + atomicAdd(spans.d[0], 1)] = first;
}
