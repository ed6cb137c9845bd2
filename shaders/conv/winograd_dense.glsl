// Winograd's way for convolutions of stride 1, tiles of 4x4 results (see conv/winograd.glsl).
//
// Kernels 4x4 take the way of two results and taps twice. In one dimension, c[o] = sum over t < 4 of
// w[t] f[o + t]. Split results by their parity r, taps by their parity p: blocks of correlations
// g_p = (w[p], w[2 + p]) over f_q = f[q], f[2 + q], …:
//     c_0 = f_0 * g_0 + f_1 * g_1 = M0 + M1,  c_1 = f_1 * g_0 + f_0' * g_1 = M1 - M2,
//     M0 = (f_0 - f_1) * g_0,  M1 = f_1 * (g_0 + g_1),  M2 = (f_1 - f_0') * g_1,
// f_0' being f_0 one step on; and each M with its two taps by three products for two results. That
// is nine products for the sixteen of four results, in two dimensions 81 for 256, and all factors
// are 0, 1 and -1.
//
// Kernels 3x3 take six products for twelve, with the points 0, 1, -1, 2, -1/2 and infinity: 36 for
// 144. The error is twice that of adding up one by one.
//
// Matrices: kSide^2 of [channels, tiles].
layout(constant_id = 1) const uint kSide = 9;  // products in one dimension; 6: of kernels 3x3
const uint kPixels = kSide == 6 ? 6 : 7;       // that a tile sees in one dimension

vec3 threeOf(vec3 u) { return vec3(u.x - u.y, u.y, u.y - u.z); }

// B^T f
void toPoints(float f[7], out float u[9]) {
    if (kSide == 6) {
        u[0] = f[0] + f[4] - 2 * f[2] + 1.5 * (f[1] - f[3]);
        u[1] = f[1] - f[4] + 2.5 * f[2] + 0.5 * f[3];
        u[2] = f[1] + f[4] + 0.5 * f[2] - 2.5 * f[3];
        u[3] = f[4] - f[2] + 0.5 * (f[3] - f[1]);
        u[4] = f[4] - f[2] + 2 * (f[1] - f[3]);
        u[5] = f[1] + f[5] - 2 * f[3] + 1.5 * (f[2] - f[4]);
        return;
    }
    vec3 a = threeOf(vec3(f[0] - f[1], f[2] - f[3], f[4] - f[5]));
    vec3 b = threeOf(vec3(f[1], f[3], f[5]));
    vec3 c = threeOf(vec3(f[1] - f[2], f[3] - f[4], f[5] - f[6]));
    [[unroll]] for (uint i = 0; i < 3; ++i) {
        u[i] = a[i];
        u[3 + i] = b[i];
        u[6 + i] = c[i];
    }
}

// A^T m: four results.
vec4 fromProducts(float m[9]) {
    if (kSide == 6) {
        float sum = m[1] + m[2], difference = m[1] - m[2];
        return vec4(m[0] + sum + m[3] + m[4], difference + 2 * m[3] - 0.5 * m[4],
                    sum + 4 * m[3] + 0.25 * m[4], difference + 8 * m[3] - 0.125 * m[4] + m[5]);
    }
    vec2 a = vec2(m[0] + m[1], m[1] - m[2]), b = vec2(m[3] + m[4], m[4] - m[5]);
    vec2 c = vec2(m[6] + m[7], m[7] - m[8]);
    return vec4(a.x + b.x, b.x - c.x, a.y + b.y, b.y - c.y);
}

// A c of four results.
void toProducts(vec4 c, out float u[9]) {
    if (kSide == 6) {
        float even = c.x + c.z, odd = c.y + c.w;
        u[0] = c.x;
        u[1] = even + odd;
        u[2] = even - odd;
        u[3] = c.x + 2 * c.y + 4 * c.z + 8 * c.w;
        u[4] = c.x - 0.5 * c.y + 0.25 * c.z - 0.125 * c.w;
        u[5] = c.w;
        return;
    }
    vec2 parts[3] = vec2[3](c.xz, c.xz + c.yw, -c.yw);
    [[unroll]] for (uint k = 0; k < 3; ++k) {
        u[3 * k] = parts[k].x;
        u[3 * k + 1] = parts[k].x + parts[k].y;
        u[3 * k + 2] = -parts[k].y;
    }
}

// G w
void tapsToPoints(float w[4], out float u[9]) {
    if (kSide == 6) {
        float even = w[0] + w[2];
        u[0] = w[0];
        u[1] = 1.0 / 3 * (even + w[1]);
        u[2] = 1.0 / 3 * (even - w[1]);
        u[3] = 1.0 / 15 * w[0] + 2.0 / 15 * w[1] + 4.0 / 15 * w[2];
        u[4] = 8.0 / 15 * w[1] - 16.0 / 15 * w[0] - 4.0 / 15 * w[2];
        u[5] = w[2];
        return;
    }
    vec2 g[3] = vec2[3](vec2(w[0], w[2]), vec2(w[0] + w[1], w[2] + w[3]), vec2(w[1], w[3]));
    [[unroll]] for (uint k = 0; k < 3; ++k) {
        u[3 * k] = g[k].x;
        u[3 * k + 1] = g[k].x + g[k].y;
        u[3 * k + 2] = g[k].y;
    }
}

// G^T s; of a kernel 3x3 the last is nothing.
vec4 tapsFromPoints(float s[9]) {
    if (kSide == 6) {
        float sum = 1.0 / 3 * (s[1] + s[2]), difference = 1.0 / 3 * (s[1] - s[2]);
        return vec4(s[0] + sum + 1.0 / 15 * s[3] - 16.0 / 15 * s[4],
                    difference + 2.0 / 15 * s[3] + 8.0 / 15 * s[4],
                    s[5] + sum + 4.0 / 15 * (s[3] - s[4]), 0);
    }
    vec2 a = vec2(s[0] + s[1], s[1] + s[2]), b = vec2(s[3] + s[4], s[4] + s[5]);
    vec2 c = vec2(s[6] + s[7], s[7] + s[8]);
    return vec4(a.x + b.x, b.x + c.x, a.y + b.y, b.y + c.y);
}
