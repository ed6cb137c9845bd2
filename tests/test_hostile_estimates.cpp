// Files of other estimators' poses that would fill the stack, the memory or the time, and what is
// said of damaged ones that are opened as motions.
#include <gtest/gtest.h>

#include <sys/stat.h>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "tests/estimate_scene.h"
#include "trainer/motion/estimates/estimate.h"
#include "trainer/motion/motion.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using namespace test;

void expectRefusal(const std::string& sentence, const std::function<void()>& call) {
    const std::string found = messageOf<InputError>(call);
    EXPECT_NE(found.find(sentence), std::string::npos) << found;
    EXPECT_LT(found.size(), 1000u);
}

// Opening a pipe without a writer would wait for one.
TEST(HostileEstimates, PipesAreRefused) {
    Folder folder;
    for (const char* name : {"pipe", "pipe.pkl", "pipe.npz"}) {
        ASSERT_EQ(mkfifo((folder / name).c_str(), 0600), 0);
        expectRefusal("is not a regular file", [&] { readEstimates(folder / name); });
        expectRefusal("is not a regular file", [&] { readMotion(folder / name); });
    }
}

std::string easyMocapPerson(const std::string& rh) {
    std::string poses = "0";
    for (size_t k = 1; k < 72; ++k) poses += ", 0";
    return "{\"id\": 0, \"Rh\": " + rh + ", \"Th\": [[0, 0, 3]], \"poses\": [[" + poses + "]]}";
}

TEST(HostileEstimates, DeeplyNestedJson) {
    Folder folder;
    const std::string deep = std::string(200'000, '[') + std::string(200'000, ']');
    for (const std::string& text :
         {"{\"annots\": " + deep + "}", "[" + easyMocapPerson(deep) + "]", deep}) {
        folder.write("000000.json", text);
        expectRefusal("000000.json: expected JSON nested at most 64 deep",
                      [&] { readEstimates(folder.path()); });
        expectRefusal("000000.json: expected JSON nested at most 64 deep",
                      [&] { readMotion(folder.path()); });
    }
}

TEST(HostileEstimates, MatricesWithoutEnd) {
    Folder folder;
    folder.write("000000.json", "[" + easyMocapPerson("[[0, 0, 0]]") + "]");
    folder.write("extri.yml", std::string());
    const auto matrix = [](const std::string& name) {
        return name + ": !!opencv-matrix\n   data: [ 1. ]\n";
    };
    const auto expect = [&](const std::string& text, bool refused) {
        folder.write("intri.yml", text);
        if (refused)
            expectRefusal(
                "intri.yml: expected at most 8192 matrices with names of at most 64 characters",
                [&] { readEstimates(folder.path()); });
        else
            EXPECT_EQ(readEstimates(folder.path()).people.size(), 1u);
    };
    // The name may begin the file, or a line.
    for (const char* before : {"", "%YAML:1.0\n"}) {
        expect(before + matrix(std::string(64, 'n')), false);
        expect(before + matrix(std::string(65, 'n')), true);
    }
    std::string many;
    for (int i = 0; i < 8192; ++i) many += matrix(fmt::format("m{}", i));
    expect(many, false);
    expect(many + matrix("one"), true);
}

// Looking each picture up among all others would take minutes.
TEST(HostileEstimates, ManyPictures) {
    Folder folder;
    const auto smpl =
        py::dict({{py::text("global_orient"), py::array({1, 3}, {0, 0, 0})},
                  {py::text("body_pose"), py::array({23, 3}, std::vector<double>(69))}});
    std::vector<std::pair<py::Value, py::Value>> frames;
    for (int64_t f = 0; f < 60'000; ++f) {
        const bool seen = f == 59'998;
        frames.push_back(
            {py::text(fmt::format("outputs/_DEMO/clip/img/{:06}.jpg", f)),
             py::dict(
                 {{py::text("time"), py::integer(f)},
                  {py::text("tid"),
                   py::list(seen ? std::vector{py::integer(1)} : std::vector<py::Value>{})},
                  {py::text("smpl"), py::list(seen ? std::vector{smpl} : std::vector<py::Value>{})},
                  {py::text("camera"), py::list(seen ? std::vector{py::array({3}, {0, 0, 9})}
                                                     : std::vector<py::Value>{})}})});
    }
    write(folder, "demo_clip.pkl", py::dict(frames));
    const Estimates found = readEstimates(folder / "demo_clip.pkl");
    ASSERT_EQ(found.people.size(), 1u);
    ASSERT_EQ(found.people[0].poses.size(), 1u);
    EXPECT_EQ(found.people[0].poses[0].picture, 59'998);
    EXPECT_EQ(found.people[0].poses[0].name, "059998");
}

py::Value rompPicture(bool metres) {
    std::vector<std::pair<py::Value, py::Value>> fields{
        {py::text("cam"), py::array({1, 3}, {1, 0, 0})},
        {py::text("smpl_thetas"), py::array({1, 72}, std::vector<double>(72))}};
    if (metres) fields.push_back({py::text("cam_trans"), py::array({1, 3}, {0, 0, 4})});
    return py::dict(fields);
}

// A way to read the file is listed where all of it can be read so.
TEST(HostileEstimates, RompWithoutMetres) {
    Folder folder;
    for (const bool second : {true, false}) {
        py::savezObject(folder / "video_results.npz", "results",
                        py::dict({{py::text("0.jpg"), rompPicture(true)},
                                  {py::text("1.jpg"), rompPicture(second)},
                                  {py::text("2.jpg"), py::dict({})}}));
        const Estimates found = readEstimates(folder / "video_results.npz");
        EXPECT_EQ(found.readings.size(), second ? 4u : 2u);
        ASSERT_EQ(found.people.at(0).poses.size(), 2u);
        for (const EstimatedPose& pose : found.people[0].poses) {
            EXPECT_EQ(pose.views.size(), found.readings.size());
            for (const EstimatedView& view : pose.views)
                EXPECT_NE(view.kind, EstimatedView::Kind::Nowhere);
        }
    }
}

// What is wrong with a file of another program is said, and not what a capture's would lack.
TEST(HostileEstimates, MotionsSayWhatIsWrong) {
    Folder folder;
    py::savezObject(folder / "video_results.npz", "results",
                    "cos\nsystem\n(" + py::text("true") + "tR");
    expectRefusal("refers to code (os.system)", [&] { readMotion(folder / "video_results.npz"); });
    fs::create_directories(folder / "mocap");
    folder.write("mocap/000000.json", std::string("[{\"Rh\":"));
    expectRefusal("000000.json: expected JSON, found other text",
                  [&] { readMotion(folder / "mocap"); });
    // Without any of that a folder and an archive are meant to be ours.
    fs::create_directories(folder / "empty");
    expectRefusal("poses.npz: cannot read it", [&] { readMotion(folder / "empty"); });
    Npz npz;
    npz.set("other", Array::scalarF64(1));
    writeNpz(folder / "none.npz", npz, false);
    expectRefusal("none.npz: expected an array 'global_orient'",
                  [&] { readMotion(folder / "none.npz"); });
    folder.write("text.npz", std::string("no archive"));
    expectRefusal("text.npz: ", [&] { readMotion(folder / "text.npz"); });
}

}  // namespace
}  // namespace doppel
