#version 460
// The sums of masked_l1_loss.comp for a CPU's whole vectors (common/blocks.glsl): three channels.
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "loss/params.h"
PARAMS(MaskedL1LossParams, 4)
#include "common/blocks.glsl"
// The colours of a block of the mask's pixels.
struct Colours {
    uint64_t pairs[3 * kBlockElements / 2];
};
BUFFER(0, readonly, Colours, predicted);  // [n,3], in pairs
BUFFER(1, readonly, Colours, target);     // [n,3]
BUFFER(2, readonly, Block, mask);         // [n]
BUFFER(3, writeonly, uint64_t, partial);  // [partials] differences, mask

// As lanePair(): the first, second or third pair of two pixels' colours.
vec2 colours(Colours block, uint part, uint which) {
    uint lane = gl_SubgroupInvocationID, first = 3 * part * kLanes + which;
    uint64_t pair = block.pairs[first];
    [[unroll]] for (uint k = 1; k < kLanes; ++k)
        pair = lane >= k ? block.pairs[first + 3 * k] : pair;
    return unpackLanePair(pair);
}
vec2 difference(Colours a, Colours b, uint part, uint which) {
    return abs(colours(a, part, which) - colours(b, part, which));
}

// A subgroup takes kMaskBlocks blocks of the mask.
ENTRY(sums) {
    uint i = gl_WorkGroupID.x * gl_NumSubgroups + gl_SubgroupID;
    uint first = uniformOf(i, kDigits) * kMaskBlocks;
    vec2 sum = vec2(0);
    [[unroll]] for (uint e = 0; e < kMaskBlocks * kParts; ++e) {
        uint block = first + e / kParts, part = e % kParts;
        vec2 m = unpackLanePair(lanePair(mask.d[block], part));
        vec2 a = difference(predicted.d[block], target.d[block], part, 0);
        vec2 b = difference(predicted.d[block], target.d[block], part, 1);
        vec2 c = difference(predicted.d[block], target.d[block], part, 2);
        vec2 both = vec2(a.x + a.y + b.x, b.y + c.x + c.y);
        // What the mask leaves out may be anything, a NaN too.
        both = mix(m * both, vec2(0), equal(m, vec2(0)));
        sum += vec2(both.x + both.y, m.x + m.y);
    }
    sum = vec2(sumOfLanes(sum.x), sumOfLanes(sum.y));
    if (gl_SubgroupInvocationID == 0) partial.d[i] = packPair(sum);
}
