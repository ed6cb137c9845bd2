#include "nn/ops/linalg.h"

#include <algorithm>

#include "common/panels.h"
#include "engine/files/numbers.h"
#include "linalg/params.h"
#include "nn/core/tuning.h"

namespace doppel {

namespace {

int64_t ceilDiv(int64_t a, int64_t b) { return (a + b - 1) / b; }

// Panels of halves have a multiple of so many steps of k, and are zero behind k: a side of any
// device's matrices, and of gemm.comp's loop.
constexpr int64_t kHalfSteps = std::max<int64_t>(kMatrixTile, kGemmUnroll);
int64_t halfPanelSteps(int64_t k) { return ceilDiv(k, kHalfSteps) * kHalfSteps; }

bool divisible(int64_t by, std::initializer_list<int64_t> values) {
    return std::ranges::all_of(values, [by](int64_t v) { return v % by == 0; });
}

// Of GPUs: tiles of gemm_staged.comp, and what the panels that it reads have.
constexpr int64_t kSide = 64, kLargeSide = 128, kStagedPanelRows = 8;
int64_t stagedPanelWidth(int64_t n) { return n <= kSide ? kSide : kLargeSide; }

// How a product is spread over workgroups.
struct Plan {
    uint32_t lanes = 32, pairs = 2;
    int64_t rows = 8, columns = 128;          // of a tile
    int64_t panelRows = 8, panelWidth = 128;  // of panels that the tiles read
    bool onCpu = false;
    bool panelsA = false, panelsB = false;  // packed first
    std::optional<MatrixShape> matrices;    // on matrix units
    bool halves = false;                    // of both sides
    int64_t parts = 1, kPart = 0;
};

bool runsOnCpu(const Device& device) { return device.kernelPath().vectorLanes > 0; }

// Each tile of rows reads a tile of columns' part of B again, which a CPU should find in its cache
// then. A part is a pass over C, so that many parts pay only where C is small beside B.
int64_t partsForCache(const Gemm& g, const Plan& p) {
    constexpr int64_t kCached = 128 << 10;  // numbers
    if (g.m < 4 * p.rows) return 1;
    int64_t wanted = ceilDiv(g.k * std::min(g.n, p.columns), kCached);
    return std::max<int64_t>(1, std::min(g.k / (4 * g.m), wanted));
}

Plan plan(const Device& device, const Gemm& g) {
    const GemmTuning& tuning = gemmTuning(device);
    Plan p;
    p.matrices = device.matrixUnits();
    p.halves = device.precision() == Precision::Mixed;
    p.onCpu = runsOnCpu(device) && !p.matrices;
    p.panelRows = gemmPanelRows(device, g.m);
    p.panelWidth = gemmPanelWidth(device, g.n);
    auto tiles = [&](int64_t rows, int64_t columns) {
        return ceilDiv(g.m, rows) * ceilDiv(g.n, columns) * g.batch;
    };
    const int64_t mostParts = std::max<int64_t>(1, g.k / tuning.shortestPart);
    if (p.matrices) {
        p.lanes = device.info().subgroupSize;
        p.panelsA = p.panelsB = true;
    } else if (p.onCpu) {
        p.lanes = device.info().subgroupSize;
        if (g.panelsB)
            p.pairs = u32(p.panelWidth / 2 / p.lanes);
        else if (g.n <= 2 * p.lanes)
            p.pairs = 1;
        p.panelWidth = int64_t{2} * p.pairs * p.lanes;
        // Packing is a pass over memory, a product a quarter of a cycle per element of A and
        // column. Rows that do not start at texels gain more.
        auto worth = [](int64_t uses, int64_t ld) { return uses >= (ld % 4 == 0 ? 512 : 64); };
        p.panelsA = p.halves || (!g.panelsA && worth(g.n, g.lda));
        p.panelsB = p.halves || (!g.panelsB && worth(g.m, g.ldb));
    }
    p.rows = p.panelRows;
    p.columns = p.panelWidth;
    if (!p.matrices && !p.onCpu) {
        p.panelsA = p.panelsB = p.halves;
        // A large tile reads less, where there is work for all cores with it. Of small ones an image
        // may need more than a dispatch has.
        const bool worth = g.m > kSide && g.n > kSide &&
                           tiles(kLargeSide, kLargeSide) * mostParts >= tuning.tiles;
        const bool large = (worth || ceilDiv(g.n, kSide) > device.info().maxWorkgroups[1]) &&
                           2 * kLargeSide <= device.info().maxWorkgroupInvocations;
        p.rows = p.columns = large ? kLargeSide : kSide;
        p.lanes = u32(2 * p.rows);
    }
    // Long sums with few results are cut into parts, so that there is work for all cores. A CPU
    // has few tiles for a core, of which the last should not wait for one.
    const int64_t all = tiles(p.rows, p.columns);
    p.parts = std::clamp<int64_t>(p.onCpu ? ceilDiv(tuning.tiles, all) : tuning.tiles / all, 1,
                                  mostParts);
    if (p.onCpu) p.parts = std::max(p.parts, partsForCache(g, p));
    int64_t kPart = ceilDiv(g.k, p.parts);
    p.kPart = p.halves ? std::max(kHalfSteps, halfPanelSteps(kPart))
                       : std::max<int64_t>(kGemmUnroll, gemmPanelSteps(kPart));
    p.parts = std::max<int64_t>(1, ceilDiv(g.k, p.kPart));
    return p;
}

// A matrix [batch, count, steps] by its strides as panels of width items.
struct Source {
    Tensor tensor;
    int64_t start, batch, strideMatrix, count, strideItem, strideStep;
    int64_t stridePanel = 0;  // 0: width items
};
// halves: rounded, two to an element, and, with largest, scaled. interleaved: kLayoutInterleaved.
Tensor pack(Graph& graph, const Source& s, int64_t steps, int64_t stepsInPanel, uint32_t width,
            bool halves = false, const Tensor& largest = {}, bool interleaved = false) {
    int64_t panels = ceilDiv(s.count, width);
    Tensor packed = graph.temporary({s.batch, panels, stepsInPanel, halves ? width / 2 : width});
    PanelsParams params{.count = u32(s.count),
                        .steps = u32(steps),
                        .stepsInPanel = u32(stepsInPanel),
                        .start = u32(s.start),
                        .strideMatrix = u32(s.strideMatrix),
                        .strideItem = u32(s.strideItem),
                        .strideStep = u32(s.strideStep),
                        .stridePanel = u32(s.stridePanel ? s.stridePanel : width * s.strideItem),
                        .panels = u32(panels)};
    uint32_t pairs = 0;
    if (s.strideItem == 1 && divisible(2, {s.start, s.strideMatrix, s.strideStep, s.count}))
        pairs = 1;
    if (s.strideStep == 1 && divisible(2, {s.start, s.strideMatrix, s.strideItem, steps}))
        pairs = 2;
    int64_t invocations = ceilDiv(stepsInPanel, 4) * (width / 2);
    graph.dispatchGroups("linalg/panels.pack",
                         {{"matrix", s.tensor},
                          {"pairs", s.tensor},
                          {"packed", packed},
                          {"halves", packed},
                          {"largest", largest ? largest : graph.none()}},
                         params, {u32(ceilDiv(invocations, 64)), u32(panels), u32(s.batch)},
                         {{"kWidth", width},
                          {"kPairs", pairs},
                          {"kHalves", halves},
                          {"kScaled", bool(largest)},
                          {"kInterleaved", interleaved}});
    return packed;
}

GemmParams gemmParams(const Gemm& g) {
    return {.m = u32(g.m),
            .n = u32(g.n),
            .k = u32(g.k),
            .lda = u32(g.lda),
            .ldb = u32(g.ldb),
            .ldc = u32(g.ldc),
            .startA = u32(g.startA),
            .startB = u32(g.startB),
            .startC = u32(g.startC),
            .strideA = u32(g.strideA),
            .strideB = u32(g.strideB),
            .strideC = u32(g.strideC),
            .batch = u32(g.batch)};
}

// Of the kernels: none, one per column, one per row.
uint32_t biasKind(const Gemm& g) { return !g.bias ? 0 : g.biasPerRow ? 2 : 1; }

// Of the kernels: none, to positive numbers, to [0, 6].
uint32_t clampKind(const Gemm& g) { return g.relu6 ? 2 : g.relu ? 1 : 0; }

constexpr int64_t kNarrow = 4;  // columns at most, see gemm_narrow.comp

// Whether the product is one of gemm_narrow.comp's.
bool isNarrow(const Gemm& g, const Plan& p) {
    bool shape = p.onCpu && !p.halves && g.n <= kNarrow && g.batch == 1 && !g.panelsA &&
                 !g.panelsB && clampKind(g) == 0 && !g.accumulate &&
                 divisible(4, {g.lda, g.startA, g.ldb, g.startB});
    if (g.transA) return shape && !g.transB && !g.bias && g.m >= 64 && g.m % 4 == 0;
    return shape && g.m >= 256 && g.k >= 4 && g.k % 4 == 0;
}

void narrowRows(Graph& graph, const Tensor& a, const Tensor& b, const Tensor& c, const Gemm& g,
                const Plan& p) {
    dispatchRows(graph, "linalg/gemm_narrow.rows", g.rows,
                 {{"a", a},
                  {"b", b},
                  {"c", c},
                  {"bias", g.bias ? g.bias : graph.none()},
                  {"listed", g.rows.list(graph)}},
                 gemmParams(g), static_cast<uint64_t>(g.m), kRowsListed,
                 {{"kLanes", p.lanes},
                  {"kColumns", u32(g.n)},
                  {"kBias", biasKind(g)},
                  {"kTransB", g.transB}});
}

// How many of the last columns are better off in a product of their own, for lanes that run one
// after the other, as a CPU's, also pay for columns behind the last.
int64_t columnsApart(const Gemm& g, const Plan& p) {
    if (!p.onCpu || g.panelsB || (g.bias && !g.biasPerRow)) return 0;
    int64_t few = g.n % (2 * p.lanes);
    Gemm last = g;
    last.n = few;
    last.startB += (g.n - few) * (g.transB ? g.ldb : 1);
    if (few > 0 && few < g.n && isNarrow(last, p)) return few;
    // Half of a tile, or less.
    int64_t rest = g.n % p.columns;
    return g.n > p.columns && rest <= p.columns / 2 ? rest : 0;
}

}  // namespace

int64_t gemmPanelSteps(int64_t k) { return ceilDiv(k, kGemmUnroll) * kGemmUnroll; }

int64_t gemmPanelRows(const Device& device, int64_t m) {
    if (auto matrices = device.matrixUnits()) return kMatrixFragments * matrices->m;
    if (!runsOnCpu(device)) return kStagedPanelRows;
    const GemmTuning& tuning = gemmTuning(device);
    // A tile may reach over the last row.
    const std::pair<int64_t, double> rowCosts[] = {
        {32, 1.0}, {16, tuning.cost16}, {8, tuning.cost8}};
    double best = 0;
    int64_t chosen = 0;
    for (auto [rows, cost] : rowCosts) {
        double time = static_cast<double>(ceilDiv(m, rows) * rows) * cost;
        if (best == 0 || time < best) {
            best = time;
            chosen = rows;
        }
    }
    return chosen;
}

bool gemmTakesRows(const Device& device) {
    return runsOnCpu(device) && !device.matrixUnits() && device.precision() == Precision::Single;
}

int64_t gemmPanelWidth(const Device& device, int64_t n) {
    if (auto matrices = device.matrixUnits()) return kMatrixFragments * matrices->n;
    if (!runsOnCpu(device)) return stagedPanelWidth(n);
    int64_t lanes = device.info().subgroupSize;
    return n <= 2 * lanes ? 2 * lanes : 4 * lanes;
}

void gemm(Graph& graph, const Tensor& a, const Tensor& b, const Tensor& c, const Gemm& shape) {
    Gemm g = shape;
    CHECK(!g.panelsB || (!g.transB && g.ldb == 0 && g.startB == 0), "panels of B are packed");
    CHECK(!g.panelsA || (!g.transA && g.lda == 0 && g.startA == 0), "panels of A are packed");
    if (g.lda == 0) g.lda = g.transA ? g.m : g.k;
    if (g.ldb == 0) g.ldb = g.transB ? g.k : g.n;
    if (g.ldc == 0) g.ldc = g.n;
    if (g.m == 0 || g.n == 0 || g.batch == 0) return;
    auto reach = [&](int64_t start, int64_t rows, int64_t columns, int64_t ld, int64_t stride) {
        return rows == 0 || columns == 0
                   ? 0
                   : start + (g.batch - 1) * stride + (rows - 1) * ld + columns;
    };
    int64_t reachA = reach(g.startA, g.transA ? g.k : g.m, g.transA ? g.m : g.k, g.lda, g.strideA);
    int64_t reachB = reach(g.startB, g.transB ? g.n : g.k, g.transB ? g.k : g.n, g.ldb, g.strideB);
    int64_t reachC = reach(g.startC, g.m, g.n, g.ldc, g.strideC);
    CHECK(reachA <= a.elements() && reachB <= b.elements() && reachC <= c.elements(),
          "the matrices of a product {}x{}x{} lie within their tensors", g.m, g.n, g.k);
    CHECK(!g.bias || g.bias.elements() == (g.biasPerRow ? g.m : g.n), "bias fits the product");

    Plan p = plan(graph.device(), g);
    if (g.sums)
        CHECK(g.transA && g.batch == 1 && g.startA == 0 && g.lda == g.m, "A's sums are over rows");
    if (int64_t apart = columnsApart(g, p)) {
        if (g.panelsA) g.lda = 0;  // as it was given
        Gemm wide = g, narrow = g;
        wide.sums = {};
        wide.n = g.n - apart;
        narrow.n = apart;
        narrow.startB += wide.n * (g.transB ? g.ldb : 1);
        narrow.startC += wide.n;
        gemm(graph, a, b, c, wide);
        gemm(graph, a, b, c, narrow);
        return;
    }
    if (g.panelsB) {  // a single panel is a matrix of its width
        Gemm matrix = g;
        matrix.panelsB = false;
        matrix.ldb = p.columns;
        if (isNarrow(matrix, p)) g = matrix;
    }
    const bool narrow = isNarrow(g, p);
    if (narrow && !g.transA) return narrowRows(graph, a, b, c, g, p);
    if (narrow) p.panelsA = p.panelsB = false;
    if (g.sums && !narrow) sumAxis(graph, a, 1, g.k, g.m, g.sums);
    // A's panels have only the rows that are listed, so that C can have no others.
    const bool listed = g.rows && g.panelsA;
    CHECK(!listed || gemmTakesRows(graph.device()), "this product can leave rows out");
    Tensor left = a, right = b;
    uint32_t layoutA = g.transA ? kLayoutTransposed : g.panelsA ? kLayoutRowPanels : kLayoutRows;
    uint32_t layoutB = g.transB ? kLayoutTransposed : g.panelsB ? kLayoutColumnPanels : kLayoutRows;
    if (g.panelsA) g.lda = gemmPanelSteps(g.k) * p.panelRows;
    if (g.panelsB) g.ldb = g.k * p.panelWidth;
    int64_t stepsA = p.halves ? halfPanelSteps(g.k) : gemmPanelSteps(g.k);
    // A tile of few columns takes two steps of them from a texel.
    const bool interleaved = p.onCpu && p.panelsB && !p.halves && !g.panelsB && p.pairs == 1;
    int64_t stepsB = p.halves ? stepsA : interleaved ? ceilDiv(g.k, 2) * 2 : g.k;
    if (p.panelsA && g.k > 0) {
        int64_t matrices = g.strideA == 0 ? 1 : g.batch;
        Source source{
            a, g.startA, matrices, g.strideA, g.m, g.transA ? 1 : g.lda, g.transA ? g.lda : 1};
        if (g.panelsA)  // panels already, of single precision
            source = {a, 0, matrices, g.strideA, ceilDiv(g.m, p.panelRows) * p.panelRows,
                      1, p.panelRows, g.lda};
        left = pack(graph, source, g.k, stepsA, u32(p.panelRows), p.halves, g.largestA);
        layoutA = kLayoutRowPanels;
        g.startA = 0;
        g.lda = stepsA * p.panelRows;
        if (matrices > 1) g.strideA = ceilDiv(g.m, p.panelRows) * g.lda;
    }
    if (p.panelsB && g.k > 0) {
        int64_t matrices = g.strideB == 0 ? 1 : g.batch;
        Source source{
            b, g.startB, matrices, g.strideB, g.n, g.transB ? g.ldb : 1, g.transB ? 1 : g.ldb};
        if (g.panelsB) {
            int64_t width = p.panelWidth;
            source = {b, 0, matrices, g.strideB, ceilDiv(g.n, width) * width, 1, width, g.ldb};
        }
        right =
            pack(graph, source, g.k, stepsB, u32(p.panelWidth), p.halves, g.largestB, interleaved);
        layoutB = interleaved ? kLayoutInterleaved : kLayoutColumnPanels;
        g.startB = 0;
        g.ldb = stepsB * p.panelWidth;
        if (matrices > 1) g.strideB = ceilDiv(g.n, p.panelWidth) * g.ldb;
    }
    bool split = p.parts > 1;
    Tensor out = split ? graph.temporary({p.parts, g.batch, g.m, g.n}) : c;
    if (split && listed) graph.keep(out);
    if (split) {
        g.ldc = g.n;
        g.startC = 0;
        g.strideC = g.m * g.n;
    }
    Tensor sums = !narrow || !g.sums ? graph.none()
                  : split            ? graph.temporary({p.parts, g.m})
                                     : g.sums;
    int64_t strideCPart = g.batch * g.m * g.n;
    GemmParams params = gemmParams(g);
    params.kPart = u32(p.kPart);
    Groups groups{u32(ceilDiv(g.m, p.rows)), u32(ceilDiv(g.n, p.columns)),
                  u32(p.parts * g.batch)};
    Tensor bias = g.bias ? g.bias : graph.none();
    Tensor largest = g.largestA ? g.largestA : g.largestB;
    CHECK(!g.largestA || !g.largestB, "one side of a product at most is made of gradients");
    const bool accumulates = !split && g.accumulate, scaled = g.largestA || g.largestB;
    const uint32_t biasOf = split ? 0 : biasKind(g), clamp = split ? 0 : clampKind(g);
    auto quads = [](bool wanted, std::initializer_list<int64_t> values) {
        return wanted && divisible(4, values);
    };
    Specialisation spec{{"local_size", p.lanes}};
    if (!largest) largest = graph.none();
    graph.expectFlops(flops(g));
    if (p.matrices || p.onCpu)
        spec.insert({{"kAccumulate", accumulates}, {"kBias", biasOf}, {"kClamp", clamp}});
    if (p.matrices) {
        spec["kScaled"] = scaled;
        spec["kMatrixM"] = p.matrices->m;
        spec["kMatrixN"] = p.matrices->n;
        spec["kMatrixK"] = p.matrices->k;
        spec["kDirect"] = g.m % p.rows == 0 && g.n % p.columns == 0 &&
                          (split || (!g.accumulate && !g.bias && clampKind(g) == 0));
        graph.dispatchGroups(
            "linalg/gemm_matrix.tile",
            {{"a", left}, {"b", right}, {"c", out}, {"bias", bias}, {"largest", largest}}, params,
            groups, spec);
    } else if (!p.onCpu) {
        spec.insert({{"kSide", u32(p.rows)},
                     {"kLayoutA", layoutA},
                     {"kLayoutB", layoutB},
                     {"kPanelA", u32(p.panelRows)},
                     {"kPanelB", u32(p.panelWidth)},
                     {"kHalves", p.halves}});
        const bool rowPanels = layoutA == kLayoutRowPanels;
        const bool columnPanels = layoutB == kLayoutColumnPanels;
        const std::pair<uint32_t, bool> traits[] = {
            {kGemmAccumulates, accumulates},
            {kGemmBiasOfColumns, biasOf == 1},
            {kGemmBiasOfRows, biasOf == 2},
            {kGemmClamps, clamp > 0},
            {kGemmClampsAtSix, clamp > 1},
            {kGemmScaled, scaled},
            {kGemmQuadsA, !p.halves && (rowPanels || quads(layoutA == kLayoutTransposed,
                                                           {g.lda, g.startA, g.strideA, g.m}))},
            {kGemmQuadsB, !p.halves && (columnPanels || quads(layoutB == kLayoutRows,
                                                              {g.ldb, g.startB, g.strideB, g.n}))},
            {kGemmQuadsC, quads(true, {g.ldc, g.startC, g.strideC, g.n, split ? strideCPart : 0})}};
        for (auto [trait, holds] : traits) spec["kTraits"] |= holds ? trait : 0;
        graph.dispatchGroups("linalg/gemm_staged.tile",
                             {{"a", left},
                              {"b", right},
                              {"c", out},
                              {"bias", bias},
                              {"largest", largest},
                              {"aQuads", left},
                              {"bQuads", right},
                              {"cQuads", out}},
                             params, groups, spec);
    } else if (narrow) {
        groups.x = u32(ceilDiv(g.m, int64_t{4} * p.lanes));
        graph.dispatchGroups("linalg/gemm_narrow.columns",
                             {{"a", a}, {"b", b}, {"c", out}, {"sums", sums}}, params, groups,
                             {{"local_size", p.lanes},
                              {"kLanes", p.lanes},
                              {"kColumns", u32(g.n)},
                              {"kTransB", false},
                              {"kSums", bool(g.sums)}});
    } else {
        const bool panelsB = layoutB == kLayoutColumnPanels || layoutB == kLayoutInterleaved;
        spec.insert(
            {{"kLanes", p.lanes},
             {"kRows", u32(p.rows)},
             {"kPairs", p.pairs},
             {"kLayoutA", layoutA},
             {"kLayoutB", layoutB},
             {"kHalves", p.halves},
             {"kScaled", scaled},
             {"kWholeRows", !listed && g.m % p.rows == 0},
             {"kWholeColumns", g.n % p.columns == 0},
             {"kQuadA", !p.halves && (layoutA == kLayoutRowPanels ||
                                      quads(true, {g.lda, g.startA, g.strideA}))},
             {"kQuadB",
              !p.halves &&
                  (panelsB || quads(true, {g.ldb, g.startB, g.strideB, g.transB ? g.k : 0}))},
             {"kEvenC",
              divisible(2, {g.ldc, g.startC, g.strideC, g.n, split ? strideCPart : 0})},
             {"kListed", listed}});
        std::initializer_list<Argument> arguments{
            {"a", left},       {"b", right},         {"c", out},
            {"bias", bias},    {"largest", largest}, {"aQuads", left},
            {"bQuads", right}, {"cPairs", out},      {"listed", g.rows.list(graph)}};
        if (listed)
            graph.dispatchIndirect("linalg/gemm.tile", arguments, params,
                                   g.rows.groups(u32(p.rows / kRowsListed), groups.y, groups.z), spec);
        else
            graph.dispatchGroups("linalg/gemm.tile", arguments, params, groups, spec);
    }
    if (!split) return;
    GemmReduceParams reduce{.elements = u32(strideCPart),
                            .ldc = u32(shape.ldc ? shape.ldc : g.n),
                            .startC = u32(shape.startC),
                            .strideC = u32(shape.strideC),
                            .parts = u32(p.parts),
                            .byRows = divisorOf(uint64_t(g.m)),
                            .byColumns = divisorOf(uint64_t(g.n))};
    graph.dispatch(
        "linalg/gemm_reduce.sum", {{"partial", out}, {"c", c}, {"bias", bias}}, reduce,
        static_cast<uint64_t>(strideCPart),
        {{"kAccumulate", g.accumulate}, {"kBias", biasKind(g)}, {"kClamp", clampKind(g)}});
    if (narrow && g.sums) sumAxis(graph, sums, 1, p.parts, g.m, g.sums);
}

}  // namespace doppel
