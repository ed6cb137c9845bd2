// Films as FFmpeg reads them, apart from our own reader: alpha, sound, palettes, times.
#pragma once

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "engine/io/image.h"

namespace doppel::test {

struct ReadFilm {
    std::string codec, pixels, sound;  // FFmpeg's names; sound is empty where there is none
    std::vector<Image> frames;         // 4 channels
    std::vector<double> times;         // of the frames, seconds
    // Of the stored alpha, before any conversion, by its own depth: [frame][H·W]. Empty where the
    // pixels have none of their own plane.
    std::vector<std::vector<int>> alpha;
    int alphaBits = 0;
    double soundBegin = 0, soundEnd = 0;  // seconds: of the first packet, and after the last
    std::vector<float> samples;           // of the first channel
    int rate = 0;

    // Root mean square of a part of the sound, seconds from its first sample.
    double loudness(double from, double to) const {
        double sum = 0;
        size_t count = 0;
        for (size_t i = size_t(from * rate); i < samples.size() && double(i) < to * rate; ++i)
            sum += double(samples[i]) * samples[i], ++count;
        return count > 0 ? std::sqrt(sum / double(count)) : 0;
    }
};

inline void need(bool good, const char* what) {
    if (!good) throw std::runtime_error(what);
}

inline void takePicture(ReadFilm& film, const AVFrame& frame, double time) {
    const auto format = static_cast<AVPixelFormat>(frame.format);
    const AVPixFmtDescriptor* description = av_pix_fmt_desc_get(format);
    film.pixels = description->name;
    SwsContext* scaler = sws_getContext(
        frame.width, frame.height, format, frame.width, frame.height, AV_PIX_FMT_RGBA,
        SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INT | SWS_BITEXACT, nullptr, nullptr,
        nullptr);
    need(scaler != nullptr, "pixels can be converted");
    sws_setColorspaceDetails(scaler, sws_getCoefficients(SWS_CS_ITU709), 0,
                             sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, 1 << 16, 1 << 16);
    const int stride = (frame.width * 4 + 63) / 64 * 64;
    std::vector<uint8_t> rows(size_t(stride) * size_t(frame.height) + 64);
    uint8_t* planes[4] = {rows.data()};
    const int strides[4] = {stride};
    sws_scale(scaler, frame.data, frame.linesize, 0, frame.height, planes, strides);
    sws_freeContext(scaler);
    Image image(frame.width, frame.height, 4);
    for (int y = 0; y < frame.height; ++y)
        std::copy_n(&rows[size_t(y) * size_t(stride)], image.rowBytes(), image.row(y));
    film.frames.push_back(std::move(image));
    film.times.push_back(time);
    if (description->nb_components != 4 || !(description->flags & AV_PIX_FMT_FLAG_PLANAR)) return;
    film.alphaBits = description->comp[3].depth;
    std::vector<int> alpha;
    for (int y = 0; y < frame.height; ++y)
        for (int x = 0; x < frame.width; ++x) {
            const uint8_t* row = frame.data[3] + y * frame.linesize[3];
            alpha.push_back(film.alphaBits > 8 ? reinterpret_cast<const uint16_t*>(row)[x]
                                               : int{row[x]});
        }
    film.alpha.push_back(std::move(alpha));
}

inline void takeSound(ReadFilm& film, const AVFrame& frame) {
    film.rate = frame.sample_rate;
    for (int i = 0; i < frame.nb_samples; ++i) {
        const uint8_t* first = frame.extended_data[0];
        const int step =
            av_sample_fmt_is_planar(AVSampleFormat(frame.format)) ? 1 : frame.ch_layout.nb_channels;
        switch (frame.format) {
            case AV_SAMPLE_FMT_FLT:
            case AV_SAMPLE_FMT_FLTP:
                film.samples.push_back(reinterpret_cast<const float*>(first)[i * step]);
                break;
            case AV_SAMPLE_FMT_S16:
            case AV_SAMPLE_FMT_S16P:
                film.samples.push_back(float(reinterpret_cast<const int16_t*>(first)[i * step]) /
                                       32768);
                break;
            default:
                need(false, "samples are floats or 16 bits");
        }
    }
}

// All of a film. The alpha of VP9 is read by libvpx, since FFmpeg's own decoder leaves it out.
inline ReadFilm readFilm(const std::filesystem::path& path) {
    av_log_set_level(AV_LOG_QUIET);
    ReadFilm film;
    AVFormatContext* format = nullptr;
    need(avformat_open_input(&format, path.c_str(), nullptr, nullptr) >= 0, "it opens");
    need(avformat_find_stream_info(format, nullptr) >= 0, "it has streams");
    std::vector<AVCodecContext*> decoders(format->nb_streams);
    for (unsigned i = 0; i < format->nb_streams; ++i) {
        const AVCodecParameters& parameters = *format->streams[i]->codecpar;
        const AVCodec* codec = parameters.codec_id == AV_CODEC_ID_VP9
                                   ? avcodec_find_decoder_by_name("libvpx-vp9")
                                   : avcodec_find_decoder(parameters.codec_id);
        decoders[i] = avcodec_alloc_context3(codec);
        avcodec_parameters_to_context(decoders[i], &parameters);
        decoders[i]->pkt_timebase = format->streams[i]->time_base;
        need(avcodec_open2(decoders[i], codec, nullptr) >= 0, "it is decoded");
        (parameters.codec_type == AVMEDIA_TYPE_AUDIO ? film.sound : film.codec) =
            avcodec_get_name(parameters.codec_id);
    }
    AVPacket* packet = av_packet_alloc();
    AVFrame* frame = av_frame_alloc();
    const auto drain = [&](unsigned i) {
        while (avcodec_receive_frame(decoders[i], frame) >= 0) {
            if (decoders[i]->codec_type == AVMEDIA_TYPE_AUDIO) {
                takeSound(film, *frame);
            } else {
                takePicture(
                    film, *frame,
                    double(frame->best_effort_timestamp) * av_q2d(format->streams[i]->time_base));
            }
        }
    };
    bool heard = false;
    while (av_read_frame(format, packet) >= 0) {
        const auto i = unsigned(packet->stream_index);
        if (decoders[i]->codec_type == AVMEDIA_TYPE_AUDIO) {
            const double base = av_q2d(format->streams[i]->time_base);
            if (!heard) film.soundBegin = double(packet->pts) * base;
            heard = true;
            film.soundEnd = double(packet->pts + packet->duration) * base;
        }
        need(avcodec_send_packet(decoders[i], packet) >= 0, "its packets are good");
        av_packet_unref(packet);
        drain(i);
    }
    for (unsigned i = 0; i < decoders.size(); ++i) {
        avcodec_send_packet(decoders[i], nullptr);
        drain(i);
        avcodec_free_context(&decoders[i]);
    }
    av_frame_free(&frame);
    av_packet_free(&packet);
    avformat_close_input(&format);
    return film;
}

// A WAV of one channel, 16 bits: silent but for a tone of 440 Hz in [from, to) seconds.
inline std::vector<uint8_t> wavOfTone(double seconds, double from, double to, int rate = 44100) {
    const auto count = uint32_t(seconds * rate);
    std::vector<uint8_t> bytes;
    const auto text = [&](std::string_view word) {
        for (const char c : word) bytes.push_back(uint8_t(c));
    };
    const auto number = [&](uint32_t value, int size) {
        for (int i = 0; i < size; ++i) bytes.push_back(uint8_t(value >> 8 * i));
    };
    text("RIFF"), number(36 + 2 * count, 4), text("WAVE"), text("fmt "), number(16, 4);
    number(1, 2), number(1, 2), number(uint32_t(rate), 4), number(2 * uint32_t(rate), 4);
    number(2, 2), number(16, 2), text("data"), number(2 * count, 4);
    for (uint32_t i = 0; i < count; ++i) {
        const double t = double(i) / rate;
        const double value = t >= from && t < to ? 16000 * std::sin(2764.6015 * t) : 0;
        number(uint32_t(int32_t(value)) & 0xFFFF, 2);
    }
    return bytes;
}

}  // namespace doppel::test
