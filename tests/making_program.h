// A script in the place of `doppel avatar`, whose minutes no window's test needs.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include "engine/io/video.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"

namespace doppel::test {

// Goes on when told to, by files in a folder of its own.
class MakingProgram {
public:
    MakingProgram() {
        namespace fs = std::filesystem;
        std::ofstream script(path());
        script << "#!/bin/sh\n"
               << "cd '" << own_.path().string() << "'\n"
               << R"(echo "$@" > words
echo "$DOPPEL_PROGRESS" > seconds
trap 'touch over' EXIT
echo "a first line" >&2
echo "find the person 3/6  0:10 left" >&2
trap 'echo "doppel: interrupted" >&2; touch stopped; exit 130' INT
while [ ! -e go ]; do sleep .02; done
[ -e avatar ] && mkdir -p "$4" && cp -r avatar "$4/avatar"
echo "texels 5/10  loss 0.1  0:05 left" >&2
while [ ! -e end ]; do sleep .02; done
cat said >&2
exit $(cat end)
)";
        script.close();
        fs::permissions(path(), fs::perms::owner_all);
    }
    std::filesystem::path path() const { return own_ / "doppel"; }
    // What it makes; none unless this is called.
    void makes(const Avatar& avatar) const { writeAvatar(own_ / "avatar", avatar); }
    void makesNone() const { std::filesystem::remove_all(own_ / "avatar"); }
    // words: what it was called with; stopped: it was interrupted; over: it has ended.
    bool isThere(const char* name) const { return std::filesystem::exists(own_ / name); }
    std::string words() const { return bytesOf(own_ / "words"); }
    // Between its lines, as it was told.
    std::string seconds() const { return bytesOf(own_ / "seconds"); }
    void go() const { std::ofstream(own_ / "go"); }
    void end(int status, const std::string& said) const {
        go();
        std::ofstream(own_ / "said") << said;
        std::ofstream(own_ / "part") << status;
        std::filesystem::rename(own_ / "part", own_ / "end");
    }

private:
    Folder own_;
};

// Three frames of one colour each.
inline void writeClip(const std::filesystem::path& path) {
    VideoWriter video(path, 64, 48, 30);
    for (int i = 0; i < 3; ++i) video.add(Image(64, 48, 3, uint8_t(60 * i)));
    video.finish();
}

}  // namespace doppel::test
