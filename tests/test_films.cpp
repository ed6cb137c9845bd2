// Films of every kind as other programs read them: colours, alpha, sound, the same bytes; and what
// a kind does not keep is refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
#include <set>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/film_reader.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;
using test::ReadFilm;
using test::readFilm;

// A ramp of alpha from left to right in 8 steps over colours that move; 4 channels.
Image ramp(int width, int height, int frame) {
    Image image(width, height, 4);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            uint8_t* pixel = image.pixel(x, y);
            pixel[0] = 200, pixel[1] = uint8_t(60 + 20 * frame), pixel[2] = 40;
            pixel[3] = uint8_t(255 * (x * 8 / width) / 7);
        }
    return image;
}

void write(const std::filesystem::path& path, int width, int height, int frames,
           const VideoOptions& options = {}, double rate = 25) {
    VideoWriter video(path, width, height, rate, options);
    for (int i = 0; i < frames; ++i) video.add(ramp(width, height, i));
    video.finish();
}

int largestDifference(const Image& got, const Image& want, int channels) {
    int worst = 0;
    for (int y = 0; y < want.height; ++y)
        for (int x = 0; x < want.width; ++x)
            for (int c = 0; c < channels; ++c)
                worst = std::max(worst, std::abs(got.pixel(x, y)[c] - want.pixel(x, y)[c]));
    return worst;
}

TEST(Films, EveryKindIsWhatItsNameSays) {
    Folder folder;
    struct Case {
        const char* ending;
        std::string codec, pixels;
        int tolerance;
    };
    for (const Case& one :
         {Case{".mp4", "h264", "yuv420p", 4}, Case{".webm", "vp9", "yuv420p", 4},
          Case{".mov", "prores", "yuv444p12le", 4}, Case{".gif", "gif", "bgra", 6}}) {
        const auto path = folder / (std::string("a") + one.ending);
        write(path, 64, 48, 5);
        const ReadFilm film = readFilm(path);
        EXPECT_EQ(film.codec, one.codec);
        EXPECT_EQ(film.pixels, one.pixels);
        EXPECT_EQ(film.sound, "");
        ASSERT_EQ(film.frames.size(), 5u) << one.ending;
        for (int i = 0; i < 5; ++i) {
            EXPECT_LE(largestDifference(film.frames[size_t(i)], ramp(64, 48, i), 3), one.tolerance)
                << one.ending << " frame " << i;
            EXPECT_EQ(film.frames[size_t(i)].pixel(1, 1)[3], 255) << "alpha was not asked for";
            EXPECT_NEAR(film.times[size_t(i)], i / 25.0, .005) << one.ending;
        }
        // Our own reader, too.
        VideoReader reader(path);
        Image frame;
        ASSERT_TRUE(reader.next(frame)) << one.ending;
        EXPECT_LE(largestDifference(frame, ramp(64, 48, 0), 3), one.tolerance) << one.ending;
    }
}

TEST(Films, AlphaIsKeptStraight) {
    Folder folder;
    struct Case {
        const char* ending;
        std::string pixels;
        int colours, alpha;  // the largest differences that the codec may make
    };
    for (const Case& one : {Case{".webm", "yuva420p", 5, 3}, Case{".mov", "yuva444p12le", 4, 0}}) {
        const auto path = folder / (std::string("a") + one.ending);
        write(path, 64, 48, 4, {.alpha = true});
        const ReadFilm film = readFilm(path);
        EXPECT_EQ(film.pixels, one.pixels);
        ASSERT_EQ(film.frames.size(), 4u) << one.ending;
        for (size_t i = 0; i < 4; ++i) {
            const Image want = ramp(64, 48, int(i));
            // Colours under alpha 0 and 36 are those of full cover: nothing is multiplied in.
            EXPECT_LE(largestDifference(film.frames[i], want, 3), one.colours) << one.ending;
            const double most = (1 << film.alphaBits) - 1;
            for (size_t k = 0; k < want.data.size() / 4; ++k)
                ASSERT_NEAR(255 * film.alpha.at(i).at(k) / most, want.data[4 * k + 3],
                            one.alpha + .51)
                    << one.ending << " pixel " << k;
        }
    }
}

TEST(Films, AGifIsClearWhereLessThanHalfIsCovered) {
    Folder folder;
    write(folder / "a.gif", 64, 48, 4, {.alpha = true});
    const ReadFilm film = readFilm(folder / "a.gif");
    ASSERT_EQ(film.frames.size(), 4u);
    for (const Image& frame : film.frames) {
        EXPECT_EQ(frame.pixel(10, 20)[3], 0);
        EXPECT_EQ(frame.pixel(60, 20)[3], 255);
        EXPECT_NEAR(frame.pixel(60, 20)[0], 200, 6);
    }
    EXPECT_NE(messageOf<InputError>([&] {
                  VideoWriter(folder / "b.gif", 64, 48, 60);
              }).find("60 frames per second; expected more than 0, at most 50 in a .gif"),
              std::string::npos);
}

// Chunks of a RIFF file: their names and where their bytes begin.
std::vector<std::pair<std::string, size_t>> chunksOf(const std::vector<uint8_t>& file) {
    std::vector<std::pair<std::string, size_t>> chunks;
    for (size_t at = 12; at + 8 <= file.size();) {
        const size_t size = file[at + 4] | file[at + 5] << 8 | file[at + 6] << 16;
        chunks.emplace_back(std::string(&file[at], &file[at + 4]), at + 8);
        at += 8 + size + size % 2;
    }
    return chunks;
}

// The first picture of an animated WebP as a file of its own. OpenImageIO lays the pictures of an
// animation over a canvas that it does not clear: nothing is known of what they leave transparent.
// left, top: where on the canvas it lies.
std::vector<uint8_t> firstPicture(const std::vector<uint8_t>& film, int& left, int& top) {
    for (const auto& [name, at] : chunksOf(film)) {
        if (name != "ANMF") continue;
        const auto frame = film.begin() + std::ptrdiff_t(at);
        left = 2 * (frame[0] | frame[1] << 8), top = 2 * (frame[3] | frame[4] << 8);
        const size_t size = frame[-4] | frame[-3] << 8 | frame[-2] << 16;
        std::vector<uint8_t> body{'W', 'E', 'B', 'P', 'V',  'P', '8', 'X',
                                  10,  0,   0,   0,   0x10, 0,   0,   0};
        body.insert(body.end(), frame + 6, frame + 12);  // width and height less one
        body.insert(body.end(), frame + 16, frame + std::ptrdiff_t(size));
        const size_t all = body.size();
        std::vector<uint8_t> file{
            'R', 'I', 'F', 'F', uint8_t(all), uint8_t(all >> 8), uint8_t(all >> 16), 0};
        file.insert(file.end(), body.begin(), body.end());
        return file;
    }
    ADD_FAILURE() << "there is no picture";
    return {};
}

// FFmpeg 5 does not read what it writes here, so the file's own structure is looked at, and its
// first picture through the image library.
TEST(Films, AWebpMovesForEverAndKeepsAlpha) {
    Folder folder;
    for (const bool alpha : {false, true}) {
        write(folder / "a.webp", 64, 48, 4, {.alpha = alpha});
        const std::vector<uint8_t> file = readWholeFile(folder / "a.webp");
        int frames = 0, duration = 0;
        for (const auto& [name, at] : chunksOf(file)) {
            if (name == "ANIM") {
                EXPECT_EQ(file[at + 4] | file[at + 5] << 8, 0) << "loops";
            }
            if (name == "ANMF") {
                ++frames;
                duration += file[at + 12] | file[at + 13] << 8;
            }
        }
        EXPECT_EQ(frames, 4);
        EXPECT_EQ(duration, 160) << "milliseconds";
        int left = 0, top = 0;
        const Image first = decodeImage(firstPicture(file, left, top), "the first picture", 4);
        const auto pixel = [&](int x, int y) { return first.pixel(x - left, y - top); };
        EXPECT_NEAR(pixel(60, 20)[0], 200, 6);
        EXPECT_NEAR(pixel(60, 20)[1], 60, 6);
        for (int x = 4; x < 64; x += 8) {
            const int wanted = alpha ? ramp(64, 48, 0).pixel(x, 20)[3] : 255;
            if (x < left)
                EXPECT_EQ(wanted, 0) << "left out: " << x;
            else
                EXPECT_EQ(pixel(x, 20)[3], wanted) << x;
        }
    }
}

// Memory in use between holes that are not zero, for whoever reads what he has not written.
class LitteredHeap {
public:
    void stir() {
        for (int i = 0; i < 300; ++i) {
            std::vector<uint8_t>& block = blocks_.emplace_back(16 + random_() % 200'000);
            std::ranges::generate(block, [&] { return static_cast<uint8_t>(random_()); });
        }
        std::erase_if(blocks_, [&](const auto&) { return random_() % 3 != 0; });
    }

private:
    std::mt19937 random_{1};
    std::vector<std::vector<uint8_t>> blocks_;
};

TEST(Films, SameFramesGiveTheSameBytes) {
    Folder folder;
    folder.write("tone.wav", test::wavOfTone(1, 0, 1));
    // Sides that vectors fit into, and those of a phone's clip, which they do not.
    std::vector<Image> small, clip;
    VideoReader reader(test::sourceFolder() / "tests/data/clips/vfr.mp4");
    for (int t = 0; t < 5; ++t) {
        small.push_back(ramp(64, 48, t));
        ASSERT_TRUE(reader.next(clip.emplace_back()));
    }
    ASSERT_EQ(reader.width() % 16, 14);
    LitteredHeap heap;
    for (const VideoKind& kind : videoKinds())
        for (const std::vector<Image>& frames : {small, clip}) {
            VideoOptions options{.alpha = kind.keepsAlpha() && frames[0].channels == 4};
            if (kind.keepsSound()) options.sound = SoundSource{folder / "tone.wav"};
            std::set<std::vector<uint8_t>> films;
            for (int again = 0; again < 8; ++again) {
                heap.stir();
                const auto path = folder / ("a" + std::string(kind.ending));
                VideoWriter film(path, frames[0].width, frames[0].height, 10, options);
                for (const Image& frame : frames) film.add(frame);
                film.finish();
                films.insert(readWholeFile(path));
                if (frames[0].width == 64 && again == 1) break;
            }
            EXPECT_EQ(films.size(), 1u) << kind.ending << ", width " << frames[0].width;
        }
}

TEST(Films, PicturesOfAnySizeAreWritten) {
    Folder folder;
    for (const auto& [width, height] : {std::pair{1, 1}, {33, 17}, {3, 200}})
        for (const VideoKind& kind : videoKinds())
            for (const bool alpha : {false, true}) {
                if (alpha && !kind.keepsAlpha()) continue;
                const auto path = folder / (std::string("a") + kind.ending);
                write(path, width, height, 3, {.alpha = alpha});
                if (kind.ending == std::string(".webp")) {
                    EXPECT_EQ(imageSize(path), (ImageSize{width, height}));
                    continue;
                }
                const ReadFilm film = readFilm(path);
                ASSERT_EQ(film.frames.size(), 3u) << kind.ending << " " << width;
                const int more = kind.evenSides ? 1 : 0;
                EXPECT_EQ(film.frames[0].width, width + width % 2 * more) << kind.ending;
                EXPECT_EQ(film.frames[0].height, height + height % 2 * more) << kind.ending;
                if (alpha && width < 8) continue;  // the ramp's first step, which is clear
                EXPECT_NEAR(film.frames[2].pixel(width - 1, height - 1)[0], 200, 10)
                    << kind.ending << " " << width << (alpha ? " alpha" : "");
            }
}

TEST(Films, WhatAKindDoesNotKeepIsRefused) {
    Folder folder;
    folder.write("tone.wav", test::wavOfTone(1, 0, 1));
    EXPECT_NE(messageOf<InputError>([&] {
                  VideoWriter(folder / "a.mp4", 64, 64, 30, {.alpha = true});
              }).find("a.mp4: H.264 keeps no alpha; name a .webm, .mov, .webp or .gif"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] {
                  VideoWriter(folder / "a.gif", 64, 64, 30,
                              {.sound = SoundSource{folder / "tone.wav"}});
              }).find("a.gif: GIF keeps no sound; name a .mp4, .webm or .mov"),
              std::string::npos);
    EXPECT_EQ(folder.names(), std::vector<std::string>{"tone.wav"});
}

TEST(Films, WhatThisFfmpegLacksIsSaid) {
    const HasPart noVpx = [](const std::string&, const std::string& name) {
        return name != "libvpx-vp9" && name != "palettegen";
    };
    EXPECT_EQ(messageOf<MachineError>([&] { requireVideoKind("a.webm", noVpx); }),
              "a.webm: this FFmpeg has no encoder for VP9 (libvpx-vp9); what it can write: .mp4, "
              ".mov and .webp");
    EXPECT_EQ(messageOf<MachineError>([&] { requireVideoKind("a.gif", noVpx); }),
              "a.gif: this FFmpeg has no filter palettegen; what it can write: .mp4, .mov and "
              ".webp");
    EXPECT_STREQ(requireVideoKind("A.MOV", noVpx).codec, "ProRes 4444");
    // H.264 has a stand-in.
    const HasPart noX264 = [](const std::string&, const std::string& name) {
        return name != "libx264";
    };
    EXPECT_STREQ(requireVideoKind("a.mp4", noX264).muxer, "mp4");
}

// ---- sound --------------------------------------------------------------------------------------

TEST(Films, SoundIsEncodedAndCutWherePicturesEnd) {
    Folder folder;
    // A tone in the third second of four.
    folder.write("tone.wav", test::wavOfTone(4, 2, 3));
    for (const auto& [ending, codec] :
         {std::pair{".mp4", "aac"}, {".mov", "pcm_s16le"}, {".webm", "opus"}}) {
        const auto path = folder / (std::string("a") + ending);
        // The film is two seconds from the second 1.5 on.
        write(path, 32, 32, 50, {.sound = SoundSource{folder / "tone.wav", 1.5}});
        const ReadFilm film = readFilm(path);
        EXPECT_EQ(film.sound, codec);
        EXPECT_NEAR(film.soundBegin, 0, .03) << ending;
        EXPECT_NEAR(film.soundEnd, 2, .03) << ending;
        EXPECT_EQ(film.frames.size(), 50u);
        EXPECT_LT(film.loudness(.1, .4), .02) << ending;
        EXPECT_GT(film.loudness(.6, 1.4), .25) << ending;
        EXPECT_LT(film.loudness(1.6, 1.9), .02) << ending;
        EXPECT_TRUE(hasSound(path));
    }
    write(folder / "silent.mp4", 32, 32, 5);
    EXPECT_FALSE(hasSound(folder / "silent.mp4"));
}

TEST(Films, SoundIsCopiedWhereTheContainerTakesIt) {
    Folder folder;
    folder.write("tone.wav", test::wavOfTone(4, 2, 3));
    for (const auto& [from, to] : {std::pair{"a.mp4", "b.mov"}, {"a.webm", "b.webm"}}) {
        write(folder / from, 32, 32, 100, {.sound = SoundSource{folder / "tone.wav"}});
        write(folder / to, 32, 32, 50, {.sound = SoundSource{folder / from, 1.5}});
        const ReadFilm source = readFilm(folder / from), film = readFilm(folder / to);
        EXPECT_EQ(film.sound, source.sound);
        EXPECT_NEAR(film.soundBegin, 0, .03) << to;
        EXPECT_NEAR(film.soundEnd, 2, .03) << to;
        EXPECT_LT(film.loudness(.1, .4), .02) << to;
        EXPECT_GT(film.loudness(.6, 1.4), .25) << to;
        EXPECT_LT(film.loudness(1.6, 1.9), .02) << to;
    }
    // Film and sound are of other kinds: encoded again.
    write(folder / "c.webm", 32, 32, 25, {.sound = SoundSource{folder / "a.mp4", 2}});
    const ReadFilm film = readFilm(folder / "c.webm");
    EXPECT_EQ(film.sound, "opus");
    EXPECT_GT(film.loudness(.1, .9), .25);
}

TEST(Films, SoundThatEndsEarlierLeavesSilence) {
    Folder folder;
    folder.write("tone.wav", test::wavOfTone(.5, 0, .5));
    write(folder / "a.mp4", 32, 32, 50, {.sound = SoundSource{folder / "tone.wav"}});
    const ReadFilm film = readFilm(folder / "a.mp4");
    EXPECT_NEAR(film.soundEnd, .5, .03);
    EXPECT_EQ(film.frames.size(), 50u);
}

TEST(Films, BrokenSoundIsRefused) {
    Folder folder;
    const auto refusal = [&](const char* name) {
        return messageOf<InputError>(
            [&] { write(folder / "out.mp4", 32, 32, 50, {.sound = SoundSource{folder / name}}); });
    };
    folder.write("empty.wav", std::string());
    EXPECT_NE(refusal("empty.wav").find("empty.wav: is an empty file"), std::string::npos);
    folder.write("text.wav", std::string("not a sound"));
    EXPECT_NE(refusal("text.wav").find("text.wav: expected a film or sound"), std::string::npos);
    folder.write("list.m3u8", std::string("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\na.ts\n"));
    EXPECT_NE(refusal("list.m3u8").find("expected a film or sound"), std::string::npos);
    write(folder / "silent.mp4", 32, 32, 5);
    EXPECT_NE(refusal("silent.mp4").find("silent.mp4: expected sound, found none in it"),
              std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(folder / "out.mp4"));
    // Damage of any kind ends in a film or a sentence.
    folder.write("tone.wav", test::wavOfTone(1, 0, 1));
    write(folder / "good.webm", 32, 32, 25, {.sound = SoundSource{folder / "tone.wav"}});
    const std::vector<uint8_t> whole = readWholeFile(folder / "good.webm");
    for (size_t i = 0; i < 60; ++i) {
        std::vector<uint8_t> bytes = whole;
        for (size_t k = 0; k < 3; ++k) bytes[(i * 7919 + k * 104729) % bytes.size()] ^= 0x5A;
        folder.write("bad.webm", bytes);
        try {
            write(folder / "out.mp4", 16, 16, 25, {.sound = SoundSource{folder / "bad.webm"}});
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find("bad.webm"), std::string::npos);
        }
    }
}

}  // namespace
}  // namespace doppel
