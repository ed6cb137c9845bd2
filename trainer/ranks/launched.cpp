#include "trainer/ranks/launched.h"

#include <cstdlib>

#include "engine/device.h"
#include "engine/files/module.h"
#include "trainer/data/progress.h"

namespace doppel {

namespace {

// Variables in which launchers tell.
constexpr const char* kTellers[] = {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK"};

// As Open MPI, MPICH and Slurm tell their processes; 1 where nobody tells.
int launchedSize() {
    auto number = [](const char* name) {
        const char* text = std::getenv(name);
        return text ? std::atoi(text) : 0;
    };
    for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"})
        if (int size = number(name); size > 0) return size;
    // Without PMIx, srun starts processes that know nothing of each other.
    return std::getenv("PMIX_RANK") ? std::max(1, number("SLURM_STEP_NUM_TASKS")) : 1;
}

}  // namespace

LaunchedRanks* launchedRanks() {
    static LaunchedRanks* ranks = []() -> LaunchedRanks* {
        const int size = launchedSize();
        if (size <= 1) return nullptr;
        const std::string advice = fmt::format(
            "this is one of {} processes: build with Open MPI (libopenmpi-dev), or "
            "start one process",
            size);
        // MPI's own plug-ins look for its symbols among the global ones.
        const auto start = reinterpret_cast<LaunchedRanks* (*)()>(
            moduleFunction("doppel-mpi.so", "doppelRanks", advice, true));
        LaunchedRanks* started = start();
        started->stopping = interrupted;
        // What this process starts itself is none of them.
        for (const char* name : kTellers) unsetenv(name);
        return started;
    }();
    return ranks;
}

std::string deviceOf(const LaunchedRanks& ranks, const std::string& asked) {
    if (!asked.empty()) return asked;
    std::vector<DeviceInfo> best;
    for (const DeviceInfo& info : Device::list()) {
        if (!info.refusals.empty()) continue;
        if (!best.empty() && info.score > best[0].score) best.clear();
        if (best.empty() || (info.score == best[0].score && info.name == best[0].name))
            best.push_back(info);
    }
    if (best.size() < 2) return asked;
    return fmt::format("{}", best[static_cast<size_t>(ranks.localRank()) % best.size()].index);
}

}  // namespace doppel
