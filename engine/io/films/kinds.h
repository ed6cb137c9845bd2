// The kinds of films that are written: a row each, which VideoWriter goes by.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>

namespace doppel {

// Names are FFmpeg's; options are written "name=value:name=value".
struct VideoEncoder {
    const char* name;
    const char* options;
    const char* alphaOptions = "";  // further ones, of films that keep alpha
};

struct VideoKind {
    const char* ending;  // of the file's name: ".mp4"
    const char* codec;   // for people: "H.264"
    const char* muxer;
    const char* muxerOptions;
    std::array<VideoEncoder, 2> encoders;  // the first that this FFmpeg has; unused ones: null
    const char* pixels;                    // as frames are encoded
    const char* alphaPixels = nullptr;     // the same with alpha; null: it keeps none
    bool evenSides = false;  // an odd side gets one more row or column, a copy of the last
    double mostFramesPerSecond = 1000;
    // Where frames go through libavfilter's filters, as a palette asks for: of frames without
    // alpha and with. They hold the whole film, so its pixels are limited; null: none.
    const char* filters = nullptr;
    const char* alphaFilters = nullptr;
    // Sound: what the container takes as it is, and what the rest is encoded with. Empty: no sound.
    std::array<const char*, 4> soundCodecs{};
    std::array<const char*, 2> soundEncoders{};

    bool keepsAlpha() const { return alphaPixels != nullptr; }
    bool keepsSound() const { return soundEncoders[0] != nullptr; }
};

std::span<const VideoKind> videoKinds();

// By the name's ending; null: none of these.
const VideoKind* videoKindOf(const std::filesystem::path& path);

// Whether this FFmpeg has everything that the kind takes: an encoder, the muxer, filters. `has`
// says so of one of them, `what` being "encoder", "muxer" or "filter".
using HasPart = bool (*)(const std::string& what, const std::string& name);
bool ffmpegHas(const std::string& what, const std::string& name);

// The kind by the ending. InputError that lists the endings where it is none, MachineError that
// says what FFmpeg lacks and what works where it cannot be written here.
const VideoKind& requireVideoKind(const std::filesystem::path& path, HasPart has = ffmpegHas);

// ".mp4, .webm or .mov": the endings of the kinds for which it holds.
std::string videoEndings(bool (*holds)(const VideoKind& kind));

}  // namespace doppel
