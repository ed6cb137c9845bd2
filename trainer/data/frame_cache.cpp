#include "trainer/data/frame_cache.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "trainer/data/pictures/mask_runs.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Of all caches: stages follow each other over the same masks, each with a cache of its own.
KeptMasks keptMasks(size_t{64} << 20);

void divide(std::vector<uint8_t>& rgb, const Gain& gain) {
    std::array<std::array<uint8_t, 256>, 3> table;
    for (size_t c = 0; c < 3; ++c)
        for (size_t value = 0; value < 256; ++value)
            table[c][value] = static_cast<uint8_t>(
                std::min(255l, std::lround(static_cast<float>(value) / gain[c])));
    for (size_t i = 0; i < rgb.size(); ++i) rgb[i] = table[i % 3][rgb[i]];
}

}  // namespace

FrameCache::FrameCache(const Capture& capture, size_t memoryBudget)
    : capture_(capture), budget_(memoryBudget) {}

std::shared_ptr<const Picture> FrameCache::load(size_t frame) { return load(frame, true); }

std::shared_ptr<const Picture> FrameCache::loadMask(size_t frame) { return load(frame, false); }

Image FrameCache::readSmallGrey(size_t index, int by) {
    CHECK(index < capture_.size(), "frame {} is one of the capture's {}", index, capture_.size());
    const Frame& frame = capture_.frames[index];
    ++decoded_;
    Image small = doppel::readSmallGrey(frame.image, by);
    const int width = (frame.camera.width + by - 1) / by;
    const int height = (frame.camera.height + by - 1) / by;
    if (small.width != width || small.height != height)
        throwInput("{}: expected {}×{} pixels, found about {}×{}", frame.image.string(),
                   frame.camera.width, frame.camera.height, small.width * by, small.height * by);
    return small;
}

std::shared_ptr<const Picture> FrameCache::load(size_t index, bool colours) {
    CHECK(index < capture_.size(), "frame {} is one of the capture's {}", index, capture_.size());
    const Frame& frame = capture_.frames[index];
    {
        const std::lock_guard lock(mutex_);
        for (auto at = kept_.begin(); at != kept_.end(); ++at) {
            if (at->first != index || (colours && at->second->rgb.empty())) continue;
            kept_.splice(kept_.begin(), kept_, at);
            return at->second;
        }
    }
    // Decoded without the lock, so that threads decode side by side.
    ++decoded_;
    auto picture = std::make_shared<Picture>();
    const auto require = [&](const fs::path& path, const Image& read) {
        if (read.width == frame.camera.width && read.height == frame.camera.height) return;
        throwInput("{}: expected {}×{} pixels, found {}×{}", path.string(), frame.camera.width,
                   frame.camera.height, read.width, read.height);
    };
    picture->width = frame.camera.width;
    picture->height = frame.camera.height;
    if (colours) {
        Image image = readImage(frame.image, 3);
        require(frame.image, image);
        picture->rgb = std::move(image.data);
        if (!capture_.gains.empty()) divide(picture->rgb, capture_.gains[index]);
    } else {
        checkImage(frame.image);  // rather than behind a stage that takes long
    }
    if (frame.mask) {
        std::optional<Image> kept = keptMasks.find(*frame.mask);
        Image image = kept ? std::move(*kept) : readMask(*frame.mask);
        require(*frame.mask, image);
        if (!kept) keptMasks.keep(*frame.mask, image);
        picture->mask = std::move(image.data);
    }
    const std::lock_guard lock(mutex_);
    const auto bytesOf = [](const Picture& p) { return p.rgb.size() + p.mask.size(); };
    kept_.emplace_front(index, picture);
    used_ += bytesOf(*picture);
    // The newest stays, even where it alone is more than the budget.
    while (used_ > budget_ && kept_.size() > 1) {
        used_ -= bytesOf(*kept_.back().second);
        kept_.pop_back();
    }
    return picture;
}

}  // namespace doppel
