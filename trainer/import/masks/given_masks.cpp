#include "trainer/import/masks/given_masks.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "trainer/data/frame_selection.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// [H,W] 255 where a picture of 3 or 4 channels shows the person.
Image maskOf(const Image& picture) {
    constexpr uint8_t kLabels = 64, kHalf = 127;
    const size_t pixels = size_t(picture.width) * size_t(picture.height),
                 channels = size_t(picture.channels);
    auto isCut = [&](size_t i) { return picture.data[channels * i + 3] < 255; };
    bool cut = false;
    for (size_t i = 0; i < pixels && channels == 4 && !cut; ++i) cut = isCut(i);
    Image mask(picture.width, picture.height, 1);
    uint8_t most = 0;
    for (size_t i = 0; i < pixels; ++i) {
        const uint8_t* colour = &picture.data[channels * i];
        mask.data[i] = cut ? colour[3] : std::max({colour[0], colour[1], colour[2]});
        most = std::max(most, mask.data[i]);
    }
    const uint8_t above = !cut && most < kLabels && channels == 4 ? 0 : kHalf;
    for (uint8_t& value : mask.data) value = value > above ? 255 : 0;
    return mask;
}

}  // namespace

struct GivenMasks::Parts {
    fs::path source;
    std::vector<fs::path> files;  // of a folder
    std::optional<VideoReader> video;
    size_t read = 0, pictures = 0;

    // The next one's picture of a video.
    Image frame() {
        Image picture;
        if (!video->next(picture))
            throwInput("{}: expected {} masks, one for each picture of the clip, found {}",
                       source.string(), pictures, read);
        return picture;
    }
};

GivenMasks::GivenMasks(const fs::path& masks, size_t pictures) : parts_(std::make_unique<Parts>()) {
    parts_->source = masks;
    parts_->pictures = pictures;
    std::error_code error;
    if (!fs::is_directory(masks, error)) {
        parts_->video.emplace(masks);
        return;
    }
    parts_->files = picturesOfFolder(masks);
    if (parts_->files.size() != pictures)
        throwInput("{}: expected {} masks, one for each picture of the clip, found {}",
                   masks.string(), pictures, parts_->files.size());
}

GivenMasks::~GivenMasks() = default;

void GivenMasks::skip() {
    if (parts_->video) parts_->frame();
    ++parts_->read;
}

void GivenMasks::finish() {
    Image more;
    if (parts_->video && parts_->video->next(more))
        throwInput("{}: expected {} masks, one for each picture of the clip, found more",
                   parts_->source.string(), parts_->pictures);
}

std::vector<uint8_t> GivenMasks::next(int width, int height) {
    constexpr double kShape = .02;  // by how much the sides' ratios may differ
    Parts& p = *parts_;
    Image mask;
    std::string name = p.source.string();
    if (p.video) {
        mask = maskOf(p.frame());
    } else {
        name = p.files.at(p.read).string();
        mask = maskOf(readImage(p.files[p.read], 4));
    }
    ++p.read;
    const double wide = double(mask.width) * height, high = double(mask.height) * width;
    if (std::abs(wide - high) > kShape * high)
        throwInput(
            "{}: expected a mask of {}×{} pixels or in proportion, as its picture, found {}×{}",
            name, width, height, mask.width, mask.height);
    if (mask.width != width || mask.height != height) mask = resize(mask, width, height);
    for (uint8_t& value : mask.data) value = value > 127 ? 255 : 0;
    return std::move(mask.data);
}

}  // namespace doppel
