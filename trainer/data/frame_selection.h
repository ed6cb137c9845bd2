// Which frames of a sequence, and in which order.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace doppel {

// Frame numbers, ascending and each once: "a:b" (from a up to but not b), "a:", ":b", "a:b:step",
// "a" (one frame), and lists of these with commas. Negative numbers count from the end. Empty text:
// all frames. InputError where the text is none of these, where a frame does not exist, and where
// nothing is left. `what` names the flag.
std::vector<size_t> selectFrames(std::string_view text, size_t count,
                                 std::string_view what = "--frames");

// So many of a sequence's frames, or all where it has no more, evenly taken from the first on.
std::vector<size_t> evenly(size_t count, size_t most);

// Frames per second of these of a sequence's frames, ascending, so that a motion lasts as long as
// it did: by the mean distance between them. One frame alone keeps fps.
double selectedRate(double fps, std::span<const size_t> indices);

// "frame9" before "frame10": runs of digits count as numbers.
bool naturallyBefore(const std::string& a, const std::string& b);

// Whether a file with this name is taken for a picture: PNG, JPEG, HEIC, AVIF, WebP, TIFF, BMP.
bool isPictureName(const std::filesystem::path& path);

// A folder's pictures in natural order; empty: none there.
std::vector<std::filesystem::path> picturesOfFolder(const std::filesystem::path& folder);

}  // namespace doppel
