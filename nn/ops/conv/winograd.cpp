// Convolutions with fewer products (shaders/conv/winograd.glsl has the algebra and the source). Of
// stride 2 the finer image is the windows' image, the coarser one its maps.
#include <algorithm>

#include "common/panels.h"
#include "conv/params.h"
#include "nn/ops/conv/algorithm.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

// What a piece holds in tiles: enough to keep a device busy, and a bound for the memory it takes.
constexpr int64_t kPieceElements = int64_t{1} << 22, kFewestTiles = 256;

// The kernels of convolutions of a stride.
struct Transforms {
    const char *imageToTiles, *mapsToTiles, *imageFromTiles, *mapsFromTiles;
    const char *weightsToTiles, *weightsFromTiles;
};
constexpr Transforms kStrided{
    .imageToTiles = "conv/winograd.fine_to_tiles",
    .mapsToTiles = "conv/winograd.coarse_to_tiles",
    .imageFromTiles = "conv/winograd.fine_from_tiles",
    .mapsFromTiles = "conv/winograd.coarse_from_tiles",
    .weightsToTiles = "conv/winograd_weights.to_tiles",
    .weightsFromTiles = "conv/winograd_weights.from_tiles",
};
// An image's gradient is a convolution of the maps.
constexpr Transforms kDense{
    .imageToTiles = "conv/winograd_dense.image_to_tiles",
    .mapsToTiles = "conv/winograd_dense.results_to_tiles",
    .imageFromTiles = nullptr,
    .mapsFromTiles = "conv/winograd_dense.results_from_tiles",
    .weightsToTiles = "conv/winograd_dense_weights.to_tiles",
    .weightsFromTiles = "conv/winograd_dense_weights.from_tiles",
};

// A way of cutting the layers of some kernel and stride into tiles of windows. A new one is a row
// here, and the matrices of its points in shaders/conv/winograd.glsl.
struct TileShape {
    int64_t kernel, stride;
    int64_t tile;                  // windows of a tile in one dimension
    uint32_t points;               // products in one dimension
    uint32_t taps, set;            // of the points
    bool halves;                   // half precision bears its factors
    int64_t multipleX, multipleY;  // of the maps' sides
    int64_t fewestWindows;         // of all images
    const Transforms* transforms;
};
// A layer takes the first row that it fits. Small maps of stride 2 have smaller tiles: larger ones
// have fewer products, but 25 transformed weights for 16 in place of 9.
constexpr TileShape kShapes[] = {
    {4, 2, 4, 5, 2, 1, false, 8, 4, 1024, &kStrided},
    {4, 2, 2, 3, 2, 0, true, 4, 2, 256, &kStrided},
    {3, 1, 4, 6, 3, 2, false, 1, 1, 320, &kDense},
    {4, 1, 4, 7, 4, 3, false, 1, 1, 320, &kDense},
    {4, 1, 4, 9, 4, 4, true, 1, 1, 320, &kDense},
};

// The layer's row of kShapes; null: it has none.
const TileShape* shapeOf(const Device& device, const Windows& w) {
    for (const TileShape& s : kShapes) {
        // Strided windows cover an image twice as large as the maps.
        const bool padded = s.stride == 2 ? w.padding == 1 && w.height == 2 * w.outHeight &&
                                                w.width == 2 * w.outWidth
                                          : w.padding < s.kernel;
        if (w.kernelH == s.kernel && w.kernelW == s.kernel && w.stride == s.stride && padded &&
            (s.halves || device.precision() == Precision::Single) &&
            w.outWidth % s.multipleX == 0 && w.outHeight % s.multipleY == 0 &&
            w.images * w.windows() >= s.fewestWindows)
            return &s;
    }
    return nullptr;
}

// How a layer is cut into tiles.
struct Tiling {
    Tiling(const TileShape& s, const Windows& w) : shape(s), strided(s.stride == 2) {
        across = (w.outWidth + s.tile - 1) / s.tile;
        tiles = across * ((w.outHeight + s.tile - 1) / s.tile);
        matrices = int64_t{s.points} * s.points;
        rowsEach = strided ? 4 : 1;
        channelRows = rowsEach * w.channels;
    }

    Specialisation specialisation() const {
        return {{"kSet", shape.set},
                {"kPoints", shape.points},
                {"kResults", u32(shape.tile)},
                {"kTaps", shape.taps}};
    }

    const TileShape& shape;
    bool strided;
    int64_t across = 0, tiles = 0;          // in a row, in an image
    int64_t matrices = 0;                   // products in two dimensions
    int64_t rowsEach = 0, channelRows = 0;  // rows of a channel of the image, of all
};

// Some tiles of one image, or all tiles of some images.
struct Piece {
    int64_t firstImage, images, firstTile, tiles;  // tiles of one image
    int64_t count() const { return images * tiles; }
};

std::vector<Piece> pieces(const Tiling& tiling, const Windows& w, bool wholeImages) {
    constexpr int64_t kMultiple = 32;  // tiles; of a panel's width
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

// Features, or channels of the image, whose weights are transformed at once.
struct Part {
    int64_t first, count;
};

// Transformed weights are several times what they were of; so a product takes as many rows of them
// at a time as stay in a cache until they are used (GPUs: as keep them busy). With several pieces
// they wait for all of these, and are made at once.
std::vector<Part> parts(const Device& device, int64_t channels, int64_t elementsEach,
                        size_t pieces) {
    constexpr int64_t kOfCpu = int64_t{1} << 20, kOfGpu = int64_t{1} << 24;
    constexpr int64_t kMultiple = 32;  // rows of a panel
    int64_t elements = device.kernelPath().texels ? kOfCpu : kOfGpu;
    int64_t fit = pieces > 1 ? channels : std::max<int64_t>(1, elements / elementsEach);
    int64_t count = (channels + fit - 1) / fit;
    int64_t each = ((channels + count - 1) / count + kMultiple - 1) / kMultiple * kMultiple;
    std::vector<Part> result;
    for (int64_t first = 0; first < channels; first += each)
        result.push_back({first, std::min(each, channels - first)});
    return result;
}

enum class Side { Image, Maps };

// The matrices of one side of a piece.
struct Matrices {
    uint32_t layout = kLayoutRows;  // rows; panels of A's or B^T's rows; panels of B's columns
    int64_t width = 1;              // of a panel
    int64_t panelSteps = 0;         // of a panel of rows: tiles, or some more, zeros then
    int64_t elements = 0;           // from one matrix to the next

    // rows x tiles, row by row.
    static Matrices rows(int64_t rows, int64_t tiles) {
        Matrices m;
        m.elements = apart(rows * tiles);
        return m;
    }
    // For B: [rows, tiles], a panel being some tiles.
    static Matrices tilePanels(const Device& device, int64_t rows, int64_t tiles) {
        Matrices m;
        m.layout = kLayoutColumnPanels;
        m.width = gemmPanelWidth(device, tiles);
        m.elements = apart((tiles + m.width - 1) / m.width * m.width * rows);
        return m;
    }
    // For B: [tiles, rows]; or for A: [rows, tiles]; a panel being some rows.
    static Matrices rowPanels(int64_t width, int64_t rows, int64_t steps) {
        Matrices m;
        m.layout = kLayoutRowPanels;
        m.width = width;
        m.panelSteps = steps;
        m.elements = apart((rows + width - 1) / width * width * steps);
        return m;
    }

private:
    // A kernel that makes tiles writes to the same place of all matrices. Were these a power of two
    // apart, all would fall into the same few lines of a CPU's cache.
    static int64_t apart(int64_t elements) {
        constexpr int64_t kLine = 16;
        return (elements + kLine - 1) / kLine * kLine + kLine;
    }
};

// A tensor of a layer's matrices; zeros where panels have steps that none of the rows has.
Tensor matricesTensor(Graph& graph, const Tiling& tiling, const Matrices& m, int64_t steps) {
    Tensor matrices = graph.temporary({tiling.matrices, m.elements});
    if (m.layout == kLayoutRowPanels && m.panelSteps != steps) graph.fill(matrices);
    return matrices;
}

// Parameters, workgroups and constants of the kernels between an image or maps and matrices.
struct TileDispatch {
    WinogradParams params;
    Specialisation spec;
    Groups groups;
};
Part whole(const Windows& w, Side side) {
    return {0, side == Side::Image ? w.channels : w.features};
}
TileDispatch tileDispatch(const Tiling& tiling, const Windows& w, const Piece& piece, Side side,
                          const Part& part, const Matrices& matrices) {
    bool image = side == Side::Image;
    int64_t channels = whole(w, side).count;
    int64_t height = image ? w.height : w.outHeight, width = image ? w.width : w.outWidth;
    TileDispatch d{.spec = tiling.specialisation()};
    d.params = {.channels = u32(channels),
                .height = u32(height),
                .width = u32(width),
                .firstChannel = u32(part.first),
                .partChannels = u32(part.count),
                .tiles = u32(piece.tiles),
                .firstTile = u32(piece.firstTile),
                .images = u32(piece.images),
                .startImage = u32(piece.firstImage * channels * height * width),
                .strideMatrix = u32(matrices.elements),
                .panelSteps = u32(matrices.panelSteps),
                .padding = u32(w.padding),
                .byRow = divisorOf(uint64_t(tiling.strided ? tiling.across / 2 : tiling.across))};
    // Invocations side by side write side by side: tiles or, in panels of rows, channels. Of the
    // image under strided windows, rows of either parity are a workgroup's.
    int64_t along = tiling.strided ? piece.tiles / 2 : piece.tiles, across = part.count;
    if (matrices.layout == kLayoutRowPanels) std::swap(along, across);
    if (tiling.strided && image) across *= 2;
    d.groups = planes(along, across, piece.images, d.spec);
    d.spec["kLayout"] = matrices.layout;
    d.spec["kWidth"] = u32(matrices.width);
    return d;
}

Tensor toTiles(Graph& graph, const Tiling& tiling, Side side, const Matrices& layout,
               const Windows& w, const Piece& piece, const Part& part, const Tensor& image) {
    TileDispatch d = tileDispatch(tiling, w, piece, side, part, layout);
    Tensor matrices = matricesTensor(graph, tiling, layout, piece.count());
    const Transforms& kernels = *tiling.shape.transforms;
    graph.dispatchGroups(side == Side::Image ? kernels.imageToTiles : kernels.mapsToTiles,
                         {{"image", image}, {"matrices", matrices}, {"single", matrices}}, d.params,
                         d.groups, d.spec);
    return matrices;
}

void fromTiles(Graph& graph, const Tiling& tiling, Side side, const Windows& w, const Piece& piece,
               const Part& part, const Tensor& matrices, const Tensor& bias, const Tensor& image) {
    int64_t rows = part.count * (side == Side::Image ? tiling.rowsEach : 1);
    TileDispatch d =
        tileDispatch(tiling, w, piece, side, part, Matrices::rows(rows, piece.count()));
    d.spec["kBias"] = bias ? 1 : 0;
    const Transforms& kernels = *tiling.shape.transforms;
    graph.dispatchGroups(
        side == Side::Image ? kernels.imageFromTiles : kernels.mapsFromTiles,
        {{"matrices", matrices}, {"result", image}, {"bias", bias ? bias : graph.none()}}, d.params,
        d.groups, d.spec);
}

// Of weight [features, channels, kernel, kernel].
WinogradWeightsParams weightsParams(const Windows& w, int64_t invocations, const Part& part,
                                    const Matrices& matrices, bool turned) {
    return {.invocations = u32(invocations),
            .features = u32(w.features),
            .channels = u32(w.channels),
            .first = u32(part.first),
            .strideMatrix = u32(matrices.elements),
            .panelSteps = u32(matrices.panelSteps),
            .bySteps = divisorOf(uint64_t(turned ? w.features : w.channels))};
}

// The left side of a product: matrices [features, channelRows] of a part of the features or,
// turned, [channelRows, features] of a part of the channels, in panels of A's rows. Kernels of
// stride 1 are turned by half a turn then.
struct Weights {
    Tensor matrices;
    int64_t rows = 0, steps = 0;
};
Weights weightsToTiles(Graph& graph, const Tiling& tiling, const Windows& w, const Part& part,
                       const Tensor& weight, bool turned) {
    Weights result{{},
                   turned ? part.count * tiling.rowsEach : part.count,
                   turned ? w.features : tiling.channelRows};
    Matrices layout = Matrices::rowPanels(gemmPanelRows(graph.device(), result.rows), result.rows,
                                          gemmPanelSteps(result.steps));
    result.matrices = matricesTensor(graph, tiling, layout, result.steps);
    // Rows of a panel that an invocation makes.
    int64_t rowsEach = !tiling.strided ? 1 : turned ? 4 : 2;
    int64_t panels = (result.rows + layout.width - 1) / layout.width;
    int64_t invocations = panels * (layout.width / rowsEach) * (turned ? w.features : w.channels);
    Specialisation spec = tiling.specialisation();
    spec["kTurned"] = turned;
    spec["kWidth"] = u32(layout.width);
    graph.dispatch(tiling.shape.transforms->weightsToTiles,
                   {{"weight", weight}, {"matrices", result.matrices}},
                   weightsParams(w, invocations, part, layout, turned),
                   static_cast<uint64_t>(invocations), spec);
    return result;
}

// Per matrix, products [rows, tiles] = weights B, with B's tiles in panels.
Tensor products(Graph& graph, const Weights& weights, const Tensor& tiles, int64_t count,
                const Tensor& largest) {
    Matrices layout = Matrices::rows(weights.rows, count);
    Tensor result = graph.temporary({weights.matrices.dim(0), layout.elements});
    gemm(graph, weights.matrices, tiles, result,
         {.m = weights.rows,
          .n = count,
          .k = weights.steps,
          .panelsB = true,
          .panelsA = true,
          .batch = result.dim(0),
          .strideA = weights.matrices.dim(1),
          .strideB = tiles.dim(1),
          .strideC = layout.elements,
          .largestB = largest});
    return result;
}

// The other side of the layer w = weights given (+ bias). turned: weights [channels, features],
// which are those of the layer weightsOf, of which w is the transpose where the stride is 1.
void convolve(Graph& graph, const TileShape& shape, const Windows& w, Side side,
              const Tensor& given, const Windows& weightsOf, bool turned, const Tensor& weight,
              const Tensor& bias, const Tensor& result) {
    Tiling tiling(shape, w);
    const bool gathers = side == Side::Image;
    const Side made = gathers ? Side::Maps : Side::Image;
    const Tensor& largest = gathers ? w.largestImage : w.largestMaps;
    int64_t rows = gathers ? tiling.channelRows : w.features;
    int64_t elementsEach = tiling.matrices * rows * (gathers ? 1 : tiling.rowsEach);
    std::vector<Piece> ofTiles = pieces(tiling, w, !gathers);
    std::vector<Part> ofWeights =
        parts(graph.device(), whole(w, made).count, elementsEach, ofTiles.size());
    Weights weights;
    for (const Piece& piece : ofTiles) {
        int64_t tiles = piece.count();
        Tensor seen =
            toTiles(graph, tiling, side, Matrices::tilePanels(graph.device(), rows, tiles), w,
                    piece, whole(w, side), given);
        for (const Part& part : ofWeights) {
            if (!weights.matrices || ofWeights.size() > 1)
                weights = weightsToTiles(graph, tiling, weightsOf, part, weight, turned);
            Tensor sums = products(graph, weights, seen, tiles, largest);
            fromTiles(graph, tiling, made, w, piece, part, sums, bias, result);
        }
    }
}

bool winogradPays(const Device& device, const Windows& w) {
    const TileShape* shape = shapeOf(device, w);
    if (!shape || w.channels < 16 || w.features < 16) return false;
    // The kernels count elements of all matrices in 32 bits; a piece may be a whole image.
    Tiling tiling(*shape, w);
    int64_t rows = std::max({tiling.channelRows, w.features, w.channels});
    int64_t most = std::max({tiling.tiles, kFewestTiles, rows});
    return tiling.matrices * rows * most < int64_t{1} << 31;
}

void winogradGather(Graph& graph, const Windows& w, const Tensor& image, const Tensor& weight,
                    const Tensor& bias, const Tensor& maps) {
    const TileShape& shape = *shapeOf(graph.device(), w);
    convolve(graph, shape, w, Side::Image, image, w, false, weight, bias, maps);
}

void winogradSum(Graph& graph, const Windows& w, const Tensor& maps, const Tensor& weight,
                 const Tensor& bias, const Tensor& image) {
    const TileShape& shape = *shapeOf(graph.device(), w);
    if (shape.stride == 2)
        return convolve(graph, shape, w, Side::Maps, maps, w, true, weight, bias, image);
    // A convolution of the maps, with the kernels turned.
    convolve(graph, shape, w.turned(), Side::Image, maps, w, true, weight, bias, image);
}

void winogradWeights(Graph& graph, const Windows& w, const Tensor& image, const Tensor& maps,
                     const Tensor& dweight) {
    const Device& device = graph.device();
    Tiling tiling(*shapeOf(device, w), w);
    std::vector<Piece> ofTiles = pieces(tiling, w, false);
    std::vector<Part> ofWeights =
        parts(device, w.features, tiling.matrices * tiling.channelRows, ofTiles.size());
    Matrices layout = Matrices::rows(ofWeights.front().count, tiling.channelRows);
    Tensor sums = graph.temporary({tiling.matrices, layout.elements});
    for (const Piece& piece : ofTiles) {
        int64_t tiles = piece.count();
        Tensor seen = toTiles(graph, tiling, Side::Image,
                              Matrices::rowPanels(gemmPanelWidth(device, tiling.channelRows),
                                                  tiling.channelRows, tiles),
                              w, piece, whole(w, Side::Image), image);
        for (const Part& part : ofWeights) {
            Tensor given = toTiles(graph, tiling, Side::Maps,
                                   Matrices::rowPanels(gemmPanelRows(device, part.count),
                                                       part.count, gemmPanelSteps(tiles)),
                                   w, piece, part, maps);
            gemm(graph, given, seen, sums,
                 {.m = part.count,
                  .n = tiling.channelRows,
                  .k = tiles,
                  .panelsB = true,
                  .panelsA = true,
                  .accumulate = &piece != &ofTiles.front(),
                  .batch = tiling.matrices,
                  .strideA = given.dim(1),
                  .strideB = seen.dim(1),
                  .strideC = layout.elements,
                  .largestA = w.largestMaps,
                  .largestB = w.largestImage});
            if (&piece != &ofTiles.back()) continue;
            int64_t invocations = part.count * w.channels;
            graph.dispatch(tiling.shape.transforms->weightsFromTiles,
                           {{"weight", dweight}, {"matrices", sums}},
                           weightsParams(w, invocations, part, layout, false),
                           static_cast<uint64_t>(invocations), tiling.specialisation());
        }
    }
}

}  // namespace

const ConvAlgorithm kWinogradConvolution{winogradPays, winogradGather, winogradSum,
                                         winogradWeights};

}  // namespace doppel
