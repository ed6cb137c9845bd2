// Variants of kernels that a device runs best: a table per class of device, which `doppel-bench
// --tune` replaces by what it measures on one device.
//
// The choice depends on the table alone, never on the load or the time of day: the same table gives
// the same bits. Another table may change them, as another device does.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "engine/device.h"

namespace doppel {

enum class DeviceClass { Cpu, Gpu, CooperativeMatrix };
DeviceClass deviceClass(const DeviceInfo& info);
const char* deviceClassName(DeviceClass deviceClass);

// How products are cut into tiles (see nn/ops/products/gemm.cpp).
struct GemmTuning {
    // CPUs: time per row of tiles of 8 and 16 rows, that of 32 being 1.
    double cost8 = 2, cost16 = 1.25;
    // Sums are cut into parts until there are so many tiles, but into parts of no fewer steps; GPUs
    // take large tiles where there are so many of them then.
    int64_t tiles = 256, shortestPart = 128;

    bool operator==(const GemmTuning&) const = default;
};
GemmTuning defaultGemmTuning(DeviceClass deviceClass);

// What this device uses: the table's, or what the cache has for a device of this name and driver.
// Read once per device.
const GemmTuning& gemmTuning(const Device& device);
// From here on, in this process.
void setGemmTuning(const Device& device, const GemmTuning& tuning);

// $DOPPEL_TUNING, or $XDG_CACHE_HOME/doppel/tuning (~/.cache/doppel/tuning); empty: there is none.
// DOPPEL_TUNING=off keeps to the table.
std::filesystem::path tuningCachePath();
// One line per device: name and driver in quotes, then NAME=VALUE for every number. InputError,
// naming the file and the line, where a line for this device is something else.
GemmTuning readGemmTuning(const std::filesystem::path& path, const DeviceInfo& info);
// Replaces or adds the line of this device; the others stay.
void writeGemmTuning(const std::filesystem::path& path, const DeviceInfo& info,
                     const GemmTuning& tuning);

}  // namespace doppel
