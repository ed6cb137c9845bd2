// Winograd's way for convolutions (Winograd, Arithmetic Complexity of Computations, 1980; Lavin and
// Gray, Fast Algorithms for Convolutional Neural Networks, 2016).
//
// In one dimension, c[o] = sum over t < kTaps of g[t] f[o + t] for kResults neighbouring o is a
// product of polynomials, and takes one multiplication for each of kPoints points where these are
// known:
//     c = A^T [(G g) (B f)].
// In two dimensions that is kPoints^2 for a tile of kResults^2. The channels are summed before the
// results are put together, so that each of these products is a product of matrices over all tiles.
// The gradients are the transposes: f = B^T [U^T (A c)], U = G g, and g = G^T [(A c) (B f)^T].
//
// A convolution 4x4 of stride 2 and padding 1 lies between a finer image and a coarser one of half
// its size: c[o] = sum over t < 4 of w[t] f[2o - 1 + t]. Split by the parity p of t, that is the
// sum of two convolutions with two taps, g_p = (w[p], w[2 + p]) over f_p[i] = f[2i + p - 1]: the
// phases, px and py in two dimensions, are channels of their own.
//
// The sets of points, and products of a tile in two dimensions for those of its definition:
//     kPoints  taps  results  points                                   products
//     3        2     2        0, 1, infinity                           9 for 16, stride 2
//     5        2     4        0, 1, -2, -1/2, infinity                 25 for 64, stride 2
//     6        3     4        0, 1, -1, 2, -1/2, infinity              36 for 144
//     7        4     4        0, 1, -1, 2, -2, -1/2, infinity          49 for 256
//     9        4     4        the first, of results and taps by two,   81 for 256
//                             in which the products are the first again
// With the first and the last all factors are 0, 1 and -1: what is lost in precision is a bit or
// so, and halves will do. The others are those of the least error (Barabasz and others, Error
// Analysis and Improving the Accuracy of Winograd Convolution for Deep Neural Networks, 2020): of
// random images and kernels 2.2, 2.2 and 5 times that of adding up one by one.
//
// Matrices, kPoints^2 of them: [channels, tiles] of the image, of stride 2 [4 fine channels, tiles]
// with row 4 channel + 2 py + px; [features, tiles]; weights [features, channels or rows].
//
// A set's numbers come from the table of shapes in nn/ops/conv/winograd.cpp.
layout(constant_id = 10) const uint kSet = 0;  // row of the tables below
layout(constant_id = 11) const uint kPoints = 3;
layout(constant_id = 12) const uint kResults = 2;
layout(constant_id = 13) const uint kTaps = 2;
const uint kMostPoints = 9, kMostSeen = 7;  // of all sets
const uint kSeen = kResults + kTaps - 1;  // numbers that a tile sees

#define ROW float[kMostSeen]
const float kNone[kMostSeen] = ROW(0, 0, 0, 0, 0, 0, 0);
const float kB[5][kMostPoints][kMostSeen] = float[5][kMostPoints][kMostSeen](
    float[kMostPoints][kMostSeen](ROW(1, -1, 0, 0, 0, 0, 0), ROW(0, 1, 0, 0, 0, 0, 0),
                                  ROW(0, 1, -1, 0, 0, 0, 0),
                kNone, kNone, kNone, kNone, kNone, kNone),
    float[kMostPoints][kMostSeen](ROW(1, 1.5, -1.5, -1, 0, 0, 0), ROW(0, 1, 2.5, 1, 0, 0, 0),
                ROW(0, 0.5, 0.5, -1, 0, 0, 0), ROW(0, -2, 1, 1, 0, 0, 0),
                ROW(0, -1, -1.5, 1.5, 1, 0, 0), kNone, kNone, kNone, kNone),
    float[kMostPoints][kMostSeen](ROW(1, 1.5, -2, -1.5, 1, 0, 0), ROW(0, 1, 2.5, 0.5, -1, 0, 0),
                ROW(0, 1, 0.5, -2.5, 1, 0, 0), ROW(0, -0.5, -1, 0.5, 1, 0, 0),
                ROW(0, -2, 1, 2, -1, 0, 0), ROW(0, 1, 1.5, -2, -1.5, 1, 0), kNone, kNone, kNone),
    float[kMostPoints][kMostSeen](ROW(2, 4, -2.5, -5, 0.5, 1, 0), ROW(0, 2, 6, 3.5, -1.5, -1, 0),
                ROW(0, 2, 2, -4.5, -0.5, 1, 0), ROW(0, -1, -2.5, 0, 2.5, 1, 0),
                ROW(0, -1, -1.5, 2, 1.5, -1, 0), ROW(0, -4, 0, 5, 0, -1, 0),
                ROW(0, 2, 4, -2.5, -5, 0.5, 1), kNone, kNone),
    float[kMostPoints][kMostSeen](ROW(1, -1, -1, 1, 0, 0, 0), ROW(0, 0, 1, -1, 0, 0, 0),
                                  ROW(0, 0, 1, -1, -1, 1, 0),
                ROW(0, 1, 0, -1, 0, 0, 0), ROW(0, 0, 0, 1, 0, 0, 0), ROW(0, 0, 0, 1, 0, -1, 0),
                ROW(0, 1, -1, -1, 1, 0, 0), ROW(0, 0, 0, 1, -1, 0, 0),
                ROW(0, 0, 0, 1, -1, -1, 1)));
#undef ROW
const vec4 kG[5][kMostPoints] = vec4[5][kMostPoints](
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 1, 0, 0), vec4(0, 1, 0, 0), vec4(0), vec4(0),
                      vec4(0), vec4(0), vec4(0), vec4(0)),
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(2, 2, 0, 0) / 9, vec4(1, -2, 0, 0) / 9,
                      vec4(8, -4, 0, 0) / 9, vec4(0, 1, 0, 0), vec4(0), vec4(0), vec4(0), vec4(0)),
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 1, 1, 0) / 3, vec4(1, -1, 1, 0) / 3,
                      vec4(1, 2, 4, 0) / 15, vec4(16, -8, 4, 0) / 15, vec4(0, 0, 1, 0), vec4(0),
                      vec4(0), vec4(0)),
    vec4[kMostPoints](vec4(0.5, 0, 0, 0), vec4(1, 1, 1, 1) / 9, vec4(1, -1, 1, -1) / 3,
                      vec4(1, 2, 4, 8) / 60, vec4(1, -2, 4, -8) / 36, vec4(32, -16, 8, -4) / 45,
                      vec4(0, 0, 0, 1), vec4(0), vec4(0)),
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 0, 1, 0), vec4(0, 0, 1, 0), vec4(1, 1, 0, 0),
                      vec4(1, 1, 1, 1), vec4(0, 0, 1, 1), vec4(0, 1, 0, 0), vec4(0, 1, 0, 1),
                      vec4(0, 0, 0, 1)));
const vec4 kA[5][kMostPoints] = vec4[5][kMostPoints](
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 1, 0, 0), vec4(0, -1, 0, 0), vec4(0), vec4(0),
                      vec4(0), vec4(0), vec4(0), vec4(0)),
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 1, 1, 1), vec4(1, -2, 4, -8),
                      vec4(1, -0.5, 0.25, -0.125), vec4(0, 0, 0, 1), vec4(0), vec4(0), vec4(0),
                      vec4(0)),
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 1, 1, 1), vec4(1, -1, 1, -1), vec4(1, 2, 4, 8),
                      vec4(1, -0.5, 0.25, -0.125), vec4(0, 0, 0, 1), vec4(0), vec4(0), vec4(0)),
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 1, 1, 1), vec4(1, -1, 1, -1), vec4(1, 2, 4, 8),
                      vec4(1, -2, 4, -8), vec4(1, -0.5, 0.25, -0.125), vec4(0, 0, 0, 1), vec4(0),
                      vec4(0)),
    vec4[kMostPoints](vec4(1, 0, 0, 0), vec4(1, 0, 1, 0), vec4(0, 0, -1, 0), vec4(1, 1, 0, 0),
                      vec4(1, 1, 1, 1), vec4(0, 0, -1, -1), vec4(0, -1, 0, 0), vec4(0, -1, 0, -1),
                      vec4(0, 0, 0, 1)));

// What follows is unrolled, and products with 0 and 1 fall away.
void toPoints(float f[kMostSeen], out float m[kMostPoints]) {  // B f
    [[unroll]] for (uint i = 0; i < kPoints; ++i) {
        m[i] = 0;
        [[unroll]] for (uint k = 0; k < kSeen; ++k) m[i] += kB[kSet][i][k] * f[k];
    }
}

void fromPoints(float m[kMostPoints], out float f[kMostSeen]) {  // B^T m
    [[unroll]] for (uint k = 0; k < kSeen; ++k) {
        f[k] = 0;
        [[unroll]] for (uint i = 0; i < kPoints; ++i) f[k] += kB[kSet][i][k] * m[i];
    }
}

void toProducts(float c[4], out float m[kMostPoints]) {  // A c
    [[unroll]] for (uint i = 0; i < kPoints; ++i) {
        m[i] = 0;
        [[unroll]] for (uint k = 0; k < kResults; ++k) m[i] += kA[kSet][i][k] * c[k];
    }
}

void fromProducts(float m[kMostPoints], out float c[4]) {  // A^T m
    [[unroll]] for (uint k = 0; k < kResults; ++k) {
        c[k] = 0;
        [[unroll]] for (uint i = 0; i < kPoints; ++i) c[k] += kA[kSet][i][k] * m[i];
    }
}

void tapsToPoints(float w[4], out float m[kMostPoints]) {  // G w
    [[unroll]] for (uint i = 0; i < kPoints; ++i) {
        m[i] = 0;
        [[unroll]] for (uint k = 0; k < kTaps; ++k) m[i] += kG[kSet][i][k] * w[k];
    }
}

void tapsFromPoints(float m[kMostPoints], out float w[4]) {  // G^T m
    [[unroll]] for (uint k = 0; k < kTaps; ++k) {
        w[k] = 0;
        [[unroll]] for (uint i = 0; i < kPoints; ++i) w[k] += kG[kSet][i][k] * m[i];
    }
}
