// A film's sound, taken from another file.
#pragma once

#include <memory>

#include "engine/io/video.h"

struct AVFormatContext;

namespace doppel {

// Reads sound and hands it to a muxer beside the pictures, packets as they are where the kind takes
// their codec, else encoded: mono stays so, all else becomes stereo, at 48 kHz. InputErrors name
// the file of the sound: missing, none in it, damaged.
class SoundTrack {
public:
    SoundTrack(const SoundSource& source, const VideoKind& kind);
    ~SoundTrack();
    SoundTrack(const SoundTrack&) = delete;
    SoundTrack& operator=(const SoundTrack&) = delete;

    // Adds its stream, before the muxer's header is written.
    void addTo(AVFormatContext* muxer);
    // Writes all sound before this second of the film.
    void writeUntil(double seconds);
    // The film ends at this second, and with it the sound.
    void finish(double seconds);

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace doppel
