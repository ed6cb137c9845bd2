#include <fmt/format.h>

#include <filesystem>

#include "engine/error.h"
#include "trainer/commands/commands.h"

namespace doppel {
namespace fs = std::filesystem;

void runBench() {
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

}  // namespace doppel
