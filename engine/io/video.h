// Videos: the kinds of engine/io/films/kinds.h out, what FFmpeg decodes in.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "engine/io/films/kinds.h"
#include "engine/io/image.h"

namespace doppel {

// Sound of another film, or of a file of sound, that goes with a film's pictures.
struct SoundSource {
    std::filesystem::path file;
    double start = 0;  // second of it, counted from its first picture, with which the film begins
};

// Whether a file has sound that can be read; false too where it is no film and no sound.
bool hasSound(const std::filesystem::path& file);

struct VideoOptions {
    bool alpha = false;  // kept, straight; of frames of 4 channels
    // Copied where the container takes its codec, else encoded; cut where the pictures end.
    std::optional<SoundSource> sound;
};

// Writes pictures as a video that players, browsers and editors show with the right colours; the
// name's ending decides the kind. BT.709 in limited range and tagged so, but WebP and GIF, which
// are sRGB. MPEG-4 stands in for H.264 where this FFmpeg has no x264. The same pictures give the
// same bytes: one thread, no times.
//
//     VideoWriter video("turntable.mp4", 256, 256, 30);
//     for (const Image& frame : frames) video.add(frame);
//     video.finish();
//
// Without finish() nothing is left (engine/files/atomic_file.h). Errors: InputError for a name that
// has no kind's ending, a rate that is none or that the kind has not, alpha or sound in a kind that
// keeps none, sound that cannot be read; MachineError where FFmpeg lacks the kind, or encoding or
// writing fails.
class VideoWriter {
public:
    // framesPerSecond in (0, 1000]. Where the kind has colours for pairs of pixels only, an odd
    // side gets one more column or row, a copy of the last.
    VideoWriter(const std::filesystem::path& path, int width, int height, double framesPerSecond,
                const VideoOptions& options = {});
    ~VideoWriter();
    VideoWriter(const VideoWriter&) = delete;
    VideoWriter& operator=(const VideoWriter&) = delete;

    // width × height; 1, 3 or 4 channels (alpha is dropped where it was not asked for).
    void add(const Image& frame);

    // At least one frame was added.
    void finish();

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

// Reads the first video stream of MP4, MOV, MKV, WebM, AVI, MPEG, FLV, Ogg, ASF, MXF and GIF files,
// turned upright, its pixels made square, its colours those of sRGB by the matrix and the range
// that the file names. One frame is held at a time. InputError names the file: missing, no video,
// damaged, cut short, sides over kMaxImageSide.
class VideoReader {
public:
    // mostRows: pictures that are higher are scaled to this height; 0: any.
    explicit VideoReader(const std::filesystem::path& path, int mostRows = 0);
    ~VideoReader();
    VideoReader(const VideoReader&) = delete;
    VideoReader& operator=(const VideoReader&) = delete;

    int width() const;  // of the upright picture, as next() gives it
    int height() const;
    double framesPerSecond() const;  // the mean rate; 0 where the file does not say
    int64_t frameCount() const;      // as the file says; −1 where it does not
    double duration() const;         // seconds, as the file says; 0 where it does not
    // "PQ" or "HLG" where the file is of high dynamic range, which is brought to sRGB: 203 cd/m²,
    // the white of paper (BT.2408), is white, and what is near it or brighter is compressed. Empty:
    // not. Films of standard range in Display P3 or BT.2020 are brought to sRGB as well.
    const char* highRange() const;
    // Of the lens, mm, as of one that sees as much on 35 mm film, which phones write into QuickTime
    // files; 0 where the file does not say.
    double focalLength() const;

    // The next frame, 3 channels, in `frame`; false at the end.
    bool next(Image& frame);
    // When the frame that next() gave is shown, in seconds from the start of the file.
    double time() const;

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace doppel
