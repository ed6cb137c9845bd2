// Which tiles of products a device runs best.
#include <algorithm>
#include <cmath>

#include "nn/core/tuning.h"
#include "nn/ops/linalg.h"
#include "nn/tools/bench.h"

namespace doppel::bench {

namespace {

double milliseconds(const Gemm& shape) {
    auto graph = std::make_shared<Graph>(device());
    auto matrix = [&](int64_t elements, uint32_t seed) {
        std::vector<float> values = randomValues(elements, seed);
        return graph->constant(std::span<const float>(values), {elements});
    };
    Tensor a = matrix(shape.m * shape.k, 1), b = matrix(shape.k * shape.n, 2);
    Tensor c = graph->temporary({shape.m * shape.n});
    graph->beginOp("product", flops(shape));
    gemm(*graph, a, b, c, shape);
    graph->compile({.timestamps = true});
    return bestMilliseconds({graph, graph.get()});
}

// What training makes of products: the mesh network's layers, a convolution's forward and its
// weights' gradient, and small images with long sums.
double milliseconds(const std::vector<Gemm>& shapes, const GemmTuning& tuning) {
    setGemmTuning(device(), tuning);
    double sum = 0;
    for (const Gemm& shape : shapes) sum += milliseconds(shape);
    return sum;
}

const std::vector<Gemm> kLarge{{.m = 1024, .n = 1024, .k = 512},
                               {.m = 7999, .n = 256, .k = 132, .transB = true},
                               {.m = 256, .n = 4096, .k = 512}};
const std::vector<Gemm> kLong{{.m = 256, .n = 512, .k = 4096, .transB = true},
                              {.m = 512, .n = 16, .k = 8192},
                              {.m = 64, .n = 16, .k = 65536, .transB = true}};

}  // namespace

void tune() {
    const DeviceInfo& info = device().info();
    std::filesystem::path path = tuningCachePath();
    if (path.empty())
        throwInput(
            "--tune: expected a place for the cache, found none: DOPPEL_TUNING is off, or "
            "neither DOPPEL_TUNING nor XDG_CACHE_HOME nor HOME is set");
    const GemmTuning table = defaultGemmTuning(deviceClass(info));
    GemmTuning best = table;
    if (deviceClass(info) == DeviceClass::Cpu) {
        // Tiles of 8, 16 and 32 rows, each forced in turn.
        auto forced = [&](double cost8, double cost16) {
            GemmTuning tuning = table;
            tuning.cost8 = cost8;
            tuning.cost16 = cost16;
            return milliseconds(kLarge, tuning);
        };
        double by8 = forced(.1, 100), by16 = forced(100, .1), by32 = forced(100, 100);
        auto rounded = [](double cost) { return std::clamp(std::round(20 * cost) / 20, .5, 10.0); };
        best.cost8 = rounded(by8 / by32);
        best.cost16 = rounded(by16 / by32);
        fmt::print("tiles of 8, 16, 32 rows: {:.2f}, {:.2f}, {:.2f} ms\n", by8, by16, by32);
    }
    // What is cut on a GPU decides how large tiles are as well.
    std::vector<Gemm> shapes = kLong;
    if (deviceClass(info) != DeviceClass::Cpu)
        shapes.insert(shapes.end(), kLarge.begin(), kLarge.end());
    GemmTuning cut = best;
    double least = milliseconds(shapes, best);
    for (int64_t tiles : {table.tiles / 2, table.tiles, table.tiles * 2})
        for (int64_t shortest :
             {table.shortestPart / 2, table.shortestPart, table.shortestPart * 2}) {
            GemmTuning tuning = best;
            tuning.tiles = tiles;
            tuning.shortestPart = shortest;
            double taken = milliseconds(shapes, tuning);
            fmt::print("{} tiles, parts of {}: {:.3f} ms\n", tiles, shortest, taken);
            if (taken < .97 * least) {  // what is hardly better may be noise
                least = taken;
                cut = tuning;
            }
        }
    writeGemmTuning(path, info, cut);
    fmt::print("{} ({}): cost8={} cost16={} tiles={} shortestPart={}, in {}\n", info.name,
               deviceClassName(deviceClass(info)), cut.cost8, cut.cost16, cut.tiles,
               cut.shortestPart, path.string());
}

}  // namespace doppel::bench
