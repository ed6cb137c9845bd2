#include "engine/files/deflate.h"

#include <zlib.h>

#include <algorithm>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr size_t kMostInput = size_t{1} << 30;  // that zlib takes at once
constexpr size_t kInflated = size_t{1} << 20, kDeflated = size_t{1} << 18;

}  // namespace

size_t inflate(std::span<const uint8_t> packed, Packing packing, const std::string& where,
               const std::function<void(std::span<const uint8_t>)>& take) {
    z_stream stream{};
    if (inflateInit2(&stream, packing == Packing::raw ? -MAX_WBITS : MAX_WBITS) != Z_OK)
        throwMachine("zlib: no memory");
    struct Ender {
        z_stream* stream;
        ~Ender() { inflateEnd(stream); }
    } ender{&stream};
    std::vector<uint8_t> block(kInflated);
    size_t consumed = 0;
    int status = Z_OK;
    while (status != Z_STREAM_END) {
        if (stream.avail_in == 0 && consumed < packed.size()) {
            const size_t step = std::min(packed.size() - consumed, kMostInput);
            stream.next_in = const_cast<Bytef*>(packed.data() + consumed);
            stream.avail_in = static_cast<uInt>(step);
            consumed += step;
        }
        stream.next_out = block.data();
        stream.avail_out = static_cast<uInt>(block.size());
        const uInt input = stream.avail_in;
        status = ::inflate(&stream, Z_NO_FLUSH);
        const size_t made = block.size() - stream.avail_out;
        if (status == Z_MEM_ERROR) throwMachine("{}: zlib: no memory", where);
        if ((status != Z_OK && status != Z_STREAM_END && status != Z_BUF_ERROR) ||
            (made == 0 && input == stream.avail_in && status != Z_STREAM_END)) {
            throwInput("{}: its packed bytes are damaged or cut short", where);
        }
        take(std::span(block).first(made));
    }
    return consumed - stream.avail_in;
}

std::vector<uint8_t> deflate(std::span<const std::span<const uint8_t>> parts, int level) {
    z_stream stream{};
    if (deflateInit2(&stream, level, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
        throwMachine("zlib: no memory");
    struct Ender {
        z_stream* stream;
        ~Ender() { deflateEnd(stream); }
    } ender{&stream};
    std::vector<uint8_t> packed, block(kDeflated);
    for (size_t i = 0; i < parts.size(); ++i) {
        std::span<const uint8_t> rest = parts[i];
        do {
            const auto piece = rest.first(std::min(rest.size(), kMostInput));
            rest = rest.subspan(piece.size());
            stream.next_in = const_cast<Bytef*>(piece.data());
            stream.avail_in = static_cast<uInt>(piece.size());
            const bool last = i + 1 == parts.size() && rest.empty();
            do {
                stream.next_out = block.data();
                stream.avail_out = static_cast<uInt>(block.size());
                ::deflate(&stream, last ? Z_FINISH : Z_NO_FLUSH);
                packed.insert(packed.end(), block.data(), stream.next_out);
            } while (stream.avail_out == 0);
        } while (!rest.empty());
    }
    return packed;
}

}  // namespace doppel
