// ICC profiles in PNG, JPEG, TIFF and WebP files. They are taken out here, and hidden from what
// reads the rest: OpenImageIO 2.4 unpacks each profile that it sees, and one that is damaged makes
// it read beyond its end.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace doppel {

struct EmbeddedProfile {
    std::vector<uint8_t> profile;  // as it is, damaged or not; empty: the file has none
    // Bytes that stand for those of the file from `at` on, after which it has no profile.
    struct Change {
        uint64_t at;
        std::vector<uint8_t> bytes;
    };
    std::vector<Change> hidden;
};

// format: OpenImageIO's name; of any but these four there is none. Files that are cut short or
// damaged have what is found up to there.
EmbeddedProfile embeddedProfile(const std::string& format, std::span<const uint8_t> file);
// Without reading the pixels. InputError where it cannot be read.
EmbeddedProfile embeddedProfile(const std::string& format, const std::filesystem::path& file);

}  // namespace doppel
