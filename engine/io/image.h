// Pictures: PNG, JPEG, HEIC, AVIF, TIFF, WebP, BMP, OpenEXR and PNM in; PNG and JPEG out.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace doppel {

// 8-bit pixels, sRGB-encoded, row 0 at the top, channels interleaved. Alpha, where there is one, is
// the last of 2 or 4 channels and not multiplied into the colours.
struct Image {
    int width = 0, height = 0, channels = 0;  // channels 1 to 4
    std::vector<uint8_t> data;                // height · width · channels

    Image() = default;
    Image(int imageWidth, int imageHeight, int imageChannels, uint8_t fill = 0);  // ≥ 1 each

    uint8_t* row(int y) { return data.data() + rowBytes() * static_cast<size_t>(y); }
    const uint8_t* row(int y) const { return data.data() + rowBytes() * static_cast<size_t>(y); }
    uint8_t* pixel(int x, int y) { return row(y) + static_cast<size_t>(x) * channelCount(); }
    const uint8_t* pixel(int x, int y) const {
        return row(y) + static_cast<size_t>(x) * channelCount();
    }
    size_t channelCount() const { return static_cast<size_t>(channels); }
    size_t rowBytes() const { return static_cast<size_t>(width) * channelCount(); }
    bool empty() const { return data.empty(); }
};

struct ImageSize {
    int width = 0, height = 0;
    bool operator==(const ImageSize&) const = default;
};

inline constexpr int kMaxImageSide = 16384;

// All readers: a missing, damaged or cut file, one that is no picture, or a side of more than
// kMaxImageSide pixels is an InputError that names the file. EXIF's orientation is applied.

// channels 1, 3 or 4; 0: as many as the file has. Grey is repeated into colours, colours are
// weighed into grey (Rec. 709), alpha is dropped where it is not asked for and 255 where there is
// none. 16 bits are rounded to 8; linear float (OpenEXR) is clamped to [0, 1] and sRGB-encoded.
// Colours of other profiles (Display P3, Adobe RGB) become sRGB's.
Image readImage(const std::filesystem::path& path, int channels = 3);
Image decodeImage(std::span<const uint8_t> file, const std::string& name, int channels = 3);

// In grey and smaller, ceil(side / by) pixels a side, each about the mean of by × by; by 1, 2, 4 or
// 8. Of a JPEG only as much is decoded as that takes (its luma, Rec. 601). What is left over of
// sides that are no multiples is at the right and the bottom, as the file has them.
Image readSmallGrey(const std::filesystem::path& path, int by);

// InputError where a PNG is cut short or has a wrong checksum, or a JPEG has no end: what is found
// without decoding.
void checkImage(const std::filesystem::path& path);

// A mask: 1 channel, 255 on the person and 0 elsewhere. On the person is what is > 0 in any colour
// channel (labels, palettes and 16 bits included), or, where the file has an alpha channel that
// varies (a cut-out person), alpha > 0. Lossy files (JPEG, WebP) are cut at the half, since
// their black is never quite 0.
Image readMask(const std::filesystem::path& path);
Image decodeMask(std::span<const uint8_t> file, const std::string& name);

// As readImage would give it, without decoding the pixels.
ImageSize imageSize(const std::filesystem::path& path);

// *.png (without loss) or *.jpg (quality 95, without alpha); another extension is an InputError.
// The file appears whole or not at all (engine/files/atomic_file.h). The same picture gives the
// same bytes.
void writeImage(const std::filesystem::path& path, const Image& image);
// software: what a PNG says of the program that wrote it, its text "Software"; empty: nothing.
std::vector<uint8_t> encodePng(const Image& image, const std::string& software = "");
// That text of any picture. Empty where it says nothing, or the file is no picture.
std::string imageSoftware(const std::filesystem::path& path);

// EXIF's focal length in 35 mm film, mm; 0 where a picture does not say.
double imageFocalLength(const std::filesystem::path& path);
// The same length, or 0 where no lens of a camera has it.
double plausibleFocalLength(double mm);

// Area average where an axis shrinks, bilinear where it grows, on the encoded values.
Image resize(const Image& image, int width, int height);

}  // namespace doppel
