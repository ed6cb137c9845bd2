// y ~ (I + lambda L)^-1 x by Chebyshev iteration, L the combinatorial Laplacian: L x = degree x - sum
// over the neighbours (Nicolet, Jacobson, Jakob, Large Steps in Inverse Rendering of Geometry, ACM
// ToG 2021, precondition gradients with it). With D = 1 + lambda degree the spectrum of
// D^-1 (I + lambda L) lies in [1 / max D, 2]; a fixed number of iterations is a polynomial of it, so
// the result is a symmetric positive linear map of x, the same bits every time. The host gives each
// iteration's two coefficients (Saad, Iterative Methods for Sparse Linear Systems, algorithm 12.1).
// x, y [V,3].
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(SmoothSolveParams, 7)
BUFFER(0, readonly, vec3, x);              // [V,3]
BUFFER(1, readonly, int, neighbourBegin);  // [V+1]
BUFFER(2, readonly, int, neighbours);      // [2E]
BUFFER(3, readwrite, vec3, y);             // [V,3]
BUFFER(4, readwrite, vec3, residual);      // [V,3] D^-1 (x - (I + lambda L) y)
BUFFER(5, readonly, vec3, step);           // [V,3] what the iteration before added
BUFFER(6, writeonly, vec3, next);          // [V,3] what this one adds

ENTRY(start) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    float degree = float(neighbourBegin.d[v + 1] - neighbourBegin.d[v]);
    vec3 r = x.d[v] / (1 + params.lambda * degree), first = params.ofResidual * r;
    residual.d[v] = r;
    next.d[v] = first;
    y.d[v] = first;
}

ENTRY(iterate) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    int begin = neighbourBegin.d[v], end = neighbourBegin.d[v + 1];
    vec3 d = step.d[v], sum = vec3(0);
    for (int i = begin; i < end; ++i) sum += step.d[neighbours.d[i]];
    float diagonal = 1 + params.lambda * float(end - begin);
    vec3 r = residual.d[v] - (d - params.lambda / diagonal * sum);
    vec3 added = params.ofStep * d + params.ofResidual * r;
    residual.d[v] = r;
    next.d[v] = added;
    y.d[v] += added;
}
