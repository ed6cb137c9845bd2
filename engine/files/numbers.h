// Numbers in other widths, and as bytes.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "engine/error.h"

namespace doppel {

// A size or index that has to fit into 32 bits, as kernels take them.
inline uint32_t u32(int64_t value) {
    CHECK(value >= 0 && value < (int64_t{1} << 32), "{} fits into 32 bits", value);
    return static_cast<uint32_t>(value);
}

// IEEE half precision; every value of it is one of float.
inline float halfToFloat(uint16_t half) {
    const int exponent = half >> 10 & 31;
    const int mantissa = half & 1023;
    float value;
    if (exponent == 31) {
        value = mantissa ? NAN : INFINITY;
    } else if (exponent == 0) {
        value = std::ldexp(static_cast<float>(mantissa), -24);
    } else {
        value = std::ldexp(static_cast<float>(mantissa + 1024), exponent - 25);
    }
    return half & 0x8000 ? -value : value;
}

// The upper half of a float.
inline float bfloat16ToFloat(uint16_t bits) { return std::bit_cast<float>(uint32_t{bits} << 16); }

// Number `index` of those that lie at any address.
template <typename T>
T loadAt(const uint8_t* bytes, size_t index) {
    T value;
    std::memcpy(&value, bytes + index * sizeof(T), sizeof(T));
    return value;
}

}  // namespace doppel
