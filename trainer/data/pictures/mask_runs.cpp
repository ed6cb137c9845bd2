#include "trainer/data/pictures/mask_runs.h"

#include <algorithm>
#include <cstring>
#include <system_error>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uint8_t kPerson = 255;

// nullopt where there is no such file.
std::optional<fs::file_time_type> lastWritten(const fs::path& file) {
    std::error_code error;
    const fs::file_time_type time = fs::last_write_time(file, error);
    if (error) return std::nullopt;
    return time;
}

}  // namespace

std::vector<uint8_t> maskRuns(const Image& mask) {
    std::vector<uint8_t> runs;
    const uint8_t *at = mask.data.data(), *const end = at + mask.data.size();
    for (bool person = false; at < end; person = !person) {
        const auto left = static_cast<size_t>(end - at);
        const void* next = std::memchr(at, person ? 0 : kPerson, left);
        size_t length = next ? static_cast<size_t>(static_cast<const uint8_t*>(next) - at) : left;
        at += length;
        for (; length >= 128; length >>= 7) runs.push_back(static_cast<uint8_t>(length | 128));
        runs.push_back(static_cast<uint8_t>(length));
    }
    return runs;
}

Image maskOfRuns(const std::vector<uint8_t>& runs, int width, int height) {
    Image mask(width, height, 1);
    size_t at = 0, length = 0;
    int shift = 0;
    bool person = false;
    for (uint8_t byte : runs) {
        length |= static_cast<size_t>(byte & 127) << shift;
        shift += 7;
        if (byte & 128) continue;
        CHECK(length <= mask.data.size() - at, "runs of {}×{} pixels go beyond them", width,
              height);
        if (person) std::memset(mask.data.data() + at, kPerson, length);
        at += length;
        length = 0, shift = 0;
        person = !person;
    }
    return mask;
}

std::optional<Image> KeptMasks::find(const fs::path& file) {
    const auto written = lastWritten(file);
    Kept found;
    {
        const std::lock_guard lock(mutex_);
        const auto at = byFile_.find(file.string());
        if (at == byFile_.end()) return std::nullopt;
        if (at->second->written != written) {
            drop(at->second);
            return std::nullopt;
        }
        kept_.splice(kept_.begin(), kept_, at->second);
        found = kept_.front();
    }
    return maskOfRuns(found.runs, found.width, found.height);
}

void KeptMasks::keep(const fs::path& file, const Image& mask) {
    const auto written = lastWritten(file);
    if (!written) return;
    Kept kept{file.string(), *written, mask.width, mask.height, maskRuns(mask)};
    kept.runs.shrink_to_fit();
    const std::lock_guard lock(mutex_);
    if (const auto at = byFile_.find(kept.file); at != byFile_.end()) drop(at->second);
    used_ += kept.runs.size();
    kept_.push_front(std::move(kept));
    byFile_[kept_.front().file] = kept_.begin();
    while (used_ > budget_) drop(std::prev(kept_.end()));
}

void KeptMasks::drop(std::list<Kept>::iterator kept) {
    used_ -= kept->runs.size();
    byFile_.erase(kept->file);
    kept_.erase(kept);
}

}  // namespace doppel
