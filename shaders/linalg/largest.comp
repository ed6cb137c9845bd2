// largest [1] = max |x|, for halfScale() (linalg/half_scale.glsl): a gradient is multiplied by that
// before it is rounded to halves. An integer maximum of bits, in any order the same.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "linalg/params.h"
PARAMS(LargestParams, 2)
BUFFER(0, readonly, uint, x);         // [elements], floats' bits
BUFFER(1, readwrite, uint, largest);  // [1], zero before

shared uint best;

// Of the magnitudes: without its sign a float's bits are ordered as it is, NaN being the largest.
ENTRY(magnitude) {
    if (localIndex() == 0) best = 0;
    barrier();
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint first = group * gl_WorkGroupSize.x * kLargestEach + localIndex();
    uint end = min(params.elements, (group + 1) * gl_WorkGroupSize.x * kLargestEach);
    uint mine = 0;
    for (uint i = first; i < end; i += gl_WorkGroupSize.x) mine = max(mine, x.d[i] & 0x7fffffffu);
    atomicMax(best, mine);
    barrier();
    if (localIndex() == 0) atomicMax(largest.d[0], best);
}
