// Kernels that compute rows of a tensor, all of them or the tiles of rows that a list names
// (nn/rows.h). ROW_TILES(slot) declares the list, which is a buffer like any other; kernels take
// listedIndex() for linearIndex().
layout(constant_id = 20) const uint kTileInvocations = 0;  // of a tile of rows; 0: all rows

#define ROW_TILES(slot)                        \
    BUFFER(slot, readonly, uint, tiles);       \
    uint listedIndex() {                       \
        uint i = linearIndex();                \
        if (kTileInvocations == 0) return i;   \
        uint place = i / kTileInvocations;     \
        return tiles.d[place] * kTileInvocations + (i - place * kTileInvocations); \
    }
