#include "engine/io/films/sound.h"

extern "C" {
#include <libavutil/audio_fifo.h>
#include <libavutil/channel_layout.h>
#include <libswresample/swresample.h>
}

#include <algorithm>
#include <cmath>
#include <cstring>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/films/ffmpeg.h"

namespace doppel {

namespace {

constexpr int kRate = 48000;           // of sound that is encoded; Opus has no other
constexpr int64_t kBitRate = 160'000;  // of it
constexpr int kChunk = 1024;           // samples, where the encoder takes any number

// Containers only: a playlist could name other files, and the network.
constexpr const char* kContainers =
    "mov,matroska,webm,avi,mpegts,mpeg,flv,ogg,asf,mxf,wav,mp3,flac,aac";

struct SoundDeleter {
    void operator()(AVFormatContext* context) const { avformat_close_input(&context); }
    void operator()(SwrContext* context) const { swr_free(&context); }
    void operator()(AVAudioFifo* fifo) const { av_audio_fifo_free(fifo); }
};
template <typename T>
using OwnedSound = std::unique_ptr<T, SoundDeleter>;

struct OpenedSound {
    OwnedSound<AVFormatContext> format;
    int stream = -1;  // negative: it has no sound that can be read
    const AVCodec* decoder = nullptr;
    int error = 0;
};

OpenedSound openSound(const std::filesystem::path& file) {
    quiet();
    OpenedSound opened;
    AVFormatContext* format = nullptr;
    AVDictionary* options = nullptr;
    av_dict_set(&options, "format_whitelist", kContainers, 0);
    av_dict_set(&options, "protocol_whitelist", "file", 0);
    opened.error =
        avformat_open_input(&format, ("file:" + file.string()).c_str(), nullptr, &options);
    av_dict_free(&options);
    if (opened.error < 0) return opened;
    opened.format.reset(format);
    opened.error = avformat_find_stream_info(format, nullptr);
    if (opened.error < 0) return opened;
    opened.stream = av_find_best_stream(format, AVMEDIA_TYPE_AUDIO, -1, -1, &opened.decoder, 0);
    if (opened.stream >= 0 && format->streams[opened.stream]->codecpar->sample_rate < 1)
        opened.stream = -1;
    return opened;
}

}  // namespace

bool hasSound(const std::filesystem::path& file) { return openSound(file).stream >= 0; }

struct SoundTrack::Parts {
    std::string name;
    double start = 0;
    OwnedSound<AVFormatContext> input;
    const AVStream* from = nullptr;
    double origin = 0;  // the time in the file at which its first picture is shown
    bool copied = false;
    AVFormatContext* muxer = nullptr;
    AVStream* to = nullptr;  // the muxer owns it
    Owned<AVPacket> packet, encoded;

    // Where it is encoded.
    Owned<AVCodecContext> decoder, encoder;
    Owned<AVFrame> decoded;
    OwnedSound<SwrContext> resampler;
    OwnedSound<AVAudioFifo> waiting;
    bool begun = false, held = false;
    int heardFormat = 0, heardRate = 0, heardChannels = 0;  // of the first frame, and all others
    // Samples yet to be left out, which are before the film's beginning; and yet to be made up,
    // where the sound begins later than the film.
    int64_t skip = 0, silent = 0;
    int64_t written = 0;  // samples

    bool pending = false;  // a packet was read and is not handed on yet
    bool ended = false;    // the file has no more
    double reached = 0;    // second of the film that is written

    [[noreturn]] void damaged(int code) const {
        throwInput("{}: the sound is damaged after {:.2f} s: {}", name, start + reached,
                   errorText(code));
    }
    void check(int code, const char* doing) const {
        if (code < 0) throwMachine("{}: cannot {} its sound: {}", name, doing, errorText(code));
    }
    void writePacket(AVPacket* p) const {
        p->stream_index = to->index;
        p->pos = -1;
        const int code = av_interleaved_write_frame(muxer, p);
        if (code < 0) throwMachine("{}: cannot write it: {}", muxer->url, errorText(code));
    }
    void openDecoder(const AVCodec* codec);
    void openEncoder(const VideoKind& kind);
    bool read();
    double timeOf(int64_t stamp) const;
    void copyUntil(double end);
    Owned<AVFrame> samplesOf(int count) const;
    void begin(AVFrame* first);
    void keepSilence();
    void keep(const AVFrame* heard);
    void decodeUntil(double end);
    void encode(const AVFrame* samples);
    void encodeUntil(int64_t samples, bool last);
};

void SoundTrack::Parts::openDecoder(const AVCodec* codec) {
    if (codec == nullptr) throwInput("{}: its sound cannot be decoded", name);
    decoder.reset(required(avcodec_alloc_context3(codec)));
    int code = avcodec_parameters_to_context(decoder.get(), from->codecpar);
    if (code >= 0) {
        decoder->pkt_timebase = from->time_base;
        decoder->thread_count = 1;
        code = avcodec_open2(decoder.get(), codec, nullptr);
    }
    if (code < 0) throwInput("{}: its sound cannot be decoded: {}", name, errorText(code));
    decoded.reset(required(av_frame_alloc()));
}

void SoundTrack::Parts::openEncoder(const VideoKind& kind) {
    const AVCodec* codec = nullptr;
    for (const char* candidate : kind.soundEncoders)
        if (codec == nullptr && candidate != nullptr)
            codec = avcodec_find_encoder_by_name(candidate);
    if (codec == nullptr) {
        throwMachine("{}: its sound ({}) has to be encoded for {}, and this FFmpeg has no {}", name,
                     avcodec_get_name(from->codecpar->codec_id), kind.ending,
                     kind.soundEncoders[0]);
    }
    encoder.reset(required(avcodec_alloc_context3(codec)));
    encoder->sample_fmt = codec->sample_fmts[0];
    encoder->sample_rate = kRate;
    encoder->time_base = {1, kRate};
    encoder->bit_rate = kBitRate;
    encoder->thread_count = 1;
    encoder->flags |= AV_CODEC_FLAG_GLOBAL_HEADER | AV_CODEC_FLAG_BITEXACT;
    av_channel_layout_default(&encoder->ch_layout,
                              std::min(from->codecpar->ch_layout.nb_channels, 2));
    check(avcodec_open2(encoder.get(), codec, nullptr), "encode");
    waiting.reset(
        required(av_audio_fifo_alloc(encoder->sample_fmt, encoder->ch_layout.nb_channels, kRate)));
}

// The next packet of the sound in `packet`; false at the end.
bool SoundTrack::Parts::read() {
    while (!pending && !ended) {
        const int code = av_read_frame(input.get(), packet.get());
        if (code == AVERROR_EOF) {
            ended = true;
        } else if (code < 0) {
            damaged(code);
        } else if (packet->stream_index != from->index) {
            av_packet_unref(packet.get());
        } else if (packet->flags & AV_PKT_FLAG_CORRUPT) {
            av_packet_unref(packet.get());
            damaged(AVERROR_INVALIDDATA);
        } else {
            pending = true;
        }
    }
    return pending;
}

// The film's second of a time stamp of the file.
double SoundTrack::Parts::timeOf(int64_t stamp) const {
    return static_cast<double>(stamp) * av_q2d(from->time_base) - origin - start;
}

void SoundTrack::Parts::copyUntil(double end) {
    // What a codec has to hear before its first sample lies before the beginning. MP4 and MOV say
    // so in their edit lists, of whatever packet the film begins in.
    const bool edits = (muxer->oformat->flags & AVFMT_TS_NEGATIVE) != 0 &&
                       std::strcmp(muxer->oformat->name, "webm") != 0;
    const AVCodecParameters& parameters = *from->codecpar;
    while (read()) {
        if (packet->pts == AV_NOPTS_VALUE) damaged(AVERROR_INVALIDDATA);
        const double at = timeOf(packet->pts);
        if (at >= end) return;
        const double before =
            edits ? static_cast<double>(packet->duration) * av_q2d(from->time_base)
                  : static_cast<double>(parameters.initial_padding) / parameters.sample_rate;
        pending = false;
        if (at < -before - 1e-4) {
            av_packet_unref(packet.get());
            continue;
        }
        reached = std::max(at, 0.);
        packet->pts = packet->dts = std::llround(at / av_q2d(to->time_base));
        packet->duration = av_rescale_q(packet->duration, from->time_base, to->time_base);
        writePacket(packet.get());
    }
}

// Room for samples as they are encoded.
Owned<AVFrame> SoundTrack::Parts::samplesOf(int count) const {
    Owned<AVFrame> frame(required(av_frame_alloc()));
    frame->format = encoder->sample_fmt;
    frame->sample_rate = kRate;
    frame->nb_samples = count;
    check(av_channel_layout_copy(&frame->ch_layout, &encoder->ch_layout), "encode");
    check(av_frame_get_buffer(frame.get(), 0), "encode");
    return frame;
}

// Learns from the first frame where the sound begins and how it is resampled.
void SoundTrack::Parts::begin(AVFrame* first) {
    begun = true;
    const int64_t stamp = first->best_effort_timestamp;
    const double at = stamp == AV_NOPTS_VALUE ? -start : timeOf(stamp);
    if (!(std::abs(at) < 1e9)) damaged(AVERROR_INVALIDDATA);
    const int64_t sample = std::llround(at * kRate);
    skip = std::max<int64_t>(-sample, 0);
    silent = std::max<int64_t>(sample, 0);
    heardFormat = first->format;
    heardRate = first->sample_rate;
    heardChannels = first->ch_layout.nb_channels;
    SwrContext* context = nullptr;
    int code = swr_alloc_set_opts2(&context, &encoder->ch_layout, encoder->sample_fmt, kRate,
                                   &first->ch_layout, AVSampleFormat(first->format),
                                   first->sample_rate, 0, nullptr);
    resampler.reset(context);
    if (code >= 0) code = swr_init(context);
    if (code < 0) damaged(code);
}

void SoundTrack::Parts::keepSilence() {
    Owned<AVFrame> silence = samplesOf(kChunk);
    av_samples_set_silence(silence->extended_data, 0, kChunk, encoder->ch_layout.nb_channels,
                           encoder->sample_fmt);
    const auto count = static_cast<int>(std::min<int64_t>(silent, kChunk));
    check(
        av_audio_fifo_write(waiting.get(), reinterpret_cast<void**>(silence->extended_data), count),
        "encode");
    silent -= count;
}

// Resamples what was decoded, and leaves out what is before the beginning.
void SoundTrack::Parts::keep(const AVFrame* heard) {
    if (heard->format != heardFormat || heard->sample_rate != heardRate ||
        heard->ch_layout.nb_channels != heardChannels)
        damaged(AVERROR_INPUT_CHANGED);
    const int room = std::max(swr_get_out_samples(resampler.get(), heard->nb_samples), 1);
    const Owned<AVFrame> converted = samplesOf(room);
    const int made =
        swr_convert(resampler.get(), converted->extended_data, room,
                    const_cast<const uint8_t**>(heard->extended_data), heard->nb_samples);
    if (made < 0) damaged(made);
    const auto left = static_cast<int>(std::min<int64_t>(skip, made));
    skip -= left;
    const int count = made - left;
    if (count == 0) return;
    const int bytes = av_get_bytes_per_sample(encoder->sample_fmt);
    const bool planar = av_sample_fmt_is_planar(encoder->sample_fmt) != 0;
    const int channels = encoder->ch_layout.nb_channels;
    uint8_t* planes[2] = {};
    for (int c = 0; c < (planar ? channels : 1); ++c)
        planes[c] = converted->extended_data[c] + left * bytes * (planar ? 1 : channels);
    check(av_audio_fifo_write(waiting.get(), reinterpret_cast<void**>(planes), count), "encode");
}

// Until so much of the film's sound is decoded, or there is no more.
void SoundTrack::Parts::decodeUntil(double end) {
    const auto wanted = static_cast<int64_t>(std::ceil(end * kRate));
    while (written + av_audio_fifo_size(waiting.get()) < wanted) {
        if (silent > 0) {
            keepSilence();
            continue;
        }
        // A first frame that waits for the silence before it.
        int code = held ? 0 : avcodec_receive_frame(decoder.get(), decoded.get());
        if (code >= 0) {
            if (!begun) begin(decoded.get());
            held = silent > 0;
            if (held) continue;
            keep(decoded.get());
            av_frame_unref(decoded.get());
            continue;
        }
        if (code == AVERROR_EOF) return;
        if (code != AVERROR(EAGAIN)) damaged(code);
        code = avcodec_send_packet(decoder.get(), read() ? packet.get() : nullptr);
        av_packet_unref(packet.get());
        pending = false;
        if (code < 0 && code != AVERROR_EOF) damaged(code);
    }
}

void SoundTrack::Parts::encode(const AVFrame* samples) {
    int code = avcodec_send_frame(encoder.get(), samples);
    check(code, "encode");
    while ((code = avcodec_receive_packet(encoder.get(), encoded.get())) >= 0) {
        av_packet_rescale_ts(encoded.get(), encoder->time_base, to->time_base);
        writePacket(encoded.get());
    }
    if (code != AVERROR(EAGAIN) && code != AVERROR_EOF) check(code, "encode");
}

// In frames of the encoder's size up to this sample; the last frame may be shorter.
void SoundTrack::Parts::encodeUntil(int64_t samples, bool last) {
    const int size = encoder->frame_size > 0 ? encoder->frame_size : kChunk;
    while (written < samples) {
        const auto count = static_cast<int>(
            std::min<int64_t>({size, samples - written, av_audio_fifo_size(waiting.get())}));
        if (count == 0 || (count < size && !last)) return;
        const Owned<AVFrame> frame = samplesOf(count);
        check(av_audio_fifo_read(waiting.get(), reinterpret_cast<void**>(frame->extended_data),
                                 count),
              "encode");
        frame->pts = written;
        written += count;
        reached = static_cast<double>(written) / kRate;
        encode(frame.get());
    }
}

SoundTrack::SoundTrack(const SoundSource& source, const VideoKind& kind)
    : parts_(std::make_unique<Parts>()) {
    Parts& p = *parts_;
    p.name = source.file.string();
    p.start = source.start;
    if (readFileHead(source.file, 1).empty()) throwInput("{}: is an empty file", p.name);
    OpenedSound opened = openSound(source.file);
    if (opened.error < 0) {
        throwInput("{}: expected a film or sound (WAV, MP3, FLAC, AAC, Ogg, MP4, MKV …): {}",
                   p.name, errorText(opened.error));
    }
    if (opened.stream < 0) throwInput("{}: expected sound, found none in it", p.name);
    p.input = std::move(opened.format);
    p.from = p.input->streams[opened.stream];
    const int pictures =
        av_find_best_stream(p.input.get(), AVMEDIA_TYPE_VIDEO, -1, opened.stream, nullptr, 0);
    const AVStream& first = pictures >= 0 ? *p.input->streams[pictures] : *p.from;
    const bool cover = (first.disposition & AV_DISPOSITION_ATTACHED_PIC) != 0;
    if (pictures >= 0 && !cover && first.start_time != AV_NOPTS_VALUE)
        p.origin = static_cast<double>(first.start_time) * av_q2d(first.time_base);
    p.packet.reset(required(av_packet_alloc()));
    p.encoded.reset(required(av_packet_alloc()));
    const std::string_view codec = avcodec_get_name(p.from->codecpar->codec_id);
    p.copied = std::ranges::any_of(
        kind.soundCodecs, [&](const char* taken) { return taken != nullptr && codec == taken; });
    if (p.copied) return;
    p.openDecoder(opened.decoder);
    p.openEncoder(kind);
}

SoundTrack::~SoundTrack() = default;

void SoundTrack::addTo(AVFormatContext* muxer) {
    Parts& p = *parts_;
    p.muxer = muxer;
    p.to = required(avformat_new_stream(muxer, nullptr));
    if (p.copied) {
        p.check(avcodec_parameters_copy(p.to->codecpar, p.from->codecpar), "copy");
        p.to->codecpar->codec_tag = 0;  // the container's own
        p.to->time_base = p.from->time_base;
    } else {
        p.check(avcodec_parameters_from_context(p.to->codecpar, p.encoder.get()), "encode");
        p.to->time_base = p.encoder->time_base;
    }
}

void SoundTrack::writeUntil(double seconds) {
    Parts& p = *parts_;
    if (p.copied) return p.copyUntil(seconds);
    p.decodeUntil(seconds);
    p.encodeUntil(std::llround(seconds * kRate), false);
}

void SoundTrack::finish(double seconds) {
    Parts& p = *parts_;
    if (p.copied) return p.copyUntil(seconds);
    p.decodeUntil(seconds);
    p.encodeUntil(std::llround(seconds * kRate), true);
    p.encode(nullptr);
}

}  // namespace doppel
