// Captures found in folders, figures grouped as the paper's tables group them, and the files that
// hold them.
#include "trainer/eval/results.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "engine/error.h"
#include "engine/io/image.h"
#include "tests/files.h"
#include "trainer/data/capture_writer.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

// The least that is a capture.
void makeCapture(const fs::path& folder, const std::string& actor = "",
                 const std::string& motion = "") {
    CaptureWriter writer(folder);
    writer.addImage("a", 4, 3, std::vector<uint8_t>(36, 100));
    Capture capture;
    capture.name = "c";
    capture.actor = actor;
    capture.motion = motion;
    capture.frames = {{"a", {}, {}, {10, 10, 2, 1.5, 4, 3}}};
    capture.theta.resize(1);
    capture.trans = {{0, 0, 3}};
    writer.commit(capture);
}

std::vector<std::string> namesOf(const std::vector<CollectionEntry>& entries) {
    std::vector<std::string> names;
    for (const CollectionEntry& e : entries) names.push_back(e.actor + "/" + e.motion);
    return names;
}

TEST(Results, SayWhoseFramesTheyAreOf) {
    Capture capture;
    capture.name = "dance";
    capture.frames.resize(4);
    using Provenance = std::map<std::string, std::string>;
    EXPECT_EQ(whoseFrames({}, capture, 0), "");
    EXPECT_EQ(whoseFrames({{"capture", "dance"}}, capture, 0), "");
    EXPECT_NE(whoseFrames({}, capture, 3).find("was trained on 3 of these 4 frames"),
              std::string::npos);
    EXPECT_NE(whoseFrames({{"capture", "walk"}}, capture, 0)
                  .find("learnt from \"walk\", and this is \"dance\": if it shows somebody else"),
              std::string::npos);
    const Provenance ann{{"capture", "walk"}, {"actor", "ann"}};
    capture.actor = "ann";
    EXPECT_EQ(whoseFrames(ann, capture, 0), "");
    capture.actor = "bob";
    EXPECT_EQ(whoseFrames(ann, capture, 0),
              "the avatar is of ann, the capture of bob: the figures compare two people");
}

TEST(Results, FindsCaptures) {
    Folder folder;
    const fs::path all = folder / "all";
    fs::create_directories(all / "S2");
    fs::create_directories(all / "S10");
    makeCapture(all / "S2" / "walk");
    makeCapture(all / "S2" / "box");
    makeCapture(all / "S10" / "take one", "Ann", "fusion dance");
    makeCapture(all / "jump");
    fs::create_directories(all / ".cache");
    EXPECT_EQ(namesOf(findCaptures(all)),
              (std::vector<std::string>{"S2/box", "S2/walk", "Ann/fusion dance", "all/jump"}));
    EXPECT_EQ(namesOf(findCaptures(all / "S2" / "walk")), (std::vector<std::string>{"S2/walk"}));
    EXPECT_EQ(namesOf(findCaptures(all / "S2" / "walk/")), (std::vector<std::string>{"S2/walk"}));
    // Actor and motion survive a subset and another writing.
    Capture capture = readCapture(all / "S10" / "take one");
    capture = capture.subset(std::vector<size_t>{0});
    EXPECT_EQ(capture.actor, "Ann");
    EXPECT_EQ(writeCapture(capture, folder / "copy").motion, "fusion dance");

    fs::create_directories(folder / "empty");
    EXPECT_NE(messageOf<InputError>([&] {
                  findCaptures(folder / "empty");
              }).find("expected a capture, or captures as"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] { findCaptures(folder / "gone"); }).find("found nothing"),
              std::string::npos);
    folder.write("toml", std::string("actor = 3\n"));
    fs::copy_file(folder / "toml", all / "jump" / "capture.toml",
                  fs::copy_options::overwrite_existing);
    EXPECT_NE(messageOf<InputError>([&] { findCaptures(all); }).find("actor: expected a text"),
              std::string::npos);

    fs::create_directories(folder / "avatars" / "S2");
    folder.write("avatars/S2/avatar.toml", std::string());
    EXPECT_EQ(avatarOf(folder / "avatars", "S2"), folder / "avatars" / "S2");
    EXPECT_EQ(avatarOf(folder / "avatars" / "S2", "S9"), folder / "avatars" / "S2");
    EXPECT_NE(messageOf<InputError>([&] { avatarOf(folder / "avatars", "S9"); }).find("S9"),
              std::string::npos);
}

// The numbers in the paper's own source, where it is at hand.
TEST(Results, PaperFigures) {
    EXPECT_EQ(paperMotion("Shake_Hands")->mse, 254.38);
    EXPECT_EQ(paperActor("S3")->ssim, .852);
    EXPECT_FALSE(paperMotion("swim"));
    EXPECT_EQ(paperAblation("no-clamp")->fvd, 829.60);
    std::ifstream file(test::sourceFolder() / "../shared/paper.tex");
    if (!file) GTEST_SKIP() << "the paper's source is not here";
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    // Numbers of a row: everything but digits and points is a separator; commas are thousands'.
    auto numbers = [](std::string row) {
        std::erase(row, ',');
        for (char& c : row)
            if (!std::isdigit(static_cast<unsigned char>(c)) && c != '.') c = ' ';
        std::istringstream words(row);
        std::vector<double> values;
        for (double value; words >> value;) values.push_back(value);
        return values;
    };
    const std::vector<std::string> motions{"jump", "walk",         "spinning",  "shake hands",
                                           "cone", "fusion dance", "pull down", "box"},
        actors{"S1", "S2", "S3", "S4"};
    size_t at = 0;
    for (double PaperFigures::*figure :
         {&PaperFigures::ssim, &PaperFigures::lpips, &PaperFigures::mse, &PaperFigures::fvd}) {
        at = text.find("& Ours &", at);
        ASSERT_NE(at, std::string::npos);
        const size_t end = text.find("\\\\", at);
        const std::vector<double> row = numbers(text.substr(at + 8, end - at - 8));
        ASSERT_EQ(row.size(), 12u);
        for (size_t i = 0; i < 8; ++i)
            EXPECT_EQ((*paperMotion(motions[i])).*figure, row[i]) << motions[i];
        for (size_t i = 0; i < 4; ++i)
            EXPECT_EQ((*paperActor(actors[i])).*figure, row[8 + i]) << actors[i];
        at = end;
    }
    for (const auto& [label, name] : {std::pair{"Texture Refinement Removal", "no-refine"},
                                      {"Vertex Refinement Clamping &", "no-clamp"},
                                      {"} Complete Model", "complete"}}) {
        size_t begin = text.find(label);
        ASSERT_NE(begin, std::string::npos) << label;
        begin = text.find('&', begin);
        const std::vector<double> row =
            numbers(text.substr(begin, text.find("\\\\", begin) - begin));
        const PaperFigures paper = *paperAblation(name);
        EXPECT_EQ(row, (std::vector<double>{paper.ssim, paper.lpips, paper.mse, paper.fvd}));
    }
}

EvaluatedCapture evaluated(const std::string& actor, const std::string& motion, size_t frames,
                           double ssim, double mse, std::optional<double> lpips, double clip) {
    EvaluatedCapture capture;
    capture.entry = {"", actor, motion};
    for (size_t i = 0; i < frames; ++i) {
        FrameMetrics m{.name = "f"};
        m.ssimFrame = ssim, m.mseFrame = mse, m.iou = .5, m.psnrFrame = 20, m.lpips = lpips;
        capture.evaluation.frames.push_back(m);
    }
    capture.evaluation.change = ssim;
    capture.evaluation.changeHeldStill = mse;
    capture.evaluation.realClips = {{0, 0}, {2, 0}};
    capture.evaluation.renderedClips = {{clip, 0}, {clip + 2, 0}};
    return capture;
}

std::vector<ResultRow> sampleRows() {
    return groupResults({evaluated("S1", "walk", 1, .8, 100, .1, 0),
                         evaluated("S1", "shake_hands", 10, .6, 300, .3, 4),
                         evaluated("Eve|A", "walk", 3, .9, 200, .2, 1)});
}

TEST(Results, GroupsAsThePaperDoes) {
    const std::vector<ResultRow> rows = sampleRows();
    std::vector<std::string> names;
    for (const ResultRow& row : rows) names.push_back(row.kind + " " + row.name);
    EXPECT_EQ(names, (std::vector<std::string>{"motion walk", "motion shake_hands", "actor S1",
                                               "actor Eve|A", "average average", "capture S1/walk",
                                               "capture S1/shake_hands", "capture Eve|A/walk"}));
    // Captures weigh alike, however long they are.
    EXPECT_NEAR(rows[0].figures.ssim, .85, 1e-12);
    EXPECT_NEAR(rows[0].figures.mse, 150, 1e-12);
    EXPECT_NEAR(*rows[2].figures.lpips, .2, 1e-12);
    EXPECT_NEAR(rows[4].figures.ssim, (.8 + .6 + .9) / 3, 1e-12);
    EXPECT_EQ(rows[4].figures.captures, 3u);
    EXPECT_EQ(rows[4].figures.frames, 14u);
    EXPECT_EQ(rows[4].figures.changeHeldStill, 300);
    // FVD is of all clips of a group together: real variances 4/3, means 1 and 1.5, rendered ones
    // (0,2,1,3) of variance 5/3.
    EXPECT_NEAR(*rows[0].figures.fvd, .25 + 4. / 3 + 5. / 3 - 2 * std::sqrt(4. / 3 * 5 / 3), 1e-9);
    EXPECT_NEAR(*rows[6].figures.fvd, 16, 1e-9);
    EXPECT_EQ(rows[1].paper->mse, 254.38);
    EXPECT_EQ(rows[2].paper->ssim, .876);
    EXPECT_FALSE(rows[3].paper);
    EXPECT_EQ(rows[4].paper->fvd, 769.54);

    // One capture without LPIPS: no average; one clip: no FVD.
    EvaluatedCapture without = evaluated("S1", "walk", 2, .5, 1, std::nullopt, 0);
    without.evaluation.realClips.resize(1);
    const std::vector<ResultRow> few = groupResults({without});
    EXPECT_FALSE(few[0].figures.lpips);
    EXPECT_FALSE(few[0].figures.fvd);
}

TEST(Results, Tables) {
    const std::vector<ResultRow> rows = sampleRows();
    const std::string text = resultsMarkdown(rows, {"FVD was left out"});
    EXPECT_NE(text.find("| motion | captures | frames | SSIM | paper | LPIPS | paper | MSE | paper "
                        "| FVD | paper | PSNR | IoU |\n|---|"),
              std::string::npos)
        << text;
    EXPECT_NE(text.find("| shake_hands | 1 | 10 | 0.600 | 0.865 | 0.300 | 0.130 | 300.00 | 254.38 "
                        "| 16.00 | 542.24 | 20.00 | 0.500 |\n"),
              std::string::npos)
        << text;
    EXPECT_NE(text.find("| Eve\\|A | 1 | 3 | 0.900 | – | 0.200 | – |"), std::string::npos) << text;
    EXPECT_NE(text.find("\n- FVD was left out\n"), std::string::npos) << text;

    Folder folder;
    writeResults(folder / "out", "results", rows, {{"frames", "all"}}, {"a remark"});
    std::ifstream csv(folder / "out/results.csv");
    std::string line;
    size_t lines = 0, commas = 0;
    while (std::getline(csv, line)) {
        const auto here = size_t(std::count(line.begin(), line.end(), ','));
        if (lines++ == 0) commas = here;
        EXPECT_EQ(here, commas) << line;
    }
    EXPECT_EQ(lines, rows.size() + 1);
    std::ifstream json(folder / "out/results.json");
    const auto parsed = nlohmann::json::parse(json);
    EXPECT_EQ(parsed["rows"].size(), rows.size());
    EXPECT_EQ(parsed["rows"][1]["paper"]["fvd"], 542.24);
    EXPECT_EQ(parsed["settings"]["frames"], "all");
    EXPECT_EQ(parsed["remarks"][0], "a remark");
    EXPECT_TRUE(fs::exists(folder / "out/results.md"));
}

}  // namespace
}  // namespace doppel
