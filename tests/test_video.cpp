// Videos: colours and order survive, the same frames give the same file, damage is refused.
#include "engine/io/video.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <random>
#include <stdexcept>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

// Four flat quarters whose colours change with the frame.
Image quarters(int width, int height, int frame) {
    Image image(width, height, 3);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            uint8_t* pixel = image.pixel(x, y);
            const int quarter = (y >= height / 2 ? 2 : 0) + (x >= width / 2 ? 1 : 0);
            for (int c = 0; c < 3; ++c) {
                pixel[c] =
                    static_cast<uint8_t>(quarter == 3 ? 255 : (quarter == c ? 230 : 25 * frame));
            }
        }
    }
    return image;
}

void write(const std::filesystem::path& path, int width, int height, int frames, double rate = 25) {
    VideoWriter video(path, width, height, rate);
    for (int i = 0; i < frames; ++i) video.add(quarters(width, height, i));
    video.finish();
}

int largestError(const Image& got, const Image& want, int margin) {
    // Away from the edges between quarters, where colours are stored for pairs of pixels.
    int worst = 0;
    for (int y = 0; y < want.height; ++y) {
        for (int x = 0; x < want.width; ++x) {
            if (std::abs(x - want.width / 2) < margin || std::abs(y - want.height / 2) < margin) {
                continue;
            }
            for (int c = 0; c < 3; ++c) {
                worst = std::max(worst, std::abs(got.pixel(x, y)[c] - want.pixel(x, y)[c]));
            }
        }
    }
    return worst;
}

TEST(Video, framesComeBackInOrderWithTheirColours) {
    Folder folder;
    write(folder / "a.mp4", 96, 64, 10);
    EXPECT_EQ(folder.names(), std::vector<std::string>{"a.mp4"});
    VideoReader video(folder / "a.mp4");
    EXPECT_EQ(video.width(), 96);
    EXPECT_EQ(video.height(), 64);
    EXPECT_EQ(video.frameCount(), 10);
    EXPECT_NEAR(video.framesPerSecond(), 25, 1e-6);
    Image frame;
    for (int i = 0; i < 10; ++i) {
        ASSERT_TRUE(video.next(frame)) << i;
        ASSERT_EQ(frame.channels, 3);
        EXPECT_LE(largestError(frame, quarters(96, 64, i), 10), 5) << "frame " << i;
        EXPECT_NEAR(video.time(), i / 25.0, 1e-3);
    }
    EXPECT_FALSE(video.next(frame));
}

TEST(Video, oddSidesAndOtherChannels) {
    Folder folder;
    {
        VideoWriter video(folder / "odd.mp4", 33, 17, 29.97);
        video.add(Image(33, 17, 1, 200));
        video.add(Image(33, 17, 4, 50));
        video.finish();
    }
    VideoReader video(folder / "odd.mp4");
    EXPECT_EQ(video.width(), 34);
    EXPECT_EQ(video.height(), 18);
    EXPECT_NEAR(video.framesPerSecond(), 29.97, 1e-3);
    Image frame;
    for (const int grey : {200, 50}) {
        ASSERT_TRUE(video.next(frame));
        EXPECT_LE(largestError(frame, Image(34, 18, 3, static_cast<uint8_t>(grey)), 0), 3);
    }
}

TEST(Video, sameFramesGiveTheSameBytes) {
    Folder folder;
    write(folder / "a.mp4", 64, 48, 12);
    write(folder / "b.mp4", 64, 48, 12);
    const std::vector<uint8_t> bytes = readWholeFile(folder / "a.mp4");
    EXPECT_EQ(bytes, readWholeFile(folder / "b.mp4"));
    // The index stands before the pictures, so that browsers start at once.
    const auto find = [&](std::string_view name) {
        return std::search(bytes.begin(), bytes.end(), name.begin(), name.end()) - bytes.begin();
    };
    EXPECT_LT(find("moov"), find("mdat"));
    // "colr" nclx: BT.709 three times, limited range.
    const auto colour = static_cast<size_t>(find("colrnclx"));
    ASSERT_LT(colour + 15, bytes.size());
    EXPECT_EQ(std::vector<uint8_t>(bytes.begin() + static_cast<ptrdiff_t>(colour) + 8,
                                   bytes.begin() + static_cast<ptrdiff_t>(colour) + 15),
              (std::vector<uint8_t>{0, 1, 0, 1, 0, 1, 0}));
}

// How a film of `quarters` is shown where its track header has the matrix a b, c d.
Image shownBy(const Folder& folder, std::array<int8_t, 4> abcd) {
    write(folder / "a.mp4", 96, 64, 2);
    std::vector<uint8_t> bytes = readWholeFile(folder / "a.mp4");
    const std::string_view name = "tkhd";
    const auto header = std::search(bytes.begin(), bytes.end(), name.begin(), name.end());
    if (header == bytes.end()) throw std::runtime_error("the film has no track header");
    const auto matrix = header + 4 + 40;  // 40 bytes behind the version; numbers of 16.16 bits
    std::fill(matrix, matrix + 32, uint8_t{0});
    constexpr int kPlaces[4] = {0, 4, 12, 16};
    for (size_t i = 0; i < 4; ++i) {
        matrix[kPlaces[i]] = abcd[i] < 0 ? 0xFF : 0;
        matrix[kPlaces[i] + 1] = static_cast<uint8_t>(abcd[i]);
    }
    folder.write("turned.mp4", bytes);
    VideoReader video(folder / "turned.mp4");
    Image frame;
    EXPECT_TRUE(video.next(frame));
    EXPECT_EQ(frame.width, video.width());
    EXPECT_EQ(frame.height, video.height());
    return frame;
}

// The quarters of a picture from the top left on, line by line: r, g, b and w for white.
std::string quartersOf(const Image& image) {
    std::string seen;
    for (const int y : {5, image.height - 6})
        for (const int x : {5, image.width - 6}) {
            const uint8_t* pixel = image.pixel(x, y);
            const bool white = std::min({pixel[0], pixel[1], pixel[2]}) > 200;
            seen += white ? 'w' : "rgb"[std::max_element(pixel, pixel + 3) - pixel];
        }
    return seen;
}

TEST(Video, turnsWhatThePhoneTurned) {
    Folder folder;
    const Image stored = shownBy(folder, {1, 0, 0, 1});
    EXPECT_EQ(quartersOf(stored), "rgbw");
    const Image clockwise = shownBy(folder, {0, 1, -1, 0});
    EXPECT_EQ(clockwise.width, 64);
    EXPECT_EQ(clockwise.height, 96);
    EXPECT_EQ(quartersOf(clockwise), "brwg");
    EXPECT_EQ(quartersOf(shownBy(folder, {-1, 0, 0, -1})), "wbgr");
    EXPECT_EQ(quartersOf(shownBy(folder, {0, -1, 1, 0})), "gwrb");
}

TEST(Video, mirrorsWhatThePhoneMirrored) {
    Folder folder;
    EXPECT_EQ(quartersOf(shownBy(folder, {-1, 0, 0, 1})), "grwb");   // left and right
    EXPECT_EQ(quartersOf(shownBy(folder, {1, 0, 0, -1})), "bwrg");   // up and down
    EXPECT_EQ(quartersOf(shownBy(folder, {0, 1, 1, 0})), "rbgw");    // along the diagonal
    EXPECT_EQ(quartersOf(shownBy(folder, {0, -1, -1, 0})), "wgbr");  // along the other one
}

TEST(Video, leavesNothingUnfinished) {
    Folder folder;
    {
        VideoWriter video(folder / "a.mp4", 64, 64, 30);
        video.add(Image(64, 64, 3));
    }
    EXPECT_TRUE(folder.names().empty());
    EXPECT_NE(messageOf<InputError>([&] {
                  VideoWriter(folder / "a.avi", 64, 64, 30);
              }).find("expected a name that ends with .mp4, .webm, .mov, .webp or .gif"),
              std::string::npos);
    EXPECT_THROW(VideoWriter(folder / "a.mp4", 64, 64, 0), InputError);
    EXPECT_THROW(VideoWriter(folder / "no" / "a.mp4", 64, 64, 30), InputError);
    EXPECT_TRUE(folder.names().empty());
}

TEST(Video, refusals) {
    Folder folder;
    EXPECT_NE(messageOf<InputError>([&] { VideoReader(folder / "none.mp4"); }).find("No such file"),
              std::string::npos);
    EXPECT_THROW(VideoReader(folder.path()), InputError);
    folder.write("text.mp4", std::string("not a video"));
    EXPECT_NE(
        messageOf<InputError>([&] { VideoReader(folder / "text.mp4"); }).find("expected a video"),
        std::string::npos);
    // A playlist must not make us open other files.
    write(folder / "other.mp4", 64, 64, 2);
    folder.write("list.mp4", std::string("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nother.mp4\n"
                                         "#EXT-X-ENDLIST\n"));
    EXPECT_THROW(VideoReader(folder / "list.mp4"), InputError);
    folder.write("concat.mp4", std::string("ffconcat version 1.0\nfile other.mp4\n"));
    EXPECT_THROW(VideoReader(folder / "concat.mp4"), InputError);
}

// Cut anywhere: never fewer frames without a word.
TEST(Video, damageIsRefusedNotFollowed) {
    Folder folder;
    write(folder / "a.mp4", 64, 48, 8);
    const std::vector<uint8_t> whole = readWholeFile(folder / "a.mp4");
    const auto countFrames = [&](std::span<const uint8_t> bytes) {
        folder.write("b.mp4", bytes);
        VideoReader video(folder / "b.mp4");
        Image frame;
        int frames = 0;
        while (frames < 1000 && video.next(frame)) ++frames;
        return frames;
    };
    EXPECT_EQ(countFrames(whole), 8);
    for (size_t size = 0; size < whole.size(); size += 1 + whole.size() / 60) {
        EXPECT_THROW(countFrames(std::span(whole).first(size)), InputError)
            << size << " of " << whole.size();
    }
    std::mt19937 random(9);
    for (int round = 0; round < 150; ++round) {
        std::vector<uint8_t> damaged = whole;
        for (int i = 0; i < 3; ++i)
            damaged[random() % damaged.size()] = static_cast<uint8_t>(random());
        try {
            countFrames(damaged);
        } catch (const InputError&) {
        }
    }
}

}  // namespace
}  // namespace doppel
