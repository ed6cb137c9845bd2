// Tells one run's inputs from another's.
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace doppel {

// FNV-1a: tells one capture or body from another, no more.
class Digest {
public:
    template <typename T>
    void add(std::span<const T> values) {
        for (std::byte b : std::as_bytes(values))
            hash_ = (hash_ ^ static_cast<uint64_t>(b)) * 0x100000001b3u;
    }
    template <typename T>
    void addValue(const T& value) {
        add(std::span<const T>(&value, 1));
    }
    void addText(std::string_view text) { add(std::span<const char>(text)); }
    uint64_t value() const { return hash_; }
    std::string text() const { return fmt::format("{:016x}", hash_); }

private:
    uint64_t hash_ = 0xcbf29ce484222325u;
};

}  // namespace doppel
