#include "nn/core/profile.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

namespace doppel {

std::string profileTable(Graph& graph, const std::string& title) {
    struct Sum {
        int count = 0;
        double mib = 0, gflop = 0, milliseconds = 0;
    };
    std::map<std::string, Sum> sums;
    Sum all;
    for (const OpProfile& op : graph.profile())
        for (Sum* sum : {&sums[op.name], &all}) {
            sum->count += 1;
            sum->mib += static_cast<double>(op.bytes) / (1 << 20);
            sum->gflop += op.flops * 1e-9;
            sum->milliseconds += op.milliseconds;
        }
    std::vector<std::pair<std::string, Sum>> rows(sums.begin(), sums.end());
    std::ranges::sort(rows, [](const auto& a, const auto& b) {
        return a.second.milliseconds > b.second.milliseconds;
    });
    rows.emplace_back("all", all);
    std::string text =
        fmt::format("{:<36} {:>6} {:>10} {:>9} {:>10}\n", title, "ops", "MiB", "GFLOP", "ms");
    for (const auto& [name, sum] : rows)
        text += fmt::format("{:<36} {:>6} {:>10.1f} {:>9.2f} {:>10.3f}\n", name, sum.count, sum.mib,
                            sum.gflop, sum.milliseconds);
    return text;
}

}  // namespace doppel
