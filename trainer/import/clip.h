// Pictures in the order of time, from a video or a folder, and which of them are worth keeping.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "engine/io/image.h"

namespace doppel {

// As many show a person from all sides, and in all poses of some minutes, many times over.
inline constexpr size_t kEnoughFrames = 600;

struct ClipOptions {
    double from = 0, to = std::numeric_limits<double>::infinity();  // seconds: [from, to)
    int64_t every = 1;         // of the pictures between them: the first, and each so many; 0: as
                               // few as leave kEnoughFrames at most
    std::string frames;        // selectFrames, of all pictures; empty: all
    int rows = 1080;           // pictures that are higher are scaled to this height
    double fps = 30;           // of a folder's pictures
    bool keepSimilar = false;  // duplicates and blurred pictures stay
};

// Where a folder's pictures are: in it, or in images/, beside which there may be masks/.
// Empty: it is no folder of pictures.
std::filesystem::path clipFolder(const std::filesystem::path& folder);

// Reads one picture at a time, so that memory does not depend on the length. InputErrors name the
// file: see VideoReader and readImage; a folder's pictures have one size. A video that is damaged
// behind its first picture ends there.
class Clip {
public:
    Clip(const std::filesystem::path& source, const ClipOptions& options);
    ~Clip();

    // The next picture, 3 channels, upright; false at the end.
    bool next(Image& picture);
    double time() const;                // of that picture, seconds from the first
    const std::string& damage() const;  // why it ended before its end; empty: it did not
    double duration() const;            // seconds, as a video says; 0: not known
    const char* highRange() const;      // see VideoReader; empty of pictures
    double focalLength() const;         // see VideoReader and imageFocalLength
    int64_t expected() const;           // pictures, as far as is known; −1: not known

private:
    struct Source;
    std::unique_ptr<Source> source_;
};

enum class Fate : uint8_t {
    Kept,
    Outside,    // of the times, the frames or the steps that were asked for
    Duplicate,  // shows what the last kept one shows
    Blurred,    // far less sharp than those about it
    Nobody,     // does not show the person
    Doubtful,   // shows somebody whom mask and landmarks do not agree on
};

struct ClipFrame {
    double time = 0;  // seconds from the first picture
    Fate fate = Fate::Kept;
    bool cut = false;  // shows another scene than the one before
};

// What one pass over the clip finds, of each picture. InputError where nothing is left.
std::vector<ClipFrame> surveyClip(const std::filesystem::path& source, const ClipOptions& options);

// The rate of those that are kept: by their times, so that what was left out does not make a
// motion faster. `otherwise`, where there is only one.
double keptRate(const std::vector<ClipFrame>& frames, double otherwise);

// "12 duplicates, 3 blurred, 2 without the person"; empty where nothing was left out but what was
// not asked for.
std::string leftOut(const std::vector<ClipFrame>& frames);
// "at 2.60 s of 4.00 s"; empty where the clip is as long as its file says.
std::string endsEarly(const std::vector<ClipFrame>& frames, double duration);
// "3.20 s (frame 96)", with commas; empty: none.
std::string cutsOf(const std::vector<ClipFrame>& frames);

}  // namespace doppel
