#include "trainer/motion/bvh.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <numbers>
#include <optional>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/printable.h"

namespace doppel {

namespace {

constexpr uint64_t kLargestFile = uint64_t{1} << 30;
constexpr size_t kShown = 40;  // bytes of a name or word in an error
constexpr size_t kMostJoints = 4096, kDeepest = 512, kLongestName = 128;
constexpr double kLargestNumber = 1e9;

// ---- text ---------------------------------------------------------------------------------------

bool sameWord(std::string_view a, std::string_view b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) {
        return std::tolower(static_cast<unsigned char>(x)) ==
               std::tolower(static_cast<unsigned char>(y));
    });
}

class Text {
public:
    Text(std::string_view text, const std::string& file) : text_(text), file_(file) {
        if (text_.starts_with("\xef\xbb\xbf")) text_.remove_prefix(3);
    }

    template <typename... Args>
    [[noreturn]] void fail(fmt::format_string<Args...> format, Args&&... args) const {
        throwInput("{}: line {}: {}", file_, line_,
                   fmt::format(format, std::forward<Args>(args)...));
    }
    [[noreturn]] void failExpected(std::string_view expected, std::string_view found) const {
        if (found.empty()) fail("expected {}, found the end of the file", expected);
        fail("expected {}, found \"{}\"", expected, printable(found, kShown));
    }

    // The next word, or brace; empty at the end.
    std::string_view word() {
        skip(true);
        return wordHere();
    }
    // The next one of this line; empty at its end.
    std::string_view wordOfLine() {
        skip(false);
        return at_ < text_.size() && text_[at_] != '\n' ? wordHere() : std::string_view();
    }
    void expect(std::string_view expected) {
        const std::string_view found = word();
        if (!sameWord(found, expected)) failExpected(expected, found);
    }
    // What is left of this line, before a brace; names may have spaces in them.
    std::string_view name() {
        skip(false);
        const size_t begin = at_;
        while (at_ < text_.size() && text_[at_] != '\n' && text_[at_] != '{') ++at_;
        size_t end = at_;
        while (end > begin && isSpace(text_[end - 1])) --end;
        return text_.substr(begin, end - begin);
    }
    double number(std::string_view what) { return numberOf(word(), what); }
    double numberOf(std::string_view found, std::string_view what) const {
        if (found.empty()) failExpected(what, found);
        std::string_view digits = found;
        if (digits.starts_with('+')) digits.remove_prefix(1);
        double value = 0;
        const auto [end, error] =
            std::from_chars(digits.data(), digits.data() + digits.size(), value);
        if (error != std::errc() || end != digits.data() + digits.size() ||
            !(std::abs(value) <= kLargestNumber))
            failExpected(what, found);
        return value;
    }
    size_t left() const { return text_.size() - at_; }
    int line() const { return line_; }

private:
    static bool isSpace(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

    void skip(bool overLines) {
        for (; at_ < text_.size() && isSpace(text_[at_]); ++at_) {
            if (text_[at_] != '\n') continue;
            if (!overLines) return;
            ++line_;
        }
    }
    std::string_view wordHere() {
        const size_t begin = at_;
        while (at_ < text_.size() && !isSpace(text_[at_])) {
            const bool brace = text_[at_] == '{' || text_[at_] == '}';
            if (brace && at_ > begin) break;
            ++at_;
            if (brace) break;
        }
        return text_.substr(begin, at_ - begin);
    }

    std::string_view text_;
    const std::string& file_;
    size_t at_ = 0;
    int line_ = 1;
};

std::optional<Bvh::Channel> channelOf(std::string_view word) {
    constexpr std::array<std::string_view, 6> kNames = {"Xposition", "Yposition", "Zposition",
                                                        "Xrotation", "Yrotation", "Zrotation"};
    for (size_t i = 0; i < kNames.size(); ++i)
        if (sameWord(word, kNames[i])) return static_cast<Bvh::Channel>(i);
    return {};
}

void readHierarchy(Text& text, Bvh& bvh) {
    text.expect("HIERARCHY");
    struct Open {
        int joint;
        bool offset = false, channels = false;
    };
    std::vector<Open> open;
    do {
        std::string_view word = text.word();
        const bool root = sameWord(word, "ROOT"), joint = sameWord(word, "JOINT");
        const bool end = sameWord(word, "End");
        if (open.empty() && !root) text.failExpected("ROOT", word);
        if (root || joint || end) {
            if (root && !open.empty()) text.fail("expected JOINT within a joint, found ROOT");
            if (end) text.expect("Site");
            std::string name(text.name());
            if (end) name = "End Site";
            if (name.empty() || name.size() > kLongestName)
                text.fail("expected a joint's name of 1 to {} bytes, found \"{}\"", kLongestName,
                          printable(name, kShown));
            if (bvh.joints.size() >= kMostJoints)
                text.fail("expected at most {} joints, found more", kMostJoints);
            if (open.size() >= kDeepest)
                text.fail("expected joints nested at most {} deep, found more", kDeepest);
            text.expect("{");
            Bvh::Joint added;
            added.name = name;
            added.parent = open.empty() ? -1 : open.back().joint;
            open.push_back({static_cast<int>(bvh.joints.size())});
            bvh.joints.push_back(std::move(added));
            continue;
        }
        Bvh::Joint& current = bvh.joints[static_cast<size_t>(open.back().joint)];
        if (sameWord(word, "OFFSET")) {
            if (std::exchange(open.back().offset, true))
                text.fail("expected one OFFSET for {}, found another",
                          printable(current.name, kShown));
            for (int c = 0; c < 3; ++c) current.offset[c] = text.number("a number of an OFFSET");
        } else if (sameWord(word, "CHANNELS")) {
            if (std::exchange(open.back().channels, true))
                text.fail("expected CHANNELS once for {}, found them twice",
                          printable(current.name, kShown));
            const double count = text.number("the number of CHANNELS");
            if (!(count >= 0) || count > 6 || count != std::floor(count))
                text.fail("expected 0 to 6 CHANNELS, found {}", count);
            current.first = bvh.channels;
            for (int i = 0; i < static_cast<int>(count); ++i) {
                const std::string_view found = text.word();
                const auto channel = channelOf(found);
                if (!channel) text.failExpected("a channel such as Xrotation", found);
                if (std::find(current.channels.begin(), current.channels.end(), *channel) !=
                    current.channels.end())
                    text.fail("expected each channel once, found {} twice",
                              printable(found, kShown));
                current.channels.push_back(*channel);
            }
            bvh.channels += current.channels.size();
        } else if (word == "}") {
            if (!open.back().offset)
                text.fail("expected an OFFSET in {}, found none", printable(current.name, kShown));
            open.pop_back();
        } else {
            text.failExpected("OFFSET, CHANNELS, JOINT, End Site or }", word);
        }
    } while (!open.empty());
    if (bvh.channels == 0) text.fail("expected CHANNELS, found no joint that has any");
}

void readFrames(Text& text, Bvh& bvh) {
    text.expect("MOTION");
    // "Frames: 10", "Frames:10" and "Frames : 10" are all about.
    const auto field = [&](std::initializer_list<std::string_view> words, const char* whole) {
        std::string_view found;
        for (const std::string_view expected : words) {
            found = text.word();
            const size_t colon = std::min(found.find(':'), found.size());
            if (!sameWord(found.substr(0, colon), expected)) text.failExpected(whole, found);
        }
        const size_t colon = found.find(':');
        if (colon == std::string_view::npos) {
            found = text.word();
            if (!found.starts_with(':')) text.failExpected(whole, found);
            found.remove_prefix(1);
        } else {
            found.remove_prefix(colon + 1);
        }
        return text.numberOf(found.empty() ? text.word() : found,
                             fmt::format("{} a number", whole));
    };
    const double frames = field({"Frames"}, "Frames:");
    if (!(frames >= 1) || frames != std::floor(frames))
        text.fail("expected Frames: 1 or more, found {}", frames);
    bvh.frameTime = field({"Frame", "Time"}, "Frame Time:");
    if (!(bvh.frameTime >= 1e-4) || !(bvh.frameTime <= 3600))
        text.fail("expected a Frame Time from 0.0001 to 3600 seconds, found {}", bvh.frameTime);
    // A number takes a digit and a space at least: what the rest of the file cannot hold is refused
    // before memory is taken for it.
    const double needed = 2 * frames * static_cast<double>(bvh.channels) - 1;
    if (needed > static_cast<double>(text.left()))
        text.fail("expected {} frames of {} numbers, found {} bytes for them", frames, bvh.channels,
                  text.left());
    bvh.frames = static_cast<size_t>(frames);
    bvh.values.reserve(bvh.frames * bvh.channels);
    for (size_t f = 0; f < bvh.frames; ++f) {
        std::string_view found = text.word();
        if (found.empty()) text.fail("expected {} frames, as Frames says, found {}", bvh.frames, f);
        for (size_t c = 0; c < bvh.channels; ++c) {
            if (found.empty())
                text.fail("expected {} numbers, one for each channel, found {}", bvh.channels, c);
            bvh.values.push_back(text.numberOf(found, "a number"));
            found = text.wordOfLine();
        }
        if (!found.empty())
            text.fail("expected {} numbers, one for each channel, found more", bvh.channels);
    }
    const std::string_view rest = text.word();
    if (!rest.empty())
        text.fail("expected {} frames, as Frames says, found more: \"{}\"", bvh.frames,
                  printable(rest, kShown));
}

}  // namespace

Bvh::Placement Bvh::place(int64_t frame) const {
    Placement placed;
    placed.rotation.reserve(joints.size());
    placed.position.reserve(joints.size());
    for (const Joint& joint : joints) {
        glm::dvec3 offset = joint.offset;
        glm::dquat turn(1, 0, 0, 0);
        for (size_t c = 0; frame >= 0 && c < joint.channels.size(); ++c) {
            const double value = values[static_cast<size_t>(frame) * channels + joint.first + c];
            const int axis = static_cast<int>(joint.channels[c]) % 3;
            if (joint.channels[c] <= Channel::PositionZ) {
                offset[axis] = value;
            } else {
                glm::dvec3 by(0);
                by[axis] = std::remainder(value, 360.) * std::numbers::pi / 180;
                turn = turn * quaternionOf(by);
            }
        }
        if (joint.parent < 0) {
            placed.rotation.push_back(turn);
            placed.position.push_back(offset);
            continue;
        }
        const auto parent = static_cast<size_t>(joint.parent);
        placed.rotation.push_back(placed.rotation[parent] * turn);
        placed.position.push_back(placed.position[parent] + placed.rotation[parent] * offset);
    }
    return placed;
}

Bvh bvhFromText(std::string_view content, const std::string& file) {
    Text text(content, file);
    Bvh bvh;
    bvh.file = file;
    readHierarchy(text, bvh);
    readFrames(text, bvh);
    return bvh;
}

Bvh readBvh(const std::filesystem::path& file) {
    const std::vector<uint8_t> bytes = readWholeFile(file, kLargestFile);
    return bvhFromText({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, file.string());
}

Motion motionFromBvh(const Bvh& bvh) {
    SkeletonMotion source{bvh.file, "OFFSET", {}, bvh.frames, bvh.frameTime, 0, [&](int64_t frame) {
                              return bvh.place(frame);
                          }};
    for (const Bvh::Joint& joint : bvh.joints)
        source.joints.push_back({joint.name == "End Site" ? "" : joint.name, joint.parent});
    return motionFromSkeleton(source);
}

namespace {

const MotionFormat kBvh{{
    .looks = "a .bvh",
    .ending = ".bvh",
    .recognises =
        [](const std::filesystem::path&, std::string_view begin) {
            if (begin.starts_with("\xef\xbb\xbf")) begin.remove_prefix(3);
            begin.remove_prefix(std::min(begin.find_first_not_of(" \t\r\n"), begin.size()));
            return begin.starts_with("HIERARCHY");
        },
    .read = [](const std::filesystem::path& path) { return motionFromBvh(readBvh(path)); },
}};

}  // namespace

}  // namespace doppel
