#include "trainer/import/masks/given_masks.h"

#include <cmath>
#include <optional>

#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "trainer/data/frame_selection.h"

namespace doppel {
namespace fs = std::filesystem;

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

std::vector<uint8_t> GivenMasks::next(int width, int height) {
    constexpr double kShape = .02;  // by how much the sides' ratios may differ
    Parts& p = *parts_;
    Image mask;
    std::string name = p.source.string();
    if (p.video) {
        const Image picture = p.frame();
        mask = Image(picture.width, picture.height, 1);
        for (size_t i = 0; i < mask.data.size(); ++i) {
            const uint8_t* rgb = &picture.data[3 * i];
            mask.data[i] = rgb[0] + rgb[1] + rgb[2] > 3 * 127 ? 255 : 0;
        }
    } else {
        name = p.files.at(p.read).string();
        mask = readMask(p.files[p.read]);
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
