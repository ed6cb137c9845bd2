// Whole arrays, pair by pair (common/loads.glsl), by one body for two kinds of device. On a GPU an
// invocation takes kPairsEach pairs. On a CPU with lavapipe (kLanes > 0) a subgroup takes
// kBlocksEach blocks and loads them as whole vectors. Whatever each lane loads from an address of
// its own is a gather there, some 38 cycles for 64 bytes; what all lanes load from one address is a
// scalar, and LLVM joins a block's scalars, handed out to the lanes in order, into the vectors that
// they came from. That needs
// - addresses that lavapipe sees to be the same in all lanes: it believes that of push constants
//   alone, so that uniformOf() spells the subgroup's number with digits from there;
// - no control flow around the loads: whoever dispatches sees to it that no block is missing.
// Parameters of the shader have a member "digits".
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_basic : require
#include "common/blocks.h"
#include "common/loads.glsl"

#if CPU
layout(constant_id = 31) const uint kLanes = 0;   // of a subgroup, 8 or 16; 0: no blocks
layout(constant_id = 32) const uint kDigits = 9;  // in base 4, of a subgroup's number
#else
const uint kLanes = 0, kDigits = 0;
#endif

struct Block {
    Pair pairs[kBlockElements / 2];
};

// A block fills several vectors of fewer than sixteen lanes.
const uint kParts = kLanes > 0 ? kBlockElements / 2 / (kLanes > 0 ? kLanes : 1) : 1;
const uint kPlaces = kLanes > 0 ? kBlocksEach * kParts : kPairsEach;
struct Place {
    uint block, part;  // the same in all lanes; of kLanes pairs
    uint pair;         // this invocation's
};

// i, which is the same in all lanes of a subgroup, so that lavapipe knows.
uint uniformOf(uint i, uint digits) {
    uint u = 0;
    [[unroll]] for (uint b = 0; b < digits; ++b)
        u |= params.digits.digit[(i >> (2 * b)) & 3] << (2 * b);
    return u;
}

// Part of a block, a pair for each lane.
Pair lanePair(Block block, uint part) {
    uint lane = gl_SubgroupInvocationID, first = part * kLanes;
    Pair pair = block.pairs[first];
    // "From lane k on", not "in lane k": of these LLVM makes one load.
    [[unroll]] for (uint k = 1; k < kLanes; ++k)
        pair = lane >= k ? block.pairs[first + k] : pair;
    return pair;
}

// As unpackPair, by shifts: LLVM would load the lower halves of a plain one singly.
#if CPU
vec2 unpackLanePair(Pair pair) {
    return uintBitsToFloat(uvec2(unpackUint2x32(pair << 32).y, unpackUint2x32(pair).y));
}
#else
vec2 unpackLanePair(Pair pair) { return pair; }
#endif

// The sum over the lanes, in all of them. lavapipe's subgroupAdd() goes lane by lane through
// memory.
float sumOfLanes(float own) {
    float lanes[16];
    [[unroll]] for (uint k = 0; k < 16; ++k) lanes[k] = k < kLanes ? subgroupBroadcast(own, k) : 0;
    [[unroll]] for (uint apart = 8; apart > 0; apart /= 2)
        [[unroll]] for (uint k = 0; k < apart; ++k) lanes[k] += lanes[k + apart];
    return lanes[0];
}

// This subgroup's first block, and this invocation's pair in it.
void startPlaces(out uint block, out uint pair) {
    uint i = gl_WorkGroupID.x * gl_NumSubgroups + gl_SubgroupID;
    block = kLanes > 0 ? uniformOf(i, kDigits) * kBlocksEach : 0;
    pair = i * kBlocksEach * (kBlockElements / 2) + gl_SubgroupInvocationID;
}
// Place e, and whether there is one.
bool isPlace(out Place place, uint block, uint pair, uint e, uint n) {
    place.block = block + e / kParts;
    place.part = e % kParts;
    place.pair = kLanes > 0 ? pair + e * kLanes : pairIndex(e);
    return kLanes > 0 || place.pair < (n + 1) / 2;
}

// For each place p of an array of n elements that is this invocation's:
//     EACH_PLACE(p, params.n) y.d[p.pair] = packPair(f(PAIR(x, p)));
// with readonly blocks x and pairs y.
#define EACH_PLACE(p, n)                                            \
    Place p;                                                        \
    uint p##Block, p##Pair;                                         \
    startPlaces(p##Block, p##Pair);                                 \
    [[unroll]] for (uint p##Each = 0; p##Each < kPlaces; ++p##Each) \
        if (isPlace(p, p##Block, p##Pair, p##Each, n))
#define PAIR(buffer, p)                                               \
    (kLanes > 0 ? unpackLanePair(lanePair(buffer.d[p.block], p.part)) \
                : unpackPair(BLOCK_PAIR(buffer, p)))
// For writing to blocks.
#define BLOCK_PAIR(buffer, p) \
    buffer.d[p.pair / (kBlockElements / 2)].pairs[p.pair % (kBlockElements / 2)]
