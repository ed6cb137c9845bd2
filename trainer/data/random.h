// Random numbers that are the same on every machine.
#pragma once

#include <cstdint>

namespace doppel {

// Uniform in [0,1), of a seed and a number.
inline double uniformOf(uint64_t seed, uint64_t number) {
    uint64_t x = seed * 0x9e3779b97f4a7c15u + number * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;  // SplitMix64's finaliser
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return static_cast<double>((x ^ (x >> 31)) >> 11) * 0x1p-53;
}

}  // namespace doppel
