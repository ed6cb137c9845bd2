// Which device --device means.
#pragma once

#include <string>

namespace doppel {

struct DeviceInfo;

// wanted: a device's number in Device::list(), or a part of its name in any case; empty: any.
bool matches(const DeviceInfo& info, const std::string& wanted);

}  // namespace doppel
