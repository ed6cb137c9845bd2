#include "trainer/avatar/films/footage.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "trainer/data/frame_selection.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

Image inChannels(Image image, int channels) {
    if (channels == image.channels) return image;
    CHECK(channels == 1 && image.channels == 3, "colours become grey");
    Image grey(image.width, image.height, 1);
    for (size_t i = 0; i < grey.data.size(); ++i) {
        const uint8_t* rgb = &image.data[3 * i];
        grey.data[i] = static_cast<uint8_t>(.2126f * rgb[0] + .7152f * rgb[1] + .0722f * rgb[2] +
                                            .5f);  // as readImage() weighs them
    }
    return grey;
}

// Of a mask that is cut out, its alpha says where it is; readMask() goes by the same.
Image readPicture(const fs::path& path, int channels) {
    if (channels != 1) return readImage(path, channels);
    const Image image = readImage(path, 0);
    if (image.channels % 2 != 0) return inChannels(image, 1);
    Image alpha(image.width, image.height, 1);
    const size_t step = image.channelCount();
    for (size_t i = 0; i < alpha.data.size(); ++i) alpha.data[i] = image.data[step * (i + 1) - 1];
    const auto [least, most] = std::ranges::minmax(alpha.data);
    return least < most ? alpha : readImage(path, 1);
}

bool isPicture(const fs::path& path) {
    // A GIF is a film of one picture or more.
    constexpr const char* kMore[] = {".exr", ".ppm", ".pgm"};
    return isPictureName(path) || std::ranges::count(kMore, endingOf(path)) > 0;
}

}  // namespace

Image scaledToCover(const Image& image, int width, int height) {
    if (image.width == width && image.height == height) return image;
    const double scale = std::max(double(width) / image.width, double(height) / image.height);
    const int w = std::clamp(int(std::lround(width / scale)), 1, image.width);
    const int h = std::clamp(int(std::lround(height / scale)), 1, image.height);
    const int left = (image.width - w) / 2, top = (image.height - h) / 2;
    Image part(w, h, image.channels);
    for (int y = 0; y < h; ++y)
        std::copy_n(image.pixel(left, top + y), part.rowBytes(), part.row(y));
    return resize(part, width, height);
}

Footage::Footage(const fs::path& path, int channels) : path_(path), channels_(channels) {
    std::error_code error;
    if (fs::is_directory(path, error)) {
        pictures_ = picturesOfFolder(path);
        if (pictures_.empty())
            throwInput("{}: expected pictures (PNG, JPEG, HEIC, WebP, TIFF, BMP), found none in it",
                       path.string());
        shown_ = readPicture(pictures_[0], channels);
    } else if (readFileHead(path, 1).empty()) {
        throwInput("{}: is an empty file", path.string());
    } else if (isPicture(path)) {
        shown_ = readPicture(path, channels);
    } else {
        film_.emplace(path);
        if (!film_->next(shown_))
            throwInput("{}: expected a film, found no picture", path.string());
        shown_ = inChannels(std::move(shown_), channels);
        if (film_->next(next_))
            nextTime_ = film_->time();
        else
            next_ = {};
    }
    size_ = {shown_.width, shown_.height};
}

std::vector<float> Footage::at(double seconds, size_t frame, int width, int height) {
    if (film_) {
        // Times in files are rounded; a picture may come a quarter of its time early.
        const double rate = film_->framesPerSecond();
        const double early = rate > 0 ? .25 / rate : 0;
        while (!next_.empty() && nextTime_ <= seconds + early) {
            shown_ = inChannels(std::move(next_), channels_);
            next_ = {};
            const double before = nextTime_;
            if (film_->next(next_))
                nextTime_ = std::max(film_->time(), before);
            else
                next_ = {};
        }
    } else if (!pictures_.empty()) {
        if (frame >= pictures_.size())
            throwInput(
                "{}: it has {} pictures, and frame {} of the motion has none; frames count "
                "from 0",
                path_.string(), pictures_.size(), frame);
        if (frame != shownPicture_) shown_ = readPicture(pictures_[frame], channels_);
        shownPicture_ = frame;
    }
    const Image image = scaledToCover(shown_, width, height);
    std::vector<float> values;
    values.reserve(image.data.size());
    for (uint8_t value : image.data) values.push_back(static_cast<float>(value) / 255.0f);
    return values;
}

std::string Footage::note(double seconds, int width, int height) const {
    std::vector<std::string> parts;
    if (!(size_ == ImageSize{width, height}))
        parts.push_back(fmt::format("{}×{} pixels, scaled to cover {}×{}", size_.width,
                                    size_.height, width, height));
    const double duration = film_ ? film_->duration() : 0;
    if (duration > 0 && duration < seconds - .5 / std::max(film_->framesPerSecond(), 1.))
        parts.push_back(fmt::format(
            "it ends after {:.2f} s of {:.2f} s and its last picture is held", duration, seconds));
    if (parts.empty()) return {};
    return fmt::format("{}: {}", path_.string(), fmt::join(parts, "; "));
}

}  // namespace doppel
