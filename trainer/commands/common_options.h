// What every command can be asked for.
#pragma once

#include <cstdint>
#include <string>

#include "engine/device.h"

namespace doppel {

struct CommonOptions {
    std::string device;  // part of a name or an index; empty: the best one
    std::string precision = "fp32";
    uint64_t seed = 1;
    bool json = false;
    std::string commandLine;  // as typed, for provenance

    DeviceOptions deviceOptions() const {
        return {.name = device, .precision = precisionNamed(precision)};
    }
};

}  // namespace doppel
