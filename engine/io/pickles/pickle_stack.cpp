// Numbers and strings as Python writes them.
#include "engine/io/pickles/pickle_stack.h"

namespace doppel::pickle {

namespace {

int hexDigit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

}  // namespace

void Stack::pushLong(std::span<const uint8_t> digits) {
    size_t size = digits.size();
    const uint8_t fill = size > 0 && (digits[size - 1] & 0x80) ? 0xFF : 0;
    while (size > 8 && digits[size - 1] == fill) --size;
    if (size > 8 || (size == 8 && digits.size() > 8 && (digits[7] & 0x80) != (fill & 0x80))) {
        const uint32_t node = add(Kind::object);
        nodes_[node].text = "an integer of more than 64 bits";
        push(node);
        return;
    }
    uint64_t value = fill ? ~uint64_t{0} : 0;
    for (size_t i = 0; i < size; ++i) {
        value &= ~(uint64_t{0xFF} << (8 * i));
        value |= uint64_t{digits[i]} << (8 * i);
    }
    pushInteger(static_cast<int64_t>(value));
}

uint32_t Stack::hexCode(std::string_view digits) const {
    uint32_t code = 0;
    for (const char c : digits) {
        if (hexDigit(c) < 0) bad("a broken escape in a text");
        code = code * 16 + static_cast<uint32_t>(hexDigit(c));
    }
    return code;
}

std::string Stack::unquote(std::string_view line) const {
    if (line.size() < 2 || line.front() != line.back() ||
        (line.front() != '\'' && line.front() != '"')) {
        bad("a text without quotes");
    }
    line = line.substr(1, line.size() - 2);
    std::string result;
    for (size_t i = 0; i < line.size(); ++i) {
        if (line[i] != '\\') {
            result += line[i];
            continue;
        }
        if (++i >= line.size()) bad("a broken escape in a text");
        constexpr std::string_view kCodes = "\\\\''\"\"n\nr\rt\ta\ab\bf\fv\v";
        if (line[i] == 'x') {
            if (line.size() - i < 3) bad("a broken escape in a text");
            result += static_cast<char>(hexCode(line.substr(i + 1, 2)));
            i += 2;
        } else if (line[i] >= '0' && line[i] <= '7') {
            int code = 0;
            size_t digits = 0;
            while (digits < 3 && i + digits < line.size() && line[i + digits] >= '0' &&
                   line[i + digits] <= '7') {
                code = code * 8 + (line[i + digits++] - '0');
            }
            result += static_cast<char>(code);
            i += digits - 1;
        } else {
            size_t at = 0;
            while (at < kCodes.size() && kCodes[at] != line[i]) at += 2;
            if (at >= kCodes.size()) bad("a broken escape in a text");
            result += kCodes[at + 1];
        }
    }
    return result;
}

std::string Stack::rawUnicode(std::string_view line) const {
    std::string result;
    for (size_t i = 0; i < line.size(); ++i) {
        const bool escape =
            line[i] == '\\' && i + 1 < line.size() && (line[i + 1] == 'u' || line[i + 1] == 'U');
        if (!escape) {
            appendUtf8(static_cast<unsigned char>(line[i]), result);
            continue;
        }
        const size_t digits = line[i + 1] == 'u' ? 4 : 8;
        if (line.size() - i < digits + 2) bad("a broken escape in a text");
        const uint32_t code = hexCode(line.substr(i + 2, digits));
        if (code > 0x10FFFF) bad("a broken escape in a text");
        appendUtf8(code, result);
        i += digits + 1;
    }
    return result;
}

std::string Stack::latin1(std::string_view text) const {
    std::string result;
    for (size_t i = 0; i < text.size(); ++i) {
        const unsigned char c = static_cast<unsigned char>(text[i]);
        if (c < 0x80) {
            result += text[i];
        } else if ((c == 0xC2 || c == 0xC3) && i + 1 < text.size() &&
                   (static_cast<unsigned char>(text[i + 1]) & 0xC0) == 0x80) {
            result +=
                static_cast<char>((c & 3) << 6 | (static_cast<unsigned char>(text[++i]) & 0x3F));
        } else {
            bad("bytes kept as text hold a character beyond latin-1");
        }
    }
    return result;
}

}  // namespace doppel::pickle
