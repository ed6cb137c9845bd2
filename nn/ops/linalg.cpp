#include "nn/ops/linalg.h"

#include <algorithm>
#include <cmath>

#include "engine/files/numbers.h"
#include "linalg/params.h"
#include "nn/body/mesh_topology.h"
#include "nn/core/op.h"

namespace doppel {

Tensor largestMagnitude(Graph& graph, const Tensor& x) {
    if (graph.device().precision() != Precision::Mixed) return {};
    Tensor largest = graph.temporary({1});
    graph.fill(largest);
    constexpr uint32_t kLanes = 256;
    auto elements = static_cast<uint64_t>(x.elements());
    graph.dispatch("linalg/largest.magnitude", {{"x", x}, {"largest", largest}},
                   LargestParams{u32(x.elements())}, (elements + kLargestEach - 1) / kLargestEach,
                   {{"local_size", kLanes}});
    return largest;
}

namespace {

// Rows of entries, each a column and a place among the matrix's numbers.
struct SparseRows {
    std::vector<int32_t> begin, entries;
};

SparseRows rowsOf(const SparseMatrix& a) {
    SparseRows rows{a.begin, {}};
    for (size_t n = 0; n < a.column.size(); ++n)
        rows.entries.insert(rows.entries.end(), {a.column[n], static_cast<int32_t>(n)});
    return rows;
}

// Each sum over a row has the order of the rows of `a`.
SparseRows transposedRowsOf(const SparseMatrix& a) {
    SparseRows rows{std::vector<int32_t>(static_cast<size_t>(a.columns) + 1),
                    std::vector<int32_t>(2 * a.column.size())};
    for (const int32_t column : a.column) ++rows.begin[static_cast<size_t>(column) + 1];
    for (size_t c = 1; c < rows.begin.size(); ++c) rows.begin[c] += rows.begin[c - 1];
    std::vector<int32_t> next(rows.begin.begin(), rows.begin.end() - 1);
    for (size_t row = 0; row + 1 < a.begin.size(); ++row)
        for (int32_t n = a.begin[row]; n < a.begin[row + 1]; ++n) {
            const auto at =
                static_cast<size_t>(next[static_cast<size_t>(a.column[static_cast<size_t>(n)])]++);
            rows.entries[2 * at] = static_cast<int32_t>(row);
            rows.entries[2 * at + 1] = n;
        }
    return rows;
}

// y = A x; value [n] are the numbers of `a`, whose own do not count.
Tensor sparseProduct(Graph& graph, const SparseMatrix& a, const Tensor& value, const Tensor& x) {
    const int64_t channels = x.dim(-1);
    CHECK(x.elements() == a.columns * channels, "a matrix [{},{}] is multiplied by {} rows, not {}",
          a.rows(), a.columns, a.columns, toString(x.shape));
    Tensor y = graph.temporary({a.rows(), channels});
    const auto multiply = [value, channels, &graph](const SparseRows& rows, const Tensor& by,
                                                    const Tensor& to) {
        const uint32_t count = u32(static_cast<int64_t>(rows.begin.size()) - 1);
        graph.dispatch("linalg/sparse_product.forward",
                       {{"begin", listConstant(graph, rows.begin)},
                        {"entries", listConstant(graph, rows.entries)},
                        {"value", value},
                        {"x", by},
                        {"y", to}},
                       SparseProductParams{count, u32(channels)}, count);
    };
    graph.beginOp("sparse_product");
    multiply(rowsOf(a), x, y);
    graph.differentiate({x}, {y}, [=, back = transposedRowsOf(a), &graph] {
        multiply(back, graph.gradient(y), graph.gradientTarget(x));
    });
    return y;
}

}  // namespace

Tensor sparseProduct(Graph& graph, const SparseMatrix& a, const Tensor& x) {
    const auto count = static_cast<int64_t>(a.value.size());
    CHECK(a.column.size() == a.value.size() && count > 0, "a matrix has numbers");
    return sparseProduct(graph, a, graph.constant(std::span<const float>(a.value), {count}), x);
}

void sumAxis(Graph& graph, const Tensor& x, int64_t outer, int64_t count, int64_t inner,
             const Tensor& target, bool accumulate) {
    CHECK(outer * count * inner <= x.elements() && outer * inner <= target.elements(),
          "a sum over [{},{},{}] lies within its tensors", outer, count, inner);
    if (outer * inner == 0) return;
    // Both dispatches add up chains of one length, the shortest there is.
    constexpr int64_t kLeastPart = 16;
    const int64_t partLength = std::max<int64_t>(
        kLeastPart, std::llround(std::ceil(std::sqrt(static_cast<double>(count)))));
    const int64_t parts = std::max<int64_t>(1, (count + partLength - 1) / partLength);
    Tensor source = x;
    if (parts > 1) {
        SumParams params{u32(outer), u32(count), u32(inner), u32(partLength), u32(parts)};
        source = graph.temporary({outer, parts, inner});
        graph.dispatch("linalg/sum.axis", {{"x", x}, {"y", source}}, params,
                       static_cast<uint64_t>(outer * parts * inner));
        count = parts;
    }
    SumParams params{u32(outer), u32(count), u32(inner), u32(std::max<int64_t>(count, 1)), 1};
    graph.dispatch("linalg/sum.axis", {{"x", source}, {"y", target}}, params,
                   static_cast<uint64_t>(outer * inner), {{"kAccumulate", accumulate}});
}

Tensor matmul(Graph& graph, const Tensor& a, const Tensor& b, bool transA, bool transB) {
    int64_t B = a.dim(0), M = a.dim(transA ? 2 : 1), K = a.dim(transA ? 1 : 2);
    int64_t N = b.dim(transB ? 1 : 2);
    if (b.dim(transB ? 2 : 1) != K || b.dim(0) != B)
        throwInput("matmul: expected matrices that fit, found {} and {}", toString(a.shape),
                   toString(b.shape));
    Tensor c = graph.temporary({B, M, N});
    Gemm product{.m = M,
                 .n = N,
                 .k = K,
                 .transA = transA,
                 .transB = transB,
                 .batch = B,
                 .strideA = M * K,
                 .strideB = K * N,
                 .strideC = M * N};
    graph.beginOp("matmul", flops(product));
    gemm(graph, a, b, c, product);
    graph.differentiate({a, b}, {c}, [=, &graph] {
        Tensor dc = graph.gradient(c), largest = largestMagnitude(graph, dc);
        // dA = dC op(B)^T or its transpose, dB = op(A)^T dC or its transpose.
        Gemm da{.m = M,
                .n = K,
                .k = N,
                .transB = !transB,
                .batch = B,
                .strideA = M * N,
                .strideB = K * N,
                .strideC = M * K,
                .largestA = largest};
        Gemm daT{.m = K,
                 .n = M,
                 .k = N,
                 .transA = transB,
                 .transB = true,
                 .batch = B,
                 .strideA = K * N,
                 .strideB = M * N,
                 .strideC = M * K,
                 .largestB = largest};
        Gemm db{.m = K,
                .n = N,
                .k = M,
                .transA = !transA,
                .batch = B,
                .strideA = M * K,
                .strideB = M * N,
                .strideC = K * N,
                .largestB = largest};
        Gemm dbT{.m = N,
                 .n = K,
                 .k = M,
                 .transA = true,
                 .transB = transA,
                 .batch = B,
                 .strideA = M * N,
                 .strideB = M * K,
                 .strideC = K * N,
                 .largestA = largest};
        if (graph.wantsGradient(a)) {
            Tensor target = graph.gradientTarget(a);
            if (transA)
                gemm(graph, b, dc, target, daT);
            else
                gemm(graph, dc, b, target, da);
        }
        if (graph.wantsGradient(b)) {
            Tensor target = graph.gradientTarget(b);
            if (transB)
                gemm(graph, dc, a, target, dbT);
            else
                gemm(graph, a, dc, target, db);
        }
    });
    return c;
}

Tensor linear(Graph& graph, const Tensor& x, const Tensor& weight, const Tensor& bias,
              const ListedRows& rows) {
    int64_t V = x.dim(0), I = x.dim(1), O = weight.dim(0);
    CHECK(weight.dim(1) == I, "weight {} fits x {}", toString(weight.shape), toString(x.shape));
    Tensor y = graph.temporary({V, O});
    Gemm product{.m = V, .n = O, .k = I, .transB = true, .bias = bias, .rows = rows};
    graph.beginOp("linear", flops(product));
    gemm(graph, x, weight, y, product);
    if (rows) return graph.keep(y), y;
    graph.differentiate({x, weight, bias}, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y), largest = largestMagnitude(graph, dy);
        if (graph.wantsGradient(x))
            gemm(graph, dy, weight, graph.gradientTarget(x),
                 {.m = V, .n = I, .k = O, .largestA = largest});
        if (graph.wantsGradient(weight))
            gemm(graph, dy, x, graph.gradientTarget(weight),
                 {.m = O,
                  .n = I,
                  .k = V,
                  .transA = true,
                  .sums = graph.wantsGradient(bias) ? graph.gradientTarget(bias) : Tensor(),
                  .largestA = largest});
        else if (graph.wantsGradient(bias))
            sumAxis(graph, dy, 1, V, O, graph.gradientTarget(bias));
    });
    return y;
}

static const Op kSparseProduct{{
    .name = "sparse_product",
    .inputs = "begin:i32[B] column:i32[E] value[E] x[M,C]",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            SparseMatrix a{c["x"].dim(0), c.ints("begin"), c.ints("column"), {}};
            const int64_t count = c["value"].dim(0);
            if (a.begin.size() < 2 || a.begin.front() != 0 || a.begin.back() != count ||
                !std::ranges::is_sorted(a.begin))
                throwInput("sparse_product: begin: expected numbers that rise from 0 to {}", count);
            for (const int32_t column : a.column)
                if (column < 0 || column >= a.columns)
                    throwInput("sparse_product: column has {}; expected 0 to {}", column,
                               a.columns - 1);
            c.result("y", sparseProduct(c.graph, a, c["value"], c["x"]));
        },
}};

static const Op kLinear{{
    .name = "linear",
    .inputs = "x[V,I] weight[O,I] bias[O]?",
    .outputs = "y",
    .differentiable = "x weight bias",
    .build = [](OpCall& c) { c.result("y", linear(c.graph, c["x"], c["weight"], c["bias"])); },
}};

// The product itself, so that every variant can be tested and compared: a and b as stored.
static const Op kMatmul{{
    .name = "matmul",
    .inputs = "a[B,R,S] b[B,T,U]",
    .attributes = "trans_a=0 trans_b=0",
    .outputs = "c",
    .differentiable = "a b",
    .build =
        [](OpCall& c) {
            c.result("c",
                     matmul(c.graph, c["a"], c["b"], c.u("trans_a") != 0, c.u("trans_b") != 0));
        },
}};

}  // namespace doppel
