// Protocol buffers, as far as files that Doppel writes need them (TensorBoard's events, ONNX), and
// for what it wants to know of others' networks.
#pragma once

#include <cstdint>
#include <optional>
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

// A message being read, field by field, of any bytes: where they are no message, or cut short,
// fields end.
class ProtoFields {
public:
    explicit ProtoFields(std::string_view message) : rest_(message) {}

    struct Field {
        uint64_t number = 0;
        std::string_view bytes;  // of a text or a submessage; of numbers empty
    };
    std::optional<Field> next() {
        const std::optional<uint64_t> key = number();
        if (!key) return {};
        Field field{*key >> 3, {}};
        std::optional<uint64_t> size;
        switch (*key & 7) {
            case 0:
                size = number() ? std::optional<uint64_t>(0) : std::nullopt;
                break;
            case 1:
                size = 8;
                break;
            case 2:
                size = number();
                break;
            case 5:
                size = 4;
                break;
            default:
                break;
        }
        if (!size || *size > rest_.size()) return {};
        if ((*key & 7) == 2) field.bytes = rest_.substr(0, *size);
        rest_.remove_prefix(*size);
        return field;
    }

private:
    std::optional<uint64_t> number() {
        uint64_t value = 0;
        for (unsigned shift = 0; shift < 64 && !rest_.empty(); shift += 7) {
            const auto byte = static_cast<uint8_t>(rest_.front());
            rest_.remove_prefix(1);
            value |= uint64_t{byte & 127u} << shift;
            if (byte < 128) return value;
        }
        rest_ = {};
        return {};
    }

    std::string_view rest_;
};

}  // namespace doppel
