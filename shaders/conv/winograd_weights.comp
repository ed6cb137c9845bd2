#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "conv/params.h"
#include "conv/winograd.glsl"
PARAMS(WinogradWeightsParams, 2)
BUFFER(0, readwrite, uint64_t, weight);    // [coarse, fine, 4, 4] in pairs along x
BUFFER(1, readwrite, uint64_t, matrices);  // [coarse, 4 fine] each, in pairs

// For the left side of a product: panels (linalg/gemm.glsl) of kWidth coarse channels or, kTurned,
// of kWidth rows of the finer image.
layout(constant_id = 2) const uint kWidth = 32;
layout(constant_id = 3) const bool kTurned = false;

// The points of weight's kernels of phases (py, 0) and (py, 1).
void pointsOf(uint weightIndex, uint py, out vec2 g[5][5]) {  // my, mx
    vec2 across[2][5];
    [[unroll]] for (uint a = 0; a < 2; ++a) {
        uint row = 8 * weightIndex + 2 * (2 * a + py);
        tapsToPoints(unpackPair(weight.d[row]), unpackPair(weight.d[row + 1]), across[a]);
    }
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        vec2 down[5];
        tapsToPoints(across[0][mx], across[1][mx], down);
        [[unroll]] for (uint my = 0; my < kPoints; ++my) g[my][mx] = down[my];
    }
}

void store(uint matrix, uint row, uint step, vec2 pair) {
    uint at = (row / kWidth * params.panelSteps + step) * kWidth + row % kWidth;
    matrices.d[(matrix * params.strideMatrix + at) / 2] = packPair(pair);
}

// G w. One invocation per fine channel and two coarse ones, which are neighbours in a panel; turned,
// per fine and coarse channel, px being neighbours. Invocations go step by step through a panel, so
// that it is a stream.
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
            [[unroll]] for (uint m = 0; m < kPoints * kPoints; ++m)
                [[unroll]] for (uint px = 0; px < 2; ++px)
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
        vec2 across[2][5];
        [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
            vec2 s[5];
            [[unroll]] for (uint my = 0; my < kPoints; ++my)
                s[my] = unpackPair(
                    matrices.d[((kPoints * my + mx) * params.strideMatrix + 4 * i) / 2 + py]);
            tapsFromPoints(s, across[0][mx], across[1][mx]);
        }
        [[unroll]] for (uint a = 0; a < 2; ++a) {
            uint row = 8 * (params.first * params.channels + i) + 2 * (2 * a + py);
            vec2 first, second;
            tapsFromPoints(across[a], first, second);
            weight.d[row] = packPair(first);
            weight.d[row + 1] = packPair(second);
        }
    }
}
