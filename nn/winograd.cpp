#include "nn/winograd.h"

#include <algorithm>

#include "conv/params.h"
#include "nn/linalg.h"

namespace doppel {

namespace {

constexpr int64_t kMatrices = 9;
// What a piece holds in tiles: enough to keep a device busy, and a bound for the memory it takes.
constexpr int64_t kPieceElements = int64_t{1} << 22;

// Some tiles of one image, or all tiles of some images.
struct Piece {
    int64_t firstImage, images, firstTile, tiles;  // tiles of one image
    int64_t count() const { return images * tiles; }
};

int64_t tilesOf(const Windows& w) { return w.windows() / 4; }

std::vector<Piece> pieces(const Windows& w, bool wholeImages) {
    constexpr int64_t kMultiple = 32;  // tiles; of a panel's width
    int64_t tiles = tilesOf(w), perTile = kMatrices * (4 * w.channels + w.features);
    int64_t fit = std::max(kPieceElements / perTile / kMultiple, int64_t{4}) * kMultiple;
    std::vector<Piece> result;
    int64_t images = std::clamp<int64_t>(fit / tiles, 1, w.images);
    for (int64_t n = 0; n < w.images; n += images) {
        int64_t together = std::min(images, w.images - n);
        int64_t part = together > 1 || wholeImages ? tiles : std::min(tiles, fit);
        for (int64_t first = 0; first < tiles; first += part)
            result.push_back({n, together, first, std::min(part, tiles - first)});
    }
    return result;
}

enum class Layout : uint32_t { Rows, TilePanels, RowPanels };

struct TileKernel {
    const char* name;
    bool finer;  // of the two images
    bool toTiles = false;
    Layout layout = Layout::Rows;
};

int64_t rowsOf(const Windows& w, bool finer) { return finer ? 4 * w.channels : w.features; }

// Elements of one of the nine matrices.
int64_t matrixElements(const Device& device, const Windows& w, const Piece& piece, bool finer,
                       Layout layout) {
    int64_t rows = rowsOf(w, finer), across = piece.count(), along = rows;
    if (layout == Layout::Rows) return rows * across;
    if (layout == Layout::RowPanels) std::swap(across, along);
    int64_t width = gemmPanelWidth(device, across);
    return (across + width - 1) / width * width * along;
}

void dispatchTiles(Graph& graph, const TileKernel& kernel, const Windows& w, const Piece& piece,
                   const Tensor& image, const Tensor& matrices, const Tensor& bias = {}) {
    int64_t channels = kernel.finer ? w.channels : w.features;
    int64_t height = kernel.finer ? w.height : w.outHeight;
    int64_t width = kernel.finer ? w.width : w.outWidth;
    WinogradParams params{
        .channels = u32(channels),
        .height = u32(height),
        .width = u32(width),
        .tiles = u32(piece.tiles),
        .firstTile = u32(piece.firstTile),
        .images = u32(piece.images),
        .startImage = u32(piece.firstImage * channels * height * width),
        .strideMatrix = u32(matrixElements(graph.device(), w, piece, kernel.finer, kernel.layout)),
        .byPairs = divisorOf(uint64_t(w.outWidth / 4))};
    Specialisation spec;
    Groups groups = planes(piece.tiles / 2, channels, piece.images, spec);
    int64_t rows = rowsOf(w, kernel.finer);
    spec["kLayout"] = static_cast<uint32_t>(kernel.layout);
    spec["kWidth"] = u32(
        gemmPanelWidth(graph.device(), kernel.layout == Layout::RowPanels ? rows : piece.count()));
    spec["kBias"] = bias ? 1 : 0;
    if (kernel.toTiles)
        graph.dispatchGroups(kernel.name, {{"image", image}, {"matrices", matrices}}, params,
                             groups, spec);
    else
        graph.dispatchGroups(
            kernel.name,
            {{"matrices", matrices}, {"result", image}, {"bias", bias ? bias : graph.none()}},
            params, groups, spec);
}

// Matrices of one image for a product.
Tensor toTiles(Graph& graph, bool finer, Layout layout, const Windows& w, const Piece& piece,
               const Tensor& image) {
    Tensor matrices =
        graph.temporary({kMatrices, matrixElements(graph.device(), w, piece, finer, layout)});
    const char* name = finer ? "conv/winograd.fine_to_tiles" : "conv/winograd.coarse_to_tiles";
    dispatchTiles(graph, {name, finer, true, layout}, w, piece, image, matrices);
    return matrices;
}

WinogradWeightsParams weightsParams(const Windows& w) {
    return {.pairs = u32(w.features * w.channels),
            .strideMatrix = u32(4 * w.features * w.channels)};
}

Tensor weightsToTiles(Graph& graph, const Windows& w, const Tensor& weight) {
    Tensor matrices = graph.temporary({kMatrices, w.features, 4 * w.channels});
    WinogradWeightsParams params = weightsParams(w);
    graph.dispatch("conv/winograd_weights.to_tiles", {{"weight", weight}, {"matrices", matrices}},
                   params, params.pairs);
    return matrices;
}

}  // namespace

bool winogradPays(const Windows& w) {
    return w.kernelH == 4 && w.kernelW == 4 && w.stride == 2 && w.padding == 1 &&
           w.height % 4 == 0 && w.width % 8 == 0 && w.channels >= 16 && w.features >= 16 &&
           w.images * tilesOf(w) >= 64;
}

void winogradGather(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                    const Tensor& bias, const Tensor& maps) {
    Tensor weights = weightsToTiles(graph, w, weight);
    int64_t rows = 4 * w.channels;
    for (const Piece& piece : pieces(w, false)) {
        int64_t tiles = piece.count();
        Tensor seen = toTiles(graph, true, Layout::TilePanels, w, piece, image);
        Tensor products = graph.temporary({kMatrices, w.features, tiles});
        gemm(graph, weights, seen, products,
             {.m = w.features,
              .n = tiles,
              .k = rows,
              .panelsB = true,
              .batch = kMatrices,
              .strideA = w.features * rows,
              .strideB = seen.dim(1),
              .strideC = w.features * tiles});
        dispatchTiles(graph, {"conv/winograd.coarse_from_tiles", false}, w, piece, maps, products,
                      bias);
    }
}

void winogradSum(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                 const Tensor& bias, const Tensor& image) {
    Tensor weights = weightsToTiles(graph, w, weight);
    int64_t rows = 4 * w.channels;
    for (const Piece& piece : pieces(w, true)) {
        int64_t tiles = piece.count();
        Tensor given = toTiles(graph, false, Layout::TilePanels, w, piece, maps);
        Tensor products = graph.temporary({kMatrices, rows, tiles});
        gemm(graph, weights, given, products,
             {.m = rows,
              .n = tiles,
              .k = w.features,
              .transA = true,
              .panelsB = true,
              .batch = kMatrices,
              .strideA = w.features * rows,
              .strideB = given.dim(1),
              .strideC = rows * tiles});
        dispatchTiles(graph, {"conv/winograd.fine_from_tiles", true}, w, piece, image, products,
                      bias);
    }
}

void winogradWeights(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                     const Tensor& dweight) {
    int64_t rows = 4 * w.channels;
    Tensor sums = graph.temporary({kMatrices, w.features, rows});
    bool first = true;
    for (const Piece& piece : pieces(w, false)) {
        int64_t tiles = piece.count();
        Tensor given = toTiles(graph, false, Layout::Rows, w, piece, maps);
        Tensor seen = toTiles(graph, true, Layout::RowPanels, w, piece, image);
        gemm(graph, given, seen, sums,
             {.m = w.features,
              .n = rows,
              .k = tiles,
              .panelsB = true,
              .accumulate = !first,
              .batch = kMatrices,
              .strideA = w.features * tiles,
              .strideB = seen.dim(1),
              .strideC = w.features * rows});
        first = false;
    }
    WinogradWeightsParams params = weightsParams(w);
    graph.dispatch("conv/winograd_weights.from_tiles", {{"weight", dweight}, {"matrices", sums}},
                   params, params.pairs);
}

}  // namespace doppel
