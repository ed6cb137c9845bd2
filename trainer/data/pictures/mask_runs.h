// Masks that were decoded, small enough to be kept.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/io/image.h"

namespace doppel {

// The lengths of a mask's runs, row after row, the first of what is not the person; seven bits a
// byte, the lowest first, with the eighth where more follow.
std::vector<uint8_t> maskRuns(const Image& mask);
// The mask of so many pixels whose runs they are.
Image maskOfRuns(const std::vector<uint8_t>& runs, int width, int height);

// The masks that were decoded latest, by file, as runs: a thousandth of their pixels. Can be used
// from several threads.
class KeptMasks {
public:
    explicit KeptMasks(size_t memoryBudget) : budget_(memoryBudget) {}
    // nullopt where it is not kept, or the file has been written since.
    std::optional<Image> find(const std::filesystem::path& file);
    void keep(const std::filesystem::path& file, const Image& mask);

private:
    struct Kept {
        std::string file;
        std::filesystem::file_time_type written;
        int width = 0, height = 0;
        std::vector<uint8_t> runs;
    };

    void drop(std::list<Kept>::iterator kept);

    size_t budget_, used_ = 0;
    std::mutex mutex_;
    std::list<Kept> kept_;  // latest first
    std::map<std::string, std::list<Kept>::iterator> byFile_;
};

}  // namespace doppel
