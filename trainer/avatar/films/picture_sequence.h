// Pictures one after the other, as a film or as files.
#pragma once

#include <filesystem>
#include <optional>

#include "engine/io/video.h"
#include "trainer/data/output_folder.h"

namespace doppel {

// Whether a name is that of a film of a kind that is written (engine/io/films/kinds.h), and not a
// folder's. InputError where it is that of a film of another kind, MachineError where FFmpeg lacks
// what the kind takes.
bool isFilm(const std::filesystem::path& out);

// A film, or a folder of 0000.png, 0001.png, …; it appears whole with finish(), or not at all.
// Errors as VideoWriter's and OutputFolder's; pictures in a folder keep alpha and no sound.
class PictureSequence {
public:
    // The size is a film's; files may differ from one another.
    PictureSequence(const std::filesystem::path& out, int width, int height, double fps,
                    const VideoOptions& options = {});

    void add(const Image& image);
    void finish();

private:
    std::optional<VideoWriter> video_;
    std::optional<OutputFolder> folder_;
    int count_ = 0;
};

}  // namespace doppel
