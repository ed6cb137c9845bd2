// Text for people: out of a stranger's file, and from code points.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace doppel {

// Text out of a stranger's file, for an error: nothing in it may reach a terminal raw, so control
// characters become '?'. Longer text is cut to `limit` bytes and ends in "…".
std::string printable(std::string_view text, size_t limit = 100);

// Appends a code point of up to 10FFFF (hex) as UTF-8.
void appendUtf8(uint32_t code, std::string& out);

}  // namespace doppel
