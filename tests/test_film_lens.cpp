// What files say of the lens: phones' films, and pictures.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/film_reader.h"
#include "trainer/import/clip.h"
#include "trainer/person/body_start.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

// A copy in a QuickTime file, which says this of its lens.
void copyWithLens(const fs::path& from, const fs::path& to, const char* length) {
    AVFormatContext *in = nullptr, *out = nullptr;
    ASSERT_GE(avformat_open_input(&in, from.c_str(), nullptr, nullptr), 0);
    ASSERT_GE(avformat_find_stream_info(in, nullptr), 0);
    ASSERT_GE(avformat_alloc_output_context2(&out, nullptr, "mov", to.c_str()), 0);
    AVStream* stream = avformat_new_stream(out, nullptr);
    ASSERT_GE(avcodec_parameters_copy(stream->codecpar, in->streams[0]->codecpar), 0);
    stream->codecpar->codec_tag = 0;
    stream->time_base = in->streams[0]->time_base;
    av_dict_set(&out->metadata, "com.apple.quicktime.camera.focal_length.35mm_equivalent", length,
                0);
    AVDictionary* options = nullptr;
    av_dict_set(&options, "movflags", "use_metadata_tags", 0);
    ASSERT_GE(avio_open(&out->pb, to.c_str(), AVIO_FLAG_WRITE), 0);
    ASSERT_GE(avformat_write_header(out, &options), 0);
    av_dict_free(&options);
    AVPacket* packet = av_packet_alloc();
    while (av_read_frame(in, packet) >= 0) {
        av_packet_rescale_ts(packet, in->streams[0]->time_base, stream->time_base);
        packet->pos = -1;
        ASSERT_GE(av_write_frame(out, packet), 0);
        av_packet_unref(packet);
    }
    av_packet_free(&packet);
    ASSERT_GE(av_write_trailer(out), 0);
    avio_closep(&out->pb);
    avformat_free_context(out);
    avformat_close_input(&in);
}

TEST(Lens, FilmsSayIt) {
    test::Folder folder;
    VideoWriter video(folder / "a.mp4", 64, 48, 10);
    for (int i = 0; i < 3; ++i) video.add(Image(64, 48, 3, uint8_t(40 * i)));
    video.finish();
    EXPECT_EQ(VideoReader(folder / "a.mp4").focalLength(), 0);
    copyWithLens(folder / "a.mp4", folder / "b.mov", "26");
    EXPECT_EQ(VideoReader(folder / "b.mov").focalLength(), 26);
    EXPECT_EQ(Clip(folder / "b.mov", {}).focalLength(), 26);
    for (const char* wrong : {"0", "-3", "1e9", "nan", "wide"}) {
        copyWithLens(folder / "a.mp4", folder / "c.mov", wrong);
        EXPECT_EQ(VideoReader(folder / "c.mov").focalLength(), 0) << wrong;
    }
}

TEST(Lens, PicturesSayIt) {
    test::Folder folder;
    fs::create_directory(folder / "pictures");
    const fs::path plain = folder / "plain.jpg", told = folder / "pictures/told.jpg";
    writeImage(plain, Image(64, 48, 3, 90));
    // EXIF with one directory, whose one entry leads to another with one entry.
    constexpr uint8_t kLength = 35;
    const std::array<uint8_t, 54> exif{
        0xff,    0xe1, 0,    52,   'E', 'x', 'i', 'f', 0, 0,  //
        'I',     'I',  42,   0,    8,   0,   0,   0,          // 8 bytes on
        1,       0,    0x69, 0x87, 4,   0,   1,   0,   0, 0,
        26,      0,    0,    0,    0,   0,   0,   0,  // Exif's, at 26
        1,       0,    0x05, 0xa4, 3,   0,   1,   0,   0, 0,
        kLength, 0,    0,    0,    0,   0,   0,   0};
    const std::vector<uint8_t> bytes = readWholeFile(plain);
    std::vector<uint8_t> with(bytes.begin(), bytes.begin() + 2);
    with.insert(with.end(), exif.begin(), exif.end());
    with.insert(with.end(), bytes.begin() + 2, bytes.end());
    folder.write("pictures/told.jpg", std::span<const uint8_t>(with));
    EXPECT_EQ(imageFocalLength(plain), 0);
    EXPECT_EQ(imageFocalLength(told), kLength);
    EXPECT_EQ(Clip(folder / "pictures", {}).focalLength(), kLength);
    EXPECT_EQ(readImage(told).data, readImage(plain).data);
}

TEST(Lens, IsAnAngle) {
    EXPECT_NEAR(angleOfLens(18), 90, 1e-9);
    EXPECT_NEAR(angleOfLens(26), 69.39, .01);
    EXPECT_NEAR(cameraOfAngle(3600, 2400, angleOfLens(50)).fx, 5000, 1e-6);
}

}  // namespace
}  // namespace doppel
