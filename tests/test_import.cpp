#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "engine/io/image.h"
#include "tests/files.h"
#include "trainer/eval/metrics.h"
#include "trainer/import/import.h"
#include "trainer/import/masks/chroma_key.h"
#include "trainer/import/overlay.h"
#include "trainer/person/masks/mask_tools.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

// ---- pickles, as Python would write them --------------------------------------------------------

class PickleWriter {
public:
    PickleWriter() { bytes_ = {0x80, 2, '}', '('}; }
    PickleWriter& set(const std::string& key, const std::vector<double>& values) {
        text(key);
        bytes_.insert(bytes_.end(), {']', '('});
        for (double value : values) number(value);
        bytes_.push_back('e');
        return *this;
    }
    PickleWriter& set(const std::string& key, const std::vector<std::array<double, 3>>& rows) {
        text(key);
        bytes_.insert(bytes_.end(), {']', '('});
        for (const auto& row : rows) {
            bytes_.insert(bytes_.end(), {']', '('});
            for (double value : row) number(value);
            bytes_.push_back('e');
        }
        bytes_.push_back('e');
        return *this;
    }
    PickleWriter& set(const std::string& key, double value) {
        text(key);
        number(value);
        return *this;
    }
    // os.system("…"), as a hostile file would have it.
    PickleWriter& call(const std::string& key) {
        text(key);
        bytes_.insert(bytes_.end(), {'c', 'o', 's', '\n', 's', 'y', 's', 't', 'e', 'm', '\n', '('});
        text("true");
        bytes_.insert(bytes_.end(), {'t', 'R'});
        return *this;
    }
    std::vector<uint8_t> done() const {
        auto bytes = bytes_;
        bytes.insert(bytes.end(), {'u', '.'});
        return bytes;
    }

private:
    void text(const std::string& value) {
        bytes_.push_back('X');
        const auto size = uint32_t(value.size());
        for (int i = 0; i < 4; ++i) bytes_.push_back(uint8_t(size >> (8 * i)));
        bytes_.insert(bytes_.end(), value.begin(), value.end());
    }
    void number(double value) {
        uint64_t bits = 0;
        std::memcpy(&bits, &value, 8);
        bytes_.push_back('G');
        for (int i = 7; i >= 0; --i) bytes_.push_back(uint8_t(bits >> (8 * i)));
    }
    std::vector<uint8_t> bytes_;
};

PickleWriter pose(double x, size_t keypoints = 25) {
    std::vector<double> theta(72, 0.), betas(10, .5);
    theta[0] = 3;
    theta[5] = x;
    PickleWriter pickle;
    pickle.set("pose", theta).set("betas", betas).set("trans", std::vector<double>{x, .1, 3});
    pickle.set("f", 80).set("model_type", 2).set("t", std::vector<double>{0, 0, 0});
    pickle.set("openpose", std::vector<std::array<double, 3>>(keypoints, {x, 2, .5}));
    return pickle;
}

// ---- a person before a screen -------------------------------------------------------------------

constexpr int kWidth = 160, kHeight = 120;

// The person is a box 30×70 that a body a little smaller hints at, and its colours are not the
// screen's, nor those of the other object.
struct Scene {
    int left = 40;      // of the person
    bool box = true;    // another object, far right
    bool held = false;  // the other object touches the person's hand
    unsigned seed = 1;

    bool person(int x, int y) const {
        return (x >= left && x < left + 30 && y >= 30 && y < 100) ||
               (held && x >= left + 30 && x < left + 40 && y >= 50 && y < 56);
    }
    int boxLeft() const { return held ? left + 40 : 125; }
    bool object(int x, int y) const {
        return box && x >= boxLeft() && x < boxLeft() + 25 && y >= 40 && y < 75;
    }
    Picture draw() const {
        Picture picture{kWidth, kHeight, {}, {}};
        std::mt19937 random(seed);
        std::normal_distribution<double> noise(0, 3);
        for (int y = 0; y < kHeight; ++y) {
            for (int x = 0; x < kWidth; ++x) {
                // Green, darker downwards, with a shadow beside the person.
                const bool shadow = x >= left + 30 && x < left + 50 && y > 80;
                const double light = (1 - .4 * y / kHeight) * (shadow ? .6 : 1);
                std::array<double, 3> rgb{120 * light, 190 * light, 60 * light};
                if (object(x, y)) rgb = {150, 110, 70};
                if (person(x, y)) {
                    rgb = y < 60 ? std::array<double, 3>{20, 20, 22}
                                 : std::array<double, 3>{60, 80, 150};
                }
                for (double value : rgb) {
                    picture.rgb.push_back(
                        uint8_t(std::lround(std::clamp(value + noise(random), 0., 255.))));
                }
            }
        }
        return picture;
    }
    std::vector<uint8_t> truth() const {
        std::vector<uint8_t> mask;
        for (int y = 0; y < kHeight; ++y) {
            for (int x = 0; x < kWidth; ++x) mask.push_back(person(x, y) ? 255 : 0);
        }
        return mask;
    }
};

BodyPicture boxBody(const Camera& camera, double left) {
    BodyPicture body;
    for (int y = 0; y < camera.height; ++y) {
        for (int x = 0; x < camera.width; ++x) {
            body.mask.push_back(x >= left + 4 && x < left + 27 && y >= 34 && y < 95 ? 255 : 0);
        }
    }
    return body;
}

// A dataset of frames x1, x2, x10 in which the person stands at 30, 40, 50.
void writeDataset(const fs::path& folder, bool masks) {
    fs::create_directories(folder / "smpl_pose");
    fs::create_directories(folder / "images");
    if (masks) fs::create_directories(folder / "segmentations");
    int i = 0;
    for (const char* name : {"x1", "x2", "x10"}) {
        const Scene scene{.left = 30 + 10 * i, .box = true, .held = false, .seed = unsigned(i)};
        Image image(kWidth, kHeight, 3);
        image.data = scene.draw().rgb;
        writeImage(folder / "images" / (std::string(name) + ".png"), image);
        if (masks) {
            Image mask(kWidth, kHeight, 1);
            mask.data = scene.truth();
            for (uint8_t& value : mask.data) value = value > 0 ? 1 : 0;  // labels, not 255
            writeImage(folder / "segmentations" / (std::string(name) + ".png"), mask);
        }
        // Both of the dataset's ways to call them.
        const std::string file = i == 1 ? fmt::format("{}_IUV.png_body.pkl", name)
                                        : fmt::format("{}.jpg_body.pkl", name);
        const auto bytes = pose(30 + 10 * i).done();
        std::ofstream(folder / "smpl_pose" / file, std::ios::binary)
            .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
        ++i;
    }
}

ImportResult import(const fs::path& from, const fs::path& to, bool key = false,
                    const std::string& frames = "") {
    ImportSettings settings;
    settings.request.source = from;
    settings.out = to;
    settings.request.key = key;
    settings.request.fps = 24;
    settings.request.frames = frames;
    return importCapture(settings, [](const Camera& camera, const Theta&, const Trans& trans,
                                      const Betas&) { return boxBody(camera, double(trans[0])); });
}

// A layout that this file adds.
const Importer kOneFile{{
    .name = "one-file",
    .looks = "recording.txt (a test's)",
    .recognises = [](const fs::path& source) { return fs::exists(source / "recording.txt"); },
    .read =
        [](const ImportRequest& request) {
            Capture capture = readCapture(request.source / "inside");
            capture.fps = request.fps;
            return capture;
        },
}};

TEST(Import, RetargetingWithMasks) {
    Folder folder;
    writeDataset(folder / "src", true);
    const ImportResult result = import(folder / "src", folder / "out");
    EXPECT_EQ(result.layout, "human-retargeting");
    EXPECT_EQ(result.givenMasks, 3u);
    EXPECT_EQ(result.keyedMasks, 0u);
    EXPECT_NEAR(result.meanIou, 23. * 61 / (30 * 70), 1e-6);

    const Capture capture = readCapture(folder / "out");
    ASSERT_EQ(capture.size(), 3u);
    EXPECT_EQ(capture.frames[2].name, "x10");
    EXPECT_EQ(capture.frames[0].camera, (Camera{80, 80, 80, 60, kWidth, kHeight}));
    EXPECT_EQ(capture.name, "src");
    EXPECT_EQ(capture.fps, 24);
    EXPECT_EQ(capture.theta[1][5], 40);
    EXPECT_EQ(capture.trans[2], (Trans{50, .1f, 3}));
    EXPECT_EQ(capture.betas, Betas{});  // the source's mean nothing for our body
    ASSERT_TRUE(capture.sourceBetas);
    EXPECT_EQ((*capture.sourceBetas)[3], .5f);
    ASSERT_TRUE(capture.keypoints);
    EXPECT_EQ(capture.keypoints->scheme, "openpose25");
    EXPECT_EQ(capture.keypoints->values[3 * 25], 40);
    EXPECT_EQ(capture.source.at("model"), "female");
    EXPECT_EQ(capture.source.at("masks"), "given");
    EXPECT_TRUE(fs::exists(folder / "out/overlay.jpg"));
    EXPECT_TRUE(fs::exists(folder / "out/overlays/x10.jpg"));
    FrameCache cache(capture);
    const Scene first{.left = 30};
    EXPECT_EQ(cache.load(0)->mask, first.truth());

    // A part of it, and a capture of our own as the source.
    EXPECT_EQ(import(folder / "src", folder / "part", false, "1:").capture.frames[0].name, "x2");
    const ImportResult again = import(folder / "out", folder / "again", false, "-1");
    EXPECT_EQ(again.layout, "capture");
    EXPECT_EQ(again.capture.fps, 24);
    EXPECT_EQ(again.capture.trans[0], capture.trans[2]);
    EXPECT_EQ(FrameCache(again.capture).load(0)->mask, cache.load(2)->mask);
}

TEST(Import, KeysMasksThatAreMissing) {
    Folder folder;
    writeDataset(folder / "src", false);
    const ImportResult plain = import(folder / "src", folder / "plain");
    EXPECT_FALSE(plain.capture.hasMasks());
    EXPECT_EQ(plain.capture.source.at("masks"), "none");

    const ImportResult keyed = import(folder / "src", folder / "keyed", true);
    EXPECT_EQ(keyed.keyedMasks, 3u);
    EXPECT_EQ(keyed.capture.source.at("masks"), "keyed");
    FrameCache cache(keyed.capture);
    for (int i = 0; i < 3; ++i) {
        const Scene scene{.left = 30 + 10 * i};
        EXPECT_GT(intersectionOverUnion(cache.load(size_t(i))->mask, scene.truth()), .99);
    }

    // A capture that was without says so no longer, and one that was keyed goes on saying it.
    const ImportResult later = import(folder / "plain", folder / "later", true);
    EXPECT_EQ(later.capture.source.at("masks"), "keyed");
    const ImportResult again = import(folder / "later", folder / "again");
    EXPECT_EQ(again.givenMasks, 3u);
    EXPECT_EQ(again.capture.source.at("masks"), "keyed");

    writeDataset(folder / "src", true);
    fs::remove(folder / "src/segmentations/x2.png");
    const ImportResult both = import(folder / "src", folder / "both", true);
    EXPECT_EQ(both.givenMasks, 2u);
    EXPECT_EQ(both.keyedMasks, 1u);
}

TEST(Import, SaysWhatIsWrongAndLeavesNothing) {
    Folder folder;
    const fs::path src = folder / "src";
    const auto expect = [&](const std::string& sentence, const auto& spoil, bool key = false) {
        fs::remove_all(src);
        writeDataset(src, !key);
        spoil();
        const auto before = folder.names();
        const std::string found = messageOf<InputError>([&] { import(src, folder / "out", key); });
        EXPECT_NE(found.find(sentence), std::string::npos) << found;
        EXPECT_EQ(found.find('\n'), std::string::npos) << found;
        EXPECT_EQ(folder.names(), before) << sentence;
    };
    const auto write = [&](const char* name, const std::vector<uint8_t>& bytes) {
        folder.write(std::string("src/smpl_pose/") + name, bytes);
    };
    expect("src: expected a video or a folder to import, found nothing",
           [&] { fs::remove_all(src); });
    expect("src: expected a known layout: a video, or images/ and smpl_pose/",
           [&] { fs::remove_all(src / "smpl_pose"); });
    expect("found images, segmentations", [&] { fs::remove_all(src / "smpl_pose"); });
    expect("src/images: expected one picture (.jpg, .png) or more, found none", [&] {
        fs::remove_all(src / "images");
        fs::create_directories(src / "images");
    });
    expect("src/smpl_pose: expected the pose of x2.png (x2.png_body.pkl), found none",
           [&] { fs::remove(src / "smpl_pose/x2_IUV.png_body.pkl"); });
    expect("src/segmentations: expected a mask for every picture, found none for x10.png; --key",
           [&] { fs::remove(src / "segmentations/x10.png"); });
    expect("src/segmentations/x2.png: expected 160×120 pixels, the size of its frame, found 80×120",
           [&] { writeImage(src / "segmentations/x2.png", Image(80, 120, 1)); });
    // A hostile pickle is told by its name for code, and nothing of it runs.
    expect("x1.jpg_body.pkl",
           [&] { write("x1.jpg_body.pkl", PickleWriter().call("pose").done()); });
    expect("os.system", [&] { write("x1.jpg_body.pkl", PickleWriter().call("pose").done()); });
    expect("x10.jpg_body.pkl", [&] {
        auto bytes = pose(1).done();
        bytes.resize(bytes.size() / 2);
        write("x10.jpg_body.pkl", bytes);
    });
    expect("x1.jpg_body.pkl: pose: expected finite numbers, found nan in element 5", [&] {
        write("x1.jpg_body.pkl", pose(std::numeric_limits<double>::quiet_NaN()).done());
    });
    expect("x1.jpg_body.pkl: f: expected a focal length in pixels, found -2",
           [&] { write("x1.jpg_body.pkl", pose(1).set("f", -2).done()); });
    expect("x1.jpg_body.pkl: pose", [&] {
        write("x1.jpg_body.pkl", pose(1).set("pose", std::vector<double>(71, 0.)).done());
    });
    expect("x1.jpg_body.pkl: t: expected zeros, the body being in camera space, found 0.5", [&] {
        write("x1.jpg_body.pkl", pose(1).set("t", std::vector<double>{0, .5, 0}).done());
    });
    expect("img_shape: expected 120×160, the size of x1.png, found 90×160", [&] {
        write("x1.jpg_body.pkl", pose(1).set("img_shape", std::vector<double>{90, 160, 3}).done());
    });
    expect("x2_IUV.png_body.pkl: openpose: expected 25 keypoints as in the first frame, found 19",
           [&] { write("x2_IUV.png_body.pkl", pose(40, 19).done()); });
    expect("src/images/x2.png", [&] {
        fs::resize_file(src / "images/x2.png", fs::file_size(src / "images/x2.png") - 200);
    });
    expect(
        "src/images: expected pictures before a green (or other saturated) screen",
        [&] {
            for (const char* name : {"x1", "x2", "x10"}) {
                writeImage(src / "images" / (std::string(name) + ".png"),
                           Image(kWidth, kHeight, 3, 128));
            }
        },
        true);
    expect(
        "images/x10.png: expected the person where its pose draws the body, found only the "
        "screen",
        [&] { write("x10.jpg_body.pkl", pose(84, 25).done()); }, true);
    // The place to write.
    fs::remove_all(src);
    writeDataset(src, true);
    folder.write("notes.txt", "x");
    EXPECT_NE(messageOf<InputError>([&] {
                  import(src, folder.path());
              }).find("expected an empty folder or one that Doppel wrote as capture"),
              std::string::npos);
}

TEST(ChromaKey, TellsPersonFromScreenShadowAndObject) {
    // In some pictures the object stands far away, in others it is in the person's hand.
    std::vector<Scene> scenes;
    for (int i = 0; i < 4; ++i) {
        scenes.push_back(
            {.left = 20 + 8 * i, .box = true, .held = i % 2 == 1, .seed = unsigned(i)});
    }
    std::vector<std::shared_ptr<const Picture>> pictures;
    std::vector<std::vector<uint8_t>> bodies;
    const Camera camera{100, 100, 80, 60, kWidth, kHeight};
    for (const Scene& scene : scenes) {
        pictures.push_back(std::make_shared<const Picture>(scene.draw()));
        bodies.push_back(boxBody(camera, scene.left).mask);
    }
    const PersonKey key(pictures, bodies, "test");
    EXPECT_NEAR(key.screen().colour()[1], 165, 25);
    for (size_t i = 0; i < scenes.size(); ++i) {
        const auto truth = scenes[i].truth();
        const auto mask = key.mask(*pictures[i], bodies[i]);
        EXPECT_GT(intersectionOverUnion(mask, truth), scenes[i].held ? .96 : .99) << i;
        // What is the object's is not the person's.
        size_t wrong = 0;
        for (int y = 0; y < kHeight; ++y) {
            for (int x = 0; x < kWidth; ++x) {
                wrong += scenes[i].object(x, y) && mask[size_t(y * kWidth + x)] > 0;
            }
        }
        EXPECT_LT(wrong, 40u) << i;
    }
    // Nobody where the body is not before anything.
    EXPECT_EQ(key.mask(*pictures[0], std::vector<uint8_t>(kWidth * kHeight, 0)),
              std::vector<uint8_t>(kWidth * kHeight, 0));
}

TEST(ChromaKey, Distances) {
    std::mt19937 random(5);
    for (const auto& [w, h] : {std::pair{1, 1}, {13, 7}, {7, 13}, {31, 24}}) {
        std::vector<uint8_t> mask(size_t(w * h), 0);
        for (int i = 0; i < w * h / 9 + 1; ++i) mask[random() % mask.size()] = 1;
        const auto distance = distanceTo(mask, w, h);
        for (int y = 0; y < h; ++y) {
            for (int x = 0; x < w; ++x) {
                double nearest = 1e9;
                for (int v = 0; v < h; ++v) {
                    for (int u = 0; u < w; ++u) {
                        if (mask[size_t(v * w + u)] == 0) continue;
                        nearest = std::min(nearest, std::hypot(u - x, v - y));
                    }
                }
                EXPECT_NEAR(distance[size_t(y * w + x)], nearest, 1e-4);
            }
        }
    }
    EXPECT_EQ(distanceTo(std::vector<uint8_t>(12, 0), 4, 3)[5], 1e9f);
}

TEST(ChromaKey, Parts) {
    const std::vector<uint8_t> mask{1, 1, 0, 1,  //
                                    0, 1, 0, 1,  //
                                    1, 0, 0, 1};
    const Parts inside = connectedParts(mask, true, 4, 3);
    EXPECT_EQ(inside.sizes, (std::vector<size_t>{3, 3, 1}));
    EXPECT_EQ(inside.part[3], 1);
    EXPECT_EQ(inside.part[2], -1);
    EXPECT_EQ(connectedParts(mask, false, 4, 3).sizes, (std::vector<size_t>{4, 1}));
}

TEST(Overlay, ShowsBodyAndOutlines) {
    Picture frame{20, 10, std::vector<uint8_t>(600, 100), std::vector<uint8_t>(200, 0)};
    BodyPicture body{std::vector<uint8_t>(200, 0), {}};
    for (int y = 2; y < 8; ++y) {
        for (int x = 3; x < 12; ++x) body.mask[size_t(20 * y + x)] = 255;
    }
    for (int y = 4; y < 9; ++y) frame.mask[size_t(20 * y + 15)] = 255;
    const Image image = overlayPicture(frame, body);
    EXPECT_EQ(image.pixel(0, 0)[0], 100);
    EXPECT_EQ(image.pixel(3, 4)[2], 255);                   // the body's outline, white
    EXPECT_GT(image.pixel(6, 5)[0], image.pixel(6, 5)[2]);  // orange
    EXPECT_EQ(image.pixel(15, 6)[1], 255);
    EXPECT_LT(image.pixel(15, 6)[0], 60);  // green
    const Image small = overlayPicture(frame, body, 10);
    EXPECT_EQ(small.width, 10);
    EXPECT_EQ(small.height, 5);
    const std::vector<Image> three(3, small);
    const Image sheet = tiles(three, 2);
    EXPECT_EQ(sheet.width, 20);
    EXPECT_EQ(sheet.height, 10);
}

TEST(Import, AnImporterIsOneDeclaration) {
    Folder folder;
    writeDataset(folder / "src", true);
    import(folder / "src", folder / "own/inside");
    folder.write("own/recording.txt", std::string("x"));
    const ImportResult result = import(folder / "own", folder / "out");
    EXPECT_EQ(result.layout, "one-file");
    EXPECT_EQ(result.capture.fps, 24);
    EXPECT_EQ(result.capture.size(), 3u);
    // The error for what nobody knows lists what is known.
    fs::create_directories(folder / "empty");
    EXPECT_NE(
        messageOf<InputError>([&] { import(folder / "empty", folder / "out2"); })
            .find("empty: expected a known layout: a video, or images/ and smpl_pose/ (Human "
                  "Retargeting), or images/, cameras.npz and poses.npz (a capture), or pictures (a "
                  "clip's frames), also in images/ beside masks/, or recording.txt (a test's); "
                  "found an empty folder"),
        std::string::npos);
}

// ---- the dataset itself, where it is ------------------------------------------------------------

fs::path dataset() { return test::sourceFolder() / ".." / "shared" / "data" / "retargeting"; }

TEST(ImportData, EightViews) {
    if (!fs::exists(dataset() / "8-views")) GTEST_SKIP() << "no dataset in ../shared/data";
    Folder folder;
    ImportSettings settings;
    settings.request.source = dataset() / "8-views";
    settings.out = folder / "out";
    settings.request.frames = "0,3";
    const auto nobody = [](const Camera& camera, const Theta&, const Trans&, const Betas&) {
        return BodyPicture{std::vector<uint8_t>(size_t(camera.width * camera.height), 0), {}};
    };
    const ImportResult result = importCapture(settings, nobody);
    const Capture& capture = result.capture;
    ASSERT_EQ(capture.size(), 2u);
    EXPECT_EQ(capture.frames[0].camera, (Camera{1150, 1150, 500, 540, 1000, 1080}));
    EXPECT_EQ(capture.frames[1].name, "GOPR95340000000081");
    EXPECT_NEAR(capture.theta[0][0], M_PI, .5);
    EXPECT_NEAR(capture.trans[0][2], 2.8386, 1e-3);
    EXPECT_EQ(capture.keypoints->scheme, "lsp19");
    const auto picture = FrameCache(capture).load(0);
    const auto area =
        std::count_if(picture->mask.begin(), picture->mask.end(), [](uint8_t v) { return v > 0; });
    EXPECT_NEAR(double(area), 73600, 1500);
}

TEST(ImportData, Box) {
    if (!fs::exists(dataset() / "box")) GTEST_SKIP() << "no dataset in ../shared/data";
    // The dataset's own renders stand in for the body: the white around them is not.
    Folder folder;
    ImportSettings settings;
    settings.request.source = dataset() / "box";
    settings.out = folder / "out";
    settings.request.key = true;
    settings.request.frames = "0::40";
    std::vector<fs::path> renders;
    for (const char* name : {"000", "040", "080"}) {
        renders.push_back(dataset() / fmt::format("box/smpl_render/GOPR95420000000{}.jpg", name));
    }
    std::map<float, BodyPicture> bodies;  // by the position that tells the frames apart
    const auto draw = [&](const Camera&, const Theta&, const Trans& trans, const Betas&) {
        const auto at = bodies.find(trans[0]);
        if (at != bodies.end()) return at->second;
        const Image render = readImage(renders.at(bodies.size()), 3);
        BodyPicture body;
        for (size_t p = 0; p < render.data.size(); p += 3) {
            body.mask.push_back(render.data[p + 2] < 240 ? 255 : 0);
        }
        return bodies[trans[0]] = body;
    };
    const ImportResult result = importCapture(settings, draw);
    EXPECT_EQ(result.keyedMasks, 3u);
    EXPECT_EQ(result.capture.keypoints->scheme, "openpose25");
    EXPECT_GT(result.meanIou, .7);
    FrameCache cache(result.capture);
    for (size_t f = 0; f < 3; ++f) {
        // Neither the chair nor the box on the floor.
        const auto picture = cache.load(f);
        size_t right = 0;
        for (int y = 0; y < 1080; ++y) {
            for (int x = 600; x < 1000; ++x) right += picture->mask[size_t(y * 1000 + x)] > 0;
        }
        EXPECT_EQ(right, 0u) << f;
        const auto area = std::count_if(picture->mask.begin(), picture->mask.end(),
                                        [](uint8_t v) { return v > 0; });
        EXPECT_NEAR(double(area), 89000, 9000) << f;
    }
}

}  // namespace
}  // namespace doppel
