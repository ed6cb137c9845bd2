#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "conv/params.h"
#include "conv/winograd.glsl"
PARAMS(WinogradWeightsParams, 2)
BUFFER(0, readwrite, uint64_t, weight);    // [coarse, fine, 4, 4] in pairs along x
BUFFER(1, readwrite, uint64_t, matrices);  // nine [coarse, 4 fine], in pairs of px

// One invocation per coarse and fine channel. A pair holds both px: kernel columns 2a and 2a + 1.
uint place(uint matrix, uint py, uint i) { return (matrix * params.strideMatrix + 4 * i) / 2 + py; }

// G w = [w0, w0 + w1, w1], along both axes.
ENTRY(to_tiles) {
    uint i = linearIndex();
    if (i >= params.pairs) return;
    [[unroll]] for (uint py = 0; py < 2; ++py) {
        vec2 g[2][3];  // kernel row 2a + py; mx
        [[unroll]] for (uint a = 0; a < 2; ++a) {
            uint row = 8 * i + 2 * (2 * a + py);
            g[a][0] = unpackPair(weight.d[row]);
            g[a][2] = unpackPair(weight.d[row + 1]);
            g[a][1] = g[a][0] + g[a][2];
        }
        [[unroll]] for (uint mx = 0; mx < 3; ++mx) {
            matrices.d[place(mx, py, i)] = packPair(g[0][mx]);
            matrices.d[place(3 + mx, py, i)] = packPair(g[0][mx] + g[1][mx]);
            matrices.d[place(6 + mx, py, i)] = packPair(g[1][mx]);
        }
    }
}

// G^T s = [s0 + s1, s1 + s2], along both axes.
ENTRY(from_tiles) {
    uint i = linearIndex();
    if (i >= params.pairs) return;
    [[unroll]] for (uint py = 0; py < 2; ++py) {
        vec2 g[2][3];
        [[unroll]] for (uint mx = 0; mx < 3; ++mx) {
            vec2 middle = unpackPair(matrices.d[place(3 + mx, py, i)]);
            g[0][mx] = unpackPair(matrices.d[place(mx, py, i)]) + middle;
            g[1][mx] = middle + unpackPair(matrices.d[place(6 + mx, py, i)]);
        }
        [[unroll]] for (uint a = 0; a < 2; ++a) {
            uint row = 8 * i + 2 * (2 * a + py);
            weight.d[row] = packPair(g[a][0] + g[a][1]);
            weight.d[row + 1] = packPair(g[a][1] + g[a][2]);
        }
    }
}
