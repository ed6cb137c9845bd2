#include "nn/winograd.h"

#include <algorithm>

#include "conv/params.h"
#include "nn/linalg.h"

namespace doppel {

namespace {

// What a piece holds in tiles: enough to keep a device busy, and a bound for the memory it takes.
constexpr int64_t kPieceElements = int64_t{1} << 22, kFewestTiles = 256;

// How a layer is cut into tiles. Stride 2: nine matrices, [4 channels, tiles] of the image and
// [features, tiles] of the maps, tiles of 2x2 windows. Stride 1: 81 matrices, or 64 of kernels 3x3,
// one row per channel or feature, tiles of 4x4 windows.
struct Tiling {
    explicit Tiling(const Windows& w) : strided(w.stride == 2) {
        int64_t windows = strided ? 2 : 4;
        across = (w.outWidth + windows - 1) / windows;
        tiles = across * ((w.outHeight + windows - 1) / windows);
        side = strided ? 3 : w.kernelW == 3 ? 8 : 9;
        matrices = side * side;
        channelRows = strided ? 4 * w.channels : w.channels;
    }
    bool strided;
    int64_t across, tiles;   // in a row, in an image
    int64_t side, matrices;  // products in one dimension, in two
    int64_t channelRows;
};

// Some tiles of one image, or all tiles of some images.
struct Piece {
    int64_t firstImage, images, firstTile, tiles;  // tiles of one image
    int64_t count() const { return images * tiles; }
};

std::vector<Piece> pieces(const Windows& w, bool wholeImages) {
    constexpr int64_t kMultiple = 32;  // tiles; of a panel's width
    Tiling tiling(w);
    int64_t perTile = tiling.matrices * (tiling.channelRows + w.features);
    int64_t fit = std::max(kPieceElements / perTile / kMultiple * kMultiple, kFewestTiles);
    std::vector<Piece> result;
    int64_t images = std::clamp<int64_t>(fit / tiling.tiles, 1, w.images);
    for (int64_t n = 0; n < w.images; n += images) {
        int64_t together = std::min(images, w.images - n);
        int64_t part = together > 1 || wholeImages ? tiling.tiles : std::min(tiling.tiles, fit);
        for (int64_t first = 0; first < tiling.tiles; first += part)
            result.push_back({n, together, first, std::min(part, tiling.tiles - first)});
    }
    return result;
}

enum class Layout : uint32_t { Rows, TilePanels, RowPanels };
enum class Side { Image, Maps };

int64_t rowsOf(const Windows& w, Side side) {
    return side == Side::Image ? Tiling(w).channelRows : w.features;
}

// Elements of one matrix.
int64_t matrixElements(const Device& device, const Windows& w, const Piece& piece, Side side,
                       Layout layout) {
    int64_t rows = rowsOf(w, side), across = piece.count(), along = rows;
    if (layout == Layout::Rows) return rows * across;
    if (layout == Layout::RowPanels) std::swap(across, along);
    int64_t width = gemmPanelWidth(device, across);
    return (across + width - 1) / width * width * along;
}

// Parameters, workgroups and constants of the kernels between an image or maps and matrices.
struct TileDispatch {
    WinogradParams params;
    Specialisation spec;
    Groups groups;
};
TileDispatch tileDispatch(const Device& device, const Windows& w, const Piece& piece, Side side,
                          Layout layout) {
    Tiling tiling(w);
    bool image = side == Side::Image;
    int64_t channels = image ? w.channels : w.features;
    int64_t height = image ? w.height : w.outHeight, width = image ? w.width : w.outWidth;
    TileDispatch d;
    d.params = {.channels = u32(channels),
                .height = u32(height),
                .width = u32(width),
                .tiles = u32(piece.tiles),
                .firstTile = u32(piece.firstTile),
                .images = u32(piece.images),
                .startImage = u32(piece.firstImage * channels * height * width),
                .strideMatrix = u32(matrixElements(device, w, piece, side, layout)),
                .padding = u32(w.padding),
                .byRow = divisorOf(uint64_t(tiling.strided ? tiling.across / 2 : tiling.across))};
    int64_t invocations = tiling.strided ? piece.tiles / 2 : piece.tiles;
    d.groups = planes(invocations, channels, piece.images, d.spec);
    int64_t across = layout == Layout::RowPanels ? rowsOf(w, side) : piece.count();
    d.spec["kLayout"] = static_cast<uint32_t>(layout);
    d.spec["kWidth"] = u32(gemmPanelWidth(device, across));
    if (!tiling.strided) d.spec["kSide"] = u32(tiling.side);
    return d;
}

Tensor toTiles(Graph& graph, Side side, Layout layout, const Windows& w, const Piece& piece,
               const Tensor& image) {
    TileDispatch d = tileDispatch(graph.device(), w, piece, side, layout);
    Tensor matrices = graph.temporary({Tiling(w).matrices, d.params.strideMatrix});
    const bool fine = side == Side::Image, texels = loadsTexels(graph.device());
    const char* kernel = w.stride == 1 ? fine ? "conv/winograd_dense.image_to_tiles"
                                              : "conv/winograd_dense.results_to_tiles"
                         : texels      ? fine ? "conv/winograd_texels.fine_to_tiles"
                                              : "conv/winograd_texels.coarse_to_tiles"
                         : fine        ? "conv/winograd.fine_to_tiles"
                                       : "conv/winograd.coarse_to_tiles";
    graph.dispatchGroups(kernel, {{"image", image}, {"matrices", matrices}}, d.params, d.groups,
                         d.spec);
    return matrices;
}

void fromTiles(Graph& graph, Side side, const Windows& w, const Piece& piece,
               const Tensor& matrices, const Tensor& bias, const Tensor& image) {
    TileDispatch d = tileDispatch(graph.device(), w, piece, side, Layout::Rows);
    d.spec["kBias"] = bias ? 1 : 0;
    const char* kernel = side == Side::Image ? "conv/winograd.fine_from_tiles"
                         : w.stride == 2     ? "conv/winograd.coarse_from_tiles"
                                             : "conv/winograd_dense.results_from_tiles";
    graph.dispatchGroups(
        kernel, {{"matrices", matrices}, {"result", image}, {"bias", bias ? bias : graph.none()}},
        d.params, d.groups, d.spec);
}

// weight [features, channels, kernel, kernel] and matrices [features, channelRows], or, turned,
// [channels, features].
struct WeightDispatch {
    const char* toTiles;
    const char* fromTiles;
    WinogradWeightsParams params;
    Specialisation spec;
};
WeightDispatch weightDispatch(const Windows& w) {
    int64_t pairs = w.features * w.channels;
    Tiling tiling(w);
    bool strided = tiling.strided;
    Specialisation spec;
    if (!strided) spec = {{"kKernel", u32(w.kernelW)}, {"kSide", u32(tiling.side)}};
    return {strided ? "conv/winograd_weights.to_tiles" : "conv/winograd_dense_weights.to_tiles",
            strided ? "conv/winograd_weights.from_tiles" : "conv/winograd_dense_weights.from_tiles",
            {.pairs = u32(pairs),
             .strideMatrix = u32(w.features * tiling.channelRows),
             .channels = u32(w.channels),
             .byFeatures = divisorOf(uint64_t(w.features))},
            spec};
}

Tensor weightsToTiles(Graph& graph, const Windows& w, const Tensor& weight, bool turned = false) {
    Tiling tiling(w);
    WeightDispatch d = weightDispatch(w);
    Tensor matrices = graph.temporary({tiling.matrices, w.features, tiling.channelRows});
    if (!tiling.strided) d.spec["kTurned"] = turned;
    graph.dispatch(d.toTiles, {{"weight", weight}, {"matrices", matrices}}, d.params,
                   d.params.pairs, d.spec);
    return matrices;
}

// maps = weights columns(image) (+ bias), the weights as matrices.
void gather(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weights,
            const Tensor& bias, const Tensor& maps) {
    Tiling tiling(w);
    for (const Piece& piece : pieces(w, false)) {
        int64_t tiles = piece.count();
        Tensor seen = toTiles(graph, Side::Image, Layout::TilePanels, w, piece, image);
        Tensor products = graph.temporary({tiling.matrices, w.features, tiles});
        gemm(graph, weights, seen, products,
             {.m = w.features,
              .n = tiles,
              .k = tiling.channelRows,
              .panelsB = true,
              .batch = tiling.matrices,
              .strideA = w.features * tiling.channelRows,
              .strideB = seen.dim(1),
              .strideC = w.features * tiles,
              .largestB = w.largestImage});
        fromTiles(graph, Side::Maps, w, piece, products, bias, maps);
    }
}

}  // namespace

bool winogradPays(const Windows& w) {
    if (w.kernelH != w.kernelW || w.channels < 16 || w.features < 16) return false;
    bool strided =
        w.kernelW == 4 && w.stride == 2 && w.padding == 1 && w.height % 4 == 0 && w.width % 8 == 0;
    bool dense = (w.kernelW == 3 || w.kernelW == 4) && w.stride == 1 && w.padding < w.kernelW;
    if (!strided && !dense) return false;
    // The kernels count elements of all matrices in 32 bits; a piece may be a whole image.
    Tiling tiling(w);
    int64_t rows = std::max({tiling.channelRows, w.features, w.channels});
    int64_t most = std::max({tiling.tiles, kFewestTiles, rows});
    if (tiling.matrices * rows * most >= int64_t{1} << 31) return false;
    return w.images * tiling.tiles >= 64;
}

void winogradGather(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                    const Tensor& bias, const Tensor& maps) {
    gather(graph, w, image, weightsToTiles(graph, w, weight), bias, maps);
}

void winogradSum(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                 const Tensor& bias, const Tensor& image) {
    if (w.stride == 1) {  // a convolution of the maps, with the kernels turned
        Windows turned = w;
        std::swap(turned.channels, turned.features);
        std::swap(turned.height, turned.outHeight);
        std::swap(turned.width, turned.outWidth);
        std::swap(turned.largestImage, turned.largestMaps);
        turned.padding = w.kernelW - 1 - w.padding;
        gather(graph, turned, maps, weightsToTiles(graph, w, weight, true), bias, image);
        return;
    }
    Tiling tiling(w);
    Tensor weights = weightsToTiles(graph, w, weight);
    for (const Piece& piece : pieces(w, true)) {
        int64_t tiles = piece.count();
        Tensor given = toTiles(graph, Side::Maps, Layout::TilePanels, w, piece, maps);
        Tensor products = graph.temporary({tiling.matrices, tiling.channelRows, tiles});
        gemm(graph, weights, given, products,
             {.m = tiling.channelRows,
              .n = tiles,
              .k = w.features,
              .transA = true,
              .panelsB = true,
              .batch = tiling.matrices,
              .strideA = w.features * tiling.channelRows,
              .strideB = given.dim(1),
              .strideC = tiling.channelRows * tiles,
              .largestB = w.largestMaps});
        fromTiles(graph, Side::Image, w, piece, products, bias, image);
    }
}

void winogradWeights(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                     const Tensor& dweight) {
    Tiling tiling(w);
    Tensor sums = graph.temporary({tiling.matrices, w.features, tiling.channelRows});
    bool first = true;
    for (const Piece& piece : pieces(w, false)) {
        int64_t tiles = piece.count();
        Tensor given = toTiles(graph, Side::Maps, Layout::Rows, w, piece, maps);
        Tensor seen = toTiles(graph, Side::Image, Layout::RowPanels, w, piece, image);
        gemm(graph, given, seen, sums,
             {.m = w.features,
              .n = tiling.channelRows,
              .k = tiles,
              .panelsB = true,
              .accumulate = !first,
              .batch = tiling.matrices,
              .strideA = w.features * tiles,
              .strideB = seen.dim(1),
              .strideC = w.features * tiling.channelRows,
              .largestA = w.largestMaps,
              .largestB = w.largestImage});
        first = false;
    }
    WeightDispatch d = weightDispatch(w);
    graph.dispatch(d.fromTiles, {{"weight", dweight}, {"matrices", sums}}, d.params, d.params.pairs,
                   d.spec);
}

}  // namespace doppel
