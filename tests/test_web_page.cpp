// Avatars as pages: what the folder holds, what it may replace, and what a browser shows of it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "tests/browser.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/formats/web_page.h"
#include "trainer/commands/cli.h"
#include "trainer/commands/export.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Browser;
using test::bytesOf;
using test::Folder;
using test::messageOf;

#define NEEDS_THREE()                                                             \
    try {                                                                         \
        requireWebSources();                                                      \
    } catch (const InputError& error) {                                           \
        GTEST_SKIP() << "scripts/setup --web fetches three.js: " << error.what(); \
    }
#define NEEDS_BROWSER()           \
    NEEDS_THREE();                \
    if (test::chromium().empty()) \
    GTEST_SKIP() << "pages are looked at with chromium, which is not installed"

// The default body, all in one dark grey.
Avatar plainAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = presetByName("ci");
    avatar.textureSize = 64;
    avatar.texture.assign(64 * 64 * 3, 0.25f);
    return avatar;
}

// Somebody who stands before the camera, arms lowered, and turns.
Motion turning() {
    Motion motion;
    for (uint32_t f = 0; f < 20; ++f) {
        Theta theta{};
        std::ranges::copy(uprightOrientation(0.4f + 0.1f * static_cast<float>(f)), theta.begin());
        theta[3 * 16 + 2] = -0.7f;
        theta[3 * 17 + 2] = 0.9f;
        motion.theta.push_back(theta);
        motion.trans.push_back({0.2f + 0.02f * static_cast<float>(f), 0.1f, 3.5f});
    }
    return motion;
}

class WebPage : public ::testing::Test {
protected:
    void SetUp() override {
        writeAvatar(folder_ / "me", plainAvatar());
        const Motion motion = turning();
        for (const char* name : {"turn.npz", "again.npz"})
            writeNpz(folder_ / name, posesArrays(motion.theta, motion.trans, {}), true);
        options_.avatar = folder_ / "me";
        options_.motions = {folder_ / "turn.npz", folder_ / "again.npz"};
        options_.web = folder_ / "page";
        options_.common.json = true;
    }
    void write() const {
        testing::internal::CaptureStdout();
        testing::internal::CaptureStderr();
        const auto shown = [] {
            testing::internal::GetCapturedStdout();
            testing::internal::GetCapturedStderr();
        };
        try {
            runExport(options_);
        } catch (...) {
            shown();
            throw;
        }
        shown();
    }
    std::string refusal() const {
        return messageOf<InputError>([&] { write(); });
    }

    Folder folder_;
    ExportOptions options_;
};

std::vector<std::string> filesIn(const fs::path& folder) {
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (entry.is_regular_file()) names.push_back(fs::relative(entry.path(), folder).string());
    std::ranges::sort(names);
    return names;
}

// ---- the folder ---------------------------------------------------------------------------------

TEST_F(WebPage, HoldsAllThatItNames) {
    NEEDS_THREE();
    options_.web = folder_ / "a <b> & \"c\"";
    write();
    EXPECT_EQ(filesIn(options_.web),
              (std::vector<std::string>{
                  ".doppel-files", "README.txt", "avatar.glb", "doppel-avatar.js", "index.html",
                  "page.html", "three/BufferGeometryUtils.js", "three/GLTFLoader.js",
                  "three/LICENSE", "three/OrbitControls.js", "three/three.module.min.js"}));
    for (const std::string& name : filesIn(options_.web)) {
        if (!name.ends_with(".js") || name.ends_with(".min.js")) continue;
        const std::string text = bytesOf(options_.web / name), mark = "} from '";
        size_t count = 0;
        for (size_t at = text.find(mark); at != std::string::npos; at = text.find(mark, at + 1)) {
            const size_t begin = at + mark.size(), end = text.find('\'', begin);
            const std::string address = text.substr(begin, end - begin);
            EXPECT_TRUE(address.starts_with("./") &&
                        fs::exists((options_.web / name).parent_path() / address))
                << name << " imports " << address;
            ++count;
        }
        EXPECT_GT(count, 0u) << name;
    }
    const std::string title = "<title>a &lt;b> &amp; &quot;c&quot;</title>";
    for (const char* page : {"index.html", "page.html"}) {
        const std::string text = bytesOf(options_.web / page);
        EXPECT_NE(text.find(title), std::string::npos) << page;
        EXPECT_EQ(text.find("://"), std::string::npos) << page << " names another address";
        for (const char* mark : {"@TITLE@", "@SCRIPTS@", "@SRC@", "@DATA@"})
            EXPECT_EQ(text.find(mark), std::string::npos) << page << " holds " << mark;
    }
    const std::string page = bytesOf(options_.web / "page.html");
    EXPECT_NE(page.find(">" + test::toBase64(bytesOf(options_.web / "avatar.glb")) + "<"),
              std::string::npos);
    EXPECT_NE(page.find("Permission is hereby granted"), std::string::npos) << "the licence";
    // The same avatar gives the same bytes, in the place of the page before.
    write();
    EXPECT_EQ(bytesOf(options_.web / "page.html"), page);
}

TEST_F(WebPage, LosesNothing) {
    NEEDS_THREE();
    fs::create_directories(folder_ / "mine");
    folder_.write("mine/index.html", std::string("mine"));
    options_.web = folder_ / "mine";
    EXPECT_NE(refusal().find("found index.html: name another place"), std::string::npos);
    EXPECT_EQ(bytesOf(folder_ / "mine/index.html"), "mine");
    for (const char* place : {"me", "me/page", "turn.npz"}) {
        options_.web = folder_ / place;
        EXPECT_NE(refusal().find("expected a place apart from the input"), std::string::npos);
    }
    options_.web = folder_ / "page";
    write();
    folder_.write("page/notes.txt", std::string("mine"));
    EXPECT_NE(refusal().find("found notes.txt: name another place"), std::string::npos);
    EXPECT_EQ(bytesOf(folder_ / "page/notes.txt"), "mine");
    options_.web = folder_ / "new";
    options_.motions.push_back(folder_ / "nothing");
    EXPECT_THROW(write(), InputError);
    EXPECT_EQ(folder_.names(),
              (std::vector<std::string>{"again.npz", "me", "mine", "page", "turn.npz"}));
}

TEST_F(WebPage, SaysWhatIsMissing) {
    setenv("DOPPEL_WEB", (folder_ / "nowhere").c_str(), 1);
    EXPECT_EQ(refusal(), (folder_ / "nowhere/three.module.min.js").string() +
                             ": expected a file of three.js, found nothing; run scripts/setup "
                             "--web, which fetches it, or set DOPPEL_WEB to its folder");
    unsetenv("DOPPEL_WEB");
    EXPECT_FALSE(fs::exists(options_.web));
}

TEST_F(WebPage, OthersTakeOneMotion) {
    options_.web.clear();
    for (const char* name : {"a.usda", "a.bvh"}) {
        options_.out = folder_ / name;
        EXPECT_NE(refusal().find("expected one motion, found 2; .glb and --web take several"),
                  std::string::npos);
    }
}

TEST(WebPageFlags, EitherAFileOrAPage) {
    const auto refused = [](std::vector<std::string> words) {
        words.insert(words.begin(), {"export", "a"});
        std::ostringstream out, err;
        EXPECT_EQ(runCommandLine(words, out, err), 2);
        return err.str();
    };
    EXPECT_NE(refused({}).find("one of --out FILE, --web FOLDER and --networks FOLDER, found none"),
              std::string::npos);
    EXPECT_NE(refused({"--out", "a.glb", "--web", "b"}).find("found --out and --web"),
              std::string::npos);
    EXPECT_NE(refused({"--web", "b", "--author", "me"}).find("--author: expected a .vrm"),
              std::string::npos);
}

// ---- in a browser -------------------------------------------------------------------------------

constexpr const char* kElement = "document.querySelector('doppel-avatar')";

std::string part(const std::string& selector) {
    return std::string(kElement) + ".shadowRoot.querySelector('" + selector + "')";
}

void waitForPicture(Browser& browser) {
    browser.value("customElements.whenDefined('doppel-avatar')");
    browser.value(std::string(kElement) +
                  ".ready.then(() => new Promise(done => "
                  "requestAnimationFrame(() => setTimeout(done, 50))))");
}

// Two frames later, what was asked for is seen.
Image pictureOf(Browser& browser) {
    browser.value(
        "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => "
        "setTimeout(done, 50))))");
    return browser.picture();
}

// A page that never comes to it hangs no test.
void waitUntil(Browser& browser, const std::string& expression) {
    for (int tries = 0; tries < 2000; ++tries) {
        if (browser.value(expression) == true) return;
        usleep(50000);
    }
    FAIL() << "it never was that " << expression;
}

double share(const Image& image, const std::function<bool(const uint8_t*)>& counts) {
    size_t found = 0;
    for (size_t i = 0; i < image.data.size(); i += 3) found += counts(&image.data[i]);
    return 3. * static_cast<double>(found) / static_cast<double>(image.data.size());
}

double difference(const Image& a, const Image& b) {
    size_t found = 0;
    for (size_t i = 0; i < a.data.size(); i += 3)
        for (size_t c = 0; c < 3; ++c)
            if (std::abs(a.data[i + c] - b.data[i + c]) > 24) {
                ++found;
                break;
            }
    return 3. * static_cast<double>(found) / static_cast<double>(a.data.size());
}

void clickOn(Browser& browser, const std::string& selector, double across) {
    const auto box = browser.value("(() => { const box = " + part(selector) +
                                   "; box.scrollIntoView(); const b = box.getBoundingClientRect(); "
                                   "return [b.left, b.top, b.width, b.height]; })()");
    browser.click(box.at(0).get<double>() + across * box.at(2).get<double>(),
                  box.at(1).get<double>() + box.at(3).get<double>() / 2);
}

TEST_F(WebPage, IsOnePageByADoubleClick) {
    NEEDS_BROWSER();
    write();
    Browser browser(1000, 700);
    // What a folder's index hands on to.
    browser.open("file://" + (options_.web / "index.html").string());
    waitUntil(browser,
              "document.readyState === 'complete' && location.pathname.endsWith('/page.html')");
    waitForPicture(browser);
    EXPECT_EQ(browser.value(std::string(kElement) + ".motions"), nlohmann::json({"turn", "again"}));
    EXPECT_EQ(browser.value(std::string(kElement) + ".joints").size(), 24u);
    EXPECT_EQ(browser.value(std::string(kElement) + ".playing"), true) << "autoplay";

    clickOn(browser, ".play", .5);
    EXPECT_EQ(browser.value(std::string(kElement) + ".playing"), false);
    browser.value(std::string(kElement) + ".time = .1");
    const double time = browser.value(std::string(kElement) + ".time");
    const Image before = pictureOf(browser);
    const auto dark = [](const uint8_t* p) { return p[0] < 100 && p[1] < 100 && p[2] < 100; };
    EXPECT_GT(share(before, dark), .05);
    EXPECT_LT(share(before, dark), .4);
    EXPECT_EQ(browser.value(std::string(kElement) + ".time"), time) << "it stands still";

    // A joint, by mouse and by key; then all as it was.
    browser.value(part(".joints") + ".value = 'left_shoulder'");
    browser.value(part(".joints") + ".dispatchEvent(new Event('change'))");
    clickOn(browser, ".angle-z", .75);
    const double angle = browser.value("Number(" + part(".angle-z") + ".value)");
    EXPECT_NEAR(angle, 90, 12);
    const Image moved = pictureOf(browser);
    EXPECT_GT(difference(before, moved), .005);
    browser.key("ArrowRight", 39);
    EXPECT_EQ(browser.value("Number(" + part(".angle-z") + ".value)"), angle + 1)
        << "the slider has the focus";
    clickOn(browser, ".everything", .5);
    EXPECT_LT(difference(before, pictureOf(browser)), .002) << "reset";

    // The camera, by mouse and by key.
    browser.mouse("mousePressed", 300, 300);
    for (int x = 310; x <= 500; x += 10) browser.mouse("mouseMoved", x, 300);
    browser.mouse("mouseReleased", 500, 300);
    const Image turned = pictureOf(browser);
    EXPECT_GT(difference(before, turned), .01);
    browser.value(part("canvas") + ".focus()");
    for (int i = 0; i < 4; ++i) browser.key("ArrowLeft", 37);
    EXPECT_GT(difference(turned, pictureOf(browser)), .005);

    const Image keyed = pictureOf(browser);
    browser.touch("touchStart", 300, 300);
    for (int x = 310; x <= 500; x += 10) browser.touch("touchMove", x, 300);
    browser.touch("touchEnd", 500, 300);
    EXPECT_GT(difference(keyed, pictureOf(browser)), .01) << "by a finger";

    // The other motion and the T-pose.
    browser.value(part(".time") + ".focus()");
    browser.key("End", 35);
    EXPECT_NEAR(browser.value(std::string(kElement) + ".time").get<double>(), 19. / 30, .02);
    browser.value(std::string(kElement) + ".setAttribute('motion', 'none')");
    EXPECT_EQ(browser.value(part(".motions") + ".value"), "none");
    EXPECT_GT(difference(turned, pictureOf(browser)), .01);

    // Light and dark.
    const auto isDark = [](const Image& image) { return image.pixel(2, 2)[0] < 60; };
    EXPECT_FALSE(isDark(pictureOf(browser)));
    browser.theme("dark");
    EXPECT_TRUE(isDark(pictureOf(browser)));
    EXPECT_EQ(browser.complaints, std::vector<std::string>());
}

// What a page shows from the place of a camera is what is rendered.
TEST_F(WebPage, ShowsFromAServerWhatRenderDraws) {
    NEEDS_BROWSER();
    write();
    const Motion motion = turning();
    const Avatar avatar = plainAvatar();
    constexpr int kSize = 256;
    const Camera camera{300, 300, kSize / 2., kSize / 2., kSize, kSize};
    AvatarRenderer renderer(testDevice(), avatar, true, TextureKind::Coarse);
    const std::vector<uint8_t> mask = renderer.mask(motion.theta[0], motion.trans[0], camera);

    // The page's world is camera space turned by half a turn about x, the lowest vertex on the
    // ground and the pelvis above the origin.
    const std::vector<float> verts = renderer.vertices(motion.theta[0], motion.trans[0]);
    double ground = -INFINITY;
    for (size_t i = 1; i < verts.size(); i += 3)
        ground = std::max(ground, static_cast<double>(verts[i]));
    const std::vector<double> rest =
        restJoints(avatar.body, std::vector<double>(avatar.betas.begin(), avatar.betas.end()));
    const Trans& t = motion.trans[0];
    const double x = -(rest[0] + static_cast<double>(t[0])), y = ground,
                 z = rest[2] + static_cast<double>(t[2]);
    std::ofstream(options_.web / "embedded.html") << fmt::format(
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>me</title>"
        "<link rel='icon' href='data:,'><style>body {{ margin: 0 }} doppel-avatar "
        "{{ width: {0}px; height: {0}px }}</style><script type='module' "
        "src='doppel-avatar.js'></script><doppel-avatar src='avatar.glb' "
        "controls='off' ground='off' background='#00ff00' camera='0 0 1' "
        "target='{1} {2} {3}' fov='{4}'></doppel-avatar>",
        kSize, x, y, z - 1, 2 * std::atan(kSize / 2. / 300) * 180 / std::acos(-1.));
    Browser browser(kSize, kSize, options_.web);
    browser.open(std::string(Browser::kServer) + "embedded.html");
    waitForPicture(browser);
    const Image shown = pictureOf(browser);
    ASSERT_EQ(shown.width, kSize);
    ASSERT_EQ(shown.height, kSize);
    double both = 0, either = 0;
    for (size_t i = 0; i < mask.size(); ++i) {
        const bool rendered = mask[i] > 127, seen = shown.data[3 * i + 1] < 160;
        both += rendered && seen;
        either += rendered || seen;
    }
    EXPECT_GT(both / either, .97);
    EXPECT_EQ(browser.value(std::string(kElement) + ".playing"), false);

    // The folder's own page, and an avatar that is not there.
    browser.size(1000, 700);
    browser.open(Browser::kServer);
    waitForPicture(browser);
    EXPECT_EQ(browser.value("document.title"), "page");
    EXPECT_EQ(browser.value(std::string(kElement) + ".playing"), true);
    browser.theme("light", "reduce");
    browser.open(Browser::kServer);
    waitForPicture(browser);
    EXPECT_EQ(browser.value(std::string(kElement) + ".playing"), false)
        << "the system asks for less motion";
    EXPECT_EQ(browser.complaints, std::vector<std::string>());
    browser.value(std::string(kElement) + ".setAttribute('src', 'other.glb')");
    waitUntil(browser, part(".message") + ".role === 'alert'");
    EXPECT_EQ(browser.value(part(".message") + ".textContent"),
              "The avatar cannot be shown: other.glb: the server says 404");
}

// What README.txt says works, from the first line to the last.
TEST_F(WebPage, GoesIntoOtherPages) {
    NEEDS_BROWSER();
    options_.web = folder_ / "avatar";
    write();
    const std::string text = bytesOf(options_.web / "README.txt");
    const size_t begin = text.find("<!doctype"), end = text.rfind("</script>");
    ASSERT_NE(begin, std::string::npos);
    ASSERT_NE(end, std::string::npos);
    const std::string example = text.substr(begin, end - begin) + "</script>\n";
    EXPECT_LE(std::ranges::count(example, '\n'), 11);
    folder_.write("mine.html", example);
    Browser browser(700, 800, folder_.path());
    browser.open(std::string(Browser::kServer) + "mine.html");
    waitForPicture(browser);
    browser.value(std::string(kElement) + ".pause()");
    browser.value("me.time = 0");
    const Image before = pictureOf(browser);
    browser.value("document.querySelector('button').click()");
    EXPECT_GT(difference(before, pictureOf(browser)), .003);
    EXPECT_EQ(browser.complaints, std::vector<std::string>());

    // Taken out of the page and put back, it shows itself again.
    browser.value("me.remove()");
    browser.value(
        "new Promise(done => { me.addEventListener('load', () => done()); "
        "document.body.prepend(me); })");
    browser.value("me.pause(), me.time = 0");
    EXPECT_LT(difference(before, pictureOf(browser)), .02);
    EXPECT_EQ(browser.complaints, std::vector<std::string>());
}

}  // namespace
}  // namespace doppel
