// The viewer in a real window, driven by mouse and keys as a user drives it: what its tests share.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <string_view>
#include <thread>

#include "engine/error.h"
#include "tests/files.h"
#include "tests/screen.h"
#include "trainer/avatar/networks.h"
#include "trainer/data/capture_writer.h"
#include "trainer/motion/session.h"
#include "viewer/drawn_items.h"
#include "viewer/viewer.h"

namespace doppel::test {

namespace fs = std::filesystem;

// With the timeline; no panel unless a test opens it.
inline constexpr int kWidth = 560, kHeight = 474;
inline constexpr int kTextureSize = 32;

// Colours that tell up from down and left from right in the atlas, and an untrained mesh network,
// which moves nothing but does all the work.
inline Avatar plainAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.betas = {0.5f, -1, 0.5f};
    avatar.preset = presetByName("ci");
    avatar.preset.mesh.hidden = 8;
    avatar.preset.mesh.blocks = avatar.preset.mesh.layers = 1;
    avatar.textureSize = kTextureSize;
    for (int y = 0; y < kTextureSize; ++y)
        for (int x = 0; x < kTextureSize; ++x)
            for (float c : {0.2f + 0.75f * float(x) / kTextureSize,
                            0.2f + 0.75f * float(y) / kTextureSize, ((x ^ y) & 4) ? 0.75f : 0.35f})
                avatar.texture.push_back(c);
    return avatar;
}

inline void addMeshNet(Avatar& avatar) {
    Parameters net;
    declareMeshNet(net, avatar, 1);
    for (const Parameters::Entry& entry : net.entries())
        avatar.meshNet[entry.name] = {
            entry.shape, std::vector<float>(static_cast<size_t>(elementCount(entry.shape)))};
}

inline Motion turningMotion(size_t frames) {
    Motion motion;
    motion.fps = 20;
    for (size_t f = 0; f < frames; ++f) {
        Theta theta{};
        auto root = uprightOrientation(0.3f * static_cast<float>(f));
        std::ranges::copy(root, theta.begin());
        theta[3 * 16 + 2] = -0.9f;
        theta[3 * 17 + 2] = 0.9f;
        motion.theta.push_back(theta);
        motion.trans.push_back({0, 0.1f, 3.2f});
    }
    return motion;
}

// Another way to present for viewers that are opened meanwhile.
class Presenting {
public:
    explicit Presenting(const char* how) {
        if (const char* set = std::getenv("DOPPEL_PRESENT")) before_ = set;
        setenv("DOPPEL_PRESENT", how, 1);
    }
    ~Presenting() {
        if (before_)
            setenv("DOPPEL_PRESENT", before_->c_str(), 1);
        else
            unsetenv("DOPPEL_PRESENT");
    }
    Presenting(const Presenting&) = delete;
    Presenting& operator=(const Presenting&) = delete;

private:
    std::optional<std::string> before_;
};

class ViewerTest : public testing::Test {
protected:
    static void SetUpTestSuite() {
        screen_ = new Screen(1000, 760);
        folder_ = new Folder;
        Avatar avatar = plainAvatar();
        addMeshNet(avatar);
        writeAvatar(*folder_ / "avatar", avatar);
    }
    static void TearDownTestSuite() {
        delete screen_;
        delete folder_;
    }

    // A turn that never ends would hold up all tests.
    void SetUp() override {
        signal(SIGALRM, [](int) {
            constexpr std::string_view kSentence =
                "a turn of the window hangs: this test has taken ten minutes\n";
            if (write(STDERR_FILENO, kSentence.data(), kSentence.size()) < 0) _exit(2);
            _exit(1);
        });
        alarm(600);
    }
    void TearDown() override { alarm(0); }

    // A viewer without its panel, showing the avatar from the front.
    Viewer& open(ViewerOptions options = {}) {
        if (options.avatar.empty()) options.avatar = *folder_ / "avatar";
        if (options.width == 1280) options.width = kWidth, options.height = kHeight;
        viewer_.emplace(options);
        viewer_->settings().panel = viewer_->settings().figures = false;
        screen_->move(9, 9);  // so that the window hears of the mouse wherever it was
        turn();
        screen_->move(3, 3);
        settle();
        viewer_->camera().yaw = viewer_->camera().pitch = 0;
        screen_->key("Home");
        settle();
        return *viewer_;
    }
    // With a tab of the panel, in a window that has room for all of it.
    Viewer& openTab(const std::string& tab, ViewerOptions options = {}) {
        options.width = 980, options.height = 750;
        Viewer& viewer = open(options);
        viewer.settings().panel = true;
        settle();
        clickItem(tab);
        return viewer;
    }
    void turn(int times = 3) {
        for (int i = 0; i < times; ++i) ASSERT_TRUE(viewer_->frame());
    }
    // Until nothing changes any more.
    void settle() {
        turn(4);
        for (int i = 0; i < 2000 && !viewer_->settled(); ++i) viewer_->frame();
        ASSERT_TRUE(viewer_->settled());
    }
    // And messages have gone, which they do by the clock.
    void awaitSilence() {
        await("messages to go", [&] {
            viewer_->frame();
            return viewer_->visibleMessages() == 0;
        });
        settle();
    }
    void drag(glm::dvec2 from, glm::dvec2 to, int button = 1, int steps = 6) {
        screen_->move(from.x, from.y);
        turn();
        screen_->press(button);
        turn();
        for (int i = 1; i <= steps; ++i) {
            glm::dvec2 at = from + (to - from) * (double(i) / steps);
            screen_->move(at.x, at.y);
            turn(2);
        }
        screen_->release(button);
        settle();
    }
    void keyWith(const std::string& modifier, const std::string& key) {
        screen_->keyDown(modifier);
        screen_->key(key);
        screen_->keyUp(modifier);
        settle();
    }
    // The middle of what the window has drawn under this name; of a slider, its left part.
    glm::dvec2 itemAt(const std::string& label) {
        // Of two the one that was drawn later, which lies above.
        for (auto item = drawnItems().rbegin(); item != drawnItems().rend(); ++item)
            if (item->label == label)
                return {std::min((item->low.x + item->high.x) / 2.0, item->low.x + 60.0),
                        (item->low.y + item->high.y) / 2.0};
        ADD_FAILURE() << "the window has no \"" << label << "\"";
        return {0, 0};
    }
    void clickItem(const std::string& label) {
        glm::dvec2 place = itemAt(label);
        screen_->move(place.x, place.y);
        turn();
        screen_->press(1);
        turn();
        screen_->release(1);
        settle();
    }
    // Letters, digits and what paths have, into the field that is typed into.
    void type(std::string_view text) {
        for (const char c : text) {
            const bool shifted = (c >= 'A' && c <= 'Z') || c == '~';
            if (shifted) screen_->keyDown("Shift_L");
            screen_->key(c == '/'   ? "slash"
                         : c == '.' ? "period"
                         : c == '-' ? "minus"
                         : c == '~' ? "grave"
                                    : std::string(1, c));
            if (shifted) screen_->keyUp("Shift_L");
            turn(2);
        }
        settle();
    }
    // Dear ImGui looks at what is held.
    void hold(const std::string& key) {
        screen_->keyDown(key);
        turn(2);
        screen_->keyUp(key);
        turn(2);
    }
    // Types into a slider, which Ctrl + click makes a field.
    void typeInto(const std::string& slider, std::string_view text) {
        screen_->keyDown("Control_L");
        clickItem(slider);
        screen_->keyUp("Control_L");
        turn();
        type(text);
        hold("Return");
        settle();
    }
    // As a file manager writes it: in an address every byte but letters and digits may be %XX.
    static std::string uriList(const std::vector<fs::path>& paths) {
        std::string list;
        for (const fs::path& path : paths) {
            list += "file://";
            for (const char c : fs::absolute(path).string())
                list += isalnum(static_cast<unsigned char>(c)) || c == '/'
                            ? std::string(1, c)
                            : fmt::format("%{:02X}", static_cast<unsigned char>(c));
            list += "\r\n";
        }
        return list;
    }
    void dropOnWindow(const std::vector<fs::path>& paths) {
        EXPECT_TRUE(screen_->drop(uriList(paths), 60, 60, [&] { viewer_->frame(); }));
        settle();
    }
    glm::dvec2 at(size_t joint) { return viewer_->jointOnScreen(joint); }
    // Metres that a distance on the screen is at the joint's depth.
    double metres(double pixels, size_t joint) {
        Camera camera = viewer_->camera().camera(kWidth, kHeight - Viewer::kTimelineHeight);
        return pixels * viewer_->jointOnScreen(joint).z / camera.fx;
    }
    // Until the condition holds; two minutes are more than any machine takes.
    static void await(const std::string& what, const std::function<bool()>& holds) {
        auto limit = std::chrono::steady_clock::now() + std::chrono::minutes(2);
        while (!holds()) {
            ASSERT_LT(std::chrono::steady_clock::now(), limit) << "waited in vain for " << what;
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
    }
    // As a user who looks at something: nothing has changed for so long that the window draws
    // nothing.
    void rest() {
        settle();
        turn(1);  // it waits a quarter of a second for an event
    }
    // What the window has drawn in its upper left corner, once the screen shows it.
    Image onScreen(int width, int height) {
        const Canvas drawn = viewer_->window().drawn();
        Image image(width, height, 3);
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x)
                for (int c = 0; c < 3; ++c)
                    image.pixel(x, y)[drawn.blueFirst ? 2 - c : c] =
                        static_cast<uint8_t>(drawn.row(y)[static_cast<size_t>(x)] >> 8 * c);
        await("the screen to show what the window has drawn",
              [&] { return screen_->grab(0, 0, image.width, image.height).data == image.data; });
        return image;
    }
    Image window() { return onScreen(viewer_->window().width(), viewer_->window().height()); }
    // The panes.
    Image picture() {
        const Pane& last = viewer_->panes().back();
        return onScreen(last.x + last.width, last.height);
    }

    static inline Screen* screen_ = nullptr;
    static inline Folder* folder_ = nullptr;
    std::optional<Viewer> viewer_;
};

// How many pixels differ visibly, as a share of all.
inline double difference(const Image& a, const Image& b) {
    if (a.width != b.width || a.height != b.height) return 1;
    int different = 0;
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x)
            for (int c = 0, seen = 0; c < 3 && !seen; ++c)
                if (std::abs(a.pixel(x, y)[c] - b.pixel(x, y)[c]) > 24) ++different, seen = 1;
    return double(different) / (a.width * a.height);
}

// What of a picture is not as its corner, which shows the background.
inline double shareOfAvatar(const Image& picture) {
    Image background(picture.width, picture.height, 3);
    for (size_t i = 0; i < background.data.size(); ++i)
        background.data[i] = picture.pixel(0, 0)[i % 3];
    return difference(picture, background);
}

// A capture of these frames, each of one colour: red, green, blue, red, …
inline void writeColouredCapture(const fs::path& folder, const Motion& motion) {
    CaptureWriter writer(folder);
    Capture capture;
    capture.name = "captured";
    for (size_t f = 0; f < motion.size(); ++f) {
        const std::string name = fmt::format("{}", f);
        Image frame(80, 60, 3);
        for (size_t i = 0; i < frame.data.size(); ++i) frame.data[i] = i % 3 == f % 3 ? 200 : 40;
        writer.addImage(name, 80, 60, frame.data);
        capture.frames.push_back({name, {}, {}, {75, 75, 40, 30, 80, 60}});
        capture.theta.push_back(motion.theta[f]);
        capture.trans.push_back(motion.trans[f]);
    }
    writer.commit(capture);
}

// Against tests/screens/NAME.png, a quarter of the size; DOPPEL_WRITE_SCREENS=1 writes it anew.
inline void expectScreen(const Image& picture, const std::string& name) {
    Image small = resize(picture, picture.width / 4, picture.height / 4);
    fs::path path = sourceFolder() / "tests" / "screens" / (name + ".png");
    const char* writes = getenv("DOPPEL_WRITE_SCREENS");
    if (writes && std::string_view(writes) == "1") {
        fs::create_directories(path.parent_path());
        writeImage(path, small);
    }
    ASSERT_TRUE(fs::exists(path)) << path;
    EXPECT_LT(difference(small, readImage(path)), 0.01) << name;
}

// In a folder of its own, where files without one go.
class InWorkFolder : public ViewerTest {
protected:
    void SetUp() override {
        ViewerTest::SetUp();
        here_ = fs::current_path();
        fs::create_directories(*folder_ / "work");
        fs::current_path(*folder_ / "work");
    }
    void TearDown() override {
        viewer_.reset();
        fs::current_path(here_);
        fs::remove_all(*folder_ / "work");
        ViewerTest::TearDown();
    }

private:
    fs::path here_;
};

}  // namespace doppel::test
