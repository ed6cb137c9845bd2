#include "engine/io/video.h"

extern "C" {
#include <libavutil/display.h>
#include <libavutil/pixdesc.h>
}

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/films/ffmpeg.h"

namespace doppel {
namespace {

// A hostile header may claim any size; every frame in flight takes memory for it.
constexpr int64_t kMaxPixels = int64_t{8192} * 8192;

Image turned(const Image& image, int degrees) {
    if (degrees == 0) return image;
    const bool lying = degrees != 180;
    Image result(lying ? image.height : image.width, lying ? image.width : image.height,
                 image.channels);
    for (int y = 0; y < result.height; ++y) {
        for (int x = 0; x < result.width; ++x) {
            int sx = image.width - 1 - x, sy = image.height - 1 - y;  // 180
            if (degrees == 90) sx = y, sy = image.height - 1 - x;
            if (degrees == 270) sx = image.width - 1 - y, sy = x;
            std::copy_n(image.pixel(sx, sy), image.channelCount(), result.pixel(x, y));
        }
    }
    return result;
}

void mirror(Image& image) {
    for (int y = 0; y < image.height; ++y)
        for (int left = 0, right = image.width - 1; left < right; ++left, --right)
            std::swap_ranges(image.pixel(left, y), image.pixel(left, y) + image.channels,
                             image.pixel(right, y));
}

// ---- wide colours and high dynamic range
// ---------------------------------------------------------

constexpr size_t kSteps = 4096;
constexpr double kWhite = 203, kDisplay = 1000;  // cd/m²

// cd/m².
double pq(double signal) {
    constexpr double m1 = 2610. / 16384, m2 = 2523. / 32, c1 = 3424. / 4096, c2 = 2413. / 128,
                     c3 = 2392. / 128;
    const double p = std::pow(signal, 1 / m2);
    return 10000 * std::pow(std::max(p - c1, 0.) / (c2 - c3 * p), 1 / m1);
}

// [0,1].
double srgb(double signal) {
    return signal <= .04045 ? signal / 12.92 : std::pow((signal + .055) / 1.055, 2.4);
}

// The scene's light, [0,1].
double hlg(double signal) {
    constexpr double a = .17883277, b = .28466892, c = .55991073;
    return signal <= .5 ? signal * signal / 3 : (std::exp((signal - c) / a) + b) / 12;
}

enum class Transfer : uint8_t {
    Srgb,  // near enough to what films of standard range have
    Pq,    // SMPTE ST 2084
    Hlg,   // ARIB STD-B67, shown on a display of 1,000 cd/m²
};

using Matrix = std::array<std::array<float, 3>, 3>;  // by rows
// From BT.2020's primaries (ITU-R BT.2100-2) and from Display P3's (SMPTE EG 432-1) to BT.709's,
// which are sRGB's. White is D65 in all of them.
constexpr Matrix kFromBt2020{{{1.660491f, -.587641f, -.07285f},
                              {-.12455f, 1.1329f, -.008349f},
                              {-.018151f, -.100579f, 1.11873f}}};
constexpr Matrix kFromP3{
    {{1.22494f, -.22494f, 0}, {-.042057f, 1.042057f, 0}, {-.019638f, -.078636f, 1.098274f}}};

// From signals of 16 bits to 8-bit sRGB. Of high dynamic range 203 cd/m², the white of paper
// (BT.2408), is white; what is brighter than .8 of it is compressed, hues are kept.
class WideColours {
public:
    WideColours(Transfer transfer, const Matrix& matrix);

    std::array<uint8_t, 3> operator()(const std::array<uint16_t, 3>& signal) const;

private:
    Transfer transfer_;
    Matrix matrix_;
    std::vector<float> linear_;     // of signals / 16; 1: that white, or HLG's scene light
    std::vector<uint8_t> encoded_;  // of the square root of linear light
};

WideColours::WideColours(Transfer transfer, const Matrix& matrix)
    : transfer_(transfer), matrix_(matrix) {
    for (size_t i = 0; i < kSteps; ++i) {
        const double signal = (double(i) + .5) / kSteps;
        linear_.push_back(float(transfer == Transfer::Pq    ? pq(signal) / kWhite
                                : transfer == Transfer::Hlg ? hlg(signal)
                                                            : srgb(signal)));
        const double light = signal * signal;
        const double encoded =
            light <= .0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - .055;
        encoded_.push_back(uint8_t(std::lround(255 * encoded)));
    }
}

std::array<uint8_t, 3> WideColours::operator()(const std::array<uint16_t, 3>& signal) const {
    std::array<float, 3> wide;
    for (size_t c = 0; c < 3; ++c) wide[c] = linear_[signal[c] / 16];
    if (transfer_ == Transfer::Hlg) {
        // From the scene to the display, whose gamma is 1.2 by luminance.
        const float y = .2627f * wide[0] + .678f * wide[1] + .0593f * wide[2];
        const float gain = float(kDisplay / kWhite) * std::pow(std::max(y, 1e-6f), .2f);
        for (float& v : wide) v *= gain;
    }
    std::array<float, 3> light;
    for (size_t c = 0; c < 3; ++c)
        light[c] = matrix_[c][0] * wide[0] + matrix_[c][1] * wide[1] + matrix_[c][2] * wide[2];
    constexpr float kKnee = .8f;
    const float most = std::max({light[0], light[1], light[2]});
    if (transfer_ != Transfer::Srgb && most > kKnee) {
        const float to = kKnee + (1 - kKnee) * (1 - std::exp((kKnee - most) / (1 - kKnee)));
        for (float& v : light) v *= to / most;
    }
    std::array<uint8_t, 3> result;
    for (size_t c = 0; c < 3; ++c) {
        const float root = std::sqrt(std::clamp(light[c], 0.f, 1.f));
        result[c] = encoded_[std::min(size_t(root * float(kSteps)), kSteps - 1)];
    }
    return result;
}

// Empty: a film's colours are sRGB's.
std::optional<WideColours> wideColours(const AVCodecParameters& film) {
    const Transfer transfer = film.color_trc == AVCOL_TRC_SMPTE2084      ? Transfer::Pq
                              : film.color_trc == AVCOL_TRC_ARIB_STD_B67 ? Transfer::Hlg
                                                                         : Transfer::Srgb;
    if (film.color_primaries == AVCOL_PRI_SMPTE432) return WideColours(transfer, kFromP3);
    if (transfer != Transfer::Srgb || film.color_primaries == AVCOL_PRI_BT2020)
        return WideColours(transfer, kFromBt2020);
    return {};
}

}  // namespace

// ---- reader -------------------------------------------------------------------------------------

struct VideoReader::Parts {
    ~Parts() { avformat_close_input(&format); }

    [[noreturn]] void damaged(int code) const {
        throwInput("{}: the video is damaged or cut short after frame {}: {}", name, frames,
                   errorText(code));
    }

    // Decodes into `decoded`; false at the end.
    bool decode() {
        while (true) {
            int code = avcodec_receive_frame(codec.get(), decoded.get());
            if (code >= 0) {
                // Decoders paint over what they cannot read, and following frames show it.
                constexpr int kPaintedOver = FF_DECODE_ERROR_INVALID_BITSTREAM |
                                             FF_DECODE_ERROR_CONCEALMENT_ACTIVE |
                                             FF_DECODE_ERROR_DECODE_SLICES;
                if (decoded->decode_error_flags & kPaintedOver) damaged(AVERROR_INVALIDDATA);
                return true;
            }
            if (code == AVERROR_EOF) return false;
            if (code != AVERROR(EAGAIN)) damaged(code);
            code = av_read_frame(format, packet.get());
            if (code == AVERROR_EOF) {
                code = avcodec_send_packet(codec.get(), nullptr);
                if (code < 0 && code != AVERROR_EOF) damaged(code);
                continue;
            }
            if (code < 0) damaged(code);
            if (packet->stream_index == stream->index) {
                if (packet->flags & AV_PKT_FLAG_CORRUPT) {
                    av_packet_unref(packet.get());
                    damaged(AVERROR_INVALIDDATA);
                }
                code = avcodec_send_packet(codec.get(), packet.get());
            }
            av_packet_unref(packet.get());
            if (code < 0) damaged(code);
        }
    }

    void convert(Image& image) {
        const int w = decoded->width, h = decoded->height;
        if (w != codedWidth || h != codedHeight) {
            throwInput("{}: frame {} is {} x {}, the first was {} x {}", name, frames, w, h,
                       codedWidth, codedHeight);
        }
        AVPixelFormat pixels = static_cast<AVPixelFormat>(decoded->format);
        bool full = decoded->color_range == AVCOL_RANGE_JPEG;
        // Old names for "yuv in full range".
        for (const auto& [old, plain] : {std::pair{AV_PIX_FMT_YUVJ420P, AV_PIX_FMT_YUV420P},
                                         {AV_PIX_FMT_YUVJ422P, AV_PIX_FMT_YUV422P},
                                         {AV_PIX_FMT_YUVJ444P, AV_PIX_FMT_YUV444P}}) {
            if (pixels == old) pixels = plain, full = true;
        }
        const AVPixFmtDescriptor* description = av_pix_fmt_desc_get(pixels);
        if (description == nullptr || (description->flags & AV_PIX_FMT_FLAG_HWACCEL)) {
            throwInput("{}: frames of a pixel format that cannot be read", name);
        }
        // A quarter turn comes after scaling.
        const bool lying = rotation % 180 != 0;
        const int outW = lying ? size.height : size.width, outH = lying ? size.width : size.height;
        const AVPixelFormat target = wide ? AV_PIX_FMT_RGB48 : AV_PIX_FMT_RGB24;
        scaler.reset(sws_getCachedContext(scaler.release(), w, h, pixels, outW, outH, target,
                                          kScaling, nullptr, nullptr, nullptr));
        if (!scaler) throwInput("{}: frames of a pixel format that cannot be converted", name);
        // Where the file does not say: high definition is BT.709, the rest BT.601.
        int space = SWS_CS_ITU601;
        if (decoded->colorspace == AVCOL_SPC_BT709 ||
            (decoded->colorspace == AVCOL_SPC_UNSPECIFIED && std::min(w, h) >= 720)) {
            space = SWS_CS_ITU709;
        } else if (decoded->colorspace == AVCOL_SPC_BT2020_NCL) {
            space = SWS_CS_BT2020;
        }
        sws_setColorspaceDetails(scaler.get(), sws_getCoefficients(space), full,
                                 sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, 1 << 16, 1 << 16);
        // Rows of a multiple of 64 bytes: swscale writes beyond the end of unaligned ones.
        const int stride = (outW * (wide ? 6 : 3) + 63) / 64 * 64;
        rows.resize(static_cast<size_t>(stride) * static_cast<size_t>(outH) + 64);
        uint8_t* planes[4] = {rows.data()};
        const int strides[4] = {stride};
        sws_scale(scaler.get(), decoded->data, decoded->linesize, 0, h, planes, strides);
        Image stored(outW, outH, 3);
        for (int y = 0; y < outH; ++y) {
            const uint8_t* row = &rows[static_cast<size_t>(y) * static_cast<size_t>(stride)];
            if (!wide) {
                std::memcpy(stored.row(y), row, stored.rowBytes());
                continue;
            }
            for (int x = 0; x < outW; ++x) {
                std::array<uint16_t, 3> signal;
                std::memcpy(signal.data(), row + 6 * x, sizeof signal);
                const auto colour = (*wide)(signal);
                std::copy(colour.begin(), colour.end(), stored.pixel(x, y));
            }
        }
        if (mirrored) mirror(stored);
        image = turned(stored, rotation);
    }

    std::string name;
    AVFormatContext* format = nullptr;
    const AVStream* stream = nullptr;
    Owned<AVCodecContext> codec;
    Owned<AVFrame> decoded;
    Owned<AVPacket> packet;
    Owned<SwsContext> scaler;
    std::vector<uint8_t> rows;
    std::optional<WideColours> wide;  // where the film's colours are not sRGB's
    int codedWidth = 0, codedHeight = 0, rotation = 0;
    bool mirrored = false;  // left and right, before it is turned
    ImageSize size;         // of the pictures that are given
    int64_t frames = 0;
    double time = 0;
};

VideoReader::VideoReader(const std::filesystem::path& path, int mostRows)
    : parts_(std::make_unique<Parts>()) {
    quiet();
    Parts& p = *parts_;
    p.name = path.string();
    if (readFileHead(path, 1).empty()) throwInput("{}: is an empty file", p.name);

    // Containers only: a playlist could name other files, and the network.
    AVDictionary* options = nullptr;
    av_dict_set(&options, "format_whitelist",
                "mov,matroska,webm,avi,mpegts,mpeg,flv,ogg,asf,mxf,gif", 0);
    av_dict_set(&options, "protocol_whitelist", "file", 0);
    int code = avformat_open_input(&p.format, ("file:" + p.name).c_str(), nullptr, &options);
    av_dict_free(&options);
    if (code < 0) {
        throwInput(
            "{}: expected a video (MP4, MOV, MKV, WebM, AVI, MPEG, FLV, Ogg, ASF, MXF or GIF): {}",
            p.name, errorText(code));
    }
    code = avformat_find_stream_info(p.format, nullptr);
    if (code < 0) throwInput("{}: the video is damaged: {}", p.name, errorText(code));
    const AVCodec* decoder = nullptr;
    const int index = av_find_best_stream(p.format, AVMEDIA_TYPE_VIDEO, -1, -1, &decoder, 0);
    if (index < 0 || decoder == nullptr) {
        throwInput("{}: expected a video stream that can be decoded, found none", p.name);
    }
    p.stream = p.format->streams[index];
    const AVCodecParameters& parameters = *p.stream->codecpar;
    p.codedWidth = parameters.width;
    p.codedHeight = parameters.height;
    if (p.codedWidth < 1 || p.codedHeight < 1 || p.codedWidth > kMaxImageSide ||
        p.codedHeight > kMaxImageSide ||
        int64_t{p.codedWidth} * int64_t{p.codedHeight} > kMaxPixels) {
        throwInput("{}: {} x {} pixels; expected at most {} a side and 64 million in all", p.name,
                   p.codedWidth, p.codedHeight, kMaxImageSide);
    }
    p.codec.reset(required(avcodec_alloc_context3(decoder)));
    code = avcodec_parameters_to_context(p.codec.get(), &parameters);
    if (code >= 0) {
        p.codec->pkt_timebase = p.stream->time_base;
        p.codec->max_pixels = kMaxPixels;
        p.codec->thread_count = 1;
        code = avcodec_open2(p.codec.get(), decoder, nullptr);
    }
    if (code < 0) throwInput("{}: the video cannot be decoded: {}", p.name, errorText(code));
    p.packet.reset(required(av_packet_alloc()));
    p.decoded.reset(required(av_frame_alloc()));

    p.wide = wideColours(parameters);

    std::array<int32_t, 9> place;
    size_t bytes = 0;
    const uint8_t* matrix = av_stream_get_side_data(p.stream, AV_PKT_DATA_DISPLAYMATRIX, &bytes);
    if (matrix != nullptr && bytes >= sizeof place) {
        std::memcpy(place.data(), matrix, sizeof place);
        // Cameras for selfies mirror; what is left without that is a turn.
        p.mirrored = double(place[0]) * place[4] < double(place[1]) * place[3];
        if (p.mirrored)
            for (const size_t i : {0, 1}) place[i] = -std::max(place[i], -INT32_MAX);
        const double degrees = -av_display_rotation_get(place.data());
        if (std::isfinite(degrees)) {
            p.rotation = ((static_cast<int>(std::lround(degrees / 90)) * 90) % 360 + 360) % 360;
        }
    }

    // Pixels that are not square are stretched to be; a shape that no camera has is not believed.
    double width = p.codedWidth, height = p.codedHeight;
    const AVRational aspect =
        av_guess_sample_aspect_ratio(p.format, p.format->streams[index], nullptr);
    const double stretch = aspect.num > 0 && aspect.den > 0 ? av_q2d(aspect) : 1;
    if (stretch >= 1. / 4 && stretch <= 4) width *= stretch;
    if (p.rotation % 180 != 0) std::swap(width, height);
    if (mostRows > 0 && height > mostRows) {
        width *= mostRows / height;
        height = mostRows;
    }
    const auto side = [](double length) {
        return static_cast<int>(std::clamp(std::lround(length), 1L, long{kMaxImageSide}));
    };
    p.size = {side(width), side(height)};
}

VideoReader::~VideoReader() = default;

int VideoReader::width() const { return parts_->size.width; }

int VideoReader::height() const { return parts_->size.height; }

double VideoReader::framesPerSecond() const {
    const AVRational rate = parts_->stream->avg_frame_rate;
    return rate.num > 0 && rate.den > 0 ? av_q2d(rate) : 0;
}

int64_t VideoReader::frameCount() const {
    return parts_->stream->nb_frames > 0 ? parts_->stream->nb_frames : -1;
}

const char* VideoReader::highRange() const {
    const AVColorTransferCharacteristic transfer = parts_->stream->codecpar->color_trc;
    if (transfer == AVCOL_TRC_SMPTE2084) return "PQ";
    return transfer == AVCOL_TRC_ARIB_STD_B67 ? "HLG" : "";
}

double VideoReader::duration() const {
    const AVStream& stream = *parts_->stream;
    if (stream.duration > 0) return static_cast<double>(stream.duration) * av_q2d(stream.time_base);
    const int64_t whole = parts_->format->duration;
    return whole > 0 ? static_cast<double>(whole) / AV_TIME_BASE : 0;
}

double VideoReader::focalLength() const {
    constexpr const char* kKey = "com.apple.quicktime.camera.focal_length.35mm_equivalent";
    for (const AVDictionary* told : {parts_->stream->metadata, parts_->format->metadata})
        if (const AVDictionaryEntry* entry = av_dict_get(told, kKey, nullptr, 0))
            return plausibleFocalLength(std::strtod(entry->value, nullptr));
    return 0;
}

bool VideoReader::next(Image& frame) {
    Parts& p = *parts_;
    if (!p.decode()) {
        // The index promises packets that the file does not hold.
        if (p.stream->nb_frames > 0 && p.frames == 0) p.damaged(AVERROR_EOF);
        return false;
    }
    p.convert(frame);
    const int64_t shown = p.decoded->best_effort_timestamp;
    const int64_t start = p.stream->start_time == AV_NOPTS_VALUE ? 0 : p.stream->start_time;
    p.time = shown == AV_NOPTS_VALUE
                 ? static_cast<double>(p.frames) / std::max(framesPerSecond(), 1.0)
                 : static_cast<double>(shown - start) * av_q2d(p.stream->time_base);
    ++p.frames;
    av_frame_unref(p.decoded.get());
    return true;
}

double VideoReader::time() const { return parts_->time; }

}  // namespace doppel
