// loss = scale sum_l weight_l l^2 sum over cells of l x l pixels and over channels of rho(mean), with
// the cell's mean of counts (a - b), l = 1, 2, 4, 8, zeros beyond the border, and rho(d) = d^2 or, where
// epsilon > 0, sqrt(d^2 + epsilon^2) - epsilon (Charbonnier and others, ICIP 1994). Average pooling
// keeps the loss lowest where the pictures agree, and lets far parts be felt: with d_l the mean of
// the cell that a pixel lies in,
//     da = dloss scale counts sum_l weight_l rho'(d_l).
// a, b [H,W,C], counts [H,W]. One invocation per 8x8 block and channel.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "loss/params.h"
PARAMS(PyramidLossParams, 7)
BUFFER(0, readonly, float, a);           // [H,W,C]
BUFFER(1, readonly, float, b);           // [H,W,C]
BUFFER(2, readonly, float, counts);      // [H,W] how much a pixel counts
BUFFER(3, readonly, float, scale);       // [1]
BUFFER(4, writeonly, float, partial);    // [blocks C]
BUFFER(5, readonly, float, dLoss);       // [1]
BUFFER(6, writeonly, float, da);         // [H,W,C]

float rho(float d) {
    float e = params.epsilon;
    return e > 0 ? d * d / (sqrt(d * d + e * e) + e) : d * d;
}
float slope(float d) {
    float e = params.epsilon;
    return e > 0 ? d / sqrt(d * d + e * e) : 2 * d;
}

struct Block {
    uint x, y, channel;  // of its first pixel
};
Block blockOf(uint i) {
    uint block = i / params.channels, row = block / params.blocksAcross;
    return Block((block - row * params.blocksAcross) * 8, row * 8, i - block * params.channels);
}
uint pixelAt(Block k, uint x, uint y) { return (k.y + y) * params.width + k.x + x; }
uint elementAt(Block k, uint x, uint y) {
    return pixelAt(k, x, y) * params.channels + k.channel;
}
bool inside(Block k, uint x, uint y) {
    return k.x + x < params.width && k.y + y < params.height;
}
float differenceAt(Block k, uint x, uint y) {
    if (!inside(k, x, y)) return 0;
    uint at = elementAt(k, x, y);
    return counts.d[pixelAt(k, x, y)] * (a.d[at] - b.d[at]);
}

// Sums of the differences over the cells of 2 and 4 pixels a side, row by row, and over all.
struct Sums {
    float two[16], four[4], eight;
};
Sums sumsOf(Block k) {
    Sums s;
    s.eight = 0;
    [[unroll]] for (uint i = 0; i < 4; ++i) s.four[i] = 0;
    [[unroll]] for (uint y = 0; y < 4; ++y)
        [[unroll]] for (uint x = 0; x < 4; ++x) {
            float sum = differenceAt(k, 2 * x, 2 * y) + differenceAt(k, 2 * x + 1, 2 * y) +
                        differenceAt(k, 2 * x, 2 * y + 1) + differenceAt(k, 2 * x + 1, 2 * y + 1);
            s.two[y * 4 + x] = sum;
            s.four[y / 2 * 2 + x / 2] += sum;
            s.eight += sum;
        }
    return s;
}

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.blocks * params.channels) return;
    Block k = blockOf(i);
    Sums s = sumsOf(k);
    float sum = params.weight8 * 64 * rho(s.eight / 64);
    [[unroll]] for (uint c = 0; c < 4; ++c) sum += params.weight4 * 16 * rho(s.four[c] / 16);
    [[unroll]] for (uint c = 0; c < 16; ++c) sum += params.weight2 * 4 * rho(s.two[c] / 4);
    if (params.weight1 != 0)
        for (uint y = 0; y < 8; ++y)
            for (uint x = 0; x < 8; ++x) sum += params.weight1 * rho(differenceAt(k, x, y));
    partial.d[i] = scale.d[0] * sum;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.blocks * params.channels) return;
    Block k = blockOf(i);
    Sums s = sumsOf(k);
    float whole = dLoss.d[0] * scale.d[0], eight = params.weight8 * slope(s.eight / 64);
    [[unroll]] for (uint y = 0; y < 4; ++y)
        [[unroll]] for (uint x = 0; x < 4; ++x) {
            float common_ = eight + params.weight4 * slope(s.four[y / 2 * 2 + x / 2] / 16) +
                            params.weight2 * slope(s.two[y * 4 + x] / 4);
            [[unroll]] for (uint n = 0; n < 4; ++n) {
                uint u = 2 * x + n % 2, v = 2 * y + n / 2;
                if (!inside(k, u, v)) continue;
                da.d[elementAt(k, u, v)] =
                    whole * counts.d[pixelAt(k, u, v)] *
                    (common_ + params.weight1 * slope(differenceAt(k, u, v)));
            }
        }
}
