// doppel-bench: what ops cost on a device, beside the device's own ceilings. Google Benchmark's
// command line (--benchmark_filter, --benchmark_format=json, …) and --device NAME.
//
// Times are of the device where it has timestamps; a case is one recorded graph, replayed.
#include <benchmark/benchmark.h>

#include <cstring>
#include <map>
#include <random>

#include "bench/params.h"
#include "nn/op.h"

namespace doppel {
namespace {

Device& device(const std::string& name = {}) {
    static Device device({.name = name});
    return device;
}

// Replays until Google Benchmark has seen enough.
void replay(benchmark::State& state, Graph& graph, double flops, double bytes) {
    graph.run();  // the first replay pays for page faults
    for (auto _ : state) graph.run();
    auto perSecond = [&](double amount) {
        return benchmark::Counter(amount * 1e-9, benchmark::Counter::kIsIterationInvariantRate);
    };
    if (flops > 0) state.counters["GFLOP/s"] = perSecond(flops);
    if (bytes > 0) state.counters["GB/s"] = perSecond(bytes);
}

void ceilingFma(benchmark::State& state) {
    Graph graph(device());
    constexpr uint32_t n = 1 << 15, rounds = 2000;
    Tensor x = graph.input({n, 4}), y = graph.temporary({n, 4});
    graph.beginOp("ceiling_fma");
    graph.dispatch("bench/ceiling.fma", {{"x", x}, {"y", y}}, CeilingParams{n, rounds}, n);
    graph.compile();
    replay(state, graph, 64.0 * n * rounds, 0);
}

void ceilingCopy(benchmark::State& state) {
    Graph graph(device());
    constexpr uint32_t n = 1 << 23;  // 128 MiB: larger than a CPU's caches
    std::vector<float> zeros(size_t{n} * 4);
    Tensor x = graph.constant(std::span<const float>(zeros), {n, 4});
    Tensor y = graph.temporary({n, 4});
    graph.beginOp("ceiling_copy");
    graph.dispatch("bench/ceiling.copy", {{"x", x}, {"y", y}}, CeilingParams{n, 0}, n);
    graph.compile();
    replay(state, graph, 0, 32.0 * n);
}

BENCHMARK(ceilingFma)->Name("ceiling_fma")->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(ceilingCopy)->Name("ceiling_copy")->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace doppel

int main(int argc, char** argv) {
    try {
        std::string name;
        for (int i = 1; i + 1 < argc; ++i)
            if (std::strcmp(argv[i], "--device") == 0) {
                name = argv[i + 1];
                std::copy(argv + i + 2, argv + argc, argv + i);
                argc -= 2;
            }
        benchmark::Initialize(&argc, argv);
        if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
        benchmark::AddCustomContext("device", doppel::device(name).info().name);
        benchmark::AddCustomContext("driver", doppel::device().info().driver);
        benchmark::RunSpecifiedBenchmarks();
        return 0;
    } catch (const std::exception& error) {
        fmt::print(stderr, "doppel-bench: {}\n", error.what());
        return 1;
    }
}
