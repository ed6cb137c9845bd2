// A preset's numbers: each is declared once, and everything follows from the declaration.
#include "trainer/avatar/preset.h"

#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <set>
#include <sstream>

#include "tests/op_test.h"

namespace doppel {
namespace {

CHOICES(Colour, Red, DarkBlue)

#define SAMPLE_NUMBERS(NUMBER, FLAG, CHOICE)          \
    NUMBER(int, batch, 8, 1, 256, "frames of a step") \
    NUMBER(double, lr, 1e-3, 0, 10, "learning rate")  \
    FLAG(dilate, true, "grows the mask")              \
    CHOICE(Colour, colour, DarkBlue, "what it is painted with")
struct Sample {
    NUMBERS(SAMPLE_NUMBERS)
};

TEST(Numbers, AListGivesMembersAndTheirDescription) {
    Sample sample;
    EXPECT_EQ(sample.batch, 8);
    EXPECT_EQ(sample.lr, 1e-3);
    EXPECT_TRUE(sample.dilate);
    EXPECT_EQ(sample.colour, Colour::DarkBlue);
    std::vector<std::string> lines;
    Sample::each(sample, [&](const NumberInfo& info, auto&) {
        lines.push_back(fmt::format("{} {} {} {} {}", info.name, info.lowest, info.highest,
                                    info.words.size(), info.help));
    });
    EXPECT_EQ(lines, (std::vector<std::string>{
                         "batch 1 256 0 frames of a step", "lr 0 10 0 learning rate",
                         "dilate 0 1 0 grows the mask", "colour 0 0 2 what it is painted with"}));
    EXPECT_EQ(wordsOf(Colour{}), (std::vector<std::string>{"red", "darkblue"}));
}

TEST(Presets, SayWhatIsWrongWithANumber) {
    Preset preset = presetByName("ci");
    auto refuse = [&](const char* name, const char* value, const std::string& expected) {
        auto before = presetValues(preset);
        expectInputError([&] { setPresetValue(preset, name, value, "test"); }, expected);
        EXPECT_EQ(presetValues(preset), before);
    };
    refuse("mesh.nothing", "1", "test: there is no number \"mesh.nothing\"; there are mesh.size, ");
    refuse("nothing", "1", "there are fit.size, ");
    refuse("mesh.batch", "0",
           "test: mesh.batch: expected a whole number from 1 to 256, found \"0\"");
    refuse("mesh.batch", "257", "from 1 to 256");
    refuse("mesh.batch", "2.5", "expected a whole number");
    refuse("mesh.lr", "-1", "expected a number from 0 to 10");
    refuse("mesh.lr", "nan", "expected a number from 0 to 10");
    refuse("mesh.dilateMask", "1", "expected true or false, found \"1\"");
    // Every choice takes its own words and no other's.
    refuse("mesh.clamps", "union",
           "mesh.clamps: expected paper or program or none, found \"union\"");
    refuse("texture.region", "paper", "expected union or intersection");
    refuse("refine.region", "Union", "expected union or intersection");
    refuse("refine.loss", "union", "expected log or squares");
    refuse("refine.masks", "", "expected region or own");
    refuse("refine.apart", "union", "expected different or rendered");
    refuse("refine.residual", "intersection", "expected clamped or program");
}

TEST(Presets, EveryNumberIsSetByItsName) {
    Preset preset = presetByName("paper");
    auto set = [&](const char* name, const char* value) {
        setPresetValue(preset, name, value, "test");
    };
    set("fit.passes", "7");
    set("mesh.lr", "0.25");
    set("mesh.clamps", "program");
    set("texture.region", "intersection");
    set("texture.constantInput", "true");
    set("refine.masks", "own");
    EXPECT_EQ(preset.fit.passes, 7);
    EXPECT_EQ(preset.mesh.lr, 0.25);
    EXPECT_EQ(preset.mesh.clamps, ClampBounds::Program);
    EXPECT_EQ(preset.texture.region, Region::Intersection);
    EXPECT_TRUE(preset.texture.constantInput);
    EXPECT_EQ(preset.refine.masks, GanMasks::Own);
    std::set<std::string> names;
    for (const auto& [name, value] : presetValues(preset)) EXPECT_TRUE(names.insert(name).second);
    EXPECT_EQ(names.size(), 186u);
    EXPECT_EQ(presetSections(), (std::vector<std::string>{"fit", "caps", "shape", "texels", "mesh",
                                                          "texture", "refine"}));
}

TEST(Presets, HelpListsEveryNumberWithItsValuesRangeAndMeaning) {
    std::string help = presetHelp();
    for (const auto& [name, value] : presetValues(presetByName("paper"))) {
        size_t at = help.find("\n" + name + " ");
        ASSERT_NE(at, std::string::npos) << name;
        std::string line = help.substr(at + 1, help.find('\n', at + 1) - at - 1);
        EXPECT_NE(line.find(" " + value + " "), std::string::npos) << line;
        EXPECT_NE(line.back(), ' ') << line;  // there is a meaning
    }
    auto lineOf = [&](const std::string& name) {
        std::vector<std::string> words;
        std::istringstream line(help.substr(help.find("\n" + name + " ") + 1));
        for (std::string word; words.size() < 8 && line >> word;) words.push_back(word);
        return fmt::format("{}", fmt::join(words, " "));
    };
    EXPECT_EQ(lineOf("mesh.batch"), "mesh.batch 1 1 1 4 1 to 256");
    EXPECT_EQ(lineOf("mesh.lr"), "mesh.lr 0.0005 0.0005 0.0005 0.0001 0 to 10");
    EXPECT_EQ(lineOf("texture.region"),
              "texture.region intersection intersection intersection union union or "
              "intersection");
    EXPECT_EQ(lineOf("mesh.steps"), "mesh.steps 150 300 1000 0 0 or more");
}

}  // namespace
}  // namespace doppel
