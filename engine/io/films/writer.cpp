#include "engine/io/video.h"

extern "C" {
#include <libavfilter/avfilter.h>
#include <libavfilter/buffersink.h>
#include <libavfilter/buffersrc.h>
#include <libavutil/cpu.h>
#include <libavutil/pixdesc.h>
}

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/films/ffmpeg.h"
#include "engine/io/films/sound.h"

namespace doppel {

namespace {

// Of a kind whose filters hold the whole film: a gigabyte of frames.
constexpr int64_t kMostFilteredPixels = int64_t{256} << 20;

struct GraphDeleter {
    void operator()(AVFilterGraph* graph) const { avfilter_graph_free(&graph); }
};

struct OptionsDeleter {
    void operator()(AVDictionary* options) const { av_dict_free(&options); }
};

// "name=value:name=value".
std::unique_ptr<AVDictionary, OptionsDeleter> parsed(const std::string& text) {
    AVDictionary* options = nullptr;
    const int code = av_dict_parse_string(&options, text.c_str(), "=", ":", 0);
    std::unique_ptr<AVDictionary, OptionsDeleter> owned(options);
    CHECK(code >= 0, "options are written name=value:name=value, not {}", text);
    return owned;
}

}  // namespace

struct VideoWriter::Parts {
    Parts(const std::filesystem::path& path, const VideoKind& videoKind, int frameWidth,
          int frameHeight)
        : kind(videoKind), width(frameWidth), height(frameHeight), file(path) {}
    ~Parts() {
        if (format != nullptr) {
            if (format->pb != nullptr) avio_closep(&format->pb);
            avformat_free_context(format);
        }
    }

    [[noreturn]] void fail(const char* doing, int code) const {
        throwMachine("{}: cannot {}: {}", file.target().string(), doing, errorText(code));
    }

    void openEncoder(double framesPerSecond);
    void openFile();
    void openFilters(const char* description);
    void openScaler();
    void fill(const Image& image);
    void encode(const AVFrame* input);
    void send(AVFrame* input);

    const VideoKind& kind;
    int width, height;
    AtomicFile file;
    AVFormatContext* format = nullptr;
    AVStream* stream = nullptr;  // the format owns it
    Owned<AVCodecContext> codec;
    Owned<AVFrame> frame, filtered;
    Owned<AVPacket> packet;
    Owned<SwsContext> scaler;
    std::unique_ptr<AVFilterGraph, GraphDeleter> graph;
    AVFilterContext *source = nullptr, *sink = nullptr;  // the graph owns them
    std::unique_ptr<SoundTrack> sound;
    bool alpha = false;
    int channels = 3;             // of the padded picture
    std::vector<uint8_t> pixels;  // the padded picture
    int64_t frames = 0;
    bool finished = false;
};

void VideoWriter::Parts::openEncoder(double framesPerSecond) {
    const AVCodec* encoder = nullptr;
    const VideoEncoder* chosen = nullptr;
    for (const VideoEncoder& candidate : kind.encoders) {
        if (encoder != nullptr || candidate.name == nullptr) continue;
        encoder = avcodec_find_encoder_by_name(candidate.name);
        chosen = &candidate;
    }
    CHECK(encoder != nullptr, "{} has an encoder", kind.ending);
    codec.reset(required(avcodec_alloc_context3(encoder)));
    codec->width = width + (kind.evenSides ? width % 2 : 0);
    codec->height = height + (kind.evenSides ? height % 2 : 0);
    codec->pix_fmt = av_get_pix_fmt(alpha ? kind.alphaPixels : kind.pixels);
    // MPEG-4 takes a denominator of 16 bits at most.
    codec->framerate = av_d2q(framesPerSecond, 60000);
    codec->time_base = av_inv_q(codec->framerate);
    codec->sample_aspect_ratio = {1, 1};
    const AVPixFmtDescriptor* description = av_pix_fmt_desc_get(codec->pix_fmt);
    if ((description->flags & (AV_PIX_FMT_FLAG_RGB | AV_PIX_FMT_FLAG_PAL)) == 0) {
        codec->colorspace = AVCOL_SPC_BT709;
        codec->color_primaries = AVCOL_PRI_BT709;
        codec->color_trc = AVCOL_TRC_BT709;
        codec->color_range = AVCOL_RANGE_MPEG;
    }
    codec->thread_count = 1;
    codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER | AV_CODEC_FLAG_BITEXACT;
    const bool further = alpha && *chosen->alphaOptions != 0;
    std::string options =
        further ? fmt::format("{}:{}", chosen->options, chosen->alphaOptions) : chosen->options;
    // Of x264's vectors those of 512 bits read memory that nobody has written, where a picture's
    // blocks do not fill them: the same pictures gave other bytes.
    if (std::string_view(encoder->name) == "libx264" && av_get_cpu_flags() & AV_CPU_FLAG_AVX512)
        options += ":x264-params=asm=SSE2,SSE3,SSSE3,SSE4.2,AVX,AVX2,FMA3,BMI1,BMI2,LZCNT";
    AVDictionary* taken = parsed(options).release();
    const int code = avcodec_open2(codec.get(), encoder, &taken);
    av_dict_free(&taken);
    if (code < 0) fail("start the encoder", code);
}

void VideoWriter::Parts::openFile() {
    const std::string name = "file:" + file.pathForLibrary().string();
    int code = avformat_alloc_output_context2(&format, nullptr, kind.muxer, name.c_str());
    if (code < 0) fail("start it", code);
    format->flags |= AVFMT_FLAG_BITEXACT;
    stream = required(avformat_new_stream(format, nullptr));
    stream->time_base = codec->time_base;
    stream->avg_frame_rate = codec->framerate;
    code = avcodec_parameters_from_context(stream->codecpar, codec.get());
    if (code < 0) fail("start it", code);
    if (sound) sound->addTo(format);
    code = avio_open(&format->pb, name.c_str(), AVIO_FLAG_WRITE);
    if (code < 0) fail("create it", code);
    AVDictionary* options = parsed(kind.muxerOptions).release();
    code = avformat_write_header(format, &options);
    av_dict_free(&options);
    if (code < 0) fail("write it", code);
}

// Frames go in as BGRA, and come out as the encoder takes them.
void VideoWriter::Parts::openFilters(const char* description) {
    graph.reset(required(avfilter_graph_alloc()));
    graph->nb_threads = 1;
    const std::string input = fmt::format(
        "video_size={}x{}:pix_fmt={}:time_base={}/{}:pixel_aspect=1/1", codec->width, codec->height,
        int{AV_PIX_FMT_BGRA}, codec->time_base.num, codec->time_base.den);
    int code = avfilter_graph_create_filter(&source, avfilter_get_by_name("buffer"), "in",
                                            input.c_str(), nullptr, graph.get());
    if (code >= 0) {
        code = avfilter_graph_create_filter(&sink, avfilter_get_by_name("buffersink"), "out",
                                            nullptr, nullptr, graph.get());
    }
    if (code < 0) fail("start its filters", code);
    // As FFmpeg sees it, the graph's open ends are those of the filters around it.
    AVFilterInOut* before = required(avfilter_inout_alloc());
    AVFilterInOut* after = required(avfilter_inout_alloc());
    before->name = av_strdup("in");
    before->filter_ctx = source;
    after->name = av_strdup("out");
    after->filter_ctx = sink;
    code = avfilter_graph_parse_ptr(graph.get(), description, &after, &before, nullptr);
    avfilter_inout_free(&before);
    avfilter_inout_free(&after);
    if (code >= 0) code = avfilter_graph_config(graph.get(), nullptr);
    if (code < 0) fail("start its filters", code);
    filtered.reset(required(av_frame_alloc()));
}

void VideoWriter::Parts::openScaler() {
    frame.reset(required(av_frame_alloc()));
    frame->format = graph ? AV_PIX_FMT_BGRA : codec->pix_fmt;
    frame->width = codec->width;
    frame->height = codec->height;
    // ProRes says so in every frame.
    frame->colorspace = codec->colorspace;
    frame->color_primaries = codec->color_primaries;
    frame->color_trc = codec->color_trc;
    frame->color_range = codec->color_range;
    const int code = av_frame_get_buffer(frame.get(), 0);
    if (code < 0) fail("start it", code);
    if (frame->format == AV_PIX_FMT_BGRA) return;  // no conversion, but for the order
    channels = alpha ? 4 : 3;
    scaler.reset(required(sws_getContext(
        codec->width, codec->height, alpha ? AV_PIX_FMT_RGBA : AV_PIX_FMT_RGB24, codec->width,
        codec->height, AVPixelFormat(frame->format), kScaling, nullptr, nullptr, nullptr)));
    sws_setColorspaceDetails(scaler.get(), sws_getCoefficients(SWS_CS_DEFAULT), 1,
                             sws_getCoefficients(SWS_CS_ITU709), 0, 0, 1 << 16, 1 << 16);
    // swscale reads a little beyond the last pixel, and what it finds there reaches the film.
    pixels.resize(static_cast<size_t>(codec->width) * static_cast<size_t>(codec->height) *
                      static_cast<size_t>(channels) +
                  64);
}

// Puts a picture into the frame.
void VideoWriter::Parts::fill(const Image& image) {
    const int code = av_frame_make_writable(frame.get());
    if (code < 0) fail("encode it", code);
    const bool direct = !scaler;
    const size_t step = direct ? 4 : static_cast<size_t>(channels);
    const size_t red = direct ? 2 : 0;
    for (int y = 0; y < codec->height; ++y) {
        const int row = std::min(y, image.height - 1);
        uint8_t* out =
            direct ? frame->data[0] + y * frame->linesize[0]
                   : &pixels[static_cast<size_t>(y) * static_cast<size_t>(codec->width) * step];
        for (int x = 0; x < codec->width; ++x, out += step) {
            const uint8_t* in = image.pixel(std::min(x, image.width - 1), row);
            const bool grey = image.channels == 1;
            out[red] = in[0];
            out[1] = in[grey ? 0 : 1];
            out[2 - red] = in[grey ? 0 : 2];
            if (step == 4) out[3] = alpha && image.channels == 4 ? in[3] : 255;
        }
    }
    if (direct) return;
    const uint8_t* planes[4] = {pixels.data()};
    const int strides[4] = {codec->width * channels};
    sws_scale(scaler.get(), planes, strides, 0, codec->height, frame->data, frame->linesize);
}

// Hands a frame (null: the end) to the encoder and its packets to the file.
void VideoWriter::Parts::encode(const AVFrame* input) {
    int code = avcodec_send_frame(codec.get(), input);
    if (code < 0) fail("encode it", code);
    while ((code = avcodec_receive_packet(codec.get(), packet.get())) >= 0) {
        packet->duration = 1;
        av_packet_rescale_ts(packet.get(), codec->time_base, stream->time_base);
        packet->stream_index = stream->index;
        code = av_interleaved_write_frame(format, packet.get());
        if (code < 0) fail("write it", code);
    }
    if (code != AVERROR(EAGAIN) && code != AVERROR_EOF) fail("encode it", code);
}

// The same by way of the filters, where there are some.
void VideoWriter::Parts::send(AVFrame* input) {
    if (!graph) return encode(input);
    int code = av_buffersrc_add_frame_flags(source, input, AV_BUFFERSRC_FLAG_KEEP_REF);
    while (code >= 0 && (code = av_buffersink_get_frame(sink, filtered.get())) >= 0) {
        filtered->pict_type = AV_PICTURE_TYPE_NONE;
        encode(filtered.get());
        av_frame_unref(filtered.get());
    }
    if (code != AVERROR(EAGAIN) && code != AVERROR_EOF) fail("filter it", code);
    if (input == nullptr) encode(nullptr);
}

VideoWriter::VideoWriter(const std::filesystem::path& path, int width, int height,
                         double framesPerSecond, const VideoOptions& options) {
    quiet();
    CHECK(width >= 1 && height >= 1 && width <= kMaxImageSide && height <= kMaxImageSide,
          "a video of {} x {} must have 1 to {} pixels a side", width, height, kMaxImageSide);
    const VideoKind& kind = requireVideoKind(path);
    if (!(framesPerSecond > 0 && framesPerSecond <= kind.mostFramesPerSecond)) {
        throwInput("{}: {} frames per second; expected more than 0, at most {}{}", path.string(),
                   framesPerSecond, kind.mostFramesPerSecond,
                   kind.mostFramesPerSecond < 1000 ? fmt::format(" in a {}", kind.ending) : "");
    }
    if (options.alpha && !kind.keepsAlpha()) {
        throwInput("{}: {} keeps no alpha; name a {}", path.string(), kind.codec,
                   videoEndings([](const VideoKind& other) { return other.keepsAlpha(); }));
    }
    if (options.sound && !kind.keepsSound()) {
        throwInput("{}: {} keeps no sound; name a {}", path.string(), kind.codec,
                   videoEndings([](const VideoKind& other) { return other.keepsSound(); }));
    }
    parts_ = std::make_unique<Parts>(path, kind, width, height);
    Parts& p = *parts_;
    if (options.sound) p.sound = std::make_unique<SoundTrack>(*options.sound, kind);
    p.alpha = options.alpha;
    p.openEncoder(framesPerSecond);
    p.openFile();
    if (kind.filters != nullptr) p.openFilters(options.alpha ? kind.alphaFilters : kind.filters);
    p.packet.reset(required(av_packet_alloc()));
    p.openScaler();
}

VideoWriter::~VideoWriter() = default;

void VideoWriter::add(const Image& image) {
    Parts& p = *parts_;
    CHECK(!p.finished, "no frame may be added after finish()");
    CHECK(image.width == p.width && image.height == p.height && image.channels != 2,
          "a frame must be {} x {} with 1, 3 or 4 channels, not {} x {} x {}", p.width, p.height,
          image.width, image.height, image.channels);
    if (p.graph && (p.frames + 1) * p.width * p.height > kMostFilteredPixels) {
        throwInput(
            "{}: {} frames of {} x {} pixels are more than a {} is made of here (256 million "
            "pixels); give --size or --frames, or name another kind",
            p.file.target().string(), p.frames + 1, p.width, p.height, p.kind.ending);
    }
    p.fill(image);
    p.frame->pts = p.frames++;
    p.send(p.frame.get());
    if (p.sound) p.sound->writeUntil(static_cast<double>(p.frames) * av_q2d(p.codec->time_base));
}

void VideoWriter::finish() {
    Parts& p = *parts_;
    CHECK(p.frames > 0 && !p.finished, "finish() must follow one frame or more, once");
    p.send(nullptr);
    if (p.sound) p.sound->finish(static_cast<double>(p.frames) * av_q2d(p.codec->time_base));
    int code = av_write_trailer(p.format);
    if (code < 0) p.fail("write it", code);
    // Errors of writes that were only buffered until now, no space left for one.
    if (p.format->pb->error < 0) p.fail("write it", p.format->pb->error);
    code = avio_closep(&p.format->pb);
    if (code < 0) p.fail("write it", code);
    p.file.commit();
    p.finished = true;
}

}  // namespace doppel
