#include "trainer/avatar/picture_sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "engine/error.h"

namespace doppel {

bool isFilm(const std::filesystem::path& out) {
    constexpr std::array kOthers{".apng", ".avi",  ".flv", ".gif",  ".m4v",  ".mkv", ".mov",
                                 ".mpg",  ".mpeg", ".ogv", ".webm", ".webp", ".wmv"};
    const std::string extension = out.extension().string();
    if (std::ranges::count(kOthers, extension) > 0)
        throwInput(
            "{}: expected FILE.mp4, or a folder for PNG pictures; films of the kind {} are not "
            "written",
            out.string(), extension);
    return extension == ".mp4";
}

PictureSequence::PictureSequence(const std::filesystem::path& out, int width, int height,
                                 double fps) {
    if (isFilm(out))
        video_.emplace(out, width, height, fps);
    else
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
