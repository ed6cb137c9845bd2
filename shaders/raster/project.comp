// The pinhole camera, u = fx x / z + cx, v = fy y / z + cy, in pixels relative to the picture's
// centre, where floats are finest (x right, y down, z forward, m). Vertices at z <= kNear get
// 1/depth 0. Backward: the gradients of a vertex's corners, gathered in order, through
//     dx = fx du / z,    dy = fy dv / z,    dz = -(dx x + dy y) / z.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "raster/params.h"
#include "raster/triangle.glsl"
PARAMS(ProjectParams, 7)
BUFFER(0, readonly, float, verts);          // [V,3] camera space, m
BUFFER(1, readonly, RasterCamera, camera);  // [1]
BUFFER(2, writeonly, vec4, screen);  // [V] pixels from the centre, 1/depth (0: too near), unused
BUFFER(3, readonly, int, cornerStart);  // [V+1] first corner of each vertex
BUFFER(4, readonly, int, corners);      // [3F] face*3 + corner, by vertex
BUFFER(5, readonly, vec2, dCorners);    // [3F] dL/dposition of a face's corner, per pixel
BUFFER(6, writeonly, float, dverts);    // [V,3]

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.vertices) return;
    RasterCamera c = camera.d[0];
    vec3 v = vec3(verts.d[3 * i], verts.d[3 * i + 1], verts.d[3 * i + 2]);
    bool before = v.z > kNear;
    float inverse = 1 / (before ? v.z : 1.0);
    vec2 position = vec2(fma(c.fx, v.x / (before ? v.z : 1.0), c.cx - params.centreX),
                         fma(c.fy, v.y / (before ? v.z : 1.0), c.cy - params.centreY));
    screen.d[i] = vec4(position, before ? inverse : 0.0, 0);
}

// Gathers the corners of each vertex and goes through the projection.
ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.vertices) return;
    vec2 sum = vec2(0);
    int end = cornerStart.d[i + 1];
    for (int k = cornerStart.d[i]; k < end; ++k) sum += dCorners.d[corners.d[k]];
    RasterCamera c = camera.d[0];
    vec3 v = vec3(verts.d[3 * i], verts.d[3 * i + 1], verts.d[3 * i + 2]);
    bool before = v.z > kNear;
    float inverse = 1 / (before ? v.z : 1.0);
    vec2 d = before ? sum * vec2(c.fx, c.fy) * inverse : vec2(0);
    dverts.d[3 * i] = d.x;
    dverts.d[3 * i + 1] = d.y;
    dverts.d[3 * i + 2] = before ? -(d.x * v.x + d.y * v.y) * inverse : 0.0;
}
