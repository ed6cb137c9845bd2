#include "engine/io/films/kinds.h"

#include <vector>

#include "engine/files/ending.h"
#include "engine/io/films/ffmpeg.h"

extern "C" {
#include <libavfilter/avfilter.h>
}

namespace doppel {

namespace {

// MPEG-4 stands in where FFmpeg has no x264. VP9 keeps alpha only if no frame comes out of order.
// ProRes is for editors, who want sound as it was.
constexpr VideoKind kKinds[] = {
    {.ending = ".mp4",
     .codec = "H.264",
     .muxer = "mp4",
     .muxerOptions = "movflags=+faststart",
     .encoders = {{{"libx264", "preset=fast:crf=17"},
                   {"mpeg4", "flags=+qscale:global_quality=236"}}},
     .pixels = "yuv420p",
     .evenSides = true,
     .soundCodecs = {"aac", "mp3"},
     .soundEncoders = {"aac"}},
    {.ending = ".webm",
     .codec = "VP9",
     .muxer = "webm",
     .muxerOptions = "",
     .encoders = {{{"libvpx-vp9", "crf=18:b=0:deadline=good:cpu-used=3", "auto-alt-ref=0"}}},
     .pixels = "yuv420p",
     .alphaPixels = "yuva420p",
     .evenSides = true,
     .soundCodecs = {"opus", "vorbis"},
     .soundEncoders = {"libopus", "libvorbis"}},
    {.ending = ".mov",
     .codec = "ProRes 4444",
     .muxer = "mov",
     .muxerOptions = "movflags=+faststart",
     .encoders = {{{"prores_ks", "profile=4444:vendor=apl0", "alpha_bits=16"}}},
     .pixels = "yuv444p10le",
     .alphaPixels = "yuva444p10le",
     .soundCodecs = {"aac", "mp3", "alac"},
     .soundEncoders = {"pcm_s16le"}},
    {.ending = ".webp",
     .codec = "animated WebP",
     .muxer = "webp",
     .muxerOptions = "loop=0",
     .encoders = {{{"libwebp_anim", "lossless=0:quality=90"}}},
     .pixels = "bgra",
     .alphaPixels = "bgra"},
    // A delay is of hundredths of a second, and browsers take one of less than two for ten.
    {.ending = ".gif",
     .codec = "GIF",
     .muxer = "gif",
     .muxerOptions = "loop=0",
     .encoders = {{{"gif", ""}}},
     .pixels = "pal8",
     .alphaPixels = "pal8",
     .mostFramesPerSecond = 50,
     .filters = "split[a][b];[a]palettegen=reserve_transparent=0[p];"
                "[b][p]paletteuse=dither=sierra2_4a:diff_mode=rectangle",
     .alphaFilters = "split[a][b];[a]palettegen=reserve_transparent=1[p];"
                     "[b][p]paletteuse=dither=sierra2_4a:alpha_threshold=128"},
};

// What is missing, for people; empty: nothing.
std::string missing(const VideoKind& kind, HasPart has) {
    bool encodes = false;
    for (const VideoEncoder& encoder : kind.encoders)
        encodes |= encoder.name != nullptr && has("encoder", encoder.name);
    if (!encodes) return fmt::format("encoder for {} ({})", kind.codec, kind.encoders[0].name);
    if (!has("muxer", kind.muxer)) return fmt::format("muxer {}", kind.muxer);
    if (kind.filters != nullptr)
        for (const char* filter : {"split", "palettegen", "paletteuse"})
            if (!has("filter", filter)) return fmt::format("filter {}", filter);
    return {};
}

std::string listed(const std::vector<std::string>& names, const char* last) {
    std::string text;
    for (size_t i = 0; i < names.size(); ++i)
        text += (i == 0 ? "" : i + 1 < names.size() ? ", " : last) + names[i];
    return text;
}

}  // namespace

std::span<const VideoKind> videoKinds() { return kKinds; }

const VideoKind* videoKindOf(const std::filesystem::path& path) {
    const std::string ending = endingOf(path);
    for (const VideoKind& kind : kKinds)
        if (ending == kind.ending) return &kind;
    return nullptr;
}

bool ffmpegHas(const std::string& what, const std::string& name) {
    if (what == "encoder") return avcodec_find_encoder_by_name(name.c_str()) != nullptr;
    if (what == "muxer") return av_guess_format(name.c_str(), nullptr, nullptr) != nullptr;
    return avfilter_get_by_name(name.c_str()) != nullptr;
}

const VideoKind& requireVideoKind(const std::filesystem::path& path, HasPart has) {
    const VideoKind* kind = videoKindOf(path);
    if (kind == nullptr) {
        throwInput("{}: expected a name that ends with {}", path.string(),
                   videoEndings([](const VideoKind&) { return true; }));
    }
    const std::string lacking = missing(*kind, has);
    if (lacking.empty()) return *kind;
    std::vector<std::string> others;
    for (const VideoKind& other : kKinds)
        if (missing(other, has).empty()) others.emplace_back(other.ending);
    throwMachine("{}: this FFmpeg has no {}; what it can write: {}", path.string(), lacking,
                 others.empty() ? "no films" : listed(others, " and "));
}

std::string videoEndings(bool (*holds)(const VideoKind& kind)) {
    std::vector<std::string> endings;
    for (const VideoKind& kind : kKinds)
        if (holds(kind)) endings.emplace_back(kind.ending);
    return listed(endings, " or ");
}

}  // namespace doppel
