// Dear ImGui's triangles, drawn by the host.
#include "viewer/window/canvas.h"

#include <gtest/gtest.h>
#include <imgui/imgui.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "view/compose.h"

namespace doppel {
namespace {

constexpr uint32_t kBackground = 0xff404040, kHalfRed = 0x800000ff, kHalfRedOver = 0xff2020a0;
const ImVec2 kCovered{0.125f, 0.5f};  // in the atlas

// Four texels beside each other, the first two covered, two rows.
const std::vector<uint8_t> kTexels{255, 255, 0, 100, 255, 255, 0, 100};
const FontAtlas kFont{4, 2, kTexels.data()};

class CanvasTest : public testing::Test {
protected:
    CanvasTest() : list_(nullptr) { cover(kBackground); }

    // The whole layer with one colour.
    void cover(uint32_t pixel) {
        layer_.begin(kWidth, kHeight);
        for (int y = 0; y < kHeight; ++y) std::ranges::fill(layer_.draw(y, {0, kWidth}), pixel);
    }
    std::vector<uint32_t> pixels() const {
        std::vector<uint32_t> all;
        for (int y = 0; y < kHeight; ++y) std::ranges::copy(layer_.row(y), std::back_inserter(all));
        return all;
    }

    void vertex(float x, float y, ImU32 colour, ImVec2 uv = kCovered) {
        list_.VtxBuffer.push_back({{x, y}, uv, colour});
    }
    void indices(std::initializer_list<ImDrawIdx> values) {
        for (ImDrawIdx value : values) list_.IdxBuffer.push_back(value);
    }
    void draw(ImVec4 clip = {0, 0, kWidth, kHeight}, float scale = 1,
              CanvasImage* image = nullptr) {
        ImDrawCmd command{};
        command.TextureId = image;
        command.ClipRect = clip;
        command.ElemCount = static_cast<unsigned>(list_.IdxBuffer.Size);
        list_.CmdBuffer.push_back(command);
        ImDrawList* lists[] = {&list_};
        ImDrawData data;
        data.CmdLists = lists;
        data.CmdListsCount = 1;
        data.FramebufferScale = {scale, scale};
        drawInterface(data, kFont, layer_);
        list_.VtxBuffer.clear();
        list_.IdxBuffer.clear();
        list_.CmdBuffer.clear();
    }
    // As Dear ImGui makes it, or as two triangles that are not known for a rectangle.
    void rectangle(ImVec2 a, ImVec2 c, ImU32 colour, ImVec2 uvA, ImVec2 uvC, bool whole = true) {
        vertex(a.x, a.y, colour, uvA);
        vertex(c.x, a.y, colour, {uvC.x, uvA.y});
        vertex(c.x, c.y, colour, uvC);
        vertex(a.x, c.y, colour, {uvA.x, uvC.y});
        if (whole)
            indices({0, 1, 2, 0, 2, 3});
        else
            indices({1, 2, 0, 2, 3, 0});
    }
    uint32_t at(int x, int y) const { return layer_.row(y)[static_cast<size_t>(x)]; }

    static constexpr int kWidth = 64, kHeight = 48;
    ImDrawList list_;
    InterfaceLayer layer_;
};

// Pixel by pixel where it is as large as its place, and cut where the clip ends.
TEST_F(CanvasTest, ImagesFillTheirRectangle) {
    CanvasImage image{3, 2, {1, 2, 3, 4, 5, 6}};
    for (uint32_t& pixel : image.pixels) pixel |= 0xff000000u;
    rectangle({10, 20}, {13, 22}, IM_COL32_WHITE, {0, 0}, {1, 1});
    draw({0, 0, 12, kHeight}, 1, &image);
    EXPECT_EQ(at(10, 20), image.pixels[0]);
    EXPECT_EQ(at(11, 20), image.pixels[1]);
    EXPECT_EQ(at(12, 20), kBackground) << "beyond the clip";
    EXPECT_EQ(at(10, 21), image.pixels[3]);
    EXPECT_EQ(at(11, 21), image.pixels[4]);
    EXPECT_EQ(at(9, 20), kBackground);
    EXPECT_EQ(at(10, 22), kBackground);
    // Twice as large, mirrored.
    rectangle({30, 20}, {36, 24}, IM_COL32_WHITE, {1, 0}, {0, 1});
    draw({0, 0, kWidth, kHeight}, 1, &image);
    EXPECT_EQ(at(30, 20), image.pixels[2]);
    EXPECT_EQ(at(31, 21), image.pixels[2]);
    EXPECT_EQ(at(35, 23), image.pixels[3]);
}

TEST_F(CanvasTest, TrianglesThatShareEdgesCoverEachPixelOnce) {
    std::mt19937 random(7);
    std::uniform_real_distribution<float> shift(-3, 3);
    for (int round = 0; round < 50; ++round) {
        cover(kBackground);
        constexpr int kCorners = 9;
        float radius = 18 + shift(random);
        // Corners on pixels' centres, too.
        ImVec2 centre =
            round % 2 ? ImVec2{32.5f, 24.5f} : ImVec2{32 + shift(random), 24 + shift(random)};
        vertex(centre.x, centre.y, kHalfRed);
        for (int i = 0; i < kCorners; ++i) {
            float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(i) / kCorners;
            vertex(centre.x + radius * std::cos(angle), centre.y + radius * std::sin(angle),
                   kHalfRed);
        }
        for (int i = 0; i < kCorners; ++i) {
            auto here = static_cast<ImDrawIdx>(1 + i),
                 next = static_cast<ImDrawIdx>(1 + (i + 1) % kCorners);
            if (i % 2)  // either way round
                indices({0, here, next});
            else
                indices({0, next, here});
        }
        draw();
        int covered = 0;
        for (uint32_t pixel : pixels()) {
            ASSERT_TRUE(pixel == kBackground || pixel == kHalfRedOver) << std::hex << pixel;
            covered += pixel != kBackground;
        }
        double angle = 2 * std::numbers::pi / kCorners;
        EXPECT_NEAR(covered, kCorners * radius * radius * std::sin(angle) / 2, 12);
    }
}

TEST_F(CanvasTest, ARectangleIsItsTwoTriangles) {
    for (bool textured : {false, true})
        for (float shift : {0.0f, 0.3f, 0.5f, 0.77f}) {
            ImVec2 from = textured ? ImVec2{0, 0} : kCovered, to = textured ? ImVec2{1, 1} : from;
            std::vector<std::vector<uint32_t>> both;
            for (bool whole : {false, true}) {
                cover(kBackground);
                rectangle({5 + shift, 6 + shift}, {38, 20 + 2 * shift}, 0xc010f080, from, to,
                          whole);
                draw();
                both.push_back(pixels());
            }
            for (size_t i = 0; i < both[0].size(); ++i)
                for (int byte = 0; byte < 4; ++byte)
                    EXPECT_NEAR(static_cast<int>(both[0][i] >> 8 * byte & 255),
                                static_cast<int>(both[1][i] >> 8 * byte & 255), textured ? 2 : 0)
                        << i << " " << shift;
            EXPECT_NE(both[0], std::vector<uint32_t>(both[0].size(), kBackground));
        }
}

TEST_F(CanvasTest, TexelsAreCoverage) {
    rectangle({10, 10}, {14, 12}, 0xffffffff, {0, 0}, {1, 1});
    draw();
    for (int y : {10, 11}) {
        EXPECT_EQ(at(9, y), kBackground);
        EXPECT_EQ(at(10, y), 0xffffffff);
        EXPECT_EQ(at(11, y), 0xffffffff);
        EXPECT_EQ(at(12, y), kBackground);
        EXPECT_EQ(at(13, y), 0xff8b8b8b);  // 64 + 191 * 100 / 255
        EXPECT_EQ(at(14, y), kBackground);
    }
    EXPECT_EQ(at(10, 9), kBackground);
    EXPECT_EQ(at(10, 12), kBackground);
    // Between two texels their mean.
    cover(0xff000000);
    rectangle({10, 10}, {11, 11}, 0xffffffff, {0.5f - 0.125f, 0}, {0.5f + 0.125f, 1});
    draw();
    EXPECT_EQ(at(10, 10), 0xff808080);
}

TEST_F(CanvasTest, ClipsAndScales) {
    rectangle({2, 3}, {20, 21}, 0xff0000ff, kCovered, kCovered);
    draw({10, 10, 30, 12}, 2);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
            EXPECT_EQ(at(x, y), x >= 20 && x < 40 && y >= 20 && y < 24 ? 0xff0000ff : kBackground);
}

// Colours times opacity, and what is over what: as over a picture at once.
TEST_F(CanvasTest, LiesOverPicturesAsItsPartsWould) {
    std::mt19937 random(3);
    for (int round = 0; round < 20; ++round) {
        const ImU32 first = static_cast<ImU32>(random()), second = static_cast<ImU32>(random());
        const uint32_t picture = static_cast<uint32_t>(random()) | 0xff000000u;
        std::vector<uint32_t> over;
        for (uint32_t below : {picture, 0u}) {
            cover(below);
            rectangle({4, 4}, {20, 20}, first, kCovered, kCovered);
            draw();
            rectangle({10, 10}, {30, 30}, second, kCovered, kCovered);
            draw();
            over.push_back(at(15, 15));
            EXPECT_EQ(at(40, 40), below);
        }
        const uint32_t opacity = over[1] >> 24;
        for (int byte = 0; byte < 3; ++byte)
            EXPECT_LE(over[1] >> 8 * byte & 255, opacity) << "it is times the opacity";
        const uint32_t laid = composed(picture, over[1], 0);
        for (int byte = 0; byte < 4; ++byte)
            EXPECT_NEAR(static_cast<int>(laid >> 8 * byte & 255),
                        static_cast<int>(over[0] >> 8 * byte & 255), 2)
                << round;
        EXPECT_EQ(composed(picture, over[1], 1),
                  (laid & 0xff00ff00u) | (laid & 255) << 16 | (laid >> 16 & 255));
    }
}

TEST_F(CanvasTest, KnowsWhatHasChanged) {
    layer_.begin(kWidth, kHeight);
    EXPECT_EQ(layer_.changed(), (PixelBox{0, 0, kWidth, kHeight})) << "what covered it is gone";
    const auto frame = [&](ImVec2 a, ImVec2 c, ImU32 colour) {
        layer_.begin(kWidth, kHeight);
        rectangle({2, 3}, {6, 7}, kHalfRed, kCovered, kCovered);
        draw();
        rectangle(a, c, colour, kCovered, kCovered, false);
        draw();
        return layer_.changed();
    };
    EXPECT_EQ(frame({10, 12}, {15, 14}, kHalfRed), (PixelBox{2, 3, 13, 11}));
    EXPECT_EQ(frame({10, 12}, {15, 14}, kHalfRed), PixelBox{});
    EXPECT_EQ(frame({10, 12}, {15, 14}, 0xff00ff00), (PixelBox{10, 12, 5, 2}));
    EXPECT_EQ(frame({40, 30}, {44, 31}, 0xff00ff00), (PixelBox{10, 12, 34, 19}));
    EXPECT_EQ(frame({41, 30}, {44, 31}, 0xff00ff00), (PixelBox{40, 30, 1, 1}));
    layer_.begin(kWidth + 1, kHeight);
    EXPECT_EQ(layer_.changed(), (PixelBox{0, 0, kWidth + 1, kHeight})) << "of another size";
}

TEST_F(CanvasTest, ColoursRunEvenlyBetweenCorners) {
    cover(0xff000000);
    vertex(0, 0, 0x00ffffff);
    vertex(51, 0, 0xffffffff);
    vertex(51, 40, 0xffffffff);
    vertex(0, 40, 0x00ffffff);
    indices({0, 1, 2, 0, 2, 3});
    draw();
    for (int x = 0; x < 51; ++x)
        EXPECT_NEAR(static_cast<int>(at(x, 20) & 255), 5 * x + 2.5, 1) << x;
}

TEST_F(CanvasTest, SurvivesWhatIsFarAwayOrNowhere) {
    constexpr float kInfinite = std::numeric_limits<float>::infinity();
    for (float far : {1e5f, 1e12f, 3e38f, kInfinite, std::nanf("")}) {
        vertex(-far, -far, kHalfRed);
        vertex(far, -far, kHalfRed);
        vertex(0, far, kHalfRed);
        indices({0, 1, 2});
        draw();
    }
    rectangle({-1e30f, -1e30f}, {1e30f, 1e30f}, 0xff0000ff, kCovered, kCovered);
    draw();
    EXPECT_EQ(at(0, 0), 0xff0000ff);
    EXPECT_EQ(at(kWidth - 1, kHeight - 1), 0xff0000ff);
}

}  // namespace
}  // namespace doppel
