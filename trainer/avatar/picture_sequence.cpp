#include "trainer/avatar/picture_sequence.h"

#include <fmt/format.h>

namespace doppel {

PictureSequence::PictureSequence(const std::filesystem::path& out, int width, int height,
                                 double fps) {
    if (out.extension() == ".mp4")
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
