// zlib's packing, unpacked with an eye on what arrives, and packed always alike.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace doppel {

enum class Packing {
    raw,   // deflate alone, as zip has it
    zlib,  // with zlib's header and checksum
};

// Hands take() the unpacked bytes as they come, at most 1 MiB at a time; take() throws where they
// are too many. Returns how many of the packed bytes they took. InputError that begins with `where`
// for what is damaged or cut short.
size_t inflate(std::span<const uint8_t> packed, Packing packing, const std::string& where,
               const std::function<void(std::span<const uint8_t>)>& take);

// The parts one after the other, raw; level: zlib's.
std::vector<uint8_t> deflate(std::span<const std::span<const uint8_t>> parts, int level);

}  // namespace doppel
