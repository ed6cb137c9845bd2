#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "engine/device.h"
#include "engine/device_match.h"
#include "engine/error.h"
#include "engine/files/share.h"
#include "trainer/commands/command.h"

namespace doppel {

namespace {

std::string bytesText(uint64_t bytes) {
    const double gib = double(bytes) / double(uint64_t{1} << 30);
    return gib >= 1 ? fmt::format("{:.1f} GiB", gib) : fmt::format("{} MiB", bytes >> 20);
}

std::string sentence(const DeviceInfo& info) {
    std::string text;
    for (const std::string& refusal : info.refusals) text += (text.empty() ? "" : "; ") + refusal;
    return text;
}

// What --precision mixed multiplies with.
std::string matricesText(const DeviceInfo& info) {
    if (!info.halfMatrices) return "none";
    const MatrixShape& shape = *info.halfMatrices;
    return fmt::format("{}x{}x{}", shape.m, shape.n, shape.k);
}

struct DevicesOptions {
    CommonOptions common;
};

void runDevices(const DevicesOptions& options) {
    const std::string& wanted = options.common.device;
    std::vector<DeviceInfo> devices = Device::list();
    if (devices.empty()) {
        if (options.common.json)
            printJson(nlohmann::ordered_json{{"devices", nlohmann::ordered_json::array()}});
        throwMachine("no Vulkan device; {} lavapipe, the software one",
                     sourceFolder().empty() ? "Debian's mesa-vulkan-drivers has those of GPUs and"
                                            : "`. build/env.sh` brings");
    }
    std::string names;
    for (const DeviceInfo& info : devices)
        names += fmt::format("{}{} {}", names.empty() ? "" : ", ", info.index, info.name);
    std::erase_if(devices, [&](const DeviceInfo& info) { return !matches(info, wanted); });
    if (devices.empty())
        throwInput("--device: expected a number or part of a name of {}, found \"{}\"", names,
                   wanted);
    // The one that a run with this --device takes, or without one.
    const DeviceInfo* best = nullptr;
    for (const DeviceInfo& info : devices) {
        if (info.refusals.empty() && (best == nullptr || info.score > best->score)) best = &info;
    }
    if (options.common.json) {
        nlohmann::ordered_json list = nlohmann::ordered_json::array();
        for (const DeviceInfo& info : devices) {
            list.push_back({{"index", info.index},
                            {"name", info.name},
                            {"type", info.type},
                            {"driver", info.driver},
                            {"api", info.apiVersion},
                            {"memory_bytes", info.memoryBytes},
                            {"max_allocation_bytes", info.maxAllocationBytes},
                            {"max_storage_buffer_bytes", info.maxStorageBufferBytes},
                            {"max_push_constant_bytes", info.maxPushConstantBytes},
                            {"subgroup_size", info.subgroupSize},
                            {"buffer_addresses", info.addresses},
                            {"timestamps", info.timestamps},
                            {"half_matrices", matricesText(info)},
                            {"refusals", info.refusals},
                            {"chosen", &info == best}});
        }
        printJson(nlohmann::ordered_json{{"devices", list}});
    } else {
        for (const DeviceInfo& info : devices) {
            fmt::print("{} {}{}\n", info.index, info.name,
                       &info != best    ? ""
                       : wanted.empty() ? "  (taken without --device)"
                                        : "  (taken with this --device)");
            fmt::print("    {}, driver {}, Vulkan {}\n", info.type, info.driver, info.apiVersion);
            fmt::print("    memory {}, allocation up to {}, storage buffer up to {}\n",
                       bytesText(info.memoryBytes), bytesText(info.maxAllocationBytes),
                       bytesText(info.maxStorageBufferBytes));
            fmt::print(
                "    push constants {} bytes, subgroups of {}, buffer addresses {}, "
                "timestamps {}, matrix units {}\n",
                info.maxPushConstantBytes, info.subgroupSize, info.addresses ? "yes" : "no",
                info.timestamps ? "yes" : "no", matricesText(info));
            if (!info.refusals.empty()) fmt::print("    refused: {}\n", sentence(info));
        }
    }
    if (best == nullptr) throwMachine("none of the Vulkan devices can be used");
}

const Command<DevicesOptions> kDevices{{
    .name = "devices",
    .place = 10,
    .summary = "List every Vulkan device, its limits, and why one is refused",
    .example = "doppel devices --json",
    .run = runDevices,
}};

}  // namespace

}  // namespace doppel
