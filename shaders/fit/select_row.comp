// row = table[clamp(index[word] + offset, 0, rows - 1)]: this step's frame's row of a table, and
// those of its neighbours. No gradient: the optimiser updates rows itself (optim/adamw.comp).
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "fit/params.h"
PARAMS(SelectRowParams, 3)
BUFFER(0, readonly, float, table);  // [rows, columns]
BUFFER(1, readonly, int, index);    // [word + 1 or more]
BUFFER(2, writeonly, float, row);   // [columns]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.columns) return;
    int chosen = clamp(index.d[params.word] + params.offset, 0, int(params.rows) - 1);
    row.d[i] = table.d[uint(chosen) * params.columns + i];
}
