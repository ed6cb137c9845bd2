// Winograd's matrices of images and maps (conv/winograd.glsl). With TEXEL_LOADS = 1, for CPUs, four
// pixels are read at once; common/op.glsl says why.
PARAMS(WinogradParams, 4)
#if TEXEL_LOADS
TEXELS(0, image);                          // [images, channels, height, width]
#else
BUFFER(0, readonly, uint64_t, image);      // likewise, in pairs
#endif
BUFFER(1, readwrite, uint64_t, matrices);  // nine, in pairs of tiles or of rows
BUFFER(2, writeonly, uint64_t, result);    // as image
BUFFER(3, readonly, float, bias);          // [channels]

// How the matrices lie: row by row; or as the right side of a product (linalg/gemm.glsl) in panels
// of kWidth tiles, or of kWidth rows.
layout(constant_id = 1) const uint kLayout = 0;
layout(constant_id = 2) const uint kWidth = 32;  // a power of two
layout(constant_id = 3) const bool kBias = false;
const uint kRows = 0, kTilePanels = 1, kRowPanels = 2;

// Workgroups: x pairs of tiles side by side, y channels, z images.
uint pairInPiece() { return gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x; }
uint channel() { return gl_WorkGroupID.y; }
// Tile row and pair within it.
uvec2 tilePair(uint pair) {
    uint at = params.firstTile / 2 + pair, row = quotient(at, params.byRow);
    return uvec2(remainder(at, row, params.byRow), row);
}
uint plane() {
    return params.startImage +
           (gl_WorkGroupID.z * params.channels + channel()) * params.height * params.width;
}

// Of a matrix: the element of a row and a tile of the piece.
uint place(uint matrix, uint row, uint tile, uint rows) {
    uint tiles = params.images * params.tiles, at = row * tiles + tile;
    if (kLayout == kTilePanels) at = (tile / kWidth * rows + row) * kWidth + tile % kWidth;
    if (kLayout == kRowPanels) at = (row / kWidth * tiles + tile) * kWidth + row % kWidth;
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

// B^T f: per tile of 6x6 pixels and phase.
void fineToTiles() {
    uint pair = pairInPiece();
    if (pair >= params.tiles / 2) return;
    uvec2 at = tilePair(pair);
    uint start = plane(), tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    uint rows = 4 * params.channels;
    vec3 across[2][6][2];  // tile, row of pixels, px
    [[unroll]] for (uint r = 0; r < 6; ++r) {
        // Of 16 pixels from x on, the twelve in the middle.
        uint y = 4 * at.y + r - 1, x = 8 * at.x - 4;
        float v[16];
        [[unroll]] for (uint i = 0; i < 4; ++i) {
            vec4 four = fourPixels(start, y, x + 4 * i);
            [[unroll]] for (uint k = 0; k < 4; ++k) v[4 * i + k] = four[k];
        }
        [[unroll]] for (uint t = 0; t < 2; ++t)
            [[unroll]] for (uint px = 0; px < 2; ++px) {
                uint first = 3 + 4 * t + px;
                across[t][r][px] = vec3(v[first] - v[first + 2], v[first + 2],
                                        v[first + 2] - v[first + 4]);
            }
    }
    [[unroll]] for (uint py = 0; py < 2; ++py)
        [[unroll]] for (uint my = 0; my < 3; ++my) {
            vec3 u[2][2];  // tile, px
            [[unroll]] for (uint t = 0; t < 2; ++t)
                [[unroll]] for (uint px = 0; px < 2; ++px) {
                    vec3 middle = across[t][2 + py][px];
                    u[t][px] = my == 0   ? across[t][py][px] - middle
                               : my == 1 ? middle
                                         : middle - across[t][4 + py][px];
                }
            uint row = 4 * channel() + 2 * py;
            [[unroll]] for (uint mx = 0; mx < 3; ++mx)
                [[unroll]] for (uint i = 0; i < 2; ++i) {
                    vec2 v = kLayout == kRowPanels ? vec2(u[i][0][mx], u[i][1][mx])
                                                   : vec2(u[0][i][mx], u[1][i][mx]);
                    uint to = kLayout == kRowPanels ? place(3 * my + mx, row, tile + i, rows)
                                                    : place(3 * my + mx, row + i, tile, rows);
                    matrices.d[to / 2] = packPair(v);
                }
        }
}

// A c: per tile of 2x2 pixels.
void coarseToTiles() {
    uint pair = pairInPiece();
    if (pair >= params.tiles / 2) return;
    uvec2 at = tilePair(pair);
    uint tile = gl_WorkGroupID.z * params.tiles + 2 * pair;
    vec2 c[2][2];  // tile, row of pixels
    [[unroll]] for (uint r = 0; r < 2; ++r) {
        vec4 four = fourPixels(plane(), 2 * at.y + r, 4 * at.x);
        c[0][r] = four.xy;
        c[1][r] = four.zw;
    }
    [[unroll]] for (uint my = 0; my < 3; ++my) {
        vec2 row[2];
        [[unroll]] for (uint t = 0; t < 2; ++t)
            row[t] = my == 0 ? c[t][0] : my == 1 ? c[t][0] + c[t][1] : -c[t][1];
        vec2 left = vec2(row[0].x, row[1].x), right = vec2(row[0].y, row[1].y);
        [[unroll]] for (uint mx = 0; mx < 3; ++mx)
            matrices.d[place(3 * my + mx, channel(), tile, params.channels) / 2] =
                packPair(mx == 0 ? left : mx == 1 ? left + right : -right);
    }
}
