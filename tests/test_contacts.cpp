// Contacts of feet: as files have them, and stays.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "engine/error.h"
#include "tests/files.h"
#include "trainer/motion/retarget/contacts.h"

namespace doppel {
namespace {

using namespace test;

TEST(Contacts, AStayThatWandersIsTold) {
    std::vector<FootContacts> contacts(40, FootContacts{1, 0, 0, 0});
    contacts[10][0] = 0;
    std::vector<std::array<glm::dvec3, 4>> places(40);
    for (size_t f = 0; f < 40; ++f) places[f][0] = {.005 * double(f), .1 * double(f), 0};
    const auto found = stays(contacts, places);
    ASSERT_EQ(found.size(), 2u);
    EXPECT_EQ(found[0].last, 9u);
    EXPECT_EQ(found[1].first, 11u);
    EXPECT_FALSE(found[0].wanders);
    EXPECT_TRUE(found[1].wanders);
}

void write(const std::filesystem::path& path, const std::string& text) {
    std::ofstream(path) << text;
}

TEST(Contacts, ReadsContactsAndRefusesOthers) {
    Folder folder;
    const auto json = folder / "c.json", npz = folder / "c.npz";
    write(json, R"({"left_heel": [1, 0], "left_toe": [true, false], "right_heel": [0, 0],
                    "right_toe": [0, 1], "by": "hand"})");
    const std::vector<FootContacts> given = {{1, 1, 0, 0}, {0, 0, 0, 1}};
    EXPECT_EQ(readContacts(json, 2), given);
    Npz arrays;
    addContacts(arrays, given);
    writeNpz(npz, arrays, true);
    EXPECT_EQ(readContacts(npz, 2), given);

    const auto refusal = [&](const std::filesystem::path& path, size_t frames = 2) {
        std::string message = messageOf<InputError>([&] { readContacts(path, frames); });
        EXPECT_EQ(message.find(path.string()), 0u) << message;
        return message.substr(std::min(message.size(), path.string().size()));
    };
    EXPECT_EQ(refusal(json, 3),
              ": left_heel: expected 3 flags, one for each of the motion's frames, found 2");
    EXPECT_EQ(refusal(npz, 1),
              ": left_heel: expected 1 flags, one for each of the motion's frames, found 2");
    write(json, R"({"left_heel": [1, 0], "left_toe": [1, 0], "right_heel": [0, 2],
                    "right_toe": [0, 1]})");
    EXPECT_EQ(refusal(json), ": right_heel: expected 0 or 1, found 2 in frame 1");
    write(json, R"({"left_heel": [1, "yes"]})");
    EXPECT_EQ(refusal(json), ": left_heel: expected 0 or 1, found a string in frame 1");
    write(json, R"({"left_heel": [1, 0], "left_toe": 3})");
    EXPECT_EQ(refusal(json), ": left_toe: expected a list of 0 and 1, found number");
    write(json, R"({"left_heel": [1, 0]})");
    EXPECT_EQ(refusal(json), ": left_toe: expected a list of 0 and 1, found none");
    for (const char* text : {"", "[1, 2]", "{\"left_heel\": [1,", "\x80\x81"}) {
        write(json, text);
        EXPECT_NE(refusal(json).find("expected a JSON object"), std::string::npos) << text;
    }
    write(json, std::string(100000, '['));
    EXPECT_FALSE(refusal(json).empty());
    arrays.set("right_toe", Array::f32({2}, std::array{0.f, NAN}));
    writeNpz(npz, arrays, false);
    EXPECT_EQ(refusal(npz), ": right_toe: expected 0 or 1, found nan in frame 1");
    arrays.set("right_toe", Array::f32({1, 2}, std::array{0.f, 1.f}));
    writeNpz(npz, arrays, false);
    EXPECT_NE(refusal(npz).find("right_toe"), std::string::npos);
    arrays.remove("right_toe");
    writeNpz(npz, arrays, false);
    EXPECT_NE(refusal(npz).find("right_toe"), std::string::npos);
    write(folder / "c.txt", "1");
    EXPECT_EQ(refusal(folder / "c.txt"),
              ": expected contacts as .json or .npz, found another name");
    EXPECT_FALSE(messageOf<InputError>([&] { readContacts(folder / "none.json", 2); }).empty());
}

}  // namespace
}  // namespace doppel
