// From forces on the points of a surface that are seen (surface_force.comp) to its vertices. A point
// X = sum b_i v_i is seen at p = (fx X.x / X.z + cx, fy X.y / X.z + cy), and so
//     dv_i = sum over the samples that see the face of b_i (dp/dX)^T force,
//     (dp/dX)^T f = (fx f.x, fy f.y, -(f.x (p.x - cx) + f.y (p.y - cy))) / X.z.
// dverts [V,3], force [height,width,2]. Each face gathers over the samples of its box in their order,
// each vertex over its corners: the same bits every time. Metres; forces per sample.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "raster/params.h"
#include "raster/triangle.glsl"
PARAMS(SurfaceGradientParams, 11)
BUFFER(0, readonly, ivec4, faces);          // [F]
BUFFER(1, readonly, vec4, screen);          // [V]
BUFFER(2, readonly, RasterCamera, camera);  // [1]
BUFFER(3, readonly, int, index);            // [height,width]
BUFFER(4, readonly, vec4, surface);         // [height,width] barycentrics, depth
BUFFER(5, readonly, vec2, force);           // [height,width]
BUFFER(6, readwrite, uint, large);          // [1+F] count and numbers of large faces, unordered
BUFFER(7, readwrite, vec3, dCorners);       // [3F,3]
BUFFER(8, readonly, int, cornerStart);      // [V+1] first corner of each vertex
BUFFER(9, readonly, int, corners);          // [3F] face*3 + corner, by vertex
BUFFER(10, writeonly, vec3, dverts);        // [V,3]

shared mat3 lanes[gl_WorkGroupSize.x];

PixelBox boxOf(uint face) {
    ivec4 v = faces.d[face];
    Triangle t = makeTriangle(screen.d[v.x], screen.d[v.y], screen.d[v.z], 0);
    return pixelBox(t, 0, params.width, params.height);
}

// What a sample adds to the face's three corners, a column each.
mat3 pullAt(uint face, int x, int y) {
    uint at = uint(y) * params.width + uint(x);
    if (index.d[at] != int(face)) return mat3(0);
    RasterCamera c = camera.d[0];
    vec4 seen = surface.d[at];
    vec2 f = force.d[at];
    vec3 d = vec3(f.x * c.fx, f.y * c.fy,
                  -(f.x * (float(x) + 0.5 - c.cx) + f.y * (float(y) + 0.5 - c.cy))) / seen.w;
    return mat3(seen.x * d, seen.y * d, seen.z * d);
}

void store(uint face, mat3 sum) {
    for (int k = 0; k < 3; ++k) dCorners.d[3 * face + k] = sum[k];
}

// One invocation per face.
ENTRY(small) {
    uint face = linearIndex();
    if (face >= params.faces) return;
    PixelBox box = boxOf(face);
    if (box.count > params.largeBox) {
        large.d[1 + atomicAdd(large.d[0], 1)] = face;
        return;
    }
    mat3 sum = mat3(0);
    int x = box.x0, y = box.y0;
    for (uint k = 0; k < box.count; ++k) {
        sum += pullAt(face, x, y);
        ++x;
        if (x > box.x1) {
            x = box.x0;
            ++y;
        }
    }
    store(face, sum);
}

// One workgroup per large face, over and over; its invocations' sums are added up as a tree.
ENTRY(large) {
    uint count = large.d[0], lane = localIndex();
    for (uint i = gl_WorkGroupID.x; i < count; i += gl_NumWorkGroups.x) {
        uint face = faceInList(large.d[1 + i], params.faces);
        PixelBox box = boxOf(face);
        uint columns = uint(box.x1 - box.x0 + 1);
        mat3 sum = mat3(0);
        for (uint k = lane; k < box.count; k += gl_WorkGroupSize.x)
            sum += pullAt(face, box.x0 + int(k % columns), box.y0 + int(k / columns));
        lanes[lane] = sum;
        barrier();
        for (uint half_ = gl_WorkGroupSize.x / 2; half_ > 0; half_ /= 2) {
            if (lane < half_) lanes[lane] += lanes[lane + half_];
            barrier();
        }
        if (lane == 0) store(face, lanes[0]);
        barrier();
    }
}

ENTRY(gather) {
    uint i = linearIndex();
    if (i >= params.vertices) return;
    vec3 sum = vec3(0);
    int end = cornerStart.d[i + 1];
    for (int k = cornerStart.d[i]; k < end; ++k) sum += dCorners.d[corners.d[k]];
    dverts.d[i] = sum;
}
