#include <fmt/format.h>

#include <filesystem>

#include "engine/error.h"
#include "trainer/commands/command.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

struct BenchOptions {
    CommonOptions common;
};

void runBench(const BenchOptions&) {
    std::error_code error;
    const fs::path self = fs::read_symlink("/proc/self/exe", error);
    const fs::path bench = self.parent_path() / "doppel-bench";
    if (error || !fs::exists(bench, error)) {
        throwMachine(
            "doppel-bench: expected beside this program, as {}; build the target "
            "doppel-bench",
            bench.string());
    }
    fmt::print("{}\n", bench.string());
}

const Command<BenchOptions> kBench{{
    .name = "bench",
    .place = 110,
    .summary = "Say where doppel-bench is, which measures the device",
    .example = "doppel bench",
    .run = runBench,
}};

}  // namespace

}  // namespace doppel
