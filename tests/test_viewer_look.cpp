// The interface at several scales and in small windows: nothing is cut, and what is large is large.
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "tests/viewer_test.h"
#include "viewer/overlays.h"
#include "viewer/picture/legend.h"
#include "viewer/widgets.h"
#include "viewer/window/look.h"

namespace doppel::test {
namespace {

class LookTest : public ViewerTest {
protected:
    // With its panel, at a scale.
    Viewer& openAt(int width, int height, double scale, Theme theme = Theme::Dark) {
        ViewerOptions options;
        options.avatar = *folder_ / "avatar";
        options.width = width;
        options.height = height;
        options.scale = scale;
        options.theme = theme;
        options.state = state_;
        viewer_.emplace(options);
        screen_->move(9, 9);
        turn();
        screen_->move(4, 4);
        settle();
        return *viewer_;
    }
    void expectNothingCut(const std::string& what) {
        EXPECT_GT(drawnItems().size(), 10u) << what;
        for (const DrawnItem& item : drawnItems())
            EXPECT_FALSE(item.cut) << what << ": \"" << item.label << "\" from " << item.low.x
                                   << " to " << item.high.x;
    }
    // What can be unfolded and is in sight, from below, for what unfolds pushes down what follows.
    void unfold() {
        for (const char* header : {"messages", "more of films and pictures", "opened before",
                                   "kept poses", "drags turn one bone (FK)"}) {
            const auto drawn = std::ranges::find(drawnItems(), header, &DrawnItem::label);
            if (drawn == drawnItems().end() || drawn->high.y > float(viewer_->window().height()))
                continue;
            clickItem(header);
            if (std::string_view(header) == "kept poses") clickItem("keep this pose");
            ++unfolded_;
        }
    }
    int unfolded_ = 0;
    fs::path state_;  // what the viewer remembers is there; empty: nothing
    static void SetUpTestSuite() {
        screen_ = new Screen(3840, 2160);
        folder_ = new Folder;
        Avatar avatar = plainAvatar();
        addMeshNet(avatar);
        writeAvatar(*folder_ / "avatar", avatar);
        writeColouredCapture(*folder_ / "capture", turningMotion(8));
    }
    // The whole screen, for people to look at.
    void keep(const std::string& name, int width, int height) {
        const char* folder = getenv("DOPPEL_KEEP_SCREENS");
        if (folder && *folder)
            writeImage(fs::path(folder) / (name + ".png"), screen_->grab(0, 0, width, height));
    }
};

TEST_F(LookTest, NothingIsCutWhateverTheScale) {
    struct Case {
        int width, height;
        double scale;
        Theme theme;
    };
    state_ = *folder_ / "unfolding";
    for (const Case& c : {Case{1280, 800, 1, Theme::Dark},
                          {1920, 1080, 1, Theme::Light},
                          {1920, 1080, 1.5, Theme::Dark},
                          {3840, 2160, 2, Theme::Light},
                          {600, 600, 1, Theme::Dark}}) {
        const std::string what = fmt::format("{}x{} at {}", c.width, c.height, c.scale);
        fs::remove_all(state_);
        Viewer& viewer = openAt(c.width, c.height, c.scale, c.theme);
        viewer.loadMotion(folder_->path() / "capture");
        screen_->key("Home");
        settle();
        viewer.editor().setKeyframe(0);
        EXPECT_EQ(viewer.timelineHeight(), std::lround(Viewer::kTimelineHeight * c.scale));
        for (const char* tab : {"View", "Pose", "Shape", "Inspect", "Mix", "Files"}) {
            clickItem(tab);
            if (std::string_view(tab) == "View") {
                clickItem("keep this view");
                viewer.settings().floor = true;
                viewer.settings().paint = kPaintClamps;
                settle();
            }
            if (std::string_view(tab) == "Pose") clickItem("left elbow");
            if (std::string_view(tab) == "Inspect") {
                const glm::dvec2 belly = at(joint::kSpine1);
                drag(belly, belly);
                EXPECT_TRUE(viewer.inspected());
            }
            expectNothingCut(what + ", " + tab);
            unfold();
            expectNothingCut(what + ", " + tab + ", unfolded");
            keep(fmt::format("{}-{}-{}-{}", c.width, c.height, c.scale, tab), c.width, c.height);
        }
        viewer_.reset();
    }
    EXPECT_GE(unfolded_, 5 * 5 - 3);  // in the smallest window not all are in sight
}

// A tip says what an item does, once the mouse has rested on it.
TEST_F(LookTest, TipsComeWhereTheMouseRests) {
    openAt(900, 700, 1);
    const auto shows = [](std::string_view words) {
        return std::ranges::any_of(
            drawnItems(), [&](const DrawnItem& item) { return item.label.find(words) == 0; });
    };
    const auto begins = {std::pair{"wireframe", "The edges of the mesh's faces"},
                         {"front", "From the front"},
                         {"loop", "After the last frame"},
                         {"surface", "What the surface is painted with"},
                         {"Inspect", "What is known of a point"},
                         {"remove key", "Takes the key of this frame away"}};  // not to be pressed
    const auto expectTip = [&](const char* label, const char* words, glm::dvec2 place) {
        screen_->move(place.x, place.y);
        turn(2);
        EXPECT_FALSE(shows(words)) << label << ": at once";
        await(words, [&] {
            viewer_->frame();
            return shows(words) && !tipPending();
        });
        expectNothingCut(label);
        keep(fmt::format("tip-{}", label), 900, 700);
        screen_->move(20, 20);
        settle();
        EXPECT_FALSE(shows(words)) << label << ": the mouse is elsewhere";
    };
    for (const auto& [label, words] : begins) expectTip(label, words, itemAt(label));
    // Of what a list offers, and of what is no item.
    clickItem("surface");
    expectTip("part labels", "The body's parts", itemAt("part labels"));
    screen_->key("Escape");
    settle();
    viewer_->settings().split = Split::Textures;
    viewer_->settings().divided = true;
    settle();
    const double middle = (900 - viewer_->panelWidth()) / 2.;
    expectTip("the divider", "Drag it", {middle, 200});
}

TEST_F(LookTest, LegendsSayWhatColoursMean) {
    Viewer& viewer = openAt(900, 700, 1);
    viewer.settings().joints = false;
    const Avatar avatar = readAvatar(*folder_ / "avatar");
    for (uint32_t paint = kPaintTexture; paint <= kPaintClamps; ++paint) {
        viewer.settings().paint = paint;
        settle();
        const std::vector<LegendRow> rows = legendOf(paint, avatar);
        EXPECT_EQ(rows.empty(), paint == kPaintTexture || paint == kPaintClay);
        for (const LegendRow& row : rows) EXPECT_NO_THROW(itemAt(row.name));
        expectNothingCut(fmt::format("legend {}", paint));
        keep(fmt::format("legend-{}", paint), 900, 700);
    }
    // The picture's colours are the legend's, darker where the surface turns away from the eye.
    const auto expectColour = [&](glm::dvec2 place, const LegendColour& colour,
                                  const std::string& what) {
        const Image seen = picture();
        const uint8_t* rgb = seen.pixel(static_cast<int>(place.x), static_cast<int>(place.y));
        const glm::dvec3 shown = glm::dvec3(rgb[0], rgb[1], rgb[2]) / 255.,
                         meant(colour[0], colour[1], colour[2]);
        const double light = glm::dot(shown, meant) / glm::dot(meant, meant);
        EXPECT_GT(light, .4) << what;
        EXPECT_LT(glm::distance(shown, light * meant), .03) << what;
    };
    const glm::dvec2 thigh = (at(joint::kLeftHip) + at(joint::kLeftKnee)) / 2.;
    expectColour(at(joint::kSpine3), legendOf(kPaintClamps, avatar)[0].colours[2], "the largest");
    expectColour(at(joint::kHead) - glm::dvec2(0, 10), legendOf(kPaintClamps, avatar)[0].colours[0],
                 "the face");
    viewer.settings().paint = kPaintParts;
    settle();
    expectColour(thigh, legendOf(kPaintParts, avatar)[kLeftThigh - 1].colours[0], "thigh");
}

// What is drawn at twice the scale is twice as large: the words, the rows, the handles.
TEST_F(LookTest, AllOfItGrowsWithTheScale) {
    auto heightOf = [&](const std::string& label) {
        for (const DrawnItem& item : drawnItems())
            if (item.label == label) return double(item.high.y - item.low.y);
        return 0.0;
    };
    std::vector<double> rows;
    for (double scale : {1., 2.}) {
        Viewer& viewer = openAt(1400, 1000, scale);
        rows.push_back(heightOf("wireframe"));
        EXPECT_EQ(viewer.panelWidth(), Viewer::kPanelWidth * scale);
        // A joint is met by a mouse that is 14 units away.
        const Pose before = viewer.editor().pose();
        const glm::dvec2 beyond = at(joint::kLeftHand) + glm::dvec2(22, 0);
        drag(beyond, beyond + glm::dvec2(0, -30), 1, 2);
        EXPECT_EQ(viewer.editor().pose() != before, scale == 2);
        viewer_.reset();
    }
    EXPECT_NEAR(rows[1] / rows[0], 2, .15);
}

// Of a monitor with small pixels: the window has more of them, and so has everything in it.
TEST_F(LookTest, TheMonitorsOwnScaleMakesAllOfItLarger) {
    double row = 0;
    for (const int dpi : {96, 144, 192}) {
        screen_->setDpi(dpi);
        const double scale = dpi / 96.;
        Viewer& viewer = openAt(900, 700, 1);
        viewer.settings().ringAxes = RingAxes::Views;
        EXPECT_EQ(viewer.window().width(), std::lround(900 * scale)) << dpi;
        EXPECT_EQ(viewer.window().height(), std::lround(700 * scale)) << dpi;
        EXPECT_EQ(viewer.panelWidth(), std::lround(Viewer::kPanelWidth * scale)) << dpi;
        EXPECT_EQ(viewer.timelineHeight(), std::lround(Viewer::kTimelineHeight * scale)) << dpi;
        const auto box = std::ranges::find(drawnItems(), "wireframe", &DrawnItem::label);
        ASSERT_NE(box, drawnItems().end());
        const double height = double(box->high.y - box->low.y);
        if (dpi == 96) row = height;
        EXPECT_NEAR(height / row, scale, .1) << dpi;
        expectNothingCut(fmt::format("{} dpi", dpi));

        // A joint is met by a mouse that is 12 units away, and not from 17.
        const Pose before = viewer.editor().pose();
        const OrbitCamera camera = viewer.camera();
        const glm::dvec2 hand = at(joint::kLeftHand);
        for (const double away : {17., 12.}) {
            drag(hand + glm::dvec2(away * scale, 0), hand + glm::dvec2(away * scale, -30), 1, 2);
            EXPECT_EQ(viewer.editor().pose() != before, away < 14) << dpi;
            viewer.camera() = camera;
            settle();
        }
        // The ring about the view's depth is 74 units wide.
        const size_t joint = viewer.selected().value_or(joint::kPelvis);
        const glm::dvec2 on =
            at(joint) + kRingRadius * scale * glm::dvec2(std::cos(.6), std::sin(.6));
        screen_->move(on.x, on.y);
        turn();
        screen_->press(1);
        turn();
        screen_->move(on.x - 9, on.y + 12);
        turn();
        EXPECT_NE(viewer.turnedText(), "") << dpi;
        keep(fmt::format("dpi-{}", dpi), viewer.window().width(), viewer.window().height());
        screen_->release(1);
        settle();
        viewer_.reset();
    }
    screen_->setDpi(96);
}

TEST_F(LookTest, KeysMakeLettersLargerAndTheyAreRemembered) {
    ViewerOptions options;
    options.avatar = *folder_ / "avatar";
    options.state = *folder_ / "state";
    options.width = 900, options.height = 700;
    viewer_.emplace(options);
    screen_->move(9, 9);
    turn();
    screen_->move(4, 4);
    settle();
    EXPECT_EQ(viewer_->panelWidth(), Viewer::kPanelWidth);
    keyWith("Control_L", "equal");
    EXPECT_EQ(viewer_->panelWidth(), std::lround(1.1 * Viewer::kPanelWidth));
    clickItem("theme");
    clickItem("light");
    EXPECT_EQ(viewer_->settings().theme, Theme::Light);
    viewer_.reset();
    viewer_.emplace(options);
    settle();
    EXPECT_EQ(viewer_->panelWidth(), std::lround(1.1 * Viewer::kPanelWidth));
    EXPECT_EQ(viewer_->settings().theme, Theme::Light);
    keyWith("Control_L", "0");
    EXPECT_EQ(viewer_->panelWidth(), Viewer::kPanelWidth);
    viewer_.reset();
    // Whatever the file holds, the window opens.
    for (const char* text :
         {"", "[1]", "{\"scale\": 1e9, \"theme\": 7}", "{\"recent\": [7, {}]}"}) {
        std::ofstream(*folder_ / "state" / "preferences.json") << text;
        EXPECT_EQ(readPreferences(*folder_ / "state"), Preferences{}) << text;
    }
    std::ofstream(*folder_ / "state" / "preferences.json")
        << "{\"recent\": " << std::string(400'000, '[') << std::string(400'000, ']') << "}";
    EXPECT_EQ(readPreferences(*folder_ / "state"), Preferences{}) << "a deep list";
    // What was opened last comes first, once.
    Preferences preferences;
    for (int i = 0; i < 20; ++i) remember(preferences, fmt::format("/somewhere/{}", i % 15));
    EXPECT_EQ(preferences.recent.size(), 12u);
    EXPECT_EQ(preferences.recent[0], "/somewhere/4");
    EXPECT_EQ(std::ranges::count(preferences.recent, "/somewhere/3"), 1);
    preferences.bookmarks[3] = {"from the left", cameraText({})};
    writePreferences(*folder_ / "state", preferences);
    EXPECT_EQ(readPreferences(*folder_ / "state"), preferences);
    // A view that nothing can be seen from is none.
    preferences.bookmarks[4] = {"nowhere", "1,2,3"};
    preferences.bookmarks[5] = {std::string(kLongestBookmark + 1, 'x'), cameraText({})};
    writePreferences(*folder_ / "state", preferences);
    EXPECT_EQ(readPreferences(*folder_ / "state").bookmarks.size(), 1u);
}

TEST_F(LookTest, TheHelpFitsSmallWindows) {
    Viewer& viewer = openAt(420, 320, 1);
    viewer.settings().panel = false;
    screen_->key("h");
    settle();
    expectNothingCut("the help");
    const auto bottomOf = [&](const std::string& label) {
        for (const DrawnItem& item : drawnItems())
            if (item.label == label) return item.high.y;
        return INFINITY;
    };
    EXPECT_GT(bottomOf("quit"), 320) << "there is more than the window has room for";
    screen_->move(200, 150);
    turn();
    for (int i = 0; i < 40; ++i) screen_->click(5);
    settle();
    EXPECT_LT(bottomOf("quit"), .1 * 320 + .88 * 320) << "it scrolls";
    keep("420-320-help", 420, 320);
}

TEST_F(LookTest, AQuestionDimsWhatIsBehindIt) {
    for (Theme theme : {Theme::Dark, Theme::Light}) {
        Viewer& viewer = openAt(700, 500, 1, theme);
        const auto brightness = [&] {
            const Canvas drawn = viewer.window().drawn();
            return drawn.row(20)[20] & 0xff;
        };
        viewer.settings().figures = false;
        settle();
        const uint32_t before = brightness();
        viewer.editor().setKeyframe(0);
        screen_->closeWindow();
        settle();
        ASSERT_NE(viewer.question(), "");
        EXPECT_LT(brightness(), .8 * before);
        keep(theme == Theme::Dark ? "question-dark" : "question-light", 700, 500);
        // Its answers say what becomes of the work.
        const glm::dvec2 place = itemAt("Do not save");
        screen_->move(place.x, place.y);
        await("the answer's tip", [&] {
            viewer.frame();
            return std::ranges::any_of(drawnItems(), [](const DrawnItem& item) {
                return item.label == "What you edited is lost.";
            });
        });
        viewer_.reset();
    }
}

// The letters of Dear ImGui's own font are all of one width.
TEST_F(LookTest, TheFontIsFoundOrDoneWithout) {
    openAt(900, 700, 1);
    const auto widthOf = [&](const std::string& label) {
        for (const DrawnItem& item : drawnItems())
            if (item.label == label) return item.high.x - item.low.x;
        return 0.f;
    };
    const float five = widthOf("front"), four = widthOf("side"), three = widthOf("top");
    ASSERT_GT(three, 0);
    const bool ofOneWidth = std::abs((five - four) - (four - three)) < .01f;
    EXPECT_EQ(ofOneWidth, interfaceFont().empty());
}

// Over what is opaque.
ImVec4 over(const ImVec4& colour, const ImVec4& below) {
    const auto mix = [&](float a, float b) { return a * colour.w + b * (1 - colour.w); };
    return {mix(colour.x, below.x), mix(colour.y, below.y), mix(colour.z, below.z), 1};
}

// As WCAG 2 defines relative luminance and contrast; colours of sRGB from 0 to 1.
double luminance(const ImVec4& colour) {
    const auto linear = [](double c) {
        return c <= .04045 ? c / 12.92 : std::pow((c + .055) / 1.055, 2.4);
    };
    return .2126 * linear(colour.x) + .7152 * linear(colour.y) + .0722 * linear(colour.z);
}
double contrast(const ImVec4& a, const ImVec4& b) {
    const double la = luminance(a), lb = luminance(b);
    return (std::max(la, lb) + .05) / (std::min(la, lb) + .05);
}

// WCAG's level AA: 4.5 for letters, 3 for what else has to be seen.
TEST(Look, WordsHaveTheContrastOfLevelAA) {
    EXPECT_NEAR(contrast({0, 0, 0, 1}, {1, 1, 1, 1}), 21, 1e-9);
    EXPECT_NEAR(contrast({119 / 255.f, 119 / 255.f, 119 / 255.f, 1}, {1, 1, 1, 1}), 4.48, .01);
    ImGui::CreateContext();
    for (const Theme theme : {Theme::Dark, Theme::Light}) {
        const std::string name = theme == Theme::Dark ? "dark" : "light";
        applyLook({.theme = theme});
        const ImVec4* colours = ImGui::GetStyle().Colors;
        const ImVec4 window = colours[ImGuiCol_WindowBg];
        ASSERT_EQ(window.w, 1) << "what lies on it is known";
        const auto expect = [&](const ImVec4& words, const ImVec4& ground, const std::string& what,
                                double least = 4.5) {
            EXPECT_GE(contrast(over(words, ground), ground), least) << name << ": " << what;
        };
        for (const ImGuiCol ground :
             {ImGuiCol_WindowBg, ImGuiCol_PopupBg, ImGuiCol_TitleBg, ImGuiCol_TitleBgActive,
              ImGuiCol_FrameBg, ImGuiCol_FrameBgHovered, ImGuiCol_FrameBgActive, ImGuiCol_Button,
              ImGuiCol_ButtonHovered, ImGuiCol_ButtonActive, ImGuiCol_Header,
              ImGuiCol_HeaderHovered, ImGuiCol_HeaderActive, ImGuiCol_Tab, ImGuiCol_TabHovered,
              ImGuiCol_TabActive, ImGuiCol_TableHeaderBg, ImGuiCol_TextSelectedBg})
            expect(colours[ImGuiCol_Text], over(colours[ground], window),
                   ImGui::GetStyleColorName(ground));
        const ImVec4 frame = over(colours[ImGuiCol_FrameBg], window),
                     active = over(colours[ImGuiCol_FrameBgActive], window);
        expect(colours[ImGuiCol_Text], over(colours[ImGuiCol_SliderGrab], frame),
               "a slider's grab");
        expect(colours[ImGuiCol_Text], over(colours[ImGuiCol_SliderGrabActive], active),
               "a slider's grab, held");
        expect(colours[ImGuiCol_CheckMark], frame, "a check mark", 3);
        // Hints are dimmed, and are there to be read.
        expect(colours[ImGuiCol_TextDisabled], window, "hints");
        expect(colours[ImGuiCol_TextDisabled], over(colours[ImGuiCol_PopupBg], window),
               "hints in a tip");

        // Over whatever picture there is.
        const StatusColours status = statusColours(theme);
        for (const float picture : {0.f, 1.f}) {
            const ImVec4 ground = over(ImGui::ColorConvertU32ToFloat4(status.backing),
                                       {picture, picture, picture, 1});
            expect(ImGui::ColorConvertU32ToFloat4(status.plain), ground, "words over the picture");
            expect(ImGui::ColorConvertU32ToFloat4(status.good), ground, "messages");
            expect(ImGui::ColorConvertU32ToFloat4(status.bad), ground, "mistakes");
            expect(colours[ImGuiCol_Text],
                   over({window.x, window.y, window.z, .85f}, {picture, picture, picture, 1}),
                   "a legend");
        }
    }
    ImGui::DestroyContext();
}

TEST(Look, HandlesHaveTheContrastOfLevelAAOverAnyPicture) {
    std::vector<ImU32> handles{kJointColour, kHoveredColour, kSelectedColour, kPinColour};
    handles.insert(handles.end(), std::begin(kRingColours), std::end(kRingColours));
    for (const ImU32 handle : handles)
        for (float picture = 0; picture <= 1; picture += .125f) {
            const ImVec4 ground{picture, picture, picture, 1};
            const ImVec4 rim = over(ImGui::ColorConvertU32ToFloat4(kRim), ground);
            EXPECT_GE(contrast(over(ImGui::ColorConvertU32ToFloat4(handle), rim), rim), 3)
                << std::hex << handle << " over " << picture;
        }
}

}  // namespace
}  // namespace doppel::test
