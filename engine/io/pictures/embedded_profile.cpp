#include "engine/io/pictures/embedded_profile.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <string_view>

#include "engine/error.h"
#include "engine/files/deflate.h"

namespace doppel {

namespace {

// More than any profile has; what is larger is hidden and not read.
constexpr uint64_t kLargest = uint64_t{16} << 20;

// Fills `to` from `at` on; false where the file ends before.
using Read = std::function<bool(uint64_t at, std::span<uint8_t> to)>;

class Finder {
public:
    Finder(const Read& read, EmbeddedProfile& found) : read_(read), found_(found) {}

    // From here on numbers have their lowest byte first, or their highest.
    void setLittle(bool little) { little_ = little; }

    template <size_t N>
    std::optional<std::array<uint8_t, N>> bytes(uint64_t at) const {
        std::array<uint8_t, N> result;
        if (!read_(at, result)) return {};
        return result;
    }

    std::vector<uint8_t> bytes(uint64_t at, uint64_t size) const {
        std::vector<uint8_t> result(std::min(size, kLargest));
        if (size > kLargest || !read_(at, result)) result.clear();
        return result;
    }

    uint32_t number(std::span<const uint8_t> bytes) const {
        uint32_t result = 0;
        for (size_t i = 0; i < bytes.size(); ++i)
            result = result << 8 | bytes[little_ ? bytes.size() - 1 - i : i];
        return result;
    }

    void hide(uint64_t at, std::vector<uint8_t> bytes) {
        found_.hidden.push_back({at, std::move(bytes)});
    }

    void inPng();
    void inJpeg();
    void inTiff();
    void inWebp();

private:
    const Read& read_;
    EmbeddedProfile& found_;
    bool little_ = false;
};

// PNG (third edition), 11.3.2.3: a chunk iCCP before the pixels, with a name, a zero, and the
// profile as zlib packs it.
void Finder::inPng() {
    for (uint64_t at = 8;;) {
        const auto head = bytes<8>(at);
        if (!head) return;
        const uint64_t length = number(std::span(*head).first(4));
        const std::string_view type(reinterpret_cast<const char*>(&(*head)[4]), 4);
        if (type == "IDAT" || type == "IEND") return;
        if (type == "iCCP") {
            const std::vector<uint8_t> data = bytes(at + 8, length);
            // A private chunk, which readers pass over, with its checksum.
            const std::array<uint8_t, 4> other{'i', 'c', 'C', 'p'};
            hide(at + 4, {other.begin(), other.end()});
            const uLong sum = crc32_z(crc32_z(0, other.data(), 4), data.data(), data.size());
            hide(at + 8 + length,
                 {uint8_t(sum >> 24), uint8_t(sum >> 16), uint8_t(sum >> 8), uint8_t(sum)});
            const auto zero = std::ranges::find(data, uint8_t{0});
            if (data.end() - zero > 2) {
                try {
                    std::vector<uint8_t> profile;
                    inflate(std::span(data).subspan(size_t(zero - data.begin()) + 2), Packing::zlib,
                            "", [&](std::span<const uint8_t> more) {
                                if (profile.size() + more.size() > kLargest)
                                    throwInput("too large");
                                profile.insert(profile.end(), more.begin(), more.end());
                            });
                    found_.profile = std::move(profile);
                } catch (const InputError&) {
                }
            }
        }
        at += 12 + length;
    }
}

// ICC.1:2010, B.4: segments APP2 that begin with ICC_PROFILE, which of how many, and a part each.
void Finder::inJpeg() {
    std::map<uint8_t, std::vector<uint8_t>> parts;
    for (uint64_t at = 2;;) {
        const auto marker = bytes<2>(at);
        if (!marker) break;
        // What lies between segments decoders pass over, and markers may be filled up in front.
        if ((*marker)[0] != 0xFF || (*marker)[1] == 0xFF || (*marker)[1] == 0) {
            ++at;
            continue;
        }
        const uint8_t kind = (*marker)[1];
        if (kind == 0xDA || kind == 0xD9) break;  // pixels, or the end
        if (kind == 0x01 || (kind >= 0xD0 && kind <= 0xD8)) {
            at += 2;
            continue;
        }
        const auto size = bytes<2>(at + 2);
        if (!size) break;
        const uint64_t length = std::max(number(*size), uint32_t{2});
        if (kind == 0xE2) {
            constexpr std::string_view kName("ICC_PROFILE", 12);
            const std::vector<uint8_t> data = bytes(at + 4, length - 2);
            if (data.size() >= kName.size() &&
                std::memcmp(data.data(), kName.data(), kName.size()) == 0) {
                hide(at + 4, {'x'});
                if (data.size() > kName.size() + 2)
                    parts[data[kName.size()]].assign(data.begin() + kName.size() + 2, data.end());
            }
        }
        at += 2 + length;
    }
    for (const auto& [which, part] : parts)
        found_.profile.insert(found_.profile.end(), part.begin(), part.end());
}

// TIFF 6.0 and ICC.1:2010, B.5: tag 34675 of the first directory.
void Finder::inTiff() {
    constexpr uint32_t kIcc = 34675;
    const auto head = bytes<8>(0);
    if (!head) return;
    setLittle((*head)[0] == 'I');
    const uint64_t directory = number(std::span(*head).subspan(4, 4));
    const auto count = bytes<2>(directory);
    if (!count) return;
    for (uint64_t i = 0; i < number(*count); ++i) {
        const uint64_t at = directory + 2 + 12 * i;
        const auto entry = bytes<12>(at);
        if (!entry) return;
        const std::span<const uint8_t> all(*entry);
        if (number(all.first(2)) != kIcc) continue;
        // The tag before has no meaning, and the order stays.
        const uint8_t high = kIcc >> 8, low = (kIcc - 1) & 255;
        hide(at, little_ ? std::vector{low, high} : std::vector{high, low});
        found_.profile = bytes(number(all.subspan(8, 4)), number(all.subspan(4, 4)));
    }
}

// RFC 9649: a chunk ICCP, which OpenImageIO does not look at.
void Finder::inWebp() {
    setLittle(true);
    for (uint64_t at = 12;;) {
        const auto head = bytes<8>(at);
        if (!head) return;
        const uint64_t length = number(std::span(*head).subspan(4, 4));
        if (std::memcmp(head->data(), "ICCP", 4) == 0) {
            found_.profile = bytes(at + 8, length);
            return;
        }
        at += 8 + length + length % 2;
    }
}

EmbeddedProfile found(const std::string& format, const Read& read) {
    EmbeddedProfile result;
    Finder finder(read, result);
    if (format == "png") finder.inPng();
    if (format == "jpeg") finder.inJpeg();
    if (format == "tiff") finder.inTiff();
    if (format == "webp") finder.inWebp();
    return result;
}

}  // namespace

EmbeddedProfile embeddedProfile(const std::string& format, std::span<const uint8_t> file) {
    return found(format, [&](uint64_t at, std::span<uint8_t> to) {
        if (at > file.size() || to.size() > file.size() - at) return false;
        std::ranges::copy(file.subspan(at, to.size()), to.begin());
        return true;
    });
}

EmbeddedProfile embeddedProfile(const std::string& format, const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    if (!stream) throwInput("{}: cannot be read", file.string());
    return found(format, [&](uint64_t at, std::span<uint8_t> to) {
        stream.clear();
        stream.seekg(static_cast<std::streamoff>(at));
        stream.read(reinterpret_cast<char*>(to.data()), static_cast<std::streamsize>(to.size()));
        return !stream.fail();
    });
}

}  // namespace doppel
