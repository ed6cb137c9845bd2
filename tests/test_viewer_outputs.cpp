// What the window writes, as its panel says: names, and what films and pictures are like.
#include "engine/io/video.h"
#include "tests/viewer_test.h"

namespace doppel::test {
namespace {

class OutputsTest : public InWorkFolder {
protected:
    // With the panel's files, in a window that has room for all of them.
    Viewer& openFiles(size_t frames = 0) {
        ViewerOptions options;
        options.width = 900, options.height = 750;
        if (frames > 0) {
            const Motion motion = turningMotion(frames);
            options.motion = *folder_ / "motion.npz";
            writeNpz(options.motion, posesArrays(motion.theta, motion.trans, {}), false);
        }
        Viewer& viewer = open(options);
        viewer.settings().panel = true;
        settle();
        clickItem("Files");
        return viewer;
    }
    void work() {
        await("the window to have written it", [&] {
            viewer_->frame();
            return !viewer_->working();
        });
        settle();
    }
    void name(const std::string& text) {
        clickItem("name");
        screen_->keyDown("Control_L");
        hold("a");
        screen_->keyUp("Control_L");
        hold("BackSpace");
        type(text);
    }
};

// Whatever is there already stays.
TEST_F(OutputsTest, AreCalledAsThePanelNamesThem) {
    Viewer& viewer = openFiles(3);
    fs::create_directories("shots/empty");
    clickItem("film size");
    clickItem("480");
    clickItem("more of films and pictures");
    clickItem("samples");
    clickItem("1");
    struct Case {
        const char *named, *button, *out;
    };
    std::string named;
    for (const Case& c : {Case{"", "picture", "doppel-1.png"},
                          {"", "film", "doppel-1.mp4"},
                          {"", "glTF, .glb", "doppel-1.glb"},
                          {"", "poses, .npz", "poses-1.npz"},
                          {"anna", "picture", "anna.png"},
                          {"anna", "picture", "anna-1.png"},
                          {"anna", "film", "anna.mp4"},
                          {"anna", "film", "anna-1.mp4"},
                          {"anna", "poses, .npz", "poses-1.npz"},  // of one motion one file
                          {"shots/dance.mp4", "film", "shots/dance.mp4"},
                          {"shots/dance.mp4", "glTF, .glb", "shots/dance.glb"},
                          {"shots/empty", "picture", "shots/empty/doppel-1.png"}}) {
        if (named != c.named) name(named = c.named);
        const bool again = fs::exists(c.out);
        EXPECT_EQ(again, std::string_view(c.button) == "poses, .npz" && !named.empty()) << c.out;
        clickItem(c.button);
        work();
        EXPECT_TRUE(fs::exists(c.out)) << c.out << ": " << viewer.message();
    }
    viewer.loadMotion(*folder_ / "motion.npz");
    settle();
    name("next");
    clickItem("poses, .npz");
    EXPECT_TRUE(fs::exists("next.npz")) << viewer.message();
    clickItem("film as");
    clickItem("pictures, PNG");
    clickItem("film");
    work();
    EXPECT_TRUE(fs::exists("next-frames/0002.png")) << viewer.message();
    clickItem("film as");
    clickItem(".mp4, H.264");

    // The keys name them likewise.
    name("keyed");
    const glm::dvec2 free = itemAt("Files") + glm::dvec2(40, 0);
    screen_->move(free.x, free.y);
    screen_->click(1);
    settle();
    screen_->key("F12");
    settle();
    EXPECT_TRUE(fs::exists("keyed.png")) << viewer.message();
    keyWith("Control_L", "F12");
    work();
    EXPECT_EQ(VideoReader("keyed.mp4").frameCount(), 3) << viewer.message();

    // As a shell would take it.
    const std::string home = getenv("HOME") ? getenv("HOME") : "";
    setenv("HOME", (fs::current_path() / "shots").c_str(), 1);
    name("~/home");
    clickItem("picture");
    work();
    EXPECT_TRUE(fs::exists("shots/home.png")) << viewer.message();
    setenv("HOME", home.c_str(), 1);

    name("nowhere/anna");
    for (const char* button : {"picture", "film", "glTF, .glb"}) {
        clickItem(button);
        EXPECT_NE(viewer.message().find("nowhere: expected a folder that is there"),
                  std::string::npos)
            << viewer.message();
    }
    EXPECT_FALSE(viewer.working());
    EXPECT_FALSE(fs::exists("nowhere"));
    if (const char* folder = getenv("DOPPEL_KEEP_SCREENS"))
        writeImage(fs::path(folder) / "files.png", screen_->grab(0, 0, 900, 750));
}

// Whose alpha is neither all nor nothing.
size_t halfCovered(const Image& picture) {
    size_t count = 0;
    for (size_t i = 3; i < picture.data.size(); i += 4)
        count += picture.data[i] > 0 && picture.data[i] < 255;
    return count;
}

TEST_F(OutputsTest, FilmsAreAsThePanelsControlsSay) {
    openFiles(6);
    clickItem("film as");
    clickItem("pictures, PNG");
    clickItem("film size");
    clickItem("480");
    typeInto("first frame", "1");
    typeInto("last frame", "4");
    clickItem("nothing behind");
    clickItem("more of films and pictures");
    const auto film = [&](const fs::path& out) {
        clickItem("film");
        work();
        EXPECT_TRUE(fs::exists(out / "0003.png")) << viewer_->message();
        EXPECT_FALSE(fs::exists(out / "0004.png")) << "four frames, from 1 to 4";
        return readImage(out / "0003.png", 4);
    };
    clickItem("samples");
    clickItem("1");
    const Image rough = film("doppel-frames-1");
    EXPECT_EQ(std::max(rough.width, rough.height), 480);
    EXPECT_EQ(rough.pixel(0, 0)[3], 0) << "nothing is behind";
    EXPECT_EQ(halfCovered(rough), 0u);
    clickItem("samples");
    clickItem("16");
    const Image fine = film("doppel-frames-2");
    EXPECT_GT(halfCovered(fine), 300u) << "edges are smooth";
    clickItem("nothing behind");
    clickItem("turntable");
    const Image round = film("doppel-frames-3");
    EXPECT_EQ(round.pixel(0, 0)[3], 255);
    clickItem("turntable");
    const Image still = film("doppel-frames-4");
    EXPECT_GT(difference(round, still), .02) << "three quarters round";
    const auto firstOf = [](const fs::path& out) { return readImage(out / "0000.png"); };
    EXPECT_LT(difference(firstOf("doppel-frames-3"), firstOf("doppel-frames-4")), .001);
}

TEST_F(OutputsTest, APoseIsFilmedFromAllSidesInSoManySeconds) {
    openFiles();
    clickItem("film size");
    clickItem("480");
    clickItem("more of films and pictures");
    clickItem("samples");
    clickItem("1");
    clickItem("turntable");
    typeInto("seconds", "1");
    clickItem("film");
    work();
    VideoReader reader("doppel-1.mp4");
    EXPECT_EQ(reader.frameCount(), 30);
    Image front, aside;
    for (int i = 0; i <= 8; ++i) reader.next(i == 0 ? front : aside);
    EXPECT_GT(difference(front, aside), .02);

    clickItem("picture size");
    clickItem("720");
    clickItem("transparent");
    clickItem("picture");
    work();
    const Image picture = readImage("doppel-1.png", 4);
    EXPECT_EQ(std::max(picture.width, picture.height), 720);
    EXPECT_EQ(picture.pixel(0, 0)[3], 0);
    EXPECT_GT(halfCovered(picture), 300u);
}

}  // namespace
}  // namespace doppel::test
