// doppel-bench: what ops, training steps and inference cost on a device, beside the device's own
// ceilings. The command line is Google Benchmark's, and --device NAME, --json.
#include "nn/tools/bench.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <map>
#include <optional>

#include "bench/params.h"
#include "engine/instance.h"
#include "nn/core/profile.h"

namespace doppel::bench {

static DeviceOptions deviceOptions;  // from the command line

namespace {

double secondsNow() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

struct Cost {
    double seconds = 0, flops = 0, bytes = 0;
};

// Of the newest replay's timed part, by the device's clock: 0 seconds where it has none.
Cost costOf(const Recording& r) {
    Cost cost;
    for (const OpProfile& op : r.graph->profile()) {
        if (r.part == Recording::Part::Backward && !op.name.ends_with(".backward")) continue;
        cost.seconds += op.milliseconds * 1e-3;
        cost.flops += op.flops;
        cost.bytes += static_cast<double>(op.bytes);
    }
    if (!device().info().timestamps) cost.seconds = 0;
    if (r.bytes > 0) cost.bytes = r.bytes;
    return cost;
}

std::map<std::string, std::function<Recording()>>& cases() {
    static std::map<std::string, std::function<Recording()>> all;
    return all;
}

Recording record(std::shared_ptr<Graph> graph) {
    graph->compile({.timestamps = true});
    return {graph, graph.get()};
}

Recording ceilingFma() {
    auto graph = std::make_shared<Graph>(device());
    const uint32_t n = device().info().cpu ? 1 << 15 : 1 << 20, rounds = 2000;
    Tensor x = graph->input({n, 4}), y = graph->temporary({n, 4});
    graph->beginOp("ceiling_fma", 64.0 * n * rounds);
    graph->dispatch("bench/ceiling.fma", {{"x", x}, {"y", y}}, CeilingParams{n, rounds}, n);
    return record(graph);
}

Recording ceilingCopy() {
    auto graph = std::make_shared<Graph>(device());
    constexpr uint32_t n = 1 << 23;  // 128 MiB: larger than caches
    std::vector<float> zeros(size_t{n} * 4);
    Tensor x = graph->constant(std::span<const float>(zeros), {n, 4});
    Tensor y = graph->temporary({n, 4});
    graph->beginOp("ceiling_copy");
    graph->dispatch("bench/ceiling.copy", {{"x", x}, {"y", y}}, CeilingParams{n, 0}, n);
    return record(graph);
}

// The best of some replays: what the device can do when nobody else has it.
Cost bestCost(const Recording& r) {
    Cost best{.seconds = INFINITY};
    r.graph->run();  // the first replay pays for page faults
    double started = secondsNow();
    for (int i = 0; i == 0 || (i < 20 && secondsNow() - started < 1); ++i) {
        double before = secondsNow();
        r.graph->run();
        double wall = secondsNow() - before;
        Cost cost = costOf(r);
        if (cost.seconds == 0) cost.seconds = wall;
        if (cost.seconds < best.seconds) best = cost;
    }
    return best;
}

// Google Benchmark calls a case several times to find out how often to replay; the recording of the
// newest case is kept in between.
const Recording& recordingOf(const std::string& name, const std::function<Recording()>& build) {
    device();  // outlives what follows
    static std::string current;
    static std::optional<Recording> recording;
    if (!recording || current != name) {
        recording.reset();  // its memory first
        recording = build();
        current = name;
        // The first replay pays for page faults. A GPU that waited while its inputs were made takes some
        // tenths of a second until its clock is up again.
        const double since = secondsNow();
        do recording->graph->run();
        while (!device().info().cpu && secondsNow() - since < 0.5);
    }
    return *recording;
}

void run(benchmark::State& state, const std::string& name,
         const std::function<Recording()>& build) {
    const Recording& r = recordingOf(name, build);
    Cost sum;
    double wall = 0;
    bool ownClock = true;
    for (auto _ : state) {
        double before = secondsNow();
        r.graph->run();
        double passed = secondsNow() - before;
        Cost cost = costOf(r);
        ownClock = cost.seconds > 0;
        if (!ownClock) cost.seconds = passed;
        state.SetIterationTime(cost.seconds);
        sum = {sum.seconds + cost.seconds, sum.flops + cost.flops, sum.bytes + cost.bytes};
        wall += passed;
    }
    state.counters["wall_ms"] = 1e3 * wall / static_cast<double>(state.iterations());
    // The least time that the device would take, bound by the one ceiling or by the other.
    double products = sum.flops / ceilings().flops, copies = sum.bytes / ceilings().bytes;
    if (sum.flops > 0) {
        state.counters["GFLOP/s"] = sum.flops / sum.seconds * 1e-9;
        state.counters["%fma"] = 100 * products / sum.seconds;
    }
    if (sum.bytes > 0) {
        state.counters["GB/s"] = sum.bytes / sum.seconds * 1e-9;
        state.counters["%copy"] = 100 * copies / sum.seconds;
    }
    state.counters["%floor"] = 100 * std::max(products, copies) / sum.seconds;
    if (!ownClock) state.SetLabel("wall time");
}

// Replays each case that a line of stdin names once, and prints its milliseconds or where they go.
int replayFromStdin(bool profiles) {
    for (std::string name; std::getline(std::cin, name);) {
        auto found = cases().find(name);
        if (found == cases().end())
            throwInput("stdin: expected a case's name (--benchmark_list_tests), found \"{}\"",
                       name);
        const Recording& r = recordingOf(name, found->second);
        double before = secondsNow();
        r.graph->run();
        double wall = secondsNow() - before, onDevice = costOf(r).seconds;
        if (profiles)
            std::cout << profileTable(*r.graph, name) << std::endl;
        else
            std::cout << fmt::format("{:.6f}", 1e3 * (onDevice > 0 ? onDevice : wall)) << std::endl;
    }
    return 0;
}

}  // namespace

Device& device() {
    static Device device(deviceOptions);
    return device;
}

const Ceilings& ceilings() {
    static const Ceilings ceilings = [] {
        Recording fma = ceilingFma(), copy = ceilingCopy();
        Cost products = bestCost(fma), copied = bestCost(copy);
        return Ceilings{products.flops / products.seconds, copied.bytes / copied.seconds};
    }();
    return ceilings;
}

double bestMilliseconds(const Recording& recording) { return 1e3 * bestCost(recording).seconds; }

void add(std::string name, std::function<Recording()> build) {
    cases()[name] = build;
    auto body = [name, build = std::move(build)](benchmark::State& state) {
        run(state, name, build);
    };
    benchmark::RegisterBenchmark(name.c_str(), body)
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond);
}

void addCeilings() {
    add("ceiling_fma", ceilingFma);
    add("ceiling_copy", ceilingCopy);
}

}  // namespace doppel::bench

namespace {

constexpr const char* kUsage =
    "doppel-bench [--device NAME] [--precision fp32|mixed] [--json] [--benchmark_...]\n"
    "\n"
    "Times ops at the paper's sizes, training steps and inference by the device's own clock.\n"
    "  --device NAME  part of a device's name, or its index (default: the best one)\n"
    "  --precision    of products of matrices (default: fp32); mixed: inputs in half, sums in\n"
    "                 single precision, on matrix units where the device has them\n"
    "  --json         Google Benchmark's JSON on stdout\n"
    "  --replay       replay each case that a line of stdin names once, print its milliseconds\n"
    "  --profile      the same, and print which of its ops take them\n"
    "  --tune         find the kernel variants that this device runs best, and keep them in\n"
    "                 $DOPPEL_TUNING or ~/.cache/doppel/tuning, where every program finds them\n"
    "\n"
    "  op/NAME/VARIANT/forward|backward   every op; backward without the forward before it\n"
    "  mesh_step, texture_step, gan_step  a stage's training step at the paper's sizes, batch 1\n"
    "  inference                          a frame: mesh, texture, picture\n"
    "  inference_refined                  the same with the texture refined for the frame's view\n"
    "  grow/...                           how cost grows with faces, pixels, vertices, batch\n"
    "  ceiling_fma, ceiling_copy          what the device can do\n"
    "\n"
    "Counters: GFLOP/s of products and GB/s of what has to be read and written at least; %fma and\n"
    "%copy: the same as part of the ceilings, which are measured at the start; %floor: the least\n"
    "time that the ceilings allow as part of the time taken; wall_ms: with submission and "
    "waiting.\n"
    "For whole steps GB/s counts what all their dispatches are bound to. Products that an "
    "algorithm\n"
    "saves (Winograd's) count as if they were made.\n"
    "\n"
    "--benchmark_filter=REGEX chooses cases, --benchmark_list_tests shows them,\n"
    "--benchmark_repetitions=N --benchmark_report_aggregates_only=true gives medians.\n";

int run(int argc, char** argv) {
    using namespace doppel;
    std::vector<char*> arguments{argv[0]};
    static char json[] = "--benchmark_format=json", minTime[] = "--benchmark_min_time=0.2";
    arguments.push_back(minTime);  // one given on the command line comes later and wins
    bool lists = false, replays = false, profiles = false, tunes = false;
    for (int i = 1; i < argc; ++i) {
        std::string_view argument = argv[i];
        if (argument == "--help" || argument == "-h") {
            fmt::print("{}", kUsage);
            return 0;
        }
        if (argument == "--device") {
            if (i + 1 == argc) throwInput("--device: a name is missing");
            bench::deviceOptions.name = argv[++i];
        } else if (argument == "--precision") {
            if (i + 1 == argc) throwInput("--precision: a name is missing");
            bench::deviceOptions.precision = precisionNamed(argv[++i]);
        } else if (argument == "--tune") {
            tunes = true;
        } else if (argument == "--replay") {
            replays = true;
        } else if (argument == "--profile") {
            replays = profiles = true;
        } else if (argument == "--json") {
            arguments.push_back(json);
        } else {
            lists |=
                argument.starts_with("--benchmark_list_tests") && !argument.ends_with("=false");
            arguments.push_back(argv[i]);
        }
    }
    bench::addCeilings();
    bench::addOps();
    bench::addSteps();
    bench::addGrowth();
    if (tunes) {
        bench::tune();
        return 0;
    }
    if (replays) return bench::replayFromStdin(profiles);
    int count = static_cast<int>(arguments.size());
    arguments.push_back(nullptr);
    benchmark::Initialize(&count, arguments.data());
    if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) return 2;
    if (!lists) {
        const DeviceInfo& info = bench::device().info();
        benchmark::AddCustomContext("device", info.name);
        benchmark::AddCustomContext("driver", info.driver);
        benchmark::AddCustomContext("precision", precisionName(bench::device().precision()));
        benchmark::AddCustomContext("ceiling_fma_GFLOP/s",
                                    fmt::format("{:.1f}", bench::ceilings().flops * 1e-9));
        benchmark::AddCustomContext("ceiling_copy_GB/s",
                                    fmt::format("{:.1f}", bench::ceilings().bytes * 1e-9));
    }
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    doppel::separateShaderCaches();
    try {
        return run(argc, argv);
    } catch (const doppel::InputError& error) {
        fmt::print(stderr, "doppel-bench: {}\n", error.what());
        return 2;
    } catch (const std::exception& error) {
        fmt::print(stderr, "doppel-bench: {}\n", error.what());
        return 1;
    }
}
