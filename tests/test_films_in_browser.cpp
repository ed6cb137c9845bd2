// Films as a browser shows them, colours, moments and alpha.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "engine/io/video.h"
#include "tests/browser.h"
#include "tests/files.h"

namespace doppel {
namespace {

constexpr int kWidth = 64, kHeight = 48, kFrames = 5;
constexpr double kRate = 5;

// Alpha grows from left to right in 8 steps; green tells the frame.
Image ramp(int frame) {
    Image image(kWidth, kHeight, 4);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            uint8_t* pixel = image.pixel(x, y);
            pixel[0] = 200, pixel[1] = uint8_t(40 + 40 * frame), pixel[2] = 40;
            pixel[3] = uint8_t(255 * (x * 8 / kWidth) / 7);
        }
    return image;
}

// [8][4] What a canvas holds in the middle of each step once `draw`, a promise of what drawImage()
// takes, has come.
nlohmann::json steps(test::Browser& browser, const std::string& draw) {
    return browser.value(fmt::format(
        "({}).then(thing => {{ const canvas = document.createElement('canvas'); canvas.width = {}; "
        "canvas.height = {}; const to = canvas.getContext('2d', {{willReadFrequently: true}}); "
        "to.drawImage(thing, 0, 0); "
        "return Array.from({{length: 8}}, (_, i) => "
        "Array.from(to.getImageData(8 * i + 4, 24, 1, 1).data)); }})",
        draw, kWidth, kHeight));
}

TEST(FilmsInBrowser, ShowWhatWasWritten) {
    if (test::chromium().empty())
        GTEST_SKIP() << "films are looked at with chromium, which is not installed";
    test::Folder folder;
    test::Browser browser(200, 200);
    struct Case {
        const char *ending, *type;
        bool alpha;
    };
    for (const Case& one : {Case{".mp4", "video/mp4", false}, Case{".webm", "video/webm", false},
                            Case{".webm", "video/webm", true}, Case{".webp", "image/webp", true},
                            Case{".gif", "image/gif", false}}) {
        SCOPED_TRACE(fmt::format("{}{}", one.ending, one.alpha ? " with alpha" : ""));
        const auto path = folder / (std::string("a") + one.ending);
        VideoWriter video(path, kWidth, kHeight, kRate, {.alpha = one.alpha});
        for (int i = 0; i < kFrames; ++i) video.add(ramp(i));
        video.finish();
        const std::string data =
            fmt::format("'data:{};base64,{}'", one.type, test::toBase64(test::bytesOf(path)));
        const bool moves = std::string_view(one.type).starts_with("video");
        for (int frame : {0, 3}) {
            if (!moves && frame > 0) continue;  // a canvas takes a picture's first
            // Having sought is not yet having the picture; and a picture that came while nobody
            // could be told, on a busy machine, comes again to who seeks again.
            constexpr const char* kFilm =
                "new Promise((done, fail) => {{ const film = document.createElement('video'); "
                "film.muted = true; document.body.append(film); "
                "film.onerror = () => fail(film.error.message); "
                "const seek = () => film.currentTime = {0} + .1, again = setInterval(() => "
                "film.readyState > 1 && !film.seeking && seek(), 1000); "
                "const look = (now, about) => {{ if (Math.abs(about.mediaTime - {0}) >= .1) return "
                "film.requestVideoFrameCallback(look); clearInterval(again); done(film); }}; "
                "film.requestVideoFrameCallback(look); "
                "film.onloadeddata = seek; film.src = {1}; }})";
            constexpr const char* kPicture =
                "(async () => {{ const picture = new Image(); picture.src = {}; "
                "await picture.decode(); return picture; }})()";
            const std::string draw =
                moves ? fmt::format(kFilm, frame / kRate, data) : fmt::format(kPicture, data);
            const nlohmann::json shown = steps(browser, draw);
            const Image want = ramp(frame);
            for (int step = 0; step < 8; ++step) {
                const uint8_t* pixel = want.pixel(8 * step + 4, 24);
                const nlohmann::json& found = shown.at(size_t(step));
                EXPECT_NEAR(found.at(3).get<int>(), one.alpha ? pixel[3] : 255, 6)
                    << "alpha of step " << step;
                // Colours of what is hardly seen are rounded by the canvas.
                for (size_t c = 0; c < 3 && found.at(3) > 100; ++c)
                    EXPECT_NEAR(found.at(c).get<int>(), pixel[c], 10)
                        << "frame " << frame << ", step " << step << ", channel " << c;
            }
        }
    }
    EXPECT_EQ(browser.complaints, std::vector<std::string>());
}

}  // namespace
}  // namespace doppel
