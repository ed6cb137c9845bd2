// Matrix products, and the ops that are little else.
#pragma once

#include "nn/core/graph.h"
#include "nn/core/rows.h"
#include "nn/core/sparse.h"

namespace doppel {

// A matrix product C = op(A) op(B), row by row in memory: A is [m, k], transposed [k, m]; B is
// [k, n], transposed [n, k]; C is [m, n].
struct Gemm {
    int64_t m = 0, n = 0, k = 0;
    bool transA = false, transB = false;
    // B lies in panels [batch, ceil(n / width), k, width] of gemmPanelWidth() columns.
    bool panelsB = false;
    // A lies in panels [batch, ceil(m / rows), gemmPanelSteps(k), rows] of gemmPanelRows() rows,
    // zero from step k on.
    bool panelsA = false;
    bool accumulate = false;  // C += op(A) op(B)
    // Elements from one stored row to the next; 0: the rows are packed.
    int64_t lda = 0, ldb = 0, ldc = 0;
    int64_t startA = 0, startB = 0, startC = 0;  // first element
    // So many products, and elements from one matrix to the next; 0: all share one (not C).
    int64_t batch = 1, strideA = 0, strideB = 0, strideC = 0;
    Tensor bias;  // added to every row [n], or, biasPerRow, to every column [m]
    bool biasPerRow = false;
    bool relu = false;   // C = max(0, all of that)
    bool relu6 = false;  // C = min(6, max(0, all of that))
    // [m]: the sums of op(A) over k too, where A lies transposed in one packed matrix.
    Tensor sums;
    // With mixed precision, from largestMagnitude(): of A or B, where it is made of gradients,
    // which may be too small for a half.
    Tensor largestA, largestB;
    // Rows of C that are made, see gemmTakesRows(); the others stay as they are.
    ListedRows rows;
};

// How many columns of B a panel has, for a B of n columns; rows of A, for m of them; and steps of
// k that a panel of A has.
int64_t gemmPanelWidth(const Device& device, int64_t n);
int64_t gemmPanelRows(const Device& device, int64_t m);
int64_t gemmPanelSteps(int64_t k);

// Whether products with A in panels, or of few columns, can leave rows out: a CPU's can. Of A's
// panels only as many are used then as have the listed rows, one after the other.
bool gemmTakesRows(const Device& device);

// With mixed precision the magnitude [1] of x's largest element, as its bits, for Gemm; nothing
// (an empty tensor) else. Adds dispatches to the current op.
Tensor largestMagnitude(Graph& graph, const Tensor& x);

// Adds the dispatches of a product to the current op, forward or backward; no gradient of its own.
// Sums have a fixed order: the same bits every run. With mixed precision A and B are rounded to
// halves (what they cannot hold to the largest), and sums are of single precision. Rows of an even
// number of elements are read twice as fast on lavapipe.
void gemm(Graph& graph, const Tensor& a, const Tensor& b, const Tensor& c, const Gemm& shape);
inline double flops(const Gemm& g) {
    return 2.0 * static_cast<double>(g.m * g.n) * static_cast<double>(g.k * g.batch);
}

// y[V,O] = x[V,I] weight[O,I]^T + bias[O]; bias may be an empty tensor. Gradients to all three.
// With rows these alone are computed, where the product can leave rows out; no gradients then.
Tensor linear(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
              const ListedRows& rows = {});

// c[B,M,N] = op(a) op(b) for every matrix of the batch; a, b are [B,rows,columns] as stored, and
// transposed where asked. Gradients to both.
Tensor matmul(Graph& graph, const Tensor& a, const Tensor& b, bool transA = false,
              bool transB = false);

// y[N,C] = A x[M,C], A [N,M] a constant of the graph; x may have any shape of M rows of C numbers.
// Gradient to x, gathered row by row in a fixed order.
Tensor sparseProduct(Graph& graph, const SparseMatrix& a, const Tensor& x);

// target[outer, inner] = (or +=) sum over the middle axis of x[outer, count, inner], in a fixed
// order; adds dispatches to the current op, no gradient of its own.
void sumAxis(Graph& graph, const Tensor& x, int64_t outer, int64_t count, int64_t inner,
             const Tensor& target, bool accumulate = false);

}  // namespace doppel
