#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "raster/params.h"
#include "raster/triangle.glsl"
// Soft silhouette: I(p) = 1 - exp(S), S = sum over faces of ln(1 - D) = -softplus(x),
// D = sigmoid(x), x = +-d^2 / sigma. S is summed in fixed point, so the order of faces does not
// matter and each face walks over the pixels of its own box: no lists, no limit.
// After S. Liu et al., Soft Rasterizer, ICCV 2019.
PARAMS(SoftSilhouetteParams, 10)
BUFFER(0, readonly, ivec4, faces);          // [F] v0, v1, v2, unused
BUFFER(1, readonly, vec4, screen);          // [V] from project.comp
BUFFER(2, readonly, RasterCamera, camera);  // [1]
BUFFER(3, readwrite, uint, sum);            // [2,H,W] -S in units of 2^-24: low, high words
BUFFER(4, readwrite, uint, large);          // [1+F] count and numbers of large faces, unordered
BUFFER(5, writeonly, float, silhouette);    // [H,W]
BUFFER(6, readwrite, float, transmittance);  // [H,W] exp(S)
BUFFER(7, readonly, float, dSilhouette);    // [H,W]
BUFFER(8, readwrite, float, weight);        // [H,W] dL/dI exp(S)
BUFFER(9, writeonly, vec2, dCorners);       // [3F]

shared vec2 partial[3 * gl_WorkGroupSize.x];

struct SoftFace {
    Triangle t;
    PixelBox box;
    vec2 ab, bc, ca;
    vec3 inverseLength2;  // of the edges; 0 where an edge has no length
    float side;           // 1 or -1: the sign of its area
    float blur2;          // pixels^2
    float scale;          // x = +-scale * d^2 (d in pixels)
};

SoftFace loadFace(uint face) {
    RasterCamera c = camera.d[0];
    float ndcPerPixel = 2 / float(min(params.width, params.height));
    float ndc2 = ndcPerPixel * ndcPerPixel;
    ivec4 v = faces.d[face];
    SoftFace f;
    f.t = makeTriangle(screen.d[v.x], screen.d[v.y], screen.d[v.z], 1e-8 / ndc2);
    f.blur2 = c.blurRadius / ndc2;
    f.scale = ndc2 / c.sigma;
    f.box = pixelBox(f.t, sqrt(f.blur2), params.width, params.height);
    f.ab = f.t.b - f.t.a;
    f.bc = f.t.c - f.t.b;
    f.ca = f.t.a - f.t.c;
    vec3 length2 = vec3(dot(f.ab, f.ab), dot(f.bc, f.bc), dot(f.ca, f.ca));
    f.inverseLength2 = vec3(length2.x > 0 ? 1 / length2.x : 0, length2.y > 0 ? 1 / length2.y : 0,
                            length2.z > 0 ? 1 / length2.z : 0);
    f.side = f.t.doubleArea < 0 ? -1.0 : 1.0;
    return f;
}

// The nearest point of the boundary, and what follows from it.
struct Nearest {
    vec2 offset;   // from the pixel to it
    float along;   // where it lies on its edge, 0 to 1
    int edge;      // 0: ab, 1: bc, 2: ca
    float x;       // +-d^2 / sigma, positive inside
    bool counts;   // inside, or within the blur radius
};

vec2 nearestOnEdge(vec2 from, vec2 edge, float inverseLength2, out float along) {
    along = clamp(-dot(from, edge) * inverseLength2, 0.0, 1.0);
    return vec2(fma(along, edge.x, from.x), fma(along, edge.y, from.y));
}

Nearest nearest(SoftFace f, vec2 p) {
    vec2 a = f.t.a - p, b = f.t.b - p, c = f.t.c - p;
    vec3 along;
    vec2 offset0 = nearestOnEdge(a, f.ab, f.inverseLength2.x, along.x);
    vec2 offset1 = nearestOnEdge(b, f.bc, f.inverseLength2.y, along.y);
    vec2 offset2 = nearestOnEdge(c, f.ca, f.inverseLength2.z, along.z);
    vec3 d2 = vec3(dot(offset0, offset0), dot(offset1, offset1), dot(offset2, offset2));
    Nearest n;
    n.edge = 0;
    n.offset = offset0;
    n.along = along.x;
    float least = d2.x;
    if (d2.y < least) {
        n.edge = 1;
        n.offset = offset1;
        n.along = along.y;
        least = d2.y;
    }
    if (d2.z < least) {
        n.edge = 2;
        n.offset = offset2;
        n.along = along.z;
        least = d2.z;
    }
    vec3 areas = f.side * vec3(a.x * b.y - a.y * b.x, b.x * c.y - b.y * c.x,
                               c.x * a.y - c.y * a.x);
    bool inside = min(areas.x, min(areas.y, areas.z)) > 0;
    n.counts = inside || least < f.blur2;
    n.x = (inside ? f.scale : -f.scale) * least;
    return n;
}

// ln(1 + e) for e in [0, 1], to float's precision: drivers' log() is only good to 2^-21 near 1.
float log1p01(float e) {
    float z = e / (2 + e), z2 = z * z;
    return 2 * z *
           (1 + z2 * (1.0 / 3 + z2 * (1.0 / 5 + z2 * (1.0 / 7 + z2 * (1.0 / 9 + z2 * (1.0 / 11 +
                z2 * (1.0 / 13)))))));
}

const float kUnit = 16777216.0;  // 2^24: what a face adds is rounded to 6e-8

// Adds softplus(x) = -ln(1 - D) to a pixel.
void accumulate(SoftFace f, int x, int y) {
    Nearest n = nearest(f, pixelCentre(x, y, params.width, params.height));
    if (!n.counts) return;
    // One face of 64 makes exp(S) vanish, so more is not needed; the high word is for the pixels
    // where very many faces meet.
    float value = min(max(n.x, 0.0) + log1p01(exp(-abs(n.x))), 64.0);
    uint amount = uint(fma(value, kUnit, 0.5));
    uint at = uint(y) * params.width + uint(x);
    uint old = atomicAdd(sum.d[at], amount);
    if (old + amount < old) atomicAdd(sum.d[params.width * params.height + at], 1);
}

// One invocation per face.
ENTRY(forward_small) {
    uint face = linearIndex();
    if (face >= params.faces) return;
    SoftFace f = loadFace(face);
    if (f.box.count > params.largeBox) {
        large.d[1 + atomicAdd(large.d[0], 1)] = face;
        return;
    }
    int x = f.box.x0, y = f.box.y0;
    for (uint k = 0; k < f.box.count; ++k) {
        accumulate(f, x, y);
        ++x;
        if (x > f.box.x1) {
            x = f.box.x0;
            ++y;
        }
    }
}

// One workgroup per large face, over and over.
ENTRY(forward_large) {
    uint count = large.d[0];
    for (uint i = gl_WorkGroupID.x; i < count; i += gl_NumWorkGroups.x) {
        SoftFace f = loadFace(faceInList(large.d[1 + i], params.faces));
        uint columns = uint(f.box.x1 - f.box.x0 + 1);
        for (uint k = localIndex(); k < f.box.count; k += gl_WorkGroupSize.x)
            accumulate(f, f.box.x0 + int(k % columns), f.box.y0 + int(k / columns));
    }
}

ENTRY(resolve) {
    uint i = linearIndex();
    if (i >= params.width * params.height) return;
    uint pixels = params.width * params.height;
    float minusS = float(sum.d[pixels + i]) * 256 + float(sum.d[i]) / kUnit;
    float through = minusS < 60 ? exp(-minusS) : 0.0;
    transmittance.d[i] = through;
    silhouette.d[i] = 1 - through;
}

// dL/dx_j(p) = dL/dI(p) exp(S(p)) D_j(p): the part that all faces share.
ENTRY(weigh) {
    uint i = linearIndex();
    if (i >= params.width * params.height) return;
    weight.d[i] = dSilhouette.d[i] * transmittance.d[i];
}

struct CornerGradients {
    vec2 a, b, c;
};

// x = +-scale |offset|^2, and moving an end of the edge moves the nearest point by its share; that
// the point also slides along the edge does not matter, for the offset is at right angles to it
// (or it is clamped to an end).
void gather(SoftFace f, int x, int y, inout CornerGradients g) {
    Nearest n = nearest(f, pixelCentre(x, y, params.width, params.height));
    float e = exp(-abs(n.x));
    float d = (n.x > 0 ? 1.0 : e) / (1 + e);
    float dx = n.counts ? weight.d[uint(y) * params.width + uint(x)] * d : 0.0;
    vec2 dOffset = (n.x > 0 ? 2.0 : -2.0) * f.scale * dx * n.offset;
    float begin = 1 - n.along, end = n.along;
    g.a += (n.edge == 0 ? begin : n.edge == 2 ? end : 0.0) * dOffset;
    g.b += (n.edge == 1 ? begin : n.edge == 0 ? end : 0.0) * dOffset;
    g.c += (n.edge == 2 ? begin : n.edge == 1 ? end : 0.0) * dOffset;
}

ENTRY(backward_small) {
    uint face = linearIndex();
    if (face >= params.faces) return;
    SoftFace f = loadFace(face);
    if (f.box.count > params.largeBox) {
        large.d[1 + atomicAdd(large.d[0], 1)] = face;
        return;
    }
    CornerGradients g = CornerGradients(vec2(0), vec2(0), vec2(0));
    int x = f.box.x0, y = f.box.y0;
    for (uint k = 0; k < f.box.count; ++k) {
        gather(f, x, y, g);
        ++x;
        if (x > f.box.x1) {
            x = f.box.x0;
            ++y;
        }
    }
    dCorners.d[3 * face] = g.a;
    dCorners.d[3 * face + 1] = g.b;
    dCorners.d[3 * face + 2] = g.c;
}

ENTRY(backward_large) {
    uint count = large.d[0], lane = localIndex(), lanes = gl_WorkGroupSize.x;
    for (uint i = gl_WorkGroupID.x; i < count; i += gl_NumWorkGroups.x) {
        uint face = faceInList(large.d[1 + i], params.faces);
        SoftFace f = loadFace(face);
        uint columns = uint(f.box.x1 - f.box.x0 + 1);
        CornerGradients g = CornerGradients(vec2(0), vec2(0), vec2(0));
        for (uint k = lane; k < f.box.count; k += lanes)
            gather(f, f.box.x0 + int(k % columns), f.box.y0 + int(k / columns), g);
        partial[3 * lane] = g.a;
        partial[3 * lane + 1] = g.b;
        partial[3 * lane + 2] = g.c;
        barrier();
        // Three lanes add up the others' in their order: the same bits whichever workgroup it is.
        if (lane < 3) {
            vec2 total = vec2(0);
            for (uint k = 0; k < lanes; ++k) total += partial[3 * k + lane];
            dCorners.d[3 * face + lane] = total;
        }
        barrier();
    }
}
