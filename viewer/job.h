// Jobs that go on while the window answers.
#pragma once

#include <filesystem>
#include <future>

#include "trainer/avatar/films/picture_sequence.h"
#include "viewer/picture/pane.h"

namespace doppel {

// A glTF file being written in the background.
struct ExportJob {
    std::future<void> done;
    std::filesystem::path out;
};

// What is filmed.
struct FilmSettings {
    int size = 0;  // of the longer side, pixels; 0: as in the window
    // Frames of the timeline, both included; last < 0: to its end.
    int first = 0, last = -1;
    // Nothing behind the avatar, floor and ghosts neither: the kinds that keep alpha have it.
    bool clear = false;
    bool operator==(const FilmSettings&) const = default;
};

// A film being drawn, one frame per turn of the window.
struct FilmJob {
    std::filesystem::path out;
    PictureSequence pictures;
    Pane pane;
    bool clear = false;
    int64_t first = 0, next = 0, count = 0;
    double timelineBefore = 0;
    bool asked = false;  // for the texture of the next frame
};

}  // namespace doppel
