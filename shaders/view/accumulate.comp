// The mean of pictures of one scene, drawn one per replay through a camera that is shifted by parts
// of a pixel: supersampling over time, the accumulation buffer of Haeberli and Akeley (1990).
//     sum_n = sum_(n-1) + picture_n,  sum_0 = 0,    mean = floor(sum_n / n + 1/2)
// per byte of a pixel, whatever their order. Sums of bytes are whole numbers, which a float holds
// up to 2^24: the mean is that of the pictures, rounded once.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "view/params.h"
PARAMS(AccumulateParams, 4)
BUFFER(0, readonly, float, taken);    // [1] n, this picture counted in
BUFFER(1, readonly, uint, picture);   // [H,W] four bytes a pixel
BUFFER(2, readwrite, float, sums);    // [3,H,W] of the lower bytes, from the last replay
BUFFER(3, writeonly, uint, mean);     // [H,W] as the picture; the highest byte 255

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= params.pixels) return;
    float count = taken.d[0];
    uint word = picture.d[i], packed = 0xff000000u;
    for (uint c = 0; c < 3; ++c) {
        // Before the first picture the memory holds anything, NaN as well.
        float before = count > 1 ? sums.d[c * params.pixels + i] : 0;
        float sum = before + float(word >> 8 * c & 0xffu);
        sums.d[c * params.pixels + i] = sum;
        packed |= uint(floor(sum / count + 0.5)) << 8 * c;
    }
    mean.d[i] = packed;
}
