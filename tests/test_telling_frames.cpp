// Which frames of a long recording training takes, and that a very long one takes no more memory.
#include "trainer/stages/telling_frames.h"

#include <gmock/gmock.h>

#include <chrono>
#include <cmath>
#include <set>
#include <thread>

#include "tests/refusals.h"
#include "trainer/commands/train.h"
#include "trainer/data/capture_writer.h"

namespace doppel::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr int kSide = 24;

// A capture whose frames are stripes, of full contrast or hardly any, with these rotations.
Capture striped(const fs::path& folder, const std::vector<Theta>& poses,
                const std::function<bool(size_t)>& isSharp) {
    Capture capture;
    capture.name = "stripes";
    CaptureWriter writer(folder);
    for (size_t i = 0; i < poses.size(); ++i) {
        std::vector<uint8_t> rgb, mask(size_t{kSide * kSide}, 255);
        for (int y = 0; y < kSide; ++y)
            for (int x = 0; x < kSide; ++x)
                for (int c = 0; c < 3; ++c)
                    rgb.push_back(static_cast<uint8_t>(
                        isSharp(i) ? 200 * (x / 2 % 2)
                                   : 100 + 100 * std::sin(x / static_cast<double>(kSide) * 3)));
        const std::string name = fmt::format("f{}", i);
        writer.addImage(name, kSide, kSide, rgb);
        writer.addMask(name, kSide, kSide, mask);
        capture.frames.push_back({name, {}, {}, {30, 30, kSide / 2.0, kSide / 2.0, kSide, kSide}});
        capture.theta.push_back(poses[i]);
        capture.trans.push_back({0, 0, 3});
    }
    writer.commit(capture);
    return readCapture(folder);
}

TEST(TellingFrames, TakePosesThatNoOtherFrameHas) {
    Folder folder;
    std::vector<Theta> poses(200);
    std::set<size_t> rare;
    for (size_t i = 0; i < poses.size(); ++i) {
        poses[i][5] = .001f * static_cast<float>(i % 7);
        if (i % 20 != 11) continue;
        rare.insert(i);
        poses[i][3 * (16 + rare.size() % 4)] = 1 + .2f * static_cast<float>(rare.size());
    }
    const Capture capture = striped(folder / "capture", poses, [](size_t) { return true; });
    FrameCache cache(capture);
    // Eleven evenly, and as many for their poses.
    const std::vector<size_t> taken = tellingFrames(capture, cache, 22);
    ASSERT_EQ(taken.size(), 22u);
    EXPECT_TRUE(std::ranges::is_sorted(taken));
    EXPECT_EQ(std::set<size_t>(taken.begin(), taken.end()).size(), 22u);
    for (size_t i : rare) EXPECT_TRUE(std::ranges::count(taken, i)) << i;
    EXPECT_EQ(tellingFrames(capture, cache, 22), taken);
    EXPECT_EQ(tellingFrames(capture, cache, 200).size(), 200u);
    EXPECT_EQ(tellingFrames(capture, cache, 500).back(), 199u);
}

// Who stands for most of the time and turns for a moment is learned from on both.
TEST(TellingFrames, AreHalfEvenlyTaken) {
    Folder folder;
    std::vector<Theta> poses(200);
    for (size_t i = 180; i < 200; ++i) poses[i][1] = .3f * static_cast<float>(i - 179);
    const Capture capture = striped(folder / "capture", poses, [](size_t) { return true; });
    FrameCache cache(capture);
    const std::vector<size_t> taken = tellingFrames(capture, cache, 20);
    const auto standing = std::ranges::count_if(taken, [](size_t i) { return i < 180; });
    EXPECT_GE(standing, 8);
    EXPECT_LE(standing, 11);
}

TEST(TellingFrames, AreTheSharperOnesOfNeighbours) {
    Folder folder;
    std::vector<Theta> poses(300);  // a slow turn
    for (size_t i = 0; i < poses.size(); ++i) poses[i][1] = .02f * static_cast<float>(i);
    const Capture capture =
        striped(folder / "capture", poses, [](size_t i) { return i / 2 % 2 == 1; });
    FrameCache cache(capture);
    for (size_t i : tellingFrames(capture, cache, 6)) EXPECT_EQ(i / 2 % 2, 1u) << i;
}

// A person of eight by eight places walks to and fro before a background that is sharper than she
// is, in frames of so many pixels for each place across.
Capture walk(const fs::path& folder, size_t frames, int scale) {
    Capture capture;
    CaptureWriter writer(folder);
    const int width = kSide * scale;
    for (size_t i = 0; i < frames; ++i) {
        const bool sharp = i / 2 % 2 == 1;
        const int left = 4 + 6 * (sharp ? 1 : 0);
        std::vector<uint8_t> rgb, mask;
        for (int y = 0; y < kSide; ++y)
            for (int x = 0; x < width; ++x) {
                const int place = x / scale;
                const bool person = place >= left && place < left + 8 && y >= 8 && y < 16;
                mask.push_back(person ? 255 : 0);
                for (int c = 0; c < 3; ++c)
                    rgb.push_back(static_cast<uint8_t>(
                        person ? (sharp ? 200 * (x / 2 % 2) : 10 * place) : 255 * (x / 2 % 2)));
            }
        const std::string name = fmt::format("f{}", i);
        writer.addImage(name, width, kSide, rgb);
        writer.addMask(name, width, kSide, mask);
        capture.frames.push_back(
            {name, {}, {}, {30. * scale, 30, width / 2.0, kSide / 2.0, width, kSide}});
        capture.theta.push_back({});
        capture.theta.back()[1] = .02f * static_cast<float>(i);
        capture.trans.push_back({static_cast<float>(left + 4 - kSide / 2) / 10, 0, 3});
    }
    writer.commit(capture);
    return readCapture(folder);
}

TEST(TellingFrames, AreTheSharperOnesOfAPersonWhoWalks) {
    Folder folder;
    const Capture capture = walk(folder / "capture", 300, 1);
    FrameCache cache(capture);
    for (size_t i : tellingFrames(capture, cache, 6)) EXPECT_EQ(i / 2 % 2, 1u) << i;
}

// Whose frames are looked at in a half of their pixels.
TEST(TellingFrames, AreTheSharperOnesOfLargeFrames) {
    Folder folder;
    const Capture capture = walk(folder / "capture", 40, 100);
    FrameCache cache(capture);
    for (size_t i : tellingFrames(capture, cache, 3)) EXPECT_EQ(i / 2 % 2, 1u) << i;
}

// A mask and two pictures of each: the third of three is not looked at.
TEST(TellingFrames, LookAtTwoThatAreAsSharpAsEachOther) {
    Folder folder;
    std::vector<Theta> poses(300);
    for (size_t i = 0; i < poses.size(); ++i) poses[i][1] = .02f * static_cast<float>(i);
    const Capture capture = striped(folder / "capture", poses, [](size_t) { return true; });
    FrameCache cache(capture);
    const uint64_t before = FrameCache::decoded();
    EXPECT_EQ(tellingFrames(capture, cache, 6).size(), 6u);
    EXPECT_EQ(FrameCache::decoded() - before, 6u * 3);
}

TEST(TellingFrames, AreNotDecodedWhereNoNeighbourIsLikeThem) {
    Folder folder;
    std::vector<Theta> poses(40);
    for (size_t i = 0; i < poses.size(); ++i) poses[i][1] = .5f * static_cast<float>(i % 8);
    const Capture capture = striped(folder / "capture", poses, [](size_t) { return true; });
    FrameCache cache(capture);
    const uint64_t before = FrameCache::decoded();
    EXPECT_EQ(tellingFrames(capture, cache, 6).size(), 6u);
    EXPECT_EQ(FrameCache::decoded(), before);
}

// As many as stage texels takes forty times, and no fewer than show all sides.
TEST(TellingFrames, AreAsManyAsThePresetCanLearn) {
    EXPECT_EQ(framesWorthLearning(presetByName("ci")), 40u);
    EXPECT_EQ(framesWorthLearning(presetByName("small")), 40u);
    EXPECT_EQ(framesWorthLearning(presetByName("best")), 120u);
    EXPECT_EQ(framesWorthLearning(presetByName("paper")), 1000u);
    Preset longer = presetByName("small");
    longer.texels.steps *= 3;
    EXPECT_EQ(framesWorthLearning(longer), 120u);
    longer.texels.steps = 3;  // a glance
    EXPECT_EQ(framesWorthLearning(longer), 40u);
}

class LongRecording : public Refusals {};

// Of 20,000 frames a training takes no more memory than of 400, but for what lists them.
TEST_F(LongRecording, TakesNoMoreMemory) {
    auto recording = [&](const char* name, size_t count) {
        const Capture source = readCapture(*this / "capture");
        FrameCache cache(source);
        Capture capture;
        capture.name = name;
        CaptureWriter writer(*this / name);
        for (size_t i = 0; i < count; ++i) {
            const size_t from = i % source.size();
            const std::string frame = fmt::format("f{}", i);
            writer.addImage(frame, test::kSize, test::kSize, cache.load(from)->rgb);
            writer.addMask(frame, test::kSize, test::kSize, cache.load(from)->mask);
            capture.frames.push_back({frame, {}, {}, source.frames[from].camera});
            capture.theta.push_back(source.theta[from]);
            capture.theta.back()[50] = .3f * std::sin(static_cast<float>(i));
            capture.trans.push_back(source.trans[from]);
        }
        writer.commit(capture);
    };
    auto peakMiB = [&](const char* name, size_t count) {
        recording(name, count);
        std::vector<std::string> words{
            "train",           at(name), "--out",         at(name) + "-avatar",
            "--preset",        "ci",     "--most-frames", "60",
            "--picture-every", "0",      "--no-refine"};
        for (const auto& [number, value] : kNumbers)
            words.insert(words.end(), {"--set", number + "=" + value});
        for (const char* number :
             {"shape.steps=2", "texels.steps=2", "shape.size=64", "texels.size=64", "fit.passes=1"})
            words.insert(words.end(), {"--set", number});
        long peak = 0;  // KiB, as Linux counts
        const Outcome run = doppel(words, nullptr, [&](pid_t child) {
            while (true) {
                std::ifstream status(fmt::format("/proc/{}/status", child));
                long now = 0;
                for (std::string line; std::getline(status, line);)
                    if (line.starts_with("VmHWM:")) now = std::atol(line.c_str() + 6);
                if (now == 0) return;  // it has ended
                peak = std::max(peak, now);
                std::this_thread::sleep_for(std::chrono::milliseconds(20));
            }
        });
        EXPECT_EQ(run.status, 0) << run.err;
        EXPECT_THAT(run.err, HasSubstr(fmt::format("of {} frames the 60 that tell most", count)));
        return peak / 1024;
    };
    const long few = peakMiB("few", 400), many = peakMiB("many", 20000);
    fmt::print("400 frames: {} MiB, 20,000 frames: {} MiB\n", few, many);
    EXPECT_LT(many - few, 100);
}

}  // namespace
}  // namespace doppel::test
