#include "engine/files/printable.h"

namespace doppel {

std::string printable(std::string_view text, size_t limit) {
    std::string result(text.substr(0, limit));
    for (char& c : result) {
        if (static_cast<unsigned char>(c) < ' ' || c == 127) c = '?';
    }
    return text.size() > limit ? result + "…" : result;
}

void appendUtf8(uint32_t code, std::string& out) {
    const auto put = [&](uint32_t byte) { out += static_cast<char>(byte); };
    if (code < 0x80) {
        put(code);
    } else if (code < 0x800) {
        put(0xC0 | (code >> 6));
        put(0x80 | (code & 63));
    } else if (code < 0x10000) {
        put(0xE0 | (code >> 12));
        put(0x80 | ((code >> 6) & 63));
        put(0x80 | (code & 63));
    } else {
        put(0xF0 | (code >> 18));
        put(0x80 | ((code >> 12) & 63));
        put(0x80 | ((code >> 6) & 63));
        put(0x80 | (code & 63));
    }
}

}  // namespace doppel
