// Winograd's way for convolutions 4x4, stride 2, padding 1, between a finer image and a coarser one
// of half its size (Winograd, Arithmetic Complexity of Computations, 1980; Lavin and Gray, Fast
// Algorithms for Convolutional Neural Networks, 2016).
//
// In one dimension, with f[-1] = 0 in front: c[o] = sum over t < 4 of w[t] f[2o - 1 + t]. Split by
// the parity p of t, that is the sum of two correlations with two taps g_p = (w[p], w[2 + p]) over
// u_p[i] = f[2i + p - 1]. As products of polynomials, kTile neighbouring results take one
// multiplication for each of kTile + 1 points, where the polynomials are known:
//     c = A^T [(G g) (B^T u)],
// three multiplications for two results with the points 0, 1 and infinity, five for four with 0, 1,
// -2, -1/2 and infinity. In two dimensions that is 9 or 25 per tile, for 16 or 64. The channels and
// phases are summed before the results are put together, so that each of the products is a product
// of matrices over all tiles. The gradients are its transposes: f = B [U^T (A c)], U = G w, and
// w = G^T [(A c) (B^T f)^T].
//
// With three points all factors are 0, 1 and -1: what is lost in precision is a bit or so. The five
// are those of the least error (Barabasz and others, Error Analysis and Improving the Accuracy of
// Winograd Convolution for Deep Neural Networks, 2020): twice that of adding up one by one.
//
// Matrices, kPoints^2 of them: [4 fine channels, tiles] of the finer image, row
// 4 channel + 2 py + px; [coarse channels, tiles]; weights [coarse channels, 4 fine channels].
layout(constant_id = 1) const uint kTile = 2;  // results of a tile in one dimension: 2 or 4
const uint kPoints = kTile + 1;

// B^T u
void toPoints(float u[5], out float m[5]) {
    if (kTile == 2) {
        m = float[5](u[0] - u[1], u[1], u[1] - u[2], 0, 0);
    } else {
        m[0] = u[0] - u[3] + 1.5 * (u[1] - u[2]);
        m[1] = u[1] + u[3] + 2.5 * u[2];
        m[2] = u[3] - 0.5 * (u[1] + u[2]);
        m[3] = u[2] + u[3] - 2 * u[1];
        m[4] = u[4] - u[1] + 1.5 * (u[3] - u[2]);
    }
}

// B m
void fromPoints(float m[5], out float u[5]) {
    if (kTile == 2) {
        u = float[5](m[0], m[1] + m[2] - m[0], -m[2], 0, 0);
    } else {
        u[0] = m[0];
        u[1] = 1.5 * m[0] + m[1] - 0.5 * m[2] - 2 * m[3] - m[4];
        u[2] = 2.5 * m[1] - 0.5 * m[2] + m[3] - 1.5 * (m[0] + m[4]);
        u[3] = m[1] + m[2] + m[3] - m[0] + 1.5 * m[4];
        u[4] = m[4];
    }
}

// A^T m
void fromProducts(float m[5], out float c[4]) {
    if (kTile == 2) {
        c = float[4](m[0] + m[1], m[1] - m[2], 0, 0);
    } else {
        c[0] = m[0] + m[1] + m[2] + m[3];
        c[1] = m[1] - 2 * m[2] - 0.5 * m[3];
        c[2] = m[1] + 4 * m[2] + 0.25 * m[3];
        c[3] = m[1] - 8 * m[2] - 0.125 * m[3] + m[4];
    }
}

// A c
void toProducts(float c[4], out float m[5]) {
    if (kTile == 2) {
        m = float[5](c[0], c[0] + c[1], -c[1], 0, 0);
    } else {
        m[0] = c[0];
        m[1] = c[0] + c[1] + c[2] + c[3];
        m[2] = c[0] - 2 * c[1] + 4 * c[2] - 8 * c[3];
        m[3] = c[0] - 0.5 * c[1] + 0.25 * c[2] - 0.125 * c[3];
        m[4] = c[3];
    }
}

// G w, of two kernels
void tapsToPoints(vec2 first, vec2 second, out vec2 g[5]) {
    if (kTile == 2) {
        g = vec2[5](first, first + second, second, vec2(0), vec2(0));
    } else {
        g[0] = first;
        g[1] = 2.0 / 9 * (first + second);
        g[2] = 2.0 / 9 * second - 1.0 / 9 * first;
        g[3] = 8.0 / 9 * first - 4.0 / 9 * second;
        g[4] = second;
    }
}

// G^T s
void tapsFromPoints(vec2 s[5], out vec2 first, out vec2 second) {
    if (kTile == 2) {
        first = s[0] + s[1];
        second = s[1] + s[2];
    } else {
        first = s[0] + 2.0 / 9 * s[1] - 1.0 / 9 * s[2] + 8.0 / 9 * s[3];
        second = s[4] + 2.0 / 9 * (s[1] + s[2]) - 4.0 / 9 * s[3];
    }
}
