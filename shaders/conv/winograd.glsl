// Winograd's way for convolutions 4x4, stride 2, padding 1, between a finer image and a coarser one
// of half its size (Winograd, Arithmetic Complexity of Computations, 1980; Lavin and Gray, Fast
// Algorithms for Convolutional Neural Networks, 2016).
//
// In one dimension, with f[-1] = 0 in front: c[o] = sum over t < 4 of w[t] f[2o - 1 + t]. Split by
// the parity p of t, that is the sum of two correlations with two taps g_p = (w[p], w[2 + p]) over
// u_p[i] = f[2i + p - 1]. Two neighbouring results need u0, u1, u2 of each phase, and
//     c0 = m0 + m1, c1 = m1 - m2,  m = [(u0 - u1) g0, u1 (g0 + g1), (u1 - u2) g1]:
// three multiplications for four. In two dimensions nine for sixteen, per tile of 2x2 results. The
// channels and phases are summed before the results are put together, so that each of the nine is
// a matrix product over all tiles:
//     c = A^T [U (B^T f)],  U = G w,  B^T u = [u0 - u1, u1, u1 - u2],  A^T m as above.
// The gradients are its transposes: f = B [U^T (A c)] and w = G^T [(A c) (B^T f)^T].
// All factors are 0, 1 and -1: what is lost in precision is a bit or so.
//
// Matrices: nine [4 fine channels, tiles] of the finer image, row 4 channel + 2 py + px; nine
// [coarse channels, tiles]; weights nine [coarse channels, 4 fine channels].
const uint kMatrices = 9;
