// visibility = the visibility map of Gomes et al., WACV 2022, section 3.2: the UV atlas
// [size,size], 1 in the texels of faces whose normal faces the camera, (c x (-a) > 0 for the cross
// product c and a corner a), 0 elsewhere. Texel centres at a half, edges included. No gradient.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "raster/params.h"
#include "raster/triangle.glsl"
PARAMS(VisibilityMapParams, 6)
BUFFER(0, readonly, ivec4, faces);      // [F] v0, v1, v2, unused
BUFFER(1, readonly, float, verts);      // [V,3] camera space, m
BUFFER(2, readonly, vec2, uvs);         // [T]
BUFFER(3, readonly, ivec4, facesUv);    // [F] t0, t1, t2, unused
BUFFER(4, readwrite, uint, visibility);  // [size,size] bits of 1.0 where drawn
BUFFER(5, readwrite, uint, large);      // [1+F] count and numbers of large faces, unordered

vec3 vertexAt(int i) { return vec3(verts.d[3 * i], verts.d[3 * i + 1], verts.d[3 * i + 2]); }

bool facesCamera(uint face) {
    ivec4 v = faces.d[face];
    vec3 a = vertexAt(v.x), b = vertexAt(v.y), c = vertexAt(v.z);
    return dot(cross(b - a, c - a), -a) > 0;
}

// A face of the atlas, in texels from its centre.
Triangle loadFace(uint face) {
    ivec4 t = facesUv.d[face];
    float size = float(params.size);
    vec4 a = vec4((uvs.d[t.x] - 0.5) * size, 1, 0);
    vec4 b = vec4((uvs.d[t.y] - 0.5) * size, 1, 0);
    vec4 c = vec4((uvs.d[t.z] - 0.5) * size, 1, 0);
    return makeTriangle(a, b, c, 0);
}

void visit(Triangle t, int x, int y) {
    vec3 e = edgeFunctions(t, pixelCentre(x, y, params.size, params.size));
    if (min(e.x, min(e.y, e.z)) >= 0 || max(e.x, max(e.y, e.z)) <= 0)
        atomicOr(visibility.d[uint(y) * params.size + uint(x)], floatBitsToUint(1.0));
}

// One invocation per face.
ENTRY(small) {
    uint face = linearIndex();
    if (face >= params.faces || !facesCamera(face)) return;
    Triangle t = loadFace(face);
    PixelBox box = pixelBox(t, 0, params.size, params.size);
    if (box.count > params.largeBox) {
        large.d[1 + atomicAdd(large.d[0], 1)] = face;
        return;
    }
    int x = box.x0, y = box.y0;
    for (uint k = 0; k < box.count; ++k) {
        visit(t, x, y);
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
        Triangle t = loadFace(faceInList(large.d[1 + i], params.faces));
        PixelBox box = pixelBox(t, 0, params.size, params.size);
        uint columns = uint(box.x1 - box.x0 + 1);
        for (uint k = localIndex(); k < box.count; k += gl_WorkGroupSize.x)
            visit(t, box.x0 + int(k % columns), box.y0 + int(k / columns));
    }
}
