// region = a + b - 2 a b or a (1 - b): region C of Gomes et al., WACV 2022, section 3.3: where the
// rendered silhouette a and the real one b differ, a + b - 2 a b, or, one-sided, what is rendered
// but not real, a (1 - b); 0 within the face, faceSize pixels square around a centre. Pictures
// [H,W] in [0,1]. No gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "gan/params.h"
#include "gan/window.glsl"
PARAMS(MisalignedRegionParams, 4)
BUFFER(0, readonly, float, rendered);  // [H,W]
BUFFER(1, readonly, float, real);      // [H,W]
BUFFER(2, readonly, float, centres);   // [N,2] column, row in pixels
BUFFER(3, writeonly, float, region);   // [H,W]

// Workgroups: x columns, y rows.
ENTRY(forward) {
    uint column = gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex();
    uint row = gl_WorkGroupID.y, i = row * params.width + column;
    if (column >= params.width) return;
    ivec2 start = ivec2(windowStart(centres.d[2 * params.row], params.faceSize),
                        windowStart(centres.d[2 * params.row + 1], params.faceSize));
    ivec2 p = ivec2(column, row) - start;
    int size = int(params.faceSize);
    bool face = p.x >= 0 && p.y >= 0 && p.x < size && p.y < size;
    float a = rendered.d[i], b = real.d[i];
    region.d[i] = face ? 0 : params.oneSided != 0 ? a * (1 - b) : a + b - 2 * a * b;
}
