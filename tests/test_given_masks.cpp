// Masks that another program made of a clip's pictures, and which frames they leave out.
#include "trainer/import/masks/given_masks.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar.h"
#include "trainer/import/import.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::messageOf;

// A white square that moves to the right by its number.
Image square(int width, int height, int number) {
    Image mask(width, height, 1);
    for (int y = height / 4; y < height / 2; ++y)
        for (int x = 0; x < width / 4; ++x) *mask.pixel(x + 4 * number, y) = 255;
    return mask;
}

Image inColours(const Image& mask) {
    Image picture(mask.width, mask.height, 3);
    for (size_t i = 0; i < mask.data.size(); ++i)
        std::fill_n(&picture.data[3 * i], 3, mask.data[i]);
    return picture;
}

TEST(GivenMasks, FoldersAndVideosInOrder) {
    Folder folder;
    fs::create_directory(folder / "masks");
    VideoWriter video(folder / "masks.mp4", 96, 64, 10);
    for (int i = 0; i < 12; ++i) {
        writeImage(folder / "masks" / fmt::format("m{}.png", i), square(48, 32, i));
        video.add(inColours(square(96, 64, i)));
    }
    video.finish();
    GivenMasks files(folder / "masks", 12), film(folder / "masks.mp4", 12);
    for (int i = 0; i < 12; ++i) {
        if (i == 3 || i == 4) {
            files.skip();
            film.skip();
            continue;
        }
        // Of half the size; m10 comes behind m9.
        const std::vector<uint8_t> half = square(48, 32, i).data;
        EXPECT_EQ(files.next(48, 32), half) << i;
        // Of twice the size, and compressed.
        const std::vector<uint8_t> found = film.next(96, 64), wanted = square(96, 64, i).data;
        size_t off = 0;
        for (size_t k = 0; k < wanted.size(); ++k) {
            ASSERT_TRUE(found[k] == 0 || found[k] == 255);
            off += found[k] != wanted[k];
        }
        EXPECT_LT(off, wanted.size() / 100) << i;
    }
    EXPECT_EQ(messageOf<InputError>([&] { film.next(96, 64); }),
              (folder / "masks.mp4").string() +
                  ": expected 12 masks, one for each picture of the clip, found 12");
    GivenMasks few(folder / "masks.mp4", 11);
    for (int i = 0; i < 11; ++i) few.skip();
    EXPECT_EQ(messageOf<InputError>([&] { few.finish(); }),
              (folder / "masks.mp4").string() +
                  ": expected 11 masks, one for each picture of the clip, found more");
    EXPECT_EQ(messageOf<InputError>([&] { GivenMasks(folder / "masks", 13); }),
              (folder / "masks").string() +
                  ": expected 13 masks, one for each picture of the clip, found 12");
    EXPECT_NE(messageOf<InputError>([&] {
                  GivenMasks(folder / "masks", 12).next(48, 48);
              }).find("expected a mask of 48×48 pixels or in proportion"),
              std::string::npos);
    GivenMasks larger(folder / "masks", 12);
    EXPECT_EQ(larger.next(96, 64).size(), size_t{96 * 64});
}

// A matte's soft rim is cut at the half, and its background's noise is nobody; labels are small
// numbers; of a cut-out it is alpha that tells.
TEST(GivenMasks, AreCutAtTheHalf) {
    Folder folder;
    fs::create_directory(folder / "masks");
    Image matte(4, 1, 1), labels(4, 1, 1), cut(4, 1, 4, 255);
    matte.data = {3, 100, 200, 255};
    labels.data = {0, 1, 20, 2};
    for (size_t i = 0; i < 4; ++i) cut.data[4 * i + 3] = matte.data[i];
    writeImage(folder / "masks/a.png", matte);
    writeImage(folder / "masks/b.png", labels);
    writeImage(folder / "masks/c.png", cut);
    GivenMasks masks(folder / "masks", 3);
    EXPECT_EQ(masks.next(4, 1), (std::vector<uint8_t>{0, 0, 255, 255}));
    EXPECT_EQ(masks.next(4, 1), (std::vector<uint8_t>{0, 255, 255, 255}));
    EXPECT_EQ(masks.next(4, 1), (std::vector<uint8_t>{0, 0, 255, 255}));
    masks.finish();
}

// A drawn figure that moves, in images/ beside masks/; one picture shows nobody, and one mask is
// somewhere else.
TEST(GivenMasks, AreTakenAndWhatTheyContradictIsLeftOut) {
    const fs::path models = test::sourceFolder() / "build/models";
    if (!poseModelsAreThere(PoseNet::Lite, models))
        GTEST_SKIP() << "scripts/setup --models fetches the networks";
    Folder folder;
    const fs::path data = test::sourceFolder() / "tests/data/blazepose";
    const Image scene = readImage(data / "scene_512.png"),
                outline = readMask(data / "scene_mask_tflite_c0.png");
    for (const char* kind : {"images", "masks"}) fs::create_directories(folder / "clip" / kind);
    for (int i = 0; i < 6; ++i) {
        Image picture(640, 512, 3, 128), mask(640, 512, 1);
        for (int y = 0; y < 512; ++y) {
            if (i != 1) std::copy_n(scene.pixel(0, y), scene.rowBytes(), picture.pixel(20 * i, y));
            if (i != 4)
                std::copy_n(outline.pixel(0, y), outline.rowBytes(), mask.pixel(20 * i, y));
            else if (y < 90)
                std::fill_n(mask.pixel(500, y), 140, uint8_t{255});
        }
        const std::string name = fmt::format("{:02}.png", i);
        writeImage(folder / "clip/images" / name, picture);
        writeImage(folder / "clip/masks" / name, mask);
    }
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    ImportSettings settings;
    settings.request.source = folder / "clip";
    settings.request.net = PoseNet::Lite;
    settings.request.device = &testDevice();
    settings.request.body = &body;
    settings.request.fps = 10;
    settings.request.clip.keepSimilar = true;  // the empty one is flat
    settings.out = folder / "capture";
    settings.overlays = false;
    const auto noBody = [](const Camera& camera, const Theta&, const Trans&, const Betas&) {
        return BodyPicture{std::vector<uint8_t>(size_t(camera.width) * size_t(camera.height)), {}};
    };
    importCapture(settings, noBody);
    const Capture capture = readCapture(settings.out);
    ASSERT_EQ(capture.size(), 4u);
    EXPECT_EQ(capture.frames[1].name, "000002");
    EXPECT_EQ(capture.frames[3].name, "000005");
    // What was left out does not make the motion faster: four frames in half a second.
    EXPECT_NEAR(capture.fps, 6, 1e-3);
    EXPECT_EQ(capture.source.at("masks"), "given, masks");
    EXPECT_EQ(capture.source.at("left_out"), "1 without the person, 1 with a doubtful mask");
    for (const Frame& frame : capture.frames) {
        const std::string name = frame.name.substr(4) + ".png";
        EXPECT_EQ(readMask(*frame.mask).data, readMask(folder / "clip/masks" / name).data);
    }
    EXPECT_FALSE(fs::exists(settings.out / "images/000004.png"));
    EXPECT_FALSE(fs::exists(settings.out / "masks/000004.png"));
    ASSERT_TRUE(capture.keypoints);
    EXPECT_EQ(capture.keypoints->values.size(), 4u * 75);
    const auto quality = nlohmann::json::parse(test::bytesOf(settings.out / "quality.json"));
    ASSERT_EQ(quality["left_out"].size(), 2u);
    EXPECT_EQ(quality["left_out"][0]["why"], "without the person");
    EXPECT_EQ(quality["left_out"][1]["frame"], 4);
    EXPECT_EQ(quality["left_out"][1]["picture"], "04.png");
    EXPECT_EQ(quality["per_frame"]["000002"]["picture"], "02.png");
    EXPECT_EQ(quality["per_frame"].size(), 4u);

    // Of a folder of pictures alone, by the flag; not beside what makes masks.
    settings.request.source = folder / "clip/images";
    settings.request.masks = folder / "clip/masks";
    settings.out = folder / "other";
    const std::string both =
        "--masks: expected neither --plate nor --matting nor --cut-out, which make masks";
    settings.request.plate = folder / "clip/images/01.png";
    EXPECT_EQ(messageOf<InputError>([&] { importCapture(settings, noBody); }), both);
    settings.request.plate.clear();
    settings.request.cutOutBy = CutOutBy::Edges;
    EXPECT_EQ(messageOf<InputError>([&] { importCapture(settings, noBody); }), both);
    settings.request.plate = folder / "clip/images/01.png";
    EXPECT_EQ(messageOf<InputError>([&] { importCapture(settings, noBody); }),
              "--plate: expected --cut-out all, for it is a picture of what is behind");
    settings.request.plate.clear();
    settings.request.cutOutBy = CutOutBy::All;
    // Not the pictures for the masks.
    settings.request.masks = folder / "clip/images";
    EXPECT_NE(messageOf<InputError>([&] {
                  importCapture(settings, noBody);
              }).find("images: expected masks of the person in the clip's pictures"),
              std::string::npos);
    settings.request.masks = folder / "clip/none";
    EXPECT_NE(messageOf<InputError>([&] {
                  importCapture(settings, noBody);
              }).find("--masks: expected a folder of masks or a video, found nothing at"),
              std::string::npos);
    EXPECT_FALSE(fs::exists(settings.out));
    settings.request.masks = folder / "clip/masks";
    importCapture(settings, noBody);
    EXPECT_EQ(readCapture(settings.out).size(), 4u);
}

}  // namespace
}  // namespace doppel
