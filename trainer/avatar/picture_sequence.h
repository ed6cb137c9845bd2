// Pictures one after the other, as a film or as files.
#pragma once

#include <filesystem>
#include <optional>

#include "engine/io/video.h"
#include "trainer/data/output_folder.h"

namespace doppel {

// Whether a name is that of a film, FILE.mp4, and not a folder's. InputError where it is that of a
// film of another kind.
bool isFilm(const std::filesystem::path& out);

// FILE.mp4, or a folder of 0000.png, 0001.png, …; it appears whole with finish(), or not at all.
// Errors as VideoWriter's and OutputFolder's.
class PictureSequence {
public:
    // The size is a film's; files may differ from one another.
    PictureSequence(const std::filesystem::path& out, int width, int height, double fps);

    void add(const Image& image);
    void finish();

private:
    std::optional<VideoWriter> video_;
    std::optional<OutputFolder> folder_;
    int count_ = 0;
};

}  // namespace doppel
