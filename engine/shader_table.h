// The SPIR-V of every kernel, embedded at build time (shaders/shaders.cmake writes the table).
#pragma once

#include <cstdint>
#include <span>

namespace doppel {

struct SpirvRange {
    const uint32_t* begin;
    const uint32_t* end;
};

struct ShaderTableRow {
    const char* name;  // "<family>/<op>.<entry>"
    SpirvRange addresses;
    SpirvRange descriptors;
};

std::span<const ShaderTableRow> shaderTable();

}  // namespace doppel
