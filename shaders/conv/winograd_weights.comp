// Winograd's transforms of weights 4x4 of stride 2 and padding 1: G w, and of their gradients G^T s
// (conv/winograd.glsl has the algebra, the shapes and the source). Both phases px of a kernel's row
// are neighbours.
// Matrices u = G w [kPoints^2, rows, steps] of weights w [features, channels, taps, taps].
#version 460
// VARIANTS: plain, cpu
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/panels.h"
#include "conv/params.h"
#include "conv/winograd.glsl"
PARAMS(WinogradWeightsParams, 2)
BUFFER(0, readwrite, Pair, weight);    // [coarse, fine, 4, 4] in pairs along x
BUFFER(1, readwrite, Pair, matrices);  // [coarse, 4 fine] each, in pairs

// For the left side of a product: panels (common/panels.h) of kWidth coarse channels or, kTurned,
// of kWidth rows of the finer image.
layout(constant_id = 2) const uint kWidth = 32;
layout(constant_id = 3) const bool kTurned = false;

// The points of weight's kernels of phases (py, 0) and (py, 1).
void pointsOf(uint weightIndex, uint py, out vec2 g[5][5]) {  // my, mx
    vec2 taps[2][2];  // of both phases, by row and column
    [[unroll]] for (uint a = 0; a < 2; ++a)
        [[unroll]] for (uint b = 0; b < 2; ++b)
            taps[a][b] = unpackPair(weight.d[8 * weightIndex + 2 * (2 * a + py) + b]);
    [[unroll]] for (uint px = 0; px < 2; ++px) {
        float across[2][kMostPoints];
        [[unroll]] for (uint a = 0; a < 2; ++a)
            tapsToPoints(float[4](taps[a][0][px], taps[a][1][px], 0, 0), across[a]);
        [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
            float m[kMostPoints];
            tapsToPoints(float[4](across[0][mx], across[1][mx], 0, 0), m);
            [[unroll]] for (uint my = 0; my < kPoints; ++my) g[my][mx][px] = m[my];
        }
    }
}

void store(uint matrix, uint row, uint step, vec2 pair) {
    uint at = panelIndex(row, step, params.panelSteps, kWidth);
    matrices.d[(matrix * params.strideMatrix + at) / 2] = packPair(pair);
}

// G w. One invocation per fine channel and two coarse ones, which are neighbours in a panel;
// turned, per fine and coarse channel, px being neighbours. Invocations go step by step through a
// panel, so that it is a stream.
ENTRY(to_tiles) {
    uint i = linearIndex();
    if (i >= params.invocations) return;
    uint across = kWidth / (kTurned ? 4 : 2), panel = quotient(i / across, params.bySteps);
    uint step = remainder(i / across, panel, params.bySteps), within = panel * across + i % across;
    [[unroll]] for (uint py = 0; py < 2; ++py) {
        vec2 g[5][5];
        if (kTurned) {
            uint coarse = step, fine = params.first + within;
            if (fine >= params.channels) return;
            pointsOf(coarse * params.channels + fine, py, g);
            [[unroll]] for (uint m = 0; m < kPoints * kPoints; ++m)
                store(m, 4 * within + 2 * py, coarse, g[m / kPoints][m % kPoints]);
        } else {
            uint fine = step, coarse = params.first + 2 * within;
            if (coarse >= params.features) return;
            vec2 next[5][5];
            pointsOf(coarse * params.channels + fine, py, g);
            // An odd number's last has itself for a neighbour, in a row that nobody stores.
            pointsOf(min(coarse + 1, params.features - 1) * params.channels + fine, py, next);
            [[unroll]] for (uint m = 0; m < kPoints * kPoints; ++m) [[unroll]] for (uint px = 0;
                                                                                    px < 2; ++px)
                store(m, 2 * within, 4 * fine + 2 * py + px,
                      vec2(g[m / kPoints][m % kPoints][px], next[m / kPoints][m % kPoints][px]));
        }
    }
}

// G^T s of sums [coarse, 4 fine] that lie row by row. One invocation per coarse and fine channel.
ENTRY(from_tiles) {
    uint i = linearIndex();
    if (i >= params.invocations) return;
    [[unroll]] for (uint py = 0; py < 2; ++py) {
        vec2 sums[5][5];  // mx, my
        [[unroll]] for (uint m = 0; m < kPoints * kPoints; ++m)
            sums[m % kPoints][m / kPoints] =
                unpackPair(matrices.d[(m * params.strideMatrix + 4 * i) / 2 + py]);
        vec2 taps[2][2];  // of both phases, by row and column
        [[unroll]] for (uint px = 0; px < 2; ++px) {
            float across[2][kMostPoints];
            [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
                float down[kMostPoints], w[4];
                [[unroll]] for (uint my = 0; my < kPoints; ++my) down[my] = sums[mx][my][px];
                tapsFromPoints(down, w);
                [[unroll]] for (uint a = 0; a < 2; ++a) across[a][mx] = w[a];
            }
            [[unroll]] for (uint a = 0; a < 2; ++a) {
                float w[4];
                tapsFromPoints(across[a], w);
                [[unroll]] for (uint b = 0; b < 2; ++b) taps[a][b][px] = w[b];
            }
        }
        [[unroll]] for (uint a = 0; a < 2; ++a)
            [[unroll]] for (uint b = 0; b < 2; ++b) {
                uint row = 8 * (params.first * params.channels + i) + 2 * (2 * a + py);
                weight.d[row + b] = packPair(taps[a][b]);
            }
    }
}
