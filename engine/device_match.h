// Which device --device means.
#pragma once

#include <functional>
#include <span>
#include <string>

namespace doppel {

struct DeviceInfo;

// wanted: a device's number in Device::list(), or a part of its name in any case; empty: any.
bool matches(const DeviceInfo& info, const std::string& wanted);

// Refuses the GPUs that a scheduler, or the user, has left to others: those that
// CUDA_VISIBLE_DEVICES (NVIDIA) or ROCR_VISIBLE_DEVICES (AMD) does not name, by their place among
// the vendor's on the bus, or by UUIDs as nvidia-smi prints them. Slurm sets them. An empty
// list, or one of what is not there, as where a container shows some GPUs alone, refuses none.
// variable: as std::getenv().
void leaveToOthers(std::span<DeviceInfo> devices,
                   const std::function<const char*(const char*)>& variable);

}  // namespace doppel
