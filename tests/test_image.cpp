// Pictures and masks: kinds of files, orientation, conversion, resizing, refusals.
#include "engine/io/image.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <random>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"
#include "trainer/data/frame_selection.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

using test::Folder;
using test::messageOf;
using Bytes = std::vector<uint8_t>;

void put32(Bytes& out, uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8)
        out.push_back(static_cast<uint8_t>(value >> shift));
}

void chunk(Bytes& out, const char* type, const Bytes& data) {
    put32(out, static_cast<uint32_t>(data.size()));
    Bytes body(type, type + 4);
    body.insert(body.end(), data.begin(), data.end());
    out.insert(out.end(), body.begin(), body.end());
    put32(out, static_cast<uint32_t>(crc32(0, body.data(), static_cast<uInt>(body.size()))));
}

// A PNG by hand: kinds that writeImage does not write. Rows come without their filter byte.
Bytes png(uint32_t width, uint32_t height, int depth, int colourType,
          const std::vector<Bytes>& rows, const Bytes& palette = {}) {
    Bytes out = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    Bytes header;
    put32(header, width);
    put32(header, height);
    for (const int value : {depth, colourType, 0, 0, 0})
        header.push_back(static_cast<uint8_t>(value));
    chunk(out, "IHDR", header);
    if (!palette.empty()) chunk(out, "PLTE", palette);
    Bytes raw;
    for (const Bytes& row : rows) {
        raw.push_back(0);
        raw.insert(raw.end(), row.begin(), row.end());
    }
    Bytes packed(compressBound(raw.size()));
    uLongf size = packed.size();
    compress(packed.data(), &size, raw.data(), raw.size());
    packed.resize(size);
    chunk(out, "IDAT", packed);
    chunk(out, "IEND", {});
    return out;
}

// An uncompressed OpenEXR of one row of float RGB.
Bytes exr(const std::vector<float>& rgb) {
    Bytes out = {0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0};
    const auto bytes = [&](const void* data, size_t size) {
        const uint8_t* begin = static_cast<const uint8_t*>(data);
        out.insert(out.end(), begin, begin + size);
    };
    const auto i32 = [&](int32_t value) { bytes(&value, 4); };
    const auto f32 = [&](float value) { bytes(&value, 4); };
    const auto attribute = [&](const char* name, const char* type, int32_t size) {
        bytes(name, std::strlen(name) + 1);
        bytes(type, std::strlen(type) + 1);
        i32(size);
    };
    const int32_t width = static_cast<int32_t>(rgb.size() / 3);
    attribute("channels", "chlist", 3 * 18 + 1);
    for (const char* name : {"B", "G", "R"}) {
        bytes(name, 2);
        for (const int32_t value : {2, 0, 1, 1}) i32(value);
    }
    out.push_back(0);
    attribute("compression", "compression", 1);
    out.push_back(0);
    for (const char* window : {"dataWindow", "displayWindow"}) {
        attribute(window, "box2i", 16);
        for (const int32_t value : {0, 0, width - 1, 0}) i32(value);
    }
    attribute("lineOrder", "lineOrder", 1);
    out.push_back(0);
    attribute("pixelAspectRatio", "float", 4);
    f32(1);
    attribute("screenWindowCenter", "v2f", 8);
    f32(0);
    f32(0);
    attribute("screenWindowWidth", "float", 4);
    f32(1);
    out.push_back(0);
    const uint64_t offset = out.size() + 8;
    bytes(&offset, 8);
    i32(0);
    i32(width * 12);
    for (const size_t channel : {2u, 1u, 0u}) {
        for (size_t x = 0; x < rgb.size() / 3; ++x) f32(rgb[x * 3 + channel]);
    }
    return out;
}

// A JPEG with an EXIF segment that says how the camera was held.
Bytes withOrientation(const Bytes& jpeg, uint8_t orientation) {
    const Bytes exif = {0xFF, 0xE1, 0, 34, 'E', 'x',         'i', 'f', 0,    0,    'M', 'M',
                        0,    42,   0, 0,  0,   8,           0,   1,   0x01, 0x12, 0,   3,
                        0,    0,    0, 1,  0,   orientation, 0,   0,   0,    0,    0,   0};
    Bytes out(jpeg.begin(), jpeg.begin() + 2);
    out.insert(out.end(), exif.begin(), exif.end());
    out.insert(out.end(), jpeg.begin() + 2, jpeg.end());
    return out;
}

Image noise(int width, int height, int channels, unsigned seed) {
    Image image(width, height, channels);
    std::mt19937 random(seed);
    for (uint8_t& value : image.data) value = static_cast<uint8_t>(random());
    return image;
}

TEST(Image, pngKeepsEveryBit) {
    Folder folder;
    for (const int channels : {1, 3, 4}) {
        const Image image = noise(37, 23, channels, 1);
        writeImage(folder / "a.png", image);
        const Image back = readImage(folder / "a.png", channels);
        EXPECT_EQ(back.width, 37);
        EXPECT_EQ(back.height, 23);
        EXPECT_EQ(back.data, image.data) << channels << " channels";
        EXPECT_EQ(imageSize(folder / "a.png"), (ImageSize{37, 23}));
        EXPECT_EQ(encodePng(image), readWholeFile(folder / "a.png")) << "the same bytes again";
    }
    EXPECT_EQ(folder.names(), std::vector<std::string>{"a.png"});
}

TEST(Image, channelsAsAsked) {
    const Image grey = decodeImage(png(2, 1, 8, 0, {{10, 200}}), "g", 3);
    EXPECT_EQ(grey.data, (Bytes{10, 10, 10, 200, 200, 200}));
    const Bytes rgb = png(1, 1, 8, 2, {{255, 0, 0}});
    EXPECT_EQ(decodeImage(rgb, "c", 1).data, Bytes{54}) << "0.2126 of red";
    EXPECT_EQ(decodeImage(rgb, "c", 4).data, (Bytes{255, 0, 0, 255}));
    EXPECT_EQ(decodeImage(rgb, "c", 0).channels, 3);
    const Bytes rgba = png(1, 1, 8, 6, {{100, 150, 200, 10}});
    EXPECT_EQ(decodeImage(rgba, "a", 3).data, (Bytes{100, 150, 200})) << "alpha does not darken";
    EXPECT_EQ(decodeImage(rgba, "a", 0).data, (Bytes{100, 150, 200, 10}));
    const Bytes greyAlpha = png(1, 1, 8, 4, {{100, 7}});
    EXPECT_EQ(decodeImage(greyAlpha, "ga", 4).data, (Bytes{100, 100, 100, 7}));
    EXPECT_EQ(decodeImage(greyAlpha, "ga", 1).data, Bytes{100});
}

TEST(Image, otherDepths) {
    const Bytes deep = png(3, 1, 16, 0, {{0, 0, 0x80, 0x80, 0xFF, 0xFF}});
    EXPECT_EQ(decodeImage(deep, "16", 1).data, (Bytes{0, 0x80, 255}));
    const Bytes bits = png(8, 1, 1, 0, {{0b10100001}});
    EXPECT_EQ(decodeImage(bits, "1", 1).data, (Bytes{255, 0, 255, 0, 0, 0, 0, 255}));
    const Bytes indexed = png(2, 1, 8, 3, {{1, 0}}, {9, 8, 7, 1, 2, 3});
    EXPECT_EQ(decodeImage(indexed, "p", 3).data, (Bytes{1, 2, 3, 9, 8, 7}));
    // Linear 0.2159 is 128 encoded; out of range and NaN become the ends.
    const Bytes linear = exr({0.2159f, 1.0f, 0.0f, 7.0f, -1.0f, NAN});
    EXPECT_EQ(decodeImage(linear, "exr", 3).data, (Bytes{128, 255, 0, 255, 0, 0}));
}

TEST(Image, jpegIsCloseAndOriented) {
    Folder folder;
    // Upright: red, green / blue, white quarters, 16 × 24.
    Image image(16, 24, 3);
    const uint8_t colours[4][3] = {{250, 20, 20}, {20, 250, 20}, {20, 20, 250}, {240, 240, 240}};
    for (int y = 0; y < 24; ++y) {
        for (int x = 0; x < 16; ++x)
            std::memcpy(image.pixel(x, y), colours[(y / 12) * 2 + x / 8], 3);
    }
    writeImage(folder / "a.jpg", image);
    const Bytes jpeg = readWholeFile(folder / "a.jpg");
    // Colours come from libjpeg-turbo, as many as the file has from OpenImageIO.
    EXPECT_EQ(decodeImage(jpeg, "colours", 3).data, decodeImage(jpeg, "as it is", 0).data);
    writeImage(folder / "n.jpg", noise(45, 31, 3, 9));
    EXPECT_EQ(readImage(folder / "n.jpg", 3).data, readImage(folder / "n.jpg", 0).data);
    // Half of its data is missing, and its end is there: neither says so.
    Bytes torn = readWholeFile(folder / "n.jpg");
    torn.erase(torn.begin() + static_cast<ptrdiff_t>(torn.size() / 2), torn.end() - 2);
    EXPECT_EQ(decodeImage(torn, "torn", 3).data, decodeImage(torn, "torn", 0).data);
    // Which quarter of the stored picture lies at the top left, top right, bottom left of the
    // upright.
    const int corners[9][3] = {{},        {0, 1, 2}, {1, 0, 3}, {3, 2, 1}, {2, 3, 0},
                               {0, 2, 1}, {2, 0, 3}, {3, 1, 2}, {1, 3, 0}};
    for (uint8_t orientation = 1; orientation <= 8; ++orientation) {
        folder.write("o.jpg", withOrientation(jpeg, orientation));
        const Image got = readImage(folder / "o.jpg");
        const bool lying = orientation >= 5;
        EXPECT_EQ(got.width, lying ? 24 : 16);
        EXPECT_EQ(got.height, lying ? 16 : 24);
        EXPECT_EQ(imageSize(folder / "o.jpg"), (ImageSize{got.width, got.height}));
        const int xs[3] = {3, got.width - 4, 3}, ys[3] = {3, 3, got.height - 4};
        for (int i = 0; i < 3; ++i) {
            for (int c = 0; c < 3; ++c) {
                EXPECT_NEAR(got.pixel(xs[i], ys[i])[c], colours[corners[orientation][i]][c], 12)
                    << "orientation " << int{orientation} << " corner " << i;
            }
        }
    }
}

TEST(Image, smallInGrey) {
    Folder folder;
    const auto write = [&](const std::string& name, int width, int height) {
        Image image(width, height, 3);
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                std::fill_n(
                    image.pixel(x, y), 3,
                    static_cast<uint8_t>(128 + 70 * std::sin(.3 * x) + 50 * std::cos(.2 * y)));
        writeImage(folder / name, image);
    };
    write("a.png", 37, 50);
    write("a.jpg", 37, 50);
    write("b.jpg", 40, 64);
    folder.write("turned.jpg", withOrientation(readWholeFile(folder / "b.jpg"), 6));
    for (const char* name : {"a.png", "a.jpg", "b.jpg", "turned.jpg"})
        for (const int by : {1, 2, 4, 8}) {
            const Image whole = readImage(folder / name, 1);
            // Sides that are whole multiples, for what is beyond the edge is the decoder's matter.
            const int width = whole.width / by, height = whole.height / by;
            Image inner(width * by, height * by, 1);
            for (int y = 0; y < inner.height; ++y)
                std::copy_n(whole.row(y), inner.width, inner.row(y));
            const Image means = resize(inner, width, height);
            const Image small = readSmallGrey(folder / name, by);
            EXPECT_EQ(small.channels, 1);
            EXPECT_EQ(small.width, (whole.width + by - 1) / by) << name << " 1/" << by;
            EXPECT_EQ(small.height, (whole.height + by - 1) / by) << name << " 1/" << by;
            int most = 0;
            for (int y = 0; y < height; ++y)
                for (int x = 0; x < width; ++x)
                    most = std::max(most, std::abs(*small.pixel(x, y) - *means.pixel(x, y)));
            EXPECT_LE(most, 4) << name << " 1/" << by;
        }
    EXPECT_THROW(readSmallGrey(folder / "none.jpg", 2), InputError);
    folder.write("text.jpg", std::string("no picture"));
    EXPECT_THROW(readSmallGrey(folder / "text.jpg", 2), InputError);
}

TEST(Mask, everyKind) {
    const auto mask = [](const Bytes& file) { return decodeMask(file, "mask").data; };
    EXPECT_EQ(mask(png(3, 1, 8, 0, {{0, 1, 255}})), (Bytes{0, 255, 255})) << "labels count";
    EXPECT_EQ(mask(png(3, 1, 16, 0, {{0, 0, 0, 1, 0xFF, 0xFF}})), (Bytes{0, 255, 255}));
    EXPECT_EQ(mask(png(8, 1, 1, 0, {{0b11000000}})), (Bytes{255, 255, 0, 0, 0, 0, 0, 0}));
    EXPECT_EQ(mask(png(2, 1, 8, 2, {{0, 0, 0, 0, 3, 0}})), (Bytes{0, 255}));
    EXPECT_EQ(mask(png(2, 1, 8, 3, {{1, 0}}, {0, 0, 0, 128, 0, 0})), (Bytes{255, 0}));
    // Opaque alpha says nothing; alpha that varies is the mask, black hair included.
    EXPECT_EQ(mask(png(2, 1, 8, 6, {{0, 0, 0, 255, 9, 9, 9, 255}})), (Bytes{0, 255}));
    EXPECT_EQ(mask(png(2, 1, 8, 6, {{0, 0, 0, 255, 9, 9, 9, 0}})), (Bytes{255, 0}));
    EXPECT_EQ(mask(png(2, 1, 8, 4, {{0, 255, 200, 0}})), (Bytes{255, 0}));

    Folder folder;
    Image image(32, 16, 1);
    for (int y = 0; y < 16; ++y) {
        for (int x = 13; x < 32; ++x) *image.pixel(x, y) = 255;
    }
    writeImage(folder / "m.jpg", image);
    EXPECT_EQ(readMask(folder / "m.jpg").data, image.data) << "JPEG's ringing is not the person";
}

// ---- colours of other profiles ------------------------------------------------------------------

const fs::path kPictures = fs::path(DOPPEL_SOURCE_DIR) / "tests/data/pictures";
using Colour = std::array<int, 3>;
// Display P3, three fields beside three.
constexpr Colour kFields[] = {{200, 100, 50},  {60, 180, 90},   {40, 70, 220},
                              {128, 128, 128}, {230, 190, 170}, {250, 240, 20}};

// From Display P3 (SMPTE EG 432-1 with sRGB's curve), in doubles.
Colour srgbOf(const Colour& p3) {
    constexpr double kMatrix[3][3] = {{1.2249401763, -.2249401763, 0},
                                      {-.0420569547, 1.0420569547, 0},
                                      {-.0196375546, -.0786360656, 1.0982736202}};
    Colour srgb;
    for (size_t c = 0; c < 3; ++c) {
        double light = 0;
        for (size_t k = 0; k < 3; ++k) {
            const double v = p3[k] / 255.;
            light += kMatrix[c][k] * (v <= .04045 ? v / 12.92 : std::pow((v + .055) / 1.055, 2.4));
        }
        light = std::clamp(light, 0., 1.);
        srgb[c] = int(std::lround(
            255 * (light <= .0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - .055)));
    }
    return srgb;
}

Image fields() {
    Image image(96, 64, 3);
    for (int y = 0; y < 64; ++y)
        for (int x = 0; x < 96; ++x)
            for (size_t c = 0; c < 3; ++c)
                image.pixel(x, y)[c] = uint8_t(kFields[x / 32 + 3 * (y / 32)][c]);
    return image;
}

void expectFields(const Image& image, int by) {
    ASSERT_EQ(image.width, 96);
    ASSERT_EQ(image.height, 64);
    for (int f = 0; f < 6; ++f) {
        const Colour expected = srgbOf(kFields[f]);
        const uint8_t* found = image.pixel(32 * (f % 3) + 16, 32 * (f / 3) + 16);
        for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[c], expected[c], by) << f << " " << c;
    }
}

// With these chunks behind its header.
Bytes pngWith(const Image& image, const char* type, const Bytes& data) {
    Bytes whole = encodePng(image), inserted;
    chunk(inserted, type, data);
    whole.insert(whole.begin() + 33, inserted.begin(), inserted.end());
    return whole;
}

Bytes iccp(Bytes profile) {
    Bytes data{'p', 0, 0}, packed(compressBound(profile.size()));
    uLongf size = packed.size();
    compress(packed.data(), &size, profile.data(), profile.size());
    data.insert(data.end(), packed.begin(), packed.begin() + ptrdiff_t(size));
    return data;
}

// In segments of so many bytes of it behind the first marker, which may come in any order.
Bytes jpegWith(const Bytes& profile, size_t part = 65000) {
    Folder folder;
    writeImage(folder / "a.jpg", fields());
    Bytes jpeg = readWholeFile(folder / "a.jpg");
    const size_t count = (profile.size() + part - 1) / part;
    for (size_t k = 0; k < count; ++k) {  // each before those that are there
        const auto from = profile.begin() + ptrdiff_t(k * part);
        const auto size = ptrdiff_t(std::min(part, profile.size() - k * part));
        const size_t length = 2 + 14 + size_t(size);
        Bytes segment{0xFF, 0xE2, uint8_t(length >> 8), uint8_t(length & 255)};
        for (const char letter : std::string_view("ICC_PROFILE", 12))
            segment.push_back(uint8_t(letter));
        segment.insert(segment.end(), {uint8_t(k + 1), uint8_t(count)});
        segment.insert(segment.end(), from, from + size);
        jpeg.insert(jpeg.begin() + 2, segment.begin(), segment.end());
    }
    return jpeg;
}

// One strip, lowest bytes first or last.
Bytes tiffWith(const Image& image, const Bytes& profile, bool little = true) {
    Bytes out = little ? Bytes{'I', 'I', 42, 0} : Bytes{'M', 'M', 0, 42};
    const auto put = [&](uint32_t value, int size) {
        for (int i = 0; i < size; ++i)
            out.push_back(uint8_t(value >> (8 * (little ? i : size - 1 - i))));
    };
    const uint32_t pixels = 8, bits = pixels + uint32_t(image.data.size()), icc = bits + 6;
    const uint32_t directory = (icc + uint32_t(profile.size()) + 1) / 2 * 2;
    put(directory, 4);
    out.insert(out.end(), image.data.begin(), image.data.end());
    for (int c = 0; c < 3; ++c) put(8, 2);
    out.insert(out.end(), profile.begin(), profile.end());
    out.resize(directory);
    const uint32_t entries[][4] = {{256, 4, 1, uint32_t(image.width)},
                                   {257, 4, 1, uint32_t(image.height)},
                                   {258, 3, 3, bits},
                                   {259, 3, 1, 1},
                                   {262, 3, 1, 2},
                                   {273, 4, 1, pixels},
                                   {277, 3, 1, 3},
                                   {278, 4, 1, uint32_t(image.height)},
                                   {279, 4, 1, uint32_t(image.data.size())},
                                   {34675, 7, uint32_t(profile.size()), icc}};
    put(10, 2);
    for (const auto& [tag, type, count, value] : entries) {
        put(tag, 2);
        put(type, 2);
        put(count, 4);
        // A number of two bytes is in the first ones.
        put(type == 3 && count == 1 && !little ? value << 16 : value, 4);
    }
    put(0, 4);
    return out;
}

TEST(Colours, DisplayP3BecomesSrgb) {
    const Bytes p3 = readWholeFile(kPictures / "p3.icc");
    expectFields(decodeImage(pngWith(fields(), "iCCP", iccp(p3)), "p3.png"), 1);
    // Alpha stays, and so do colours of one channel.
    Image clear(96, 64, 4, 77);
    const Image opaque = fields();
    for (int i = 0; i < 96 * 64; ++i) std::copy_n(&opaque.data[3 * i], 3, &clear.data[4 * i]);
    const Image kept = decodeImage(pngWith(clear, "iCCP", iccp(p3)), "p3.png", 4);
    EXPECT_EQ(kept.pixel(5, 5)[3], 77);
    EXPECT_NEAR(kept.pixel(5, 5)[0], srgbOf(kFields[0])[0], 1);

    // A JPEG, which another library decodes, TIFF and WebP.
    expectFields(decodeImage(jpegWith(p3), "p3.jpg"), 3);
    expectFields(decodeImage(jpegWith(p3, 250), "parts.jpg"), 3);
    expectFields(decodeImage(tiffWith(fields(), p3), "p3.tif"), 1);
    expectFields(decodeImage(tiffWith(fields(), p3, false), "p3.tif"), 1);
    expectFields(readImage(kPictures / "p3.webp"), 1);
}

TEST(Colours, SrgbsOwnProfileAndDamagedOnesChangeNothing) {
    const Bytes srgb = readWholeFile(kPictures / "srgb.icc");
    EXPECT_EQ(decodeImage(pngWith(fields(), "iCCP", iccp(srgb)), "srgb.png").data, fields().data);
    Bytes damaged = readWholeFile(kPictures / "p3.icc");
    damaged.resize(damaged.size() / 2);
    EXPECT_EQ(decodeImage(pngWith(fields(), "iCCP", iccp(damaged)), "cut.png").data, fields().data);
    EXPECT_EQ(decodeImage(pngWith(fields(), "iCCP", {'p', 0, 0, 1, 2}), "cut.png").data,
              fields().data);
}

// Profiles that lie about what they hold: the picture, in some colours.
TEST(Colours, HostileProfiles) {
    Folder folder;
    std::mt19937 random(3);
    for (int round = 0; round < 300; ++round) {
        Bytes profile = readWholeFile(kPictures / "p3.icc");
        // The table of tags is behind the 128 bytes of the head.
        for (int k = 0; k < 4; ++k) profile[128 + random() % 140] = uint8_t(random());
        const Bytes files[] = {pngWith(fields(), "iCCP", iccp(profile)), jpegWith(profile),
                               tiffWith(fields(), profile)};
        for (const Bytes& file : files) {
            EXPECT_EQ(decodeImage(file, "hostile").width, 96);
            folder.write("hostile", file);
            EXPECT_EQ(imageSize(folder / "hostile").width, 96);
            EXPECT_EQ(readSmallGrey(folder / "hostile", 2).width, 48);
            EXPECT_EQ(readMask(folder / "hostile").width, 96);
        }
    }
}

// By a profile, turned, with what EXIF says of the lens; and by its primaries' number.
TEST(Colours, TelephonesPictures) {
    const fs::path heic = kPictures / "turned-p3.heic", avif = kPictures / "p3.avif";
    EXPECT_EQ(imageSize(heic), (ImageSize{96, 64}));
    EXPECT_EQ(imageFocalLength(heic), 26);
    EXPECT_EQ(imageFocalLength(avif), 0);
    expectFields(readImage(heic), 4);
    expectFields(readImage(avif), 4);
    EXPECT_EQ(readImage(heic, 4).pixel(1, 1)[3], 255);
    EXPECT_EQ(readSmallGrey(heic, 2).width, 48);
    EXPECT_EQ(readMask(heic).pixel(90, 60)[0], 255);  // yellow's red is above the half
    EXPECT_TRUE(isPictureName("IMG_0001.HEIC"));
}

TEST(Image, resizes) {
    // A constant stays constant, exactly, at every size.
    const Image constant(17, 5, 3, 201);
    for (const auto& [w, h] : {std::pair{1, 1}, {4, 3}, {17, 9}, {50, 2}, {34, 10}}) {
        const Image out = resize(constant, w, h);
        EXPECT_EQ(out.data, Bytes(static_cast<size_t>(w) * static_cast<size_t>(h) * 3, 201));
    }
    Image two(4, 2, 1);
    two.data = {0, 100, 200, 100, 100, 200, 0, 100};
    EXPECT_EQ(resize(two, 2, 1).data, (Bytes{100, 100})) << "means of 2 × 2";
    Image ramp(2, 1, 1);
    ramp.data = {0, 100};
    EXPECT_EQ(resize(ramp, 4, 1).data, (Bytes{0, 25, 75, 100}));
    EXPECT_EQ(resize(ramp, 4, 3).data, (Bytes{0, 25, 75, 100, 0, 25, 75, 100, 0, 25, 75, 100}));
    Image three(3, 1, 1);
    three.data = {0, 90, 240};
    EXPECT_EQ(resize(three, 2, 1).data, (Bytes{30, 190})) << "(0 + 90/2)/1.5, (90/2 + 240)/1.5";
    // The mean survives any shrinking.
    const Image random = noise(211, 97, 1, 4);
    double before = 0, after = 0;
    for (const uint8_t v : random.data) before += v;
    const Image small = resize(random, 13, 7);
    for (const uint8_t v : small.data) after += v;
    EXPECT_NEAR(before / static_cast<double>(random.data.size()),
                after / static_cast<double>(small.data.size()), 0.5);
}

TEST(Image, refusals) {
    Folder folder;
    EXPECT_THROW(readImage(folder / "none.png"), InputError);
    EXPECT_THROW(imageSize(folder / "none.png"), InputError);
    EXPECT_THROW(readImage(folder.path()), InputError);
    EXPECT_THROW(imageSize(folder.path()), InputError);
    folder.write("text.png", std::string("no picture"));
    for (const auto& message : {messageOf<InputError>([&] { readImage(folder / "text.png"); }),
                                messageOf<InputError>([&] { imageSize(folder / "text.png"); })}) {
        EXPECT_NE(message.find("text.png: expected a picture (PNG"), std::string::npos) << message;
    }
    EXPECT_NE(messageOf<InputError>([] {
                  decodeImage(png(20000, 1, 8, 0, {}), "wide");
              }).find("20000 x 1 pixels; expected at most 16384"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([] {
                  decodeImage(png(16000, 16000, 8, 2, {}), "bomb");
              }).find("cut short or hostile"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  writeImage(folder / "x.gif", Image(1, 1, 3));
              }).find("expected a name that ends with .png or .jpg"),
              std::string::npos);
    EXPECT_THROW(writeImage(folder / "no" / "x.png", Image(1, 1, 3)), InputError);
    writeImage(folder / "a.jpg", Image(64, 64, 4, 90));
    const Bytes jpeg = readWholeFile(folder / "a.jpg");
    for (size_t size = 0; size < jpeg.size(); ++size) {
        EXPECT_THROW(decodeImage(std::span(jpeg).first(size), "cut"), InputError) << size;
    }
}

// PNG, JPEG, HEIC, AVIF and EXR cut and damaged: an error or a picture, never a crash.
TEST(Image, damageIsRefusedNotFollowed) {
    Folder folder;
    writeImage(folder / "a.jpg", noise(24, 24, 3, 5));
    const std::vector<Bytes> files = {encodePng(noise(24, 24, 3, 5)),
                                      readWholeFile(folder / "a.jpg"),
                                      png(2, 1, 8, 3, {{1, 0}}, {0, 0, 0, 128, 0, 0}),
                                      readWholeFile(kPictures / "turned-p3.heic"),
                                      readWholeFile(kPictures / "told.jpg"),
                                      readWholeFile(kPictures / "p3.avif"),
                                      exr({0.2f, 1.0f, 0.0f, 7.0f, -1.0f, 0.5f})};
    std::mt19937 random(11);
    for (const Bytes& whole : files) {
        for (size_t size = 0; size < whole.size(); size += 1 + whole.size() / 200) {
            try {
                decodeImage(std::span(whole).first(size), "cut");
            } catch (const InputError&) {
            }
        }
        for (int round = 0; round < 400; ++round) {
            Bytes damaged = whole;
            damaged[random() % damaged.size()] = static_cast<uint8_t>(random());
            damaged[random() % std::min<size_t>(damaged.size(), 64)] ^=
                static_cast<uint8_t>(1u << (random() % 8));
            try {
                folder.write("damaged", damaged);
                readSmallGrey(folder / "damaged", 2);
            } catch (const InputError&) {
            }
            try {
                decodeImage(damaged, "damaged");
                decodeMask(damaged, "damaged");
            } catch (const InputError&) {
            }
        }
    }
}

TEST(Image, readsARealCapture) {
    const std::filesystem::path capture =
        test::sourceFolder() / "../shared/data/retargeting/8-views";
    if (!std::filesystem::exists(capture)) GTEST_SKIP() << "needs the real captures of ../shared";
    const Image frame = readImage(capture / "images/GOPR95340000000000.jpg");
    EXPECT_EQ(frame.width, 1000);
    EXPECT_EQ(frame.height, 1080);
    const Image mask = readMask(capture / "segmentations/GOPR95340000000000.png");
    size_t person = 0;
    for (const uint8_t value : mask.data) person += value == 255;
    const double share = static_cast<double>(person) / static_cast<double>(mask.data.size());
    EXPECT_GT(share, 0.05);
    EXPECT_LT(share, 0.5);
}

}  // namespace
}  // namespace doppel
