#ifndef LINALG_PARAMS_H
#define LINALG_PARAMS_H
#include "common/divide.h"
#include "common/constants.h"
SHARED_BEGIN
SHARED_CONSTANT uint kGemmUnroll = 8;  // parts and panels have a multiple of so many steps of k
// A workgroup on matrix units makes so many by so many of the device's matrices.
SHARED_CONSTANT uint kMatrixFragments = 4;
SHARED_CONSTANT uint kLargestEach = 64;  // elements that an invocation looks at
struct GemmParams {
    uint m, n, k;
    uint lda, ldb, ldc;                 // elements from row to row, as stored; panel to panel
    uint startA, startB, startC;        // first element
    uint strideA, strideB, strideC;     // elements from one matrix of the batch to the next
    uint batch;                         // workgroup z = part * batch + matrix
    uint kPart;                         // part p sums k in [p * kPart, (p + 1) * kPart)
};
// What gemm_staged.comp does at the end, or finds in memory.
SHARED_CONSTANT uint kGemmAccumulates = 1;
SHARED_CONSTANT uint kGemmBiasOfColumns = 2, kGemmBiasOfRows = 4;
SHARED_CONSTANT uint kGemmClamps = 8, kGemmClampsAtSix = 16;  // to positive numbers; to 6
SHARED_CONSTANT uint kGemmScaled = 32;  // A or B was multiplied by halfScale(largest)
// Whether four rows of A or four columns of B or C, the first divisible by four, lie side by side
// from an element divisible by four on, and none is cut by the matrix's end.
SHARED_CONSTANT uint kGemmQuadsA = 64, kGemmQuadsB = 128, kGemmQuadsC = 256;
struct GemmReduceParams {
    uint elements;  // of C: batch * m * n
    uint ldc, startC, strideC;
    uint parts;  // [parts, batch, m, n] are summed in order
    Divisor byRows, byColumns;
};
struct PanelsParams {
    uint count, steps;       // rows of A or columns of B, and k
    uint stepsInPanel;       // k, rounded up: zero behind k
    uint start, strideMatrix;
    uint strideItem, strideStep;  // elements from one row or column, from one step to the next
    uint stridePanel;             // from the first row or column of a panel to the next one's
    uint panels;
};
struct LargestParams {
    uint elements;
};
struct SparseProductParams {
    uint rows, channels;
};
struct SumParams {
    uint outer, count, inner;  // x[outer, count, inner]
    uint partLength;           // one invocation sums so many of count
    uint parts;                // ceil(count / partLength)
};
SHARED_END
#endif
