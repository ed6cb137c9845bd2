// y = the greatest value of the 3x3 pixels around each, those outside being 0: a dilation by a
// square. Pictures [N,H,W]. No gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "loss/params.h"
PARAMS(Dilate3Params, 2)
BUFFER(0, readonly, float, x);   // [N,H,W]
BUFFER(1, writeonly, float, y);  // [N,H,W]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.n) return;
    uint column = i % params.width, row = i / params.width % params.height;
    uint left = column > 0 ? i - 1 : i, right = column + 1 < params.width ? i + 1 : i;
    uint up = row > 0 ? params.width : 0, down = row + 1 < params.height ? params.width : 0;
    float most = max(x.d[i], max(x.d[left], x.d[right]));
    most = max(most, max(x.d[i - up], max(x.d[left - up], x.d[right - up])));
    most = max(most, max(x.d[i + down], max(x.d[left + down], x.d[right + down])));
    bool border = column == 0 || column + 1 == params.width || row == 0 || row + 1 == params.height;
    y.d[i] = border ? max(most, 0) : most;
}
