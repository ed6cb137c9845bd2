// Loads and stores of more than one number at a time, in one spelling for two kinds of device.
//
//     BUFFER(0, readonly, Pair, x);    // elements 2 i and 2 i + 1: vec2 v = unpackPair(x.d[i])
//     BUFFER(1, writeonly, Pair, y);   // y.d[i] = packPair(v)
//     QUADS(2, z);                     // elements 4 i to 4 i + 3: vec4 v = quadAt(z, i)
//
// GPUs (CPU = 0) load them as they are. In the variant for CPUs with lavapipe (CPU = 1, see
// shaders.cmake) a pair is one 64-bit integer, because a load is a gather there which costs as much
// for eight bytes as for four; and a quad is a texel, because lavapipe fetches sixteen bytes of a
// texel buffer at once, two to eight times as fast as by gathers (docs/decisions.md). Whole arrays
// go faster still by common/blocks.glsl.
//
// An odd number's last pair reaches into padding, for buffers end at multiples of 16 bytes.
#extension GL_EXT_control_flow_attributes : require
#include "common/pairs.h"

#if CPU
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#define Pair uint64_t
vec2 unpackPair(uint64_t pair) { return uintBitsToFloat(unpackUint2x32(pair)); }
uint64_t packPair(vec2 pair) { return packUint2x32(floatBitsToUint(pair)); }
// Through a descriptor in either flavour; zeros behind the buffer's end.
#define QUADS(slot, name) layout(set = 0, binding = slot) uniform textureBuffer name
#define quadAt(name, i) texelFetch(name, int(i))
#else
#define Pair vec2
vec2 unpackPair(vec2 pair) { return pair; }
vec2 packPair(vec2 pair) { return pair; }
#define QUADS(slot, name) BUFFER(slot, readonly, vec4, name)
#define quadAt(name, i) name.d[i]
#endif

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
