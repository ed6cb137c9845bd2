// The visibility buffer's pixels coloured from a texture: image = the texture at the UV of the
// face's barycentrics, bilinear, clamped at the border. The gradient to the texels is summed in
// 64-bit fixed point (two words of 32) whose unit follows from the largest upstream gradient: any
// order, same bits.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "raster/params.h"
PARAMS(TexturedRenderParams, 12)
BUFFER(0, readonly, int, index);        // [H,W] face, -1: none
BUFFER(1, readonly, vec4, surface);     // [H,W] barycentrics, depth
BUFFER(2, readonly, vec2, uvs);         // [T]
BUFFER(3, readonly, ivec4, facesUv);    // [F] t0, t1, t2, unused
BUFFER(4, readonly, float, tex);        // [Ht,Wt,3]
BUFFER(5, writeonly, float, image);     // [H,W,3]
BUFFER(6, readonly, float, dImage);     // [H,W,3]
BUFFER(7, readwrite, uint, largest);    // [1] bits of max |dImage|
BUFFER(8, readwrite, uint, sums);       // [2,sumStride] low and high words, [Ht,Wt,3] used
BUFFER(9, writeonly, float, dTexture);  // [Ht,Wt,3]
BUFFER(10, readonly, uvec4, sums4);     // the same memory as sums
BUFFER(11, writeonly, vec4, dTexture4);  // and as dTexture

// The four texels around a pixel's UV, clamped at the border, and their weights.
struct Footprint {
    uvec4 texel;
    vec4 weight;
};

Footprint footprint(uint pixel, uint face) {
    vec3 b = surface.d[pixel].xyz;
    ivec4 t = facesUv.d[face];
    vec2 uv = b.x * uvs.d[t.x] + b.y * uvs.d[t.y] + b.z * uvs.d[t.z];
    vec2 size = vec2(params.textureWidth, params.textureHeight);
    vec2 at = clamp(uv * size - 0.5, vec2(0), size - 1);
    vec2 low = floor(at), share = at - low;
    uvec2 first = uvec2(low), last = uvec2(min(low + 1, size - 1));
    Footprint f;
    f.texel = uvec4(first.y, first.y, last.y, last.y) * params.textureWidth +
              uvec4(first.x, last.x, first.x, last.x);
    f.weight = vec4((1 - share.y) * (1 - share.x), (1 - share.y) * share.x,
                    share.y * (1 - share.x), share.y * share.x);
    return f;
}

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.pixels) return;
    int face = index.d[i];
    vec3 colour = vec3(0);
    if (face >= 0) {
        Footprint f = footprint(i, uint(face));
        for (int k = 0; k < 4; ++k) {
            uint t = 3 * f.texel[k];
            colour += f.weight[k] * vec3(tex.d[t], tex.d[t + 1], tex.d[t + 2]);
        }
    }
    image.d[3 * i] = colour.x;
    image.d[3 * i + 1] = colour.y;
    image.d[3 * i + 2] = colour.z;
}

// A few invocations, each over many pixels, so that few meet in the atomic.
ENTRY(backward_range) {
    uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x, most = 0;
    for (uint i = linearIndex(); i < 3 * params.pixels; i += stride)
        if (index.d[i / 3] >= 0) most = max(most, floatBitsToUint(abs(dImage.d[i])));
    atomicMax(largest.d[0], most);
}

// Fixed point's unit is 2^-exponent: a contribution is at most 2^28 units, so most sums stay within
// the low word, which counts from the middle. Where all gradients are tiny the exponent stops at
// what a float can hold.
const uint kMiddle = 0x80000000u;
int fixedExponent() {
    int top = int(largest.d[0] >> 23) - 126;  // every |dImage| < 2^top
    return min(28 - top, 126);
}
float powerOfTwo(int exponent) { return uintBitsToFloat(uint(exponent + 127) << 23); }

void addFixed(uint at, float value, float unitsPerOne) {
    uint amount = uint(fma(abs(value), unitsPerOne, 0.5));
    if (amount == 0) return;
    uint old = atomicAdd(sums.d[at], value < 0 ? ~amount + 1 : amount);
    bool carry = value < 0 ? old < amount : old + amount < old;
    if (carry) atomicAdd(sums.d[params.sumStride + at], value < 0 ? 0xffffffffu : 1u);
}

ENTRY(backward_scatter) {
    uint i = linearIndex();
    if (i >= params.pixels) return;
    int face = index.d[i];
    vec3 d = vec3(dImage.d[3 * i], dImage.d[3 * i + 1], dImage.d[3 * i + 2]);
    if (face < 0 || d == vec3(0)) return;
    float unitsPerOne = powerOfTwo(fixedExponent());
    Footprint f = footprint(i, uint(face));
    for (int k = 0; k < 4; ++k)
        for (int c = 0; c < 3; ++c) addFixed(3 * f.texel[k] + c, f.weight[k] * d[c], unitsPerOne);
}

float fromFixed(uint low, uint high) {
    // An infinity or NaN that came from above must be seen below.
    if (largest.d[0] >= 0x7f800000u) return uintBitsToFloat(0x7fc00000u);
    float units = float(int(high)) * 4294967296.0 + float(int(low ^ kMiddle));
    return units * powerOfTwo(-fixedExponent());
}

// Four at once, and the last few one by one.
ENTRY(backward_convert) {
    uint i = linearIndex(), count = 3 * params.textureWidth * params.textureHeight;
    uint quads = count / 4;
    if (i < quads) {
        uvec4 low = sums4.d[i], high = sums4.d[params.sumStride / 4 + i];
        dTexture4.d[i] = vec4(fromFixed(low.x, high.x), fromFixed(low.y, high.y),
                              fromFixed(low.z, high.z), fromFixed(low.w, high.w));
    } else if (i < count - 3 * quads) {
        uint k = i + 3 * quads;
        dTexture.d[k] = fromFixed(sums.d[k], sums.d[params.sumStride + k]);
    }
}
