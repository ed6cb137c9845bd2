// Winograd's matrices of images and maps (conv/winograd.glsl). With TEXEL_LOADS = 1, for CPUs, four
// pixels are read at once; common/op.glsl says why.
PARAMS(WinogradParams, 5)
#if TEXEL_LOADS
TEXELS(0, image);                          // [images, channels, height, width]
#else
BUFFER(0, readonly, uint64_t, image);      // likewise, in pairs
#endif
BUFFER(1, readwrite, uint64_t, matrices);  // in pairs of tiles or of rows
BUFFER(2, writeonly, uint64_t, result);    // as image
BUFFER(3, readonly, float, bias);          // [channels]
BUFFER(4, writeonly, float, single);       // the matrices, one by one

// How the matrices lie: row by row, or in panels of a product (linalg/gemm.glsl), of kWidth tiles or
// of kWidth rows.
layout(constant_id = 2) const uint kLayout = 0;
layout(constant_id = 3) const uint kWidth = 32;  // a power of two
layout(constant_id = 4) const bool kBias = false;
const uint kRows = 0, kResultsPanels = 1, kRowPanels = 2;

// Channels count from this dispatch's first. Workgroups: x pairs of tiles side by side, y channels; or, in panels of rows, the other way round,
// so that neighbours write side by side. Of the finer image y is there twice, for py = 0 and 1. z
// images.
struct Work {
    uint pair, channel, py;
    bool any;
};
Work workOf(bool fine) {
    uint x = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint y = fine ? gl_WorkGroupID.y / 2 : gl_WorkGroupID.y, py = gl_WorkGroupID.y % 2;
    if (kLayout == kRowPanels) return Work(y, x, py, x < params.partChannels);
    return Work(x, y, py, x < params.tiles / 2);
}
// Tile row and pair within it.
uvec2 tilePair(uint pair) {
    uint at = params.firstTile / 2 + pair, row = quotient(at, params.byRow);
    return uvec2(remainder(at, row, params.byRow), row);
}
uint plane(uint channel) {
    return params.startImage + (gl_WorkGroupID.z * params.channels + params.firstChannel + channel) *
                                   params.height * params.width;
}

// Of a matrix: the element of a row and a tile of the piece.
uint place(uint matrix, uint row, uint tile, uint rows) {
    uint at = row * params.images * params.tiles + tile;
    if (kLayout == kResultsPanels) at = (tile / kWidth * rows + row) * kWidth + tile % kWidth;
    if (kLayout == kRowPanels)
        at = (row / kWidth * params.panelSteps + tile) * kWidth + row % kWidth;
    return matrix * params.strideMatrix + at;
}

// Four pixels from x on, a multiple of four; zeros outside, where positions wrap to large ones.
vec4 fourPixels(uint start, uint y, uint x) {
    bool inside = y < params.height && x < params.width;
    uint at = start + (inside ? y * params.width + x : 0);
#if TEXEL_LOADS
    vec4 v = texelFetch(image, int(at / 4));
#else
    vec4 v = vec4(unpackPair(image.d[at / 2]), unpackPair(image.d[at / 2 + 1]));
#endif
    return inside ? v : vec4(0);
}

// B f: per tile of (2 kResults + 2)^2 pixels and phase.
void fineToTiles() {
    Work work = workOf(true);
    if (!work.any) return;
    uint pair = work.pair, channel = work.channel, py = work.py;
    uvec2 at = tilePair(pair);
    uint start = plane(channel), tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    float across[2][2][5][7];  // tile, px, point, row of the phase
    [[unroll]] for (uint r = 0; r < kSeen; ++r) {
        // The pair's pixels, and four more at both ends, of which one is wanted.
        uint y = 2 * (kResults * at.y + r) + py - 1, x = 4 * kResults * at.x - 4;
        float v[24];
        [[unroll]] for (uint i = 0; i < kResults + 2; ++i) {
            vec4 four = fourPixels(start, y, x + 4 * i);
            [[unroll]] for (uint k = 0; k < 4; ++k) v[4 * i + k] = four[k];
        }
        [[unroll]] for (uint t = 0; t < 2; ++t)
            [[unroll]] for (uint px = 0; px < 2; ++px) {
                float f[7], m[9];
                [[unroll]] for (uint i = 0; i < kSeen; ++i)
                    f[i] = v[3 + 2 * (kResults * t + i) + px];
                toPoints(f, m);
                [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) across[t][px][mx][r] = m[mx];
            }
    }
    uint row = 4 * channel + 2 * py, rows = 4 * params.partChannels;
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float m[2][2][9];  // tile, px, point
        [[unroll]] for (uint t = 0; t < 2; ++t)
            [[unroll]] for (uint px = 0; px < 2; ++px) toPoints(across[t][px][mx], m[t][px]);
        [[unroll]] for (uint my = 0; my < kPoints; ++my)
            [[unroll]] for (uint i = 0; i < 2; ++i) {
                uint matrix = kPoints * my + mx;
                if (kLayout == kRowPanels)
                    matrices.d[place(matrix, row, tile + i, rows) / 2] =
                        packPair(vec2(m[i][0][my], m[i][1][my]));
                else
                    matrices.d[place(matrix, row + i, tile, rows) / 2] =
                        packPair(vec2(m[0][i][my], m[1][i][my]));
            }
    }
}

// A c: per tile of kResults^2 pixels.
void coarseToTiles() {
    Work work = workOf(false);
    if (!work.any) return;
    uint pair = work.pair, channel = work.channel;
    uvec2 at = tilePair(pair);
    uint tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    float across[2][5][4];  // tile, point, row
    [[unroll]] for (uint r = 0; r < kResults; ++r) {
        float v[8];
        [[unroll]] for (uint i = 0; i < kResults / 2; ++i) {
            vec4 four = fourPixels(plane(channel), kResults * at.y + r, 2 * kResults * at.x + 4 * i);
            [[unroll]] for (uint k = 0; k < 4; ++k) v[4 * i + k] = four[k];
        }
        [[unroll]] for (uint t = 0; t < 2; ++t) {
            float c[4], m[9];
            [[unroll]] for (uint i = 0; i < kResults; ++i) c[i] = v[kResults * t + i];
            toProducts(c, m);
            [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) across[t][mx][r] = m[mx];
        }
    }
    [[unroll]] for (uint mx = 0; mx < kPoints; ++mx) {
        float m[2][9];
        [[unroll]] for (uint t = 0; t < 2; ++t) toProducts(across[t][mx], m[t]);
        [[unroll]] for (uint my = 0; my < kPoints; ++my) {
            uint matrix = kPoints * my + mx;
            if (kLayout == kRowPanels) {
                [[unroll]] for (uint t = 0; t < 2; ++t)
                    single.d[place(matrix, channel, tile + t, params.partChannels)] = m[t][my];
            } else {
                matrices.d[place(matrix, channel, tile, params.partChannels) / 2] =
                    packPair(vec2(m[0][my], m[1][my]));
            }
        }
    }
}
