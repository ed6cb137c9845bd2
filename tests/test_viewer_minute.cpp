// How many pictures a second the window shows while the mouse drags a wrist or orbits, and how many
// in the worst second: DOPPEL_MINUTE seconds of each, of the avatar DOPPEL_MINUTE_AVATAR.
#include <algorithm>
#include <iostream>
#include <vector>

#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

using Clock = std::chrono::steady_clock;

double secondsSince(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

TEST_F(ViewerTest, PicturesComeEverySecondWhileTheMouseMoves) {
    const char *length = getenv("DOPPEL_MINUTE"), *avatar = getenv("DOPPEL_MINUTE_AVATAR");
    const int seconds = length && *length ? std::clamp(atoi(length), 1, 240) : 2;
    ViewerOptions options;
    if (avatar && *avatar) options.avatar = avatar;
    options.width = 640, options.height = 714;  // a picture of 640×640 above the timeline
    Viewer& viewer = open(options);
    for (bool orbits : {false, true}) {
        const glm::dvec2 from = orbits ? glm::dvec2(60, 500) : at(joint::kLeftWrist);
        screen_->move(from.x, from.y);
        turn();
        screen_->press(orbits ? 2 : 1);
        turn();
        const auto start = Clock::now();
        // A hand that goes round in two seconds, and a mouse that tells of it every 8 ms.
        std::jthread hand([&](const std::stop_token& stop) {
            for (int i = 0; !stop.stop_requested(); ++i) {
                const double angle = 2 * M_PI * i / 250;
                screen_->move(from.x + 50 * (std::cos(angle) - 1), from.y + 50 * std::sin(angle));
                std::this_thread::sleep_for(std::chrono::milliseconds(8));
            }
        });
        std::vector<uint64_t> pictures(static_cast<size_t>(seconds));
        uint64_t before = viewer.pictureCount();
        for (double now = 0; now < seconds; now = secondsSince(start)) {
            viewer.frame();
            const uint64_t count = viewer.pictureCount();
            const auto second =
                std::min(static_cast<size_t>(secondsSince(start)), pictures.size() - 1);
            pictures[second] += count - before;
            before = count;
        }
        hand.request_stop();
        hand.join();
        screen_->release(orbits ? 2 : 1);
        settle();
        uint64_t sum = 0;
        for (uint64_t count : pictures) sum += count;
        const uint64_t worst = *std::ranges::min_element(pictures);
        std::cout << (orbits ? "orbiting: " : "dragging a wrist: ") << double(sum) / seconds
                  << " pictures a second over " << seconds << " s, " << worst
                  << " in the worst second\n";
        EXPECT_GT(sum, 0u);
    }
}

}  // namespace
}  // namespace doppel::test
