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

// A film being drawn, one frame per turn of the window.
struct FilmJob {
    std::filesystem::path out;
    PictureSequence pictures;
    Pane pane;
    int64_t next = 0, count = 0;
    double timelineBefore = 0;
    bool asked = false;  // for the texture of the next frame
};

}  // namespace doppel
