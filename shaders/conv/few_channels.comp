#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "conv/params.h"
// The transposed convolution 4x4 of stride 2 and padding 1, for images of few channels and drivers
// that run lanes as a CPU's vector. As a product with columns such a layer is bound by writing and
// reading the columns, 16 numbers for each channel and window; here they are never made. A lane has
// kRows windows by two, which are 2 kRows x 4 pixels, and reads kRows + 2 by 6 numbers of each
// feature map, in pairs; each weight is read by one lane and handed out (linalg/gemm.glsl says why).
PARAMS(FewChannelsParams, 4)
BUFFER(0, readonly, uint64_t, maps);     // [images, features, outHeight, outWidth] in pairs
BUFFER(1, readonly, uint64_t, weights);  // [features, channels, 4, 4] in pairs
BUFFER(2, writeonly, uint64_t, image);   // [images, channels, 2 outHeight, 2 outWidth] in pairs
BUFFER(3, readonly, float, bias);        // [channels]

layout(constant_id = 1) const uint kChannels = 4;  // of a workgroup; divides those of the image
layout(constant_id = 2) const uint kLanes = 8;     // of a subgroup, and of a workgroup
layout(constant_id = 3) const bool kBias = false;
layout(constant_id = 4) const uint kRows = 1;      // of windows; divides outHeight

const uint kLoads = (8 * kChannels + kLanes - 1) / kLanes;  // pairs of weights per lane and feature

// Pixel row 2 y + r sees windows y and y - 1 (r = 0), or y and y + 1 (r = 1); columns likewise.
// Place k of the kernel belongs to r = parityOf(k) and the window at distance windowOf(k).
uint parityOf(uint k) { return 1 - (k & 1); }
int windowOf(uint k) { return k == 0 ? 1 : k == 3 ? -1 : 0; }

// Workgroups: x blocks of windows, kRows by two, y parts of the channels, z images.
ENTRY(sum) {
    uint lane = gl_SubgroupInvocationID, block = gl_WorkGroupID.x * kLanes + lane;
    uint across = params.outWidth / 2, pairs = params.outHeight * across, blocks = pairs / kRows;
    uint at = min(block, blocks - 1);  // all lanes stay, for they hand out weights
    uint y = quotient(at, params.byPairs), x = remainder(at, y, params.byPairs);
    y *= kRows;
    bvec3 columnInside = bvec3(x > 0, true, x + 1 < across);
    uint first = gl_WorkGroupID.y * kChannels;
    uint from = gl_WorkGroupID.z * params.features * pairs + y * across + x;
    uint weightAt = first * 8;

    vec2 sum[kChannels][2 * kRows][2];  // row, window; columns of the window
    [[unroll]] for (uint c = 0; c < kChannels; ++c) {
        float start = kBias ? bias.d[first + c] : 0;
        [[unroll]] for (uint r = 0; r < 2 * kRows; ++r)
            [[unroll]] for (uint i = 0; i < 2; ++i) sum[c][r][i] = vec2(start);
    }
    for (uint f = 0; f < params.features; ++f) {
        float v[kRows + 2][6];
        [[unroll]] for (uint r = 0; r < kRows + 2; ++r)
            [[unroll]] for (uint k = 0; k < 3; ++k) {
                // Above the first row, positions wrap to large ones.
                bool inside = y + r - 1 < params.outHeight && columnInside[k];
                uint place = from + (r - 1) * across + k - 1;
                vec2 two = unpackPair(maps.d[inside ? place : from]);
                v[r][2 * k] = inside ? two.x : 0;
                v[r][2 * k + 1] = inside ? two.y : 0;
            }
        vec2 w[kLoads];
        [[unroll]] for (uint t = 0; t < kLoads; ++t)
            w[t] = unpackPair(weights.d[weightAt + min(t * kLanes + lane, 8 * kChannels - 1)]);
        [[unroll]] for (uint c = 0; c < kChannels; ++c)
            [[unroll]] for (uint ky = 0; ky < 4; ++ky)
                [[unroll]] for (uint kx = 0; kx < 4; ++kx) {
                    uint e = (c * 16 + ky * 4 + kx) / 2;
                    vec2 held = w[e / kLanes];
                    float weight = subgroupBroadcast(kx % 2 == 0 ? held.x : held.y, e % kLanes);
                    [[unroll]] for (uint r = 0; r < kRows; ++r)
                        [[unroll]] for (uint i = 0; i < 2; ++i)
                            sum[c][2 * r + parityOf(ky)][i][parityOf(kx)] +=
                                weight * v[1 + r + windowOf(ky)][2 + i + windowOf(kx)];
                }
        from += pairs;
        weightAt += params.channels * 8;
    }
    if (block >= blocks) return;
    [[unroll]] for (uint c = 0; c < kChannels; ++c) {
        uint plane = (gl_WorkGroupID.z * params.channels + first + c) * 4 * pairs;
        [[unroll]] for (uint r = 0; r < 2 * kRows; ++r)
            [[unroll]] for (uint i = 0; i < 2; ++i)
                image.d[plane + (2 * y + r) * params.outWidth + 2 * x + i] = packPair(sum[c][r][i]);
    }
}
