// Zip archives, read as NumPy and PyTorch write them, from memory. Everything is checked before it
// is believed: sizes against the file's, totals against limits, CRCs against the bytes, entries
// that overlap or unpack to far more than they are. What is wrong is an InputError that names the
// file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/files/atomic_file.h"

namespace doppel {

struct ZipEntry {
    std::string name;
    uint16_t flags = 0, method = 0;
    uint32_t crc = 0;
    uint64_t packed = 0, size = 0, offset = 0;
    uint64_t begin = 0;  // of the data
};

// Sizes beyond these are refused before memory is taken.
struct ZipLimits {
    uint64_t maxTotal = uint64_t{8} << 30;  // bytes of all entries together
    // What deflate may blow up more than 100 times: zeros do that honestly, and so does a zip bomb.
    uint64_t maxInflated = uint64_t{1} << 30;
    size_t maxEntries = 8192;
};

// What the archive and its entries are called in errors.
struct ZipKind {
    const char* article = "an";
    const char* file = "npz";
    const char* items = "arrays";
};

// Stored and deflated entries, zip64; in the order of the directory. name: for errors.
std::vector<ZipEntry> zipEntries(std::span<const uint8_t> file, const ZipKind& kind,
                                 const std::string& name, const ZipLimits& limits);

// The bytes of one of this file's entries.
std::vector<uint8_t> unpackZip(std::span<const uint8_t> file, const ZipEntry& entry,
                               const std::string& where);

// Writes an archive. The same entries give the same bytes: no times are written. See AtomicFile for
// errors.
//
//     ZipWriter zip("poses.npz");
//     zip.add("betas.npy", {header, data}, true);
//     zip.commit();
class ZipWriter {
public:
    explicit ZipWriter(const std::filesystem::path& path) : out_(path) {}

    // The parts one after the other, stored or deflated. name: short and not empty.
    void add(const std::string& name, std::initializer_list<std::span<const uint8_t>> parts,
             bool compress);
    // Writes the directory; without it nothing is left.
    void commit();

private:
    AtomicFile out_;
    std::string directory_;
    uint64_t count_ = 0, offset_ = 0;
};

}  // namespace doppel
