// What io/image.cpp has libraries do: pictures from bytes and back, as the file has them. They are
// OpenImageIO, which takes a third of a second to load, with a hundred libraries of its own,
// libjpeg-turbo, libheif and Little CMS: they are in a module, doppel-pictures.so, which is loaded
// with the first picture.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace doppel {

struct Image;

// A picture whose header has been read: 1 to 4 channels, sides of 1 to kMaxImageSide.
class PictureFile {
public:
    virtual ~PictureFile() = default;

    int width = 0, height = 0, channels = 0;  // as they are stored
    int orientation = 1;                      // EXIF's, 1 to 8
    bool floats = false;                      // samples are floating-point numbers
    bool bytes = false;                       // samples are integers of 8 bits at most
    bool linear = false;                      // colours are linear light
    std::string software;                     // the text of this name, or nothing
    double focalLength = 0;                   // EXIF's in 35 mm film, mm; 0: it has none
    std::vector<uint8_t> profile;             // ICC's, of HEIC's colours alone; others' are
                                              // read before (embedded_profile.h)

    // height · width · channels samples, alpha not multiplied in; integers span their type's range.
    // InputError where the file is damaged.
    virtual void read(std::span<uint8_t> samples) = 0;
    virtual void read(std::span<uint16_t> samples) = 0;
    virtual void read(std::span<float> samples) = 0;
};

class PictureCodecs {
public:
    virtual ~PictureCodecs() = default;

    // format: OpenImageIO's name, HEIC and AVIF both being "heif". `file` has to outlive the
    // picture; an empty one: the file of this name. InputError names it.
    virtual std::unique_ptr<PictureFile> open(const char* format, const std::string& name,
                                              std::span<const uint8_t> file) = 0;
    // A JPEG of grey or YCbCr in 1 or 3 channels, ceil(side / by) pixels a side, by 1, 2, 4 or 8,
    // as it is stored (not turned): the colours that open() has, in two thirds of the time. Empty
    // where it is of another kind (CMYK). InputError names it where it is damaged or has sides of
    // more than kMaxImageSide.
    virtual Image decodeJpeg(const std::string& name, std::span<const uint8_t> file, int channels,
                             int by) = 0;
    // Brings a picture of 8 bits from such a profile to sRGB (pictures/colours.h).
    virtual void convertToSrgb(Image& image, std::span<const uint8_t> profile) = 0;
    // "png" or "jpeg" (which has no alpha). MachineError names `name`.
    virtual std::vector<uint8_t> encode(const Image& image, const char* format,
                                        const std::string& name, const std::string& software) = 0;
};

// Loads the module the first time. MachineError where it cannot be loaded.
PictureCodecs& pictureCodecs();

}  // namespace doppel
