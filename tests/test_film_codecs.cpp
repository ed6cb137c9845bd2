// Films of other programs: what FFmpeg decodes is read, whatever codec and container it is in.
extern "C" {
#include <libavutil/opt.h>
}

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <vector>

#include "engine/io/films/ffmpeg.h"
#include "engine/io/video.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::Folder;

constexpr int kWidth = 96, kHeight = 64, kFrames = 6;
constexpr AVRational kStep{1001, 30000};  // 29.97 a second

// A grey that grows from frame to frame, red below.
std::array<int, 3> colourAt(int y, int frame) {
    const int grey = 40 + 30 * frame;
    return y < kHeight / 2 ? std::array{grey, grey, grey} : std::array{200, 40, 40};
}

void check(int code) { ASSERT_GE(code, 0) << errorText(code); }

// Encodes the frames as another program would; false where this FFmpeg has no such encoder.
bool encode(const std::filesystem::path& path, const char* name) {
    const AVCodec* encoder = avcodec_find_encoder_by_name(name);
    if (encoder == nullptr) return false;
    AVFormatContext* format = nullptr;
    check(avformat_alloc_output_context2(&format, nullptr, nullptr, path.c_str()));
    Owned<AVCodecContext> codec(avcodec_alloc_context3(encoder));
    codec->width = kWidth, codec->height = kHeight;
    codec->time_base = kStep;
    codec->framerate = av_inv_q(kStep);
    codec->pix_fmt = encoder->pix_fmts ? encoder->pix_fmts[0] : AV_PIX_FMT_YUV420P;
    for (const AVPixelFormat* taken = encoder->pix_fmts; taken && *taken >= 0; ++taken)
        if (*taken == AV_PIX_FMT_YUV420P) codec->pix_fmt = *taken;
    codec->colorspace = AVCOL_SPC_SMPTE170M;
    codec->bit_rate = 4'000'000;
    codec->color_range = AVCOL_RANGE_MPEG;
    codec->strict_std_compliance = FF_COMPLIANCE_UNOFFICIAL;  // Motion JPEG of this range
    codec->thread_count = 1;
    if (format->oformat->flags & AVFMT_GLOBALHEADER) codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
    av_opt_set(codec->priv_data, "x265-params", "log-level=none", 0);
    check(avcodec_open2(codec.get(), encoder, nullptr));
    AVStream* stream = avformat_new_stream(format, nullptr);
    check(avcodec_parameters_from_context(stream->codecpar, codec.get()));
    stream->time_base = kStep;
    stream->avg_frame_rate = av_inv_q(kStep);
    check(avio_open(&format->pb, path.c_str(), AVIO_FLAG_WRITE));
    check(avformat_write_header(format, nullptr));

    Owned<AVPacket> packet(av_packet_alloc());
    const auto drain = [&] {
        while (avcodec_receive_packet(codec.get(), packet.get()) >= 0) {
            av_packet_rescale_ts(packet.get(), codec->time_base, stream->time_base);
            packet->stream_index = 0;
            check(av_interleaved_write_frame(format, packet.get()));
        }
    };
    Owned<SwsContext> scaler(sws_getContext(kWidth, kHeight, AV_PIX_FMT_RGB24, kWidth, kHeight,
                                            codec->pix_fmt, SWS_BILINEAR, nullptr, nullptr,
                                            nullptr));
    Owned<AVFrame> frame(av_frame_alloc());
    frame->width = kWidth, frame->height = kHeight, frame->format = codec->pix_fmt;
    check(av_frame_get_buffer(frame.get(), 0));
    std::vector<uint8_t> pixels;
    for (int i = 0; i < kFrames; ++i) {
        pixels.clear();
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x)
                for (int value : colourAt(y, i)) pixels.push_back(uint8_t(value));
        check(av_frame_make_writable(frame.get()));
        const uint8_t* planes[] = {pixels.data()};
        const int strides[] = {3 * kWidth};
        sws_scale(scaler.get(), planes, strides, 0, kHeight, frame->data, frame->linesize);
        frame->pts = i;
        check(avcodec_send_frame(codec.get(), frame.get()));
        drain();
    }
    check(avcodec_send_frame(codec.get(), nullptr));
    drain();
    check(av_write_trailer(format));
    avio_closep(&format->pb);
    avformat_free_context(format);
    return true;
}

struct Kind {
    const char *codec, *file;
};

class Codecs : public testing::TestWithParam<Kind> {};

TEST_P(Codecs, AreRead) {
    const auto [codec, name] = GetParam();
    Folder folder;
    if (!encode(folder / name, codec)) GTEST_SKIP() << "this FFmpeg has no " << codec;
    VideoReader video(folder / name);
    EXPECT_EQ(video.width(), kWidth);
    EXPECT_EQ(video.height(), kHeight);
    EXPECT_NEAR(video.framesPerSecond(), 29.97, .01);
    Image frame;
    for (int i = 0; i < kFrames; ++i) {
        ASSERT_TRUE(video.next(frame)) << i;
        EXPECT_NEAR(video.time(), i * av_q2d(kStep), 2e-3) << i;
        for (const int y : {kHeight / 4, 3 * kHeight / 4})
            for (size_t c = 0; c < 3; ++c)
                EXPECT_NEAR(frame.pixel(kWidth / 2, y)[c], colourAt(y, i)[c], 6) << i << " " << y;
    }
    EXPECT_FALSE(video.next(frame));
}

INSTANTIATE_TEST_SUITE_P(OfPhonesAndPrograms, Codecs,
                         testing::Values(Kind{"libx264", "h264.mkv"}, Kind{"libx264", "h264.mov"},
                                         Kind{"libx265", "hevc.mp4"}, Kind{"libx265", "hevc.mkv"},
                                         Kind{"libvpx", "vp8.webm"}, Kind{"libvpx-vp9", "vp9.webm"},
                                         Kind{"libvpx-vp9", "vp9.mkv"},
                                         Kind{"libaom-av1", "av1.mp4"},
                                         Kind{"prores_ks", "prores.mov"},
                                         Kind{"mpeg4", "mpeg4.avi"}, Kind{"mjpeg", "mjpeg.avi"},
                                         Kind{"mpeg2video", "mpeg2.mpg"}),
                         [](const auto& kind) {
                             std::string name = kind.param.file;
                             std::ranges::replace(name, '.', '_');
                             return name;
                         });

}  // namespace
}  // namespace doppel
