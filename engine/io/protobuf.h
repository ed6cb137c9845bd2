// Protocol buffers, as far as files that Doppel writes need them (TensorBoard's events, ONNX).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace doppel {

// A message being written, field by field: a key (field number · 8 + wire type), then a varint (0),
// 8 bytes (1), a length and bytes (2) or 4 bytes (5). Submessages are bytes.
class ProtoMessage {
public:
    ProtoMessage& varint(uint32_t field, uint64_t value) {
        number(uint64_t{field} << 3);
        number(value);
        return *this;
    }
    ProtoMessage& real64(uint32_t field, double value) { return fixed(field, 1, value); }
    ProtoMessage& real32(uint32_t field, float value) { return fixed(field, 5, value); }
    ProtoMessage& bytes(uint32_t field, std::string_view value) {
        bytesFollow(field, value.size());
        text_.append(value);
        return *this;
    }
    ProtoMessage& message(uint32_t field, const ProtoMessage& value) {
        return bytes(field, value.text());
    }
    // The beginning of a field of bytes that are written elsewhere, right after this message.
    ProtoMessage& bytesFollow(uint32_t field, uint64_t size) {
        number(uint64_t{field} << 3 | 2);
        number(size);
        return *this;
    }
    const std::string& text() const { return text_; }

private:
    void number(uint64_t value) {
        for (; value >= 0x80; value >>= 7) text_ += static_cast<char>(value | 0x80);
        text_ += static_cast<char>(value);
    }
    template <typename T>
    ProtoMessage& fixed(uint32_t field, uint64_t wireType, T value) {
        number(uint64_t{field} << 3 | wireType);
        text_.append(reinterpret_cast<const char*>(&value), sizeof(T));
        return *this;
    }

    std::string text_;
};

}  // namespace doppel
