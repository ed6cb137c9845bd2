#include "trainer/avatar/films/picture_sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "engine/error.h"
#include "engine/files/ending.h"

namespace doppel {

bool isFilm(const std::filesystem::path& out) {
    if (videoKindOf(out) != nullptr) {
        requireVideoKind(out);
        return true;
    }
    constexpr std::array kOthers{".apng", ".avi",  ".flv", ".m4v", ".mkv",
                                 ".mpg",  ".mpeg", ".ogv", ".wmv"};
    const std::string ending = endingOf(out);
    if (std::ranges::count(kOthers, ending) > 0)
        throwInput(
            "{}: expected a film that ends with {}, or a folder for PNG pictures; films of the "
            "kind {} are not written",
            out.string(), videoEndings([](const VideoKind&) { return true; }), ending);
    return false;
}

PictureSequence::PictureSequence(const std::filesystem::path& out, int width, int height,
                                 double fps, const VideoOptions& options) {
    if (isFilm(out)) {
        video_.emplace(out, width, height, fps, options);
        return;
    }
    if (options.sound)
        throwInput("{}: a folder of pictures keeps no sound; name a {}", out.string(),
                   videoEndings([](const VideoKind& kind) { return kind.keepsSound(); }));
    folder_.emplace(out, "render");
}

void PictureSequence::add(const Image& image) {
    if (video_)
        video_->add(image);
    else
        writeImage(folder_->folder() / fmt::format("{:04}.png", count_), image);
    ++count_;
}

void PictureSequence::finish() {
    if (video_)
        video_->finish();
    else
        folder_->commit();
}

}  // namespace doppel
