// Visibility buffer [H,W]: index = the nearest face at each pixel's centre, both sides drawn.
// Integer atomics, so that the order of faces does not matter and each face walks over the pixels
// of its own box. Two passes: first the greatest 1/depth (1/m), then the lowest face that has it.
// Of the variant for devices with 64-bit atomics, one pass over both in one number, with the same
// picture.
#version 460
// VARIANTS: plain, keys
#extension GL_GOOGLE_include_directive : require
#if KEYS
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#endif
#include "common/op.glsl"
#include "raster/params.h"
#include "raster/triangle.glsl"
PARAMS(VisibilityParams, 7)
BUFFER(0, readonly, ivec4, faces);     // [F] v0, v1, v2, unused
BUFFER(1, readonly, vec4, screen);     // [V] from project.comp
#if KEYS
// [H,W] above: bits of the greatest 1/depth; below: complement of the lowest face; 0: none
BUFFER(2, readwrite, uint64_t, keys);
#else
BUFFER(2, readwrite, uint, nearness);  // [H,W] bits of the greatest 1/depth, 0: none
#endif
BUFFER(3, readwrite, uint, index);     // [H,W] face; -1 (all bits set): none
BUFFER(4, readwrite, uint, large);     // [1+F] count and numbers of large faces, unordered
BUFFER(5, writeonly, float, mask);     // [H,W]
BUFFER(6, writeonly, vec4, surface);   // [H,W] perspective-correct barycentrics; depth (m)

// 1/depth at p where the face covers it (edges included), 0 elsewhere.
float inverseDepthAt(Triangle t, vec2 p) {
    vec3 e = edgeFunctions(t, p);
    float total = e.x + e.y + e.z;
    bool covers = total != 0 && (min(e.x, min(e.y, e.z)) >= 0 || max(e.x, max(e.y, e.z)) <= 0);
    return covers ? dot(e, t.inverseDepth) / total : 0;
}

void visit(Triangle t, uint face, int x, int y) {
    float inverse = inverseDepthAt(t, pixelCentre(x, y, params.width, params.height));
    if (!(inverse > 0)) return;
    uint at = uint(y) * params.width + uint(x), bits = floatBitsToUint(inverse);
#if KEYS
    atomicMax(keys.d[at], packUint2x32(uvec2(~face, bits)));
#else
    if (params.pass == 0)
        atomicMax(nearness.d[at], bits);
    else if (nearness.d[at] == bits)
        atomicMin(index.d[at], face);
#endif
}

bool before(vec4 a, vec4 b) {
    return a.x < b.x || a.x == b.x && (a.y < b.y || a.y == b.y && a.z < b.z);
}

// With the corners in an order of their own, so that faces in the same place have the same depths
// to the last bit, whichever way they are wound.
Triangle loadFace(uint face) {
    ivec4 v = faces.d[face];
    vec4 a = screen.d[v.x], b = screen.d[v.y], c = screen.d[v.z];
    vec4 first = before(b, a) ? b : a, second = before(b, a) ? a : b;
    vec4 third = before(c, second) ? second : c;
    second = before(c, second) ? c : second;
    bool swap = before(second, first);
    return makeTriangle(swap ? second : first, swap ? first : second, third, 0);
}

// One invocation per face.
ENTRY(small) {
    uint face = linearIndex();
    if (face >= params.faces) return;
    Triangle t = loadFace(face);
    PixelBox box = pixelBox(t, 0, params.width, params.height);
    if (box.count > params.largeBox) {
        if (params.pass == 0) large.d[1 + atomicAdd(large.d[0], 1)] = face;
        return;
    }
    int x = box.x0, y = box.y0;
    for (uint k = 0; k < box.count; ++k) {
        visit(t, face, x, y);
        ++x;
        if (x > box.x1) {
            x = box.x0;
            ++y;
        }
    }
}

// One workgroup per large face, over and over.
ENTRY(large) {
    uint count = large.d[0];
    for (uint i = gl_WorkGroupID.x; i < count; i += gl_NumWorkGroups.x) {
        uint face = faceInList(large.d[1 + i], params.faces);
        Triangle t = loadFace(face);
        PixelBox box = pixelBox(t, 0, params.width, params.height);
        uint columns = uint(box.x1 - box.x0 + 1);
        for (uint k = localIndex(); k < box.count; k += gl_WorkGroupSize.x)
            visit(t, face, box.x0 + int(k % columns), box.y0 + int(k / columns));
    }
}

ENTRY(resolve) {
    uint i = linearIndex();
    if (i >= params.width * params.height) return;
#if KEYS
    uint face = ~unpackUint2x32(keys.d[i]).x;
    index.d[i] = face;
#else
    uint face = index.d[i];
#endif
    bool covered = face != 0xffffffffu;
    mask.d[i] = covered ? 1 : 0;
    vec4 result = vec4(0);
    if (covered) {
        ivec4 v = faces.d[face];
        uint row = quotient(i, params.byWidth), column = remainder(i, row, params.byWidth);
        vec2 p = pixelCentre(int(column), int(row), params.width, params.height);
        result = surfaceAt(screen.d[v.x], screen.d[v.y], screen.d[v.z], p);
    }
    surface.d[i] = result;
}
