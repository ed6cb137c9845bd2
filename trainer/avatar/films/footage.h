// Pictures of others that a render is put together with: what is behind the avatar, or masks of
// what is in front of it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/io/video.h"

namespace doppel {

// A picture, which stands still; a film, which is shown by time; or a folder of pictures, one for
// each frame of a motion, in the order of their numbers. InputErrors name the file: missing,
// empty, damaged, no pictures.
class Footage {
public:
    // channels 3: colours; 1: grey, or of pictures whose alpha varies that.
    Footage(const std::filesystem::path& path, int channels);

    // What is seen `seconds` after the film's first picture, or at frame number `frame`, [H,W,C] in
    // [0,1]. It is scaled to cover the size, and what is over at two sides is cut off. Neither
    // seconds nor frames go back. A film that has ended shows its last picture; a folder that has
    // no picture of the frame is an InputError.
    std::vector<float> at(double seconds, size_t frame, int width, int height);

    bool isFilm() const { return film_.has_value(); }
    const std::filesystem::path& path() const { return path_; }
    // What is done to it until `seconds`, at this size, for people: that it is scaled, that it is
    // held. Empty: nothing.
    std::string note(double seconds, int width, int height) const;

private:
    std::filesystem::path path_;
    int channels_;
    std::optional<VideoReader> film_;
    std::vector<std::filesystem::path> pictures_;  // a folder's
    ImageSize size_;                               // of the first
    Image shown_, next_;                           // next_: of a film, empty at its end
    double nextTime_ = 0;
    size_t shownPicture_ = 0;
};

// The largest part about the middle with the shape of width × height, at that size.
Image scaledToCover(const Image& image, int width, int height);

}  // namespace doppel
