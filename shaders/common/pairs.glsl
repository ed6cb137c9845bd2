// Elements two by two, and several pairs per invocation: on lavapipe a load or a store costs as
// much for eight bytes as for four, and an invocation as much for itself as a few loads.
// An odd number's last pair reaches into padding, for buffers end at multiples of 16 bytes.
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#include "common/pairs.h"

vec2 unpackPair(uint64_t pair) { return uintBitsToFloat(unpackUint2x32(pair)); }
uint64_t packPair(vec2 pair) { return packUint2x32(floatBitsToUint(pair)); }

// Pair e of this invocation; neighbours of a workgroup take neighbouring pairs.
uint pairIndex(uint e) {
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    return (group * kPairsEach + e) * gl_WorkGroupSize.x + localIndex();
}

// For each pair i of n elements that is this invocation's:  EACH_PAIR(i, params.n) { … }
#define EACH_PAIR(i, n)                                                \
    uint i;                                                            \
    [[unroll]] for (uint i##Each = 0; i##Each < kPairsEach; ++i##Each) \
        if ((i = pairIndex(i##Each)) < ((n) + 1) / 2)
