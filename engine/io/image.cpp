#include "engine/io/image.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "engine/files/module.h"
#include "engine/io/pictures/codecs.h"
#include "engine/io/pictures/embedded_profile.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

using Bytes = std::span<const uint8_t>;

struct Format {
    const char* plugin;  // OpenImageIO's name
    const char* magic;
    size_t size;
    bool lossy;
    size_t at = 0;  // where the magic is
};

// By content, not by name: a PNG called .jpg is read, and no other of OpenImageIO's many readers
// (movies, raw photographs, scenes) gets to see a file.
constexpr Format kFormats[] = {
    {"png", "\x89PNG\r\n\x1a\n", 8, false},
    {"jpeg", "\xFF\xD8\xFF", 3, true},
    {"tiff", "II*\0", 4, false},
    {"tiff", "MM\0*", 4, false},
    {"webp", "RIFF", 4, true},
    {"bmp", "BM", 2, false},
    {"openexr", "\x76\x2f\x31\x01", 4, false},
    {"pnm", "P1", 2, false},
    {"pnm", "P2", 2, false},
    {"pnm", "P3", 2, false},
    {"pnm", "P4", 2, false},
    {"pnm", "P5", 2, false},
    {"pnm", "P6", 2, false},
    {"heif", "ftypheic", 8, true, 4},
    {"heif", "ftypheix", 8, true, 4},
    {"heif", "ftypmif1", 8, true, 4},
    {"heif", "ftypavif", 8, true, 4},
};

const Format& formatOf(Bytes head, const std::string& name) {
    for (const Format& format : kFormats) {
        if (head.size() >= format.at + format.size &&
            std::memcmp(head.data() + format.at, format.magic, format.size) == 0) {
            return format;
        }
    }
    throwInput(
        "{}: expected a picture (PNG, JPEG, HEIC, AVIF, TIFF, WebP, BMP, OpenEXR or PNM), found "
        "{}",
        name, head.empty() ? "an empty file" : "other content");
}

// libjpeg fills what is missing at the end with grey and says nothing, so the segments are walked
// up to the end-of-image marker here.
bool jpegIsWhole(Bytes file) {
    size_t at = 2;
    while (at + 4 <= file.size()) {
        if (file[at] != 0xFF) {
            ++at;  // entropy-coded data, or garbage that libjpeg skips as well
            continue;
        }
        const uint8_t marker = file[at + 1];
        if (marker == 0xD9) return true;
        if (marker == 0xFF) {
            ++at;
        } else if (marker == 0x00 || marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8)) {
            at += 2;  // no segment follows
        } else {
            at += 2 + (size_t{file[at + 2]} << 8 | file[at + 3]);
        }
    }
    while (at + 2 <= file.size()) {
        if (file[at] == 0xFF && file[at + 1] == 0xD9) return true;
        ++at;
    }
    return false;
}

// libpng prints what is wrong with a file on its own; so chunks and their CRCs are checked before.
void checkPng(Bytes file, const std::string& name) {
    const auto read32 = [&](size_t at) {
        return uint32_t{file[at]} << 24 | uint32_t{file[at + 1]} << 16 |
               uint32_t{file[at + 2]} << 8 | uint32_t{file[at + 3]};
    };
    for (size_t at = 8;;) {
        if (file.size() - at < 12 || read32(at) > file.size() - at - 12) {
            throwInput("{}: the PNG is cut short", name);
        }
        const size_t length = read32(at);
        if (crc32_z(0, &file[at + 4], length + 4) != read32(at + 8 + length)) {
            throwInput("{}: the PNG is damaged: the CRC at byte {} is wrong", name, at);
        }
        if (std::memcmp(&file[at + 4], "IEND", 4) == 0) return;
        at += length + 12;
    }
}

// `element` elements per pixel; turns as EXIF's orientation says, so that row 0 is the top.
template <typename T>
std::vector<T> orient(std::vector<T> data, int& width, int& height, size_t channels,
                      int orientation) {
    if (orientation == 1) return data;
    const bool transposed = orientation >= 5;
    const int w = transposed ? height : width, h = transposed ? width : height;
    // The stored corner at which the upright picture's top left pixel lies.
    const bool flipX = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    const bool flipY = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    std::vector<T> result(data.size());
    for (int y = 0; y < h; ++y) {
        for (int x = 0; x < w; ++x) {
            int sx = transposed ? y : x, sy = transposed ? x : y;
            if (flipX) sx = width - 1 - sx;
            if (flipY) sy = height - 1 - sy;
            const size_t from =
                (static_cast<size_t>(sy) * static_cast<size_t>(width) + static_cast<size_t>(sx)) *
                channels;
            const size_t to =
                (static_cast<size_t>(y) * static_cast<size_t>(w) + static_cast<size_t>(x)) *
                channels;
            std::copy_n(&data[from], channels, &result[to]);
        }
    }
    width = w;
    height = h;
    return result;
}

// InputError where the header lies.
uint64_t pixelCount(const PictureFile& picture, const std::string& name, size_t fileSize) {
    const uint64_t pixels =
        static_cast<uint64_t>(picture.width) * static_cast<uint64_t>(picture.height);
    // A 1-bit picture of one colour, deflated, has about 8000 pixels in a byte; with more than that
    // a file is after our memory.
    if (pixels / 8400 > fileSize) {
        throwInput("{}: {} x {} pixels in {} bytes: the file is cut short or hostile", name,
                   picture.width, picture.height, fileSize);
    }
    return pixels;
}

template <typename T>
std::vector<T> readPixels(PictureFile& picture, const std::string& name, size_t fileSize) {
    std::vector<T> data(pixelCount(picture, name, fileSize) *
                        static_cast<uint64_t>(picture.channels));
    picture.read(std::span<T>(data));
    return data;
}

uint8_t encodeSrgb(float linear) {
    // Written so that NaN becomes 0.
    const float x = linear > 0 ? std::min(linear, 1.0f) : 0.0f;
    const float y = x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
    return static_cast<uint8_t>(std::lround(y * 255.0f));
}

Image convertChannels(Image image, int channels) {
    if (channels == 0 || channels == image.channels) return image;
    Image result(image.width, image.height, channels);
    const size_t from = image.channelCount(), to = result.channelCount();
    const size_t count = image.data.size() / from;
    for (size_t i = 0; i < count; ++i) {
        const uint8_t* in = &image.data[i * from];
        uint8_t* out = &result.data[i * to];
        const bool grey = from <= 2;
        if (to == 1) {
            out[0] = grey ? in[0]
                          : static_cast<uint8_t>(
                                (2126 * in[0] + 7152 * in[1] + 722 * in[2] + 5000) / 10000);
            continue;
        }
        for (size_t c = 0; c < 3; ++c) out[c] = grey ? in[0] : in[c];
        if (to == 4) out[3] = from == 2 ? in[1] : 255;
    }
    return result;
}

void checkWhole(const Format& format, Bytes file, const std::string& name) {
    if (std::strcmp(format.plugin, "png") == 0) checkPng(file, name);
    if (std::strcmp(format.plugin, "jpeg") == 0 && !jpegIsWhole(file)) {
        throwInput("{}: the JPEG is cut short: its end marker is missing", name);
    }
}

template <typename T>
Image thresholdMask(const std::vector<T>& data, int width, int height, size_t channels,
                    T threshold) {
    Image mask(width, height, 1);
    if (channels == 1) {  // most are, and this the compiler makes vectors of
        std::ranges::transform(data, mask.data.begin(), [&](T value) {
            return static_cast<uint8_t>(value > threshold ? 255 : 0);
        });
        return mask;
    }
    const bool hasAlpha = channels == 2 || channels == 4;
    bool alphaVaries = false;
    if (hasAlpha) {
        for (size_t i = channels - 1; i < data.size(); i += channels) {
            alphaVaries = alphaVaries || data[i] != data[channels - 1];
        }
    }
    const size_t first = alphaVaries ? channels - 1 : 0;
    const size_t last = alphaVaries || !hasAlpha ? channels : channels - 1;
    for (size_t i = 0; i < mask.data.size(); ++i) {
        for (size_t c = first; c < last; ++c) {
            if (data[i * channels + c] > threshold) mask.data[i] = 255;
        }
    }
    return mask;
}

std::vector<uint8_t> encode(const Image& image, const char* format, const std::string& name,
                            const std::string& software = "") {
    CHECK(image.width > 0 && image.height > 0 && image.width <= kMaxImageSide &&
              image.height <= kMaxImageSide && image.channels >= 1 && image.channels <= 4 &&
              image.data.size() == image.rowBytes() * static_cast<size_t>(image.height),
          "a picture of {} x {} x {} must have pixels to fill it", image.width, image.height,
          image.channels);
    return pictureCodecs().encode(image, format, name, software);
}

// One axis: for every target pixel the source pixels that it covers and their weights, in 1/65536.
struct AxisWeights {
    std::vector<size_t> first;                   // per target pixel
    std::vector<std::vector<uint32_t>> weights;  // per target pixel; they sum to 65536
};

AxisWeights axisWeights(int from, int to) {
    AxisWeights axis;
    const double scale = static_cast<double>(from) / to;
    for (int i = 0; i < to; ++i) {
        std::vector<double> exact;
        int first = 0;
        if (scale > 1) {  // area: [i, i+1) · scale
            const double begin = i * scale, end = (i + 1) * scale;
            first = std::min(static_cast<int>(begin), from - 1);
            for (int s = first; s < from && s < end - 1e-9; ++s) {
                exact.push_back(std::min<double>(s + 1, end) - std::max<double>(s, begin));
            }
        } else {  // bilinear between pixel centres
            const double centre = std::clamp((i + 0.5) * scale - 0.5, 0.0, from - 1.0);
            first = std::min(static_cast<int>(centre), std::max(from - 2, 0));
            const double t = centre - first;
            exact.push_back(1 - t);
            if (first + 1 < from) exact.push_back(t);
        }
        double sum = 0, reached = 0;
        for (const double weight : exact) sum += weight;
        std::vector<uint32_t> weights;
        uint32_t given = 0;
        for (const double weight : exact) {
            reached += weight;
            const uint32_t upTo = static_cast<uint32_t>(std::lround(reached / sum * 65536));
            weights.push_back(upTo - given);
            given = upTo;
        }
        axis.first.push_back(static_cast<size_t>(first));
        axis.weights.push_back(std::move(weights));
    }
    return axis;
}

}  // namespace

PictureCodecs& pictureCodecs() {
    static PictureCodecs& codecs = *reinterpret_cast<PictureCodecs* (*)()>(
        moduleFunction("doppel-pictures.so", "doppelPictures",
                       "it reads and writes pictures, and comes with the program: build or install "
                       "that again"))();
    return codecs;
}

Image::Image(int imageWidth, int imageHeight, int imageChannels, uint8_t fill)
    : width(imageWidth), height(imageHeight), channels(imageChannels) {
    CHECK(width >= 1 && height >= 1 && channels >= 1 && channels <= 4,
          "a picture of {} x {} x {} must have pixels", width, height, channels);
    data.assign(rowBytes() * static_cast<size_t>(height), fill);
}

namespace {

struct Opened {
    std::vector<uint8_t> file;  // what `picture` reads, where that is not the caller's
    std::vector<uint8_t> profile;
    std::unique_ptr<PictureFile> picture;

    PictureFile* operator->() const { return picture.get(); }
};

// file: its bytes, which have to outlive the result; empty: the file of this name.
Opened open(const Format& format, const std::string& name, Bytes file) {
    EmbeddedProfile embedded = file.empty() ? embeddedProfile(format.plugin, fs::path(name))
                                            : embeddedProfile(format.plugin, file);
    Opened opened;
    opened.profile = std::move(embedded.profile);
    if (!embedded.hidden.empty()) {
        opened.file = file.empty() ? readWholeFile(name, uint64_t{4} << 30)
                                   : std::vector<uint8_t>(file.begin(), file.end());
        for (const auto& [at, bytes] : embedded.hidden)
            if (at + bytes.size() <= opened.file.size())
                std::ranges::copy(bytes, opened.file.begin() + static_cast<ptrdiff_t>(at));
        file = opened.file;
    }
    opened.picture = pictureCodecs().open(format.plugin, name, file);
    if (opened.profile.empty()) opened.profile = opened.picture->profile;
    return opened;
}

// Upright, in 1 or 3 channels and ceil(side / by) pixels a side. Empty where the file is no JPEG,
// or one of a rare kind.
Image decodeJpeg(const Format& format, const PictureFile& picture, Bytes file,
                 const std::string& name, int channels, int by) {
    if (std::strcmp(format.plugin, "jpeg") != 0) return {};
    pixelCount(picture, name, file.size());
    Image image = pictureCodecs().decodeJpeg(name, file, channels, by);
    if (!image.empty())
        image.data = orient(std::move(image.data), image.width, image.height, image.channelCount(),
                            picture.orientation);
    return image;
}

}  // namespace

Image decodeImage(Bytes file, const std::string& name, int channels) {
    CHECK(channels == 0 || channels == 1 || channels == 3 || channels == 4,
          "channels must be 0, 1, 3 or 4, not {}", channels);
    const Format& format = formatOf(file, name);
    checkWhole(format, file, name);
    const Opened picture = open(format, name, file);
    if (channels >= 3)
        if (Image jpeg = decodeJpeg(format, *picture.picture, file, name, 3, 1); !jpeg.empty()) {
            pictureCodecs().convertToSrgb(jpeg, picture.profile);
            return convertChannels(std::move(jpeg), channels);
        }
    Image image;
    image.width = picture->width;
    image.height = picture->height;
    image.channels = picture->channels;
    if (picture->floats) {
        const std::vector<float> pixels = readPixels<float>(*picture.picture, name, file.size());
        image.data.resize(pixels.size());
        const size_t count = image.channelCount();
        for (size_t i = 0; i < pixels.size(); ++i) {
            const bool alpha = count % 2 == 0 && i % count == count - 1;
            const float value = pixels[i] > 0 ? std::min(pixels[i], 1.0f) : 0.0f;
            image.data[i] = picture->linear && !alpha
                                ? encodeSrgb(value)
                                : static_cast<uint8_t>(std::lround(value * 255.0f));
        }
    } else {
        image.data = readPixels<uint8_t>(*picture.picture, name, file.size());
    }
    image.data = orient(std::move(image.data), image.width, image.height, image.channelCount(),
                        picture->orientation);
    // What is linear light has been encoded as sRGB above.
    if (!picture->linear) pictureCodecs().convertToSrgb(image, picture.profile);
    return convertChannels(std::move(image), channels);
}

Image readImage(const fs::path& path, int channels) {
    return decodeImage(readWholeFile(path, uint64_t{4} << 30), path.string(), channels);
}

Image readSmallGrey(const fs::path& path, int by) {
    CHECK(by == 1 || by == 2 || by == 4 || by == 8,
          "a picture is read whole or a half, quarter or eighth as large, not 1/{}", by);
    const std::vector<uint8_t> file = readWholeFile(path, uint64_t{4} << 30);
    const std::string name = path.string();
    const Format& format = formatOf(file, name);
    checkWhole(format, file, name);
    {
        const Opened picture = open(format, name, file);
        Image jpeg = decodeJpeg(format, *picture.picture, file, name, 1, by);
        if (!jpeg.empty()) return jpeg;
    }
    // Beyond its edges there is what is at them, as in a JPEG.
    const Image whole = decodeImage(file, name, 1);
    const int width = (whole.width + by - 1) / by, height = (whole.height + by - 1) / by;
    Image filled(width * by, height * by, 1);
    for (int y = 0; y < filled.height; ++y) {
        const uint8_t* row = whole.row(std::min(y, whole.height - 1));
        std::copy_n(row, whole.width, filled.row(y));
        std::fill(filled.row(y) + whole.width, filled.row(y) + filled.width, row[whole.width - 1]);
    }
    return resize(filled, width, height);
}

void checkImage(const fs::path& path) {
    const std::vector<uint8_t> file = readWholeFile(path, uint64_t{4} << 30);
    checkWhole(formatOf(file, path.string()), file, path.string());
}

Image decodeMask(Bytes file, const std::string& name) {
    const Format& format = formatOf(file, name);
    checkWhole(format, file, name);
    const Opened picture = open(format, name, file);
    const auto above = [&]<typename T>(T threshold) {
        int width = picture->width, height = picture->height;
        const size_t channels = static_cast<size_t>(picture->channels);
        std::vector<T> data = orient(readPixels<T>(*picture.picture, name, file.size()), width,
                                     height, channels, picture->orientation);
        return thresholdMask(data, width, height, channels, format.lossy ? threshold : T(0));
    };
    // As they are stored, for a label of 1 in 65535 is still a label.
    if (picture->floats) return above(0.5f);
    if (picture->bytes) return above(uint8_t{127});
    return above(uint16_t{32767});
}

Image readMask(const fs::path& path) {
    return decodeMask(readWholeFile(path, uint64_t{4} << 30), path.string());
}

ImageSize imageSize(const fs::path& path) {
    const std::string name = path.string();
    const Format& format = formatOf(readFileHead(path, 16), name);
    const Opened picture = open(format, name, {});
    if (picture->orientation >= 5) return {picture->height, picture->width};
    return {picture->width, picture->height};
}

std::string imageSoftware(const fs::path& path) {
    const std::string name = path.string();
    try {
        const Format& format = formatOf(readFileHead(path, 16), name);
        return open(format, name, {})->software;
    } catch (const InputError&) {
        return {};
    }
}

double imageFocalLength(const fs::path& path) {
    const std::string name = path.string();
    const Format& format = formatOf(readFileHead(path, 16), name);
    return plausibleFocalLength(open(format, name, {})->focalLength);
}

double plausibleFocalLength(double mm) {
    constexpr double kShortest = 8, kLongest = 400;
    return mm >= kShortest && mm <= kLongest ? mm : 0;
}

std::vector<uint8_t> encodePng(const Image& image, const std::string& software) {
    return encode(image, "png", "picture.png", software);
}

void writeImage(const fs::path& path, const Image& image) {
    const std::string ending = endingOf(path);
    const bool jpeg = ending == ".jpg" || ending == ".jpeg";
    if (!jpeg && ending != ".png") {
        throwInput("{}: expected a name that ends with .png or .jpg", path.string());
    }
    if (!jpeg) {
        writeWholeFile(path, encode(image, "png", path.string()));
    } else if (image.channels % 2 == 0) {
        writeWholeFile(path,
                       encode(convertChannels(image, image.channels - 1), "jpeg", path.string()));
    } else {
        writeWholeFile(path, encode(image, "jpeg", path.string()));
    }
}

Image resize(const Image& image, int width, int height) {
    if (width == image.width && height == image.height) return image;
    Image result(width, height, image.channels);
    const AxisWeights columns = axisWeights(image.width, width);
    const AxisWeights rows = axisWeights(image.height, height);
    const size_t channels = image.channelCount(), rowSize = result.rowBytes();
    // Rows first shrunk along x (8 fractional bits kept), then summed along y.
    std::vector<uint32_t> line(rowSize);
    std::vector<uint64_t> sum(rowSize);
    for (size_t y = 0; y < rows.first.size(); ++y) {
        std::fill(sum.begin(), sum.end(), uint64_t{1} << 31);  // rounds to nearest
        for (size_t r = 0; r < rows.weights[y].size(); ++r) {
            if (rows.weights[y][r] == 0) continue;
            const uint8_t* source = image.row(static_cast<int>(rows.first[y] + r));
            std::fill(line.begin(), line.end(), 0u);
            for (size_t x = 0; x < columns.first.size(); ++x) {
                const uint8_t* in = source + columns.first[x] * channels;
                for (const uint32_t weight : columns.weights[x]) {
                    for (size_t c = 0; c < channels; ++c) line[x * channels + c] += weight * in[c];
                    in += channels;
                }
            }
            for (size_t i = 0; i < rowSize; ++i) sum[i] += uint64_t{line[i]} * rows.weights[y][r];
        }
        uint8_t* out = result.row(static_cast<int>(y));
        for (size_t i = 0; i < rowSize; ++i) out[i] = static_cast<uint8_t>(sum[i] >> 32);
    }
    return result;
}

}  // namespace doppel
