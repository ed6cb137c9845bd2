// What the device composes and presents is what the host would have, byte for byte.
#include <imgui/imgui.h>

#include <algorithm>
#include <memory>
#include <random>

#include "tests/op_test.h"
#include "tests/viewer_test.h"
#include "view/compose.h"
#include "viewer/window/frame.h"

namespace doppel::test {
namespace {

// ---- the composition ----------------------------------------------------------------------------

uint32_t opaque(std::mt19937& random) { return static_cast<uint32_t>(random()) | 0xff000000u; }

// Colours times an opacity.
uint32_t ofLayer(std::mt19937& random) {
    const uint32_t opacity = static_cast<uint32_t>(random()) & 255;
    uint32_t word = opacity << 24;
    for (uint32_t c = 0; c < 3; ++c)
        word |= static_cast<uint32_t>(random()) % (opacity + 1) << 8 * c;
    return word;
}

std::vector<uint32_t> randomPicture(std::mt19937& random, int width, int height) {
    std::vector<uint32_t> pixels(static_cast<size_t>(width * height));
    std::ranges::generate(pixels, [&] { return opaque(random); });
    return pixels;
}

std::shared_ptr<const Buffer> onDevice(Device& device, std::span<const uint32_t> pixels) {
    Buffer buffer = device.allocate(pixels.size_bytes(), Memory::Device);
    device.upload({&buffer, 0, pixels.size_bytes()}, std::as_bytes(pixels));
    return std::make_shared<const Buffer>(std::move(buffer));
}

struct Frame {
    std::vector<PlacedPicture> onHost, onDevice;  // the same pictures
    InterfaceLayer layer;
    int width = 0, height = 0;
    bool blueFirst = false;

    // A box of the layer that is drawn, and nothing else.
    void draw(std::mt19937& random, const PixelBox& box) {
        layer.begin(width, height);
        for (int y = box.y; y < box.y + box.height; ++y) {
            const std::span<uint32_t> row = layer.draw(y, {box.x, box.x + box.width});
            for (int x = box.x; x < box.x + box.width; ++x)
                row[static_cast<size_t>(x)] = ofLayer(random);
        }
    }
    // As both make it; they have to agree.
    std::vector<uint32_t> composed(DeviceComposer& composer) {
        constexpr uint32_t kBeside = 0xff102030;
        std::vector<uint32_t> pixels(static_cast<size_t>(width * height));
        compose(partsOfFrame(onHost, width, height, kBeside), layer,
                {width, height, blueFirst, pixels});
        composer.compose(onDevice, partsOfFrame(onDevice, width, height, kBeside), layer,
                         blueFirst);
        const Canvas there = composer.read();
        EXPECT_EQ(there.width, width);
        EXPECT_EQ(there.height, height);
        EXPECT_TRUE(std::ranges::equal(pixels, there.pixels))
            << width << "x" << height << " blue first: " << blueFirst;
        return pixels;
    }
};

TEST(Composition, IsTheHostsOnTheDevice) {
    Device& device = testDevice();
    std::mt19937 random(5);
    for (auto [width, height] : {std::pair{1, 1}, {13, 7}, {127, 61}, {300, 200}}) {
        DeviceComposer composer(device);
        for (bool blueFirst : {false, true}) {
            Frame frame;
            frame.width = width, frame.height = height, frame.blueFirst = blueFirst;
            frame.draw(random, {0, 0, width, height});
            frame.composed(composer);
            // One that is cut at two edges, one on the device within it, and one above both.
            const std::vector<uint32_t> below = randomPicture(random, width, height),
                                        inner = randomPicture(random, 40, 30),
                                        above = randomPicture(random, 9, 5);
            const int x = width / 3, y = height / 4;
            frame.onHost = {{x, y, width, height, below, {}, {}},
                            {x + 2, y + 1, 40, 30, inner, {}, {}},
                            {width / 2, 0, 9, 5, above, {}, {}}};
            frame.onDevice = frame.onHost;
            frame.onDevice[1].pixels = {};
            frame.onDevice[1].onDevice = onDevice(device, inner);
            frame.draw(random, {width / 2, height / 3, width / 4, height / 2});
            const std::vector<uint32_t> pixels = frame.composed(composer);
            for (uint32_t pixel : pixels) EXPECT_EQ(pixel >> 24, 255u);
            const uint32_t first = blueFirst ? composed(below[0], 0, 1) : below[0];
            if (width > 20) {
                EXPECT_EQ(pixels[size_t(y * width + x)], first);
            }
        }
    }
}

// What the host has drawn goes to the device where it has changed, and nowhere else.
TEST(Composition, TakesOnlyWhatHasChanged) {
    Device& device = testDevice();
    DeviceComposer composer(device);
    std::mt19937 random(6);
    constexpr int kSide = 64;
    Frame frame;
    frame.width = frame.height = kSide;
    std::vector<uint32_t> picture = randomPicture(random, kSide, kSide);
    frame.onHost = frame.onDevice = {{0, 0, kSide, kSide, picture, {}, {}}};
    const auto draw = [&](const PixelBox& box) {
        std::mt19937 same(8);
        frame.draw(same, box);
    };
    draw({10, 20, 8, 4});
    frame.composed(composer);
    EXPECT_EQ(composer.uploadedBytes(), 4u * 2 * kSide * kSide);
    draw({10, 20, 8, 4});
    const std::vector<uint32_t> before = frame.composed(composer);
    EXPECT_EQ(composer.uploadedBytes(), 0u);
    draw({30, 21, 2, 1});
    EXPECT_NE(frame.composed(composer), before);
    EXPECT_EQ(composer.uploadedBytes(), 4u * 22 * 4) << "around what is gone and what is new";
    picture[5 * kSide + 7] ^= 1;
    picture[9 * kSide + 3] ^= 1;
    draw({30, 21, 2, 1});
    frame.composed(composer);
    EXPECT_EQ(composer.uploadedBytes(), 4u * 5 * 5);
    // Of a picture that is said not to change, nobody looks for changes; of another they do.
    const auto one = std::make_shared<int>(), other = std::make_shared<int>();
    const auto uploaded = [&](const std::shared_ptr<const void>& unchanging) {
        frame.onDevice[0].unchanging = unchanging;
        draw({30, 21, 2, 1});
        composer.compose(frame.onDevice, partsOfFrame(frame.onDevice, kSide, kSide, 0), frame.layer,
                         false);
        return composer.uploadedBytes();
    };
    EXPECT_EQ(uploaded(one), 0u);
    picture[0] ^= 1;
    EXPECT_EQ(uploaded(one), 0u);
    EXPECT_EQ(uploaded(other), 4u);
}

// ---- the window ---------------------------------------------------------------------------------

TEST(Presenting, SaysWhichWordsItKnows) {
    DeviceInfo gpu, cpu;
    cpu.cpu = true;
    {
        const Presenting unset("");
        EXPECT_TRUE(presentsDirectly(gpu));
        EXPECT_FALSE(presentsDirectly(cpu));
    }
    for (const DeviceInfo& device : {gpu, cpu}) {
        EXPECT_TRUE((Presenting("direct"), presentsDirectly(device)));
        EXPECT_FALSE((Presenting("host"), presentsDirectly(device)));
        const Presenting wrong("Direct");
        EXPECT_NE(messageOf<InputError>([&] {
                      presentsDirectly(device);
                  }).find("DOPPEL_PRESENT: expected direct or host, or nothing, found Direct"),
                  std::string::npos);
    }
}

class DirectTest : public ViewerTest {
protected:
    // What a function sees of a window, presented either way.
    void expectSame(const std::function<void(std::vector<std::vector<uint8_t>>&)>& look) {
        std::vector<std::vector<uint8_t>> seen[2];
        for (const char* how : {"host", "direct"}) {
            const Presenting presenting(how);
            const bool direct = std::string_view(how) == "direct";
            look(seen[direct]);
            ASSERT_EQ(viewer_->window().directly(), direct);
            viewer_.reset();
        }
        ASSERT_EQ(seen[0].size(), seen[1].size());
        for (size_t i = 0; i < seen[0].size(); ++i)
            EXPECT_EQ(seen[0][i], seen[1][i]) << "look " << i;
        for (size_t i = 1; i < seen[0].size(); ++i)
            EXPECT_NE(seen[0][i], seen[0][i - 1]) << "looks " << i - 1 << " and " << i;
    }
};

TEST_F(DirectTest, ShowsWhatTheHostWouldShow) {
    expectSame([&](std::vector<std::vector<uint8_t>>& seen) {
        Viewer& viewer = open();
        const auto look = [&] {
            awaitSilence();
            seen.push_back(window().data);
        };
        look();
        viewer.camera().yaw = .3;
        turn(1);
        seen.push_back(window().data);  // of one sample, while it moves
        look();
        viewer.settings().floor = true;
        look();
        viewer.settings().atlas = true;
        look();
        viewer.settings().atlas = viewer.settings().floor = false;
        viewer.settings().split = Split::Meshes;
        look();
        viewer.settings().divided = true;
        look();
        viewer.camera().distance = .3;  // larger than the window
        viewer.settings().split = Split::None;
        look();
        viewer.camera().target.x += 50;  // and beside it
        look();
        screen_->key("Home");
        screen_->resizeWindow(700, 500);
        look();
        screen_->resizeWindow(kWidth, kHeight);
        viewer.window().loseSwapchain();
        look();
        // The picture in a file is of what the device has.
        viewer.saveScreenshot(*folder_ / "seen.png");
        const Image saved = readImage(*folder_ / "seen.png");
        const Pane& pane = viewer.panes().back();
        EXPECT_EQ(saved.width, pane.width);
        seen.push_back(saved.data);
    });
}

TEST_F(DirectTest, ShowsItsPanelAtAnotherScale) {
    expectSame([&](std::vector<std::vector<uint8_t>>& seen) {
        ViewerOptions options;
        options.width = 700, options.height = 620;
        options.scale = 1.5;
        Viewer& viewer = open(options);
        viewer.settings().panel = true;
        settle();
        seen.push_back(window().data);
        viewer.settings().theme = Theme::Light;
        viewer.settings().joints = false;
        settle();
        seen.push_back(window().data);
    });
}

// What the host goes on with comes from there: rows of avatars, and a capture's frames.
TEST_F(DirectTest, ShowsWhatTheHostHasDrawn) {
    writeColouredCapture(*folder_ / "capture", turningMotion(3));
    expectSame([&](std::vector<std::vector<uint8_t>>& seen) {
        ViewerOptions options;
        options.motion = *folder_ / "capture";
        options.beside = {*folder_ / "avatar"};
        Viewer& viewer = open(options);
        const auto look = [&] {
            awaitSilence();
            seen.push_back(window().data);
        };
        viewer.settings().split = Split::Together;
        look();
        viewer.settings().split = Split::Avatars;
        look();
        viewer.settings().split = Split::Source;
        look();
        viewer.settings().split = Split::None;
        viewer.settings().captureCamera = true;
        for (Backdrop backdrop : {Backdrop::Capture, Backdrop::Overlay, Backdrop::Difference}) {
            viewer.settings().backdrop = backdrop;
            look();
        }
    });
}

// An orbit takes nothing from the host while the interface is as it was.
TEST_F(DirectTest, AnOrbitTakesNothingFromTheHost) {
    const Presenting presenting("direct");
    Viewer& viewer = open();
    viewer.settings().joints = false;
    settle();
    const uint64_t pictures = viewer.pictureCount();
    for (int i = 0; i < 5; ++i) {
        viewer.camera().yaw += .05;
        turn(1);
        EXPECT_EQ(viewer.window().uploadedBytes(), 0u);
    }
    EXPECT_EQ(viewer.pictureCount(), pictures + 5);
    viewer.settings().joints = true;
    turn(1);
    EXPECT_GT(viewer.window().uploadedBytes(), 0u);
    EXPECT_LT(viewer.window().uploadedBytes(), viewer.window().drawn().pixels.size_bytes());
}

// A device that cannot present, and none at all: the host shows the same.
TEST_F(DirectTest, FallsBackToTheHost) {
    std::mt19937 random(9);
    const std::vector<uint32_t> picture = randomPicture(random, 90, 70);
    std::vector<std::vector<uint32_t>> seen;
    for (int device : {0, 1, 2}) {
        Window window({.width = 200, .height = 150});
        DeviceOptions options;
        if (device == 2) options.surfaceExtensions = window.surfaceExtensions();
        window.present(device == 0 ? nullptr : std::make_shared<Device>(options));
        EXPECT_EQ(window.directly(), device == 2);
        for (int i = 0; i < 3; ++i) {
            ASSERT_TRUE(window.begin(0));
            window.beginFrame();
            ImGui::GetBackgroundDrawList()->AddCircleFilled({60, 50}, 30,
                                                            IM_COL32(200, 100, 50, 120));
            window.end(std::vector<PlacedPicture>{{8, 4, 90, 70, picture, {}, {}}});
        }
        const Canvas drawn = window.drawn();
        seen.emplace_back(drawn.pixels.begin(), drawn.pixels.end());
    }
    EXPECT_EQ(seen[0], seen[1]);
    EXPECT_EQ(seen[0], seen[2]);
    EXPECT_GT(std::ranges::count(seen[0], picture[0] | 0xff000000u) +
                  std::ranges::count(seen[0], composed(picture[0], 0, 1)),
              0);
}

}  // namespace
}  // namespace doppel::test
