// The passes of batch_norm_passes.comp, where the formulas are, for a CPU's whole vectors
// (common/blocks.glsl). A subgroup takes a chunk, kBlocksEach blocks of one channel of one image.
// Workgroups: x chunks, y channels, z images.
// y = f(weight (x - mean) / sqrt(variance + epsilon) + bias), [images, channels, pixels].
#version 460
// VARIANTS: cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(BatchNormBlocksParams, 10)
#include "common/blocks.glsl"
BUFFER(0, readonly, Block, x);            // [images, channels, pixels]
BUFFER(1, readonly, Block, dy);           // [images, channels, pixels]
BUFFER(2, writeonly, Pair, y);        // [images, channels, pixels]; backward: dx
BUFFER(3, writeonly, Pair, partial);  // [channels, images * chunks], see each entry
BUFFER(4, readonly, float, mean);         // [channels]
BUFFER(5, readonly, float, deviation);    // [channels], 1 / sqrt(variance + epsilon)
BUFFER(6, readonly, float, weight);       // [channels]
BUFFER(7, readonly, float, bias);         // [channels]
BUFFER(8, readonly, float, dweight);      // [channels]
BUFFER(9, readonly, float, dbias);        // [channels]

struct Chunk {
    uint channel, block;  // the same in all lanes
    uint pair;            // this invocation's first
    uint partial;
};
Chunk thisChunk() {
    uint at = gl_WorkGroupID.x * gl_NumSubgroups + gl_SubgroupID, chunks = params.chunks;
    uint image = gl_WorkGroupID.z, c = gl_WorkGroupID.y;
    uint i = (image * params.channels + c) * chunks + at;
    Chunk chunk;
    chunk.channel = uniformOf(c, 6);
    chunk.block = uniformOf(i, kDigits) * kBlocksEach;
    chunk.pair = i * kBlocksEach * (kBlockElements / 2) + gl_SubgroupInvocationID;
    chunk.partial = (c * gl_NumWorkGroups.z + image) * chunks + at;
    return chunk;
}

#define CHUNK_PAIR(buffer, chunk, e) \
    unpackLanePair(lanePair(buffer.d[chunk.block + (e) / kParts], (e) % kParts))

float sumOfLanes(vec2 v) { return sumOfLanes(v.x + v.y); }
void writePartial(Chunk chunk, vec2 sums) {
    if (gl_SubgroupInvocationID == 0) partial.d[chunk.partial] = packPair(sums);
}

vec2 rectified(vec2 v, vec2 sign, float slope) {
    return mix(slope * v, v, greaterThan(sign, vec2(0)));
}

// Of each chunk the sum, and the squares around its own mean (batch_norm.comp joins them).
ENTRY(sum_values) {
    Chunk chunk = thisChunk();
    vec2 v[kBlocksEach * 2], total = vec2(0), squares = vec2(0);
    [[unroll]] for (uint e = 0; e < kPlaces; ++e) {
        v[e] = CHUNK_PAIR(x, chunk, e);
        total += v[e];
    }
    float sum = sumOfLanes(total), middle = sum / kChunkElements;
    [[unroll]] for (uint e = 0; e < kPlaces; ++e) {
        vec2 d = v[e] - middle;
        squares += d * d;
    }
    writePartial(chunk, vec2(sum, sumOfLanes(squares)));
}

ENTRY(normalise) {
    Chunk chunk = thisChunk();
    uint c = chunk.channel;
    float slope = params.slope, middle = mean.d[c], scale = deviation.d[c] * weight.d[c];
    float shift = bias.d[c];
    [[unroll]] for (uint e = 0; e < kPlaces; ++e) {
        vec2 v = (CHUNK_PAIR(x, chunk, e) - middle) * scale + shift;
        y.d[chunk.pair + e * kLanes] = packPair(rectified(v, v, slope));
    }
}

// Of each chunk the sums of dy (before the leaky ReLU) and of it times the normalised x.
//
// gradients() has dx as well, which these do not enter where mean and deviation are not x's own.
ENTRY(sum_gradients) {
    Chunk chunk = thisChunk();
    uint c = chunk.channel;
    float middle = mean.d[c], scale = deviation.d[c], slope = params.slope;
    float w = weight.d[c], shift = bias.d[c];
    vec2 total = vec2(0), product = vec2(0);
    [[unroll]] for (uint e = 0; e < kPlaces; ++e) {
        vec2 normalised = (CHUNK_PAIR(x, chunk, e) - middle) * scale;
        vec2 g = rectified(CHUNK_PAIR(dy, chunk, e), normalised * w + shift, slope);
        total += g;
        product += g * normalised;
    }
    writePartial(chunk, vec2(sumOfLanes(total), sumOfLanes(product)));
}

ENTRY(gradients) {
    Chunk chunk = thisChunk();
    uint c = chunk.channel;
    float middle = mean.d[c], scale = deviation.d[c], slope = params.slope;
    float w = weight.d[c], shift = bias.d[c];
    vec2 total = vec2(0), product = vec2(0);
    [[unroll]] for (uint e = 0; e < kPlaces; ++e) {
        vec2 normalised = (CHUNK_PAIR(x, chunk, e) - middle) * scale;
        vec2 g = rectified(CHUNK_PAIR(dy, chunk, e), normalised * w + shift, slope);
        total += g;
        product += g * normalised;
        y.d[chunk.pair + e * kLanes] = packPair(w * scale * g);
    }
    writePartial(chunk, vec2(sumOfLanes(total), sumOfLanes(product)));
}

// Of x whose own mean and deviation are taken.
ENTRY(input_gradient) {
    Chunk chunk = thisChunk();
    uint c = chunk.channel;
    float middle = mean.d[c], scale = deviation.d[c], slope = params.slope;
    float w = weight.d[c], shift = bias.d[c], all = params.all;
    float meanG = dbias.d[c] * all, meanProduct = dweight.d[c] * all;
    [[unroll]] for (uint e = 0; e < kPlaces; ++e) {
        vec2 normalised = (CHUNK_PAIR(x, chunk, e) - middle) * scale;
        vec2 g = rectified(CHUNK_PAIR(dy, chunk, e), normalised * w + shift, slope);
        g -= meanG + normalised * meanProduct;
        y.d[chunk.pair + e * kLanes] = packPair(w * scale * g);
    }
}
