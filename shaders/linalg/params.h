#ifndef LINALG_PARAMS_H
#define LINALG_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct GemmParams {
    uint m, n, k;
    uint lda, ldb, ldc;                 // elements from row to row, as stored
    uint startA, startB, startC;        // first element
    uint strideA, strideB, strideC;     // elements from one matrix of the batch to the next
    uint batch;                         // workgroup z = part * batch + matrix
    uint kPart;                         // part p sums k in [p * kPart, (p + 1) * kPart)
    uint strideCPart;                   // elements from one part's C to the next's
};
struct GemmReduceParams {
    uint elements;  // of C: batch * m * n
    uint m, n;
    uint ldc, startC, strideC;
    uint parts;  // [parts, batch, m, n] are summed in order
};
struct SumParams {
    uint outer, count, inner;  // x[outer, count, inner]
    uint partLength;           // one invocation sums so many of count
    uint parts;                // ceil(count / partLength)
};
SHARED_END
#endif
