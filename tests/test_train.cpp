// The whole job in small: a capture of the synthetic actor, fit, mesh, texture, an avatar on disk.
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/stages/train.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <array>
#include <fstream>
#include <set>

#include "engine/io/image.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/commands/train.h"
#include "trainer/data/body_render.h"
#include "trainer/data/frame_selection.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/texture_size.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::tinyCapture;
using test::tinyPreset;

Avatar tinyAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.preset = tinyPreset();
    return avatar;
}

TrainResult trainTiny(const Capture& capture, const fs::path& out,
                      Precision precision = Precision::Single) {
    TrainSettings settings;
    settings.out = out;
    settings.pictureSeconds = 0;
    return trainAvatar(testDevice(precision), tinyAvatar(), capture, settings);
}

TEST(Train, LearnsAndRepeatsItselfToTheByte) {
    test::Folder folder;
    Capture capture = tinyCapture(folder.path() / "capture");
    ASSERT_EQ(capture.size(), 6u);
    TrainResult first = trainTiny(capture, folder.path() / "a");
    ASSERT_TRUE(first.fit);
    EXPECT_GT(first.fit->iouAfter, first.fit->iouBefore + 0.04);

    // The mesh network moves vertices, and not away from the masks.
    double fitted = test::meanIou(testDevice(), first.avatar, first.capture, false);
    double refined = test::meanIou(testDevice(), first.avatar, first.capture, true);
    EXPECT_NEAR(fitted, first.fit->iouAfter, 1e-9);
    EXPECT_NE(refined, fitted);
    EXPECT_GT(refined, fitted - 0.003);
    // The texture beats a grey one.
    FrameMetrics metrics = meanMetrics(evaluateAvatar(testDevice(), first.avatar, first.capture));
    Avatar grey = first.avatar;
    std::fill(grey.texture.begin(), grey.texture.end(), 0.5f);
    EXPECT_GT(metrics.psnrBody,
              meanMetrics(evaluateAvatar(testDevice(), grey, first.capture)).psnrBody + 1);

    // On disk and back.
    Avatar read = readAvatar(folder.path() / "a");
    EXPECT_EQ(read.betas, first.avatar.betas);
    EXPECT_EQ(read.preset.mesh.hidden, 16);
    EXPECT_EQ(test::meanIou(testDevice(), read, first.capture, true), refined);
    EXPECT_FALSE(fs::exists(folder.path() / "a" / "checkpoints" / "mesh.safetensors"));

    // The same seed twice.
    trainTiny(capture, folder.path() / "b");
    for (const char* name : {"mesh_net.safetensors", "texture_net.safetensors", "texture.png"}) {
        std::string a = bytesOf(folder.path() / "a" / name);
        EXPECT_FALSE(a.empty()) << name;
        EXPECT_EQ(a, bytesOf(folder.path() / "b" / name)) << name;
    }

    // Products of half-precision numbers change what networks learn, and not how well.
    const TrainResult mixed = trainTiny(capture, folder.path() / "mixed", Precision::Mixed);
    EXPECT_NE(mixed.avatar.texture, first.avatar.texture);
    EXPECT_NEAR(meanMetrics(evaluateAvatar(testDevice(), mixed.avatar, mixed.capture)).psnrBody,
                metrics.psnrBody, .5);
}

// How many faces of a surface are turned away from where the model's point.
int turnedFaces(const BodyModel& body, const std::vector<float>& model,
                const std::vector<float>& surface) {
    auto normal = [&](const std::vector<float>& x, size_t face) {
        auto at = [&](size_t corner, size_t c) {
            return double{x[3 * size_t(body.faces[3 * face + corner]) + c]};
        };
        std::array<double, 3> n{};
        for (size_t a = 0; a < 3; ++a) {
            const size_t b = (a + 1) % 3, c = (a + 2) % 3;
            n[a] = (at(1, b) - at(0, b)) * (at(2, c) - at(0, c)) -
                   (at(1, c) - at(0, c)) * (at(2, b) - at(0, b));
        }
        return n;
    };
    int turned = 0;
    for (size_t f = 0; f < size_t(body.faceCount); ++f) {
        const auto a = normal(model, f), b = normal(surface, f);
        turned += a[0] * b[0] + a[1] * b[1] + a[2] * b[2] < 0;
    }
    return turned;
}

// At rest and in each pose of training, beside the model without offsets.
std::vector<int> turnedFaces(const TrainResult& result) {
    const BodyModel& body = result.avatar.body;
    BodyModel plain = body;
    plain.offsets.clear();
    BodyPoser model(testDevice(), plain), surface(testDevice(), body);
    std::vector<int> turned{turnedFaces(body, plain.templateVertices, body.restVertices())};
    const Capture& capture = result.capture;
    for (size_t i = 0; i < capture.size(); ++i)
        turned.push_back(
            turnedFaces(body, model.pose(capture.theta[i], capture.trans[i], capture.betas).verts,
                        surface.pose(capture.theta[i], capture.trans[i], capture.betas).verts));
    return turned;
}

// Where nothing else smooths the offsets, the cost of folds keeps faces on their side.
TEST(Train, FacesKeepTheirSide) {
    test::Folder folder;
    Capture capture = tinyCapture(folder.path() / "capture");
    Avatar avatar = tinyAvatar();
    avatar.preset.shape.steps = 0;
    avatar.preset.texels.steps = 30;
    avatar.preset.texels.smooth = 0;
    avatar.preset.texels.lambda = .1f;
    TrainSettings settings;
    settings.pictureSeconds = 0;
    settings.stages = {"texels"};
    auto turnedWith = [&](float folds) {
        avatar.preset.texels.folds = folds;
        settings.out = folder.path() / fmt::format("folds-{}", folds);
        return turnedFaces(trainAvatar(testDevice(), avatar, capture, settings));
    };
    const std::vector<int> free = turnedWith(0), held = turnedWith(10);
    ASSERT_EQ(free.size(), 1 + capture.size());
    for (size_t i = 0; i < free.size(); ++i) {
        EXPECT_GT(free[i], 100) << i;
        EXPECT_LT(10 * held[i], free[i]) << i;
    }
}

// A surface of its own: the outline and the colours of frames that it learned from.
TEST(Train, LearnsASurfaceBeyondTheModel) {
    test::Folder folder;
    Capture capture = tinyCapture(folder.path() / "capture");
    Avatar avatar = tinyAvatar();
    avatar.preset.shape.steps = avatar.preset.texels.steps = 60;
    TrainSettings settings;
    settings.out = folder.path() / "a";
    settings.pictureSeconds = 0;
    settings.stages = {"fit", "shape", "texels"};
    const TrainResult result = trainAvatar(testDevice(), avatar, capture, settings);

    const FrameMetrics mean =
        meanMetrics(evaluateAvatar(testDevice(), result.avatar, result.capture));
    EXPECT_GT(mean.iou, result.fit->iouAfter + .02);
    auto figure = [&](std::string_view name) {
        return std::ranges::find(mean.figures, name, &std::pair<std::string, double>::first)
            ->second;
    };
    EXPECT_LT(std::abs(figure("outline_bias")), .15);
    EXPECT_GT(figure("psnr_interior"), 24);

    // Few faces are turned against the model's, and no vertex flies off.
    const BodyModel& body = result.avatar.body;
    EXPECT_LT(turnedFaces(body, body.templateVertices, body.restVertices()), body.faceCount / 100);
    for (float x : body.offsets) EXPECT_LT(std::abs(x), .2f);

    // On disk and back, and its joints go where its surface goes.
    const Avatar read = readAvatar(folder.path() / "a");
    EXPECT_EQ(read.body.offsets, body.offsets);
    EXPECT_EQ(read.texels, result.avatar.texels);
    EXPECT_EQ(read.texture, read.texels);
    const BodyModel plain = bodyFromNpz(readBodyArrays("default"));
    EXPECT_NE(restJoints(read.body, std::vector<double>(10)),
              restJoints(plain, std::vector<double>(10)));
}

TEST(Train, FacesAreTaughtByWhoIsBeforeThem) {
    test::Folder folder;
    const Capture capture = tinyCapture(folder.path() / "capture");
    int runs = 0;
    const auto trained = [&](double facingFace, double facingFew = 0, size_t frames = 6,
                             double middle = 0) {
        Avatar avatar = tinyAvatar();
        avatar.preset.texels.steps = 2;
        avatar.preset.texels.lrLight = avatar.preset.texels.lrGain = 0;
        avatar.preset.texels.facing = 0;
        avatar.preset.texels.facingFace = facingFace;
        avatar.preset.texels.facingFew = facingFew;
        avatar.preset.texels.facingMiddle = middle;
        TrainSettings settings;
        settings.out = folder.path() / fmt::format("{}", runs++);
        settings.pictureSeconds = 0;
        settings.stages = {"texels"};
        return trainAvatar(testDevice(), std::move(avatar), capture.subset(evenly(6, frames)),
                           settings)
            .avatar;
    };
    const Avatar alike = trained(0), faced = trained(4);
    EXPECT_EQ(trained(4).texels, faced.texels);
    const std::vector<TexelPlace> places = texelPlaces(alike.body, alike.textureSize);
    // The part of the texels that are others in these two: elsewhere, on the face.
    const auto changed = [&](const Avatar& a, const Avatar& b) {
        std::array<double, 2> others{}, all{};
        for (size_t i = 0; i < places.size(); ++i) {
            if (places[i].face < 0) continue;
            const size_t corner = 3 * static_cast<size_t>(places[i].face);
            const size_t face = alike.body.face[static_cast<size_t>(alike.body.faces[corner])];
            ++all[face];
            others[face] += !std::equal(&a.texels[3 * i], &a.texels[3 * i] + 3, &b.texels[3 * i]);
        }
        return std::array{others[0] / all[0], others[1] / all[1]};
    };
    EXPECT_GT(changed(alike, faced)[1], .1);
    EXPECT_LT(changed(alike, faced)[0], .05);  // at its border
    // Its middle by where all of it looks.
    const Avatar middle = trained(4, 0, 6, .6);
    EXPECT_GT(changed(faced, middle)[1], .1);
    EXPECT_LT(changed(faced, middle)[0], .05);
    // Of few frames all of her, but not of two.
    EXPECT_GT(changed(faced, trained(4, 4))[0], .1);
    EXPECT_EQ(trained(4, 4, 2).texels, trained(4, 0, 2).texels);
}

// One picture from the front: her back is told by the cast, and it is another avatar than without.
TEST(Train, KnownPeopleTellWhatOnePictureDoesNotShow) {
    test::Folder folder;
    SyntheticOptions options;
    options.size = 192;
    options.samples = 2;
    const Capture capture =
        renderActor(testDevice(), readActor(assetFolder() / "actor", "long-hair"),
                    actorSession(1, 0, kActorDistance), folder.path() / "capture", options);
    Avatar avatar = tinyAvatar();
    avatar.preset.shape.steps = 120;
    avatar.preset.texture.textureSize = 128;
    // A head that leans as pictures alone have it, from which less of the hair is seen.
    avatar.preset.fit.likely = avatar.preset.fit.limits = avatar.preset.fit.balance = 0;
    avatar.preset.fit.priorBeta = 1e-5;
    TrainSettings settings;
    settings.out = folder.path() / "alone";
    settings.pictureSeconds = 0;
    settings.stages = {"fit", "shape", "texels"};
    const Avatar alone = trainAvatar(testDevice(), avatar, capture, settings).avatar;
    // One picture teaches texels by how frontal it sees them, whatever the preset says.
    avatar.preset.texels.facing = 0;
    settings.out = folder.path() / "again";
    EXPECT_EQ(trainAvatar(testDevice(), avatar, capture, settings).avatar.texels, alone.texels);
    avatar.preset = alone.preset;

    settings.out = folder.path() / "told";
    settings.known = readPeople({"cast"}, avatar.body, "--prior");
    const Avatar told = trainAvatar(testDevice(), avatar, capture, settings).avatar;

    // Her hair is dark and her skin is light.
    auto lightOf = [](const Avatar& of, bool back) {
        const auto colours = vertexColours(of.body, of.texture, of.textureSize);
        double sum = 0, count = 0;
        for (size_t v = 0; v < colours.size(); ++v) {
            const float* x = &of.body.templateVertices[3 * v];
            const bool head = of.body.weights[v * joint::kCount + joint::kHead] > .9f;
            if (!head || (back ? x[2] > -.01f || x[1] < .45f : !of.body.face[v])) continue;
            sum += (colours[v].x + colours[v].y + colours[v].z) / 3;
            ++count;
        }
        EXPECT_GT(count, 10);
        return sum / count;
    };
    EXPECT_LT(lightOf(told, true), .8 * lightOf(told, false));
    EXPECT_LT(lightOf(told, true), lightOf(alone, true) - .1);

    // What her picture does not show is filled with what was learned of it, not with how it began.
    std::set<std::array<float, 3>> learned;
    size_t filled = 0, found = 0;
    for (const bool count : {false, true})
        for (size_t i = 0; i < alone.texelsSeen.size(); ++i) {
            const float* rgb = &alone.texels[3 * i];
            const std::array<float, 3> colour{rgb[0], rgb[1], rgb[2]};
            if (!count && alone.texelsSeen[i] == kFromFrames) learned.insert(colour);
            if (!count || alone.texelsSeen[i] != kFromOtherSide) continue;
            ++filled;
            found += learned.contains(colour);
        }
    EXPECT_GT(filled, 50u);
    EXPECT_GT(double(found), .9 * double(filled));

    // A hundred looks at a picture are enough.
    const std::string losses = test::bytesOf(settings.out / "log" / "losses_shape.csv");
    EXPECT_NE(losses.find("\n99,"), losses.npos);
    EXPECT_EQ(losses.find("\n100,"), losses.npos);

    // A finished avatar is not taken for one that others told of.
    EXPECT_TRUE(isTrained(told, avatar, capture, Precision::Single, settings));
    settings.known = {};
    EXPECT_THROW(isTrained(told, avatar, capture, Precision::Single, settings), InputError);
}

// One picture shows how wide a trunk is in its clothes, and not how deep: what clothes add is not
// added to a girth that has them.
TEST(Train, KnownClothesAreNotAddedToGirth) {
    test::Folder folder;
    SyntheticOptions options;
    options.size = 192;
    options.samples = 2;
    const Actor man = readActor(assetFolder() / "actor", "man");
    const Capture capture =
        renderActor(testDevice(), man, actorSession(1, 0, kActorDistance), folder / "c", options);
    Avatar avatar = tinyAvatar();
    avatar.preset.fit = presetByName("small").fit;
    avatar.preset.shape.steps = 60;
    TrainSettings settings;
    settings.out = folder / "avatar";
    settings.pictureSeconds = 0;
    settings.stages = {"fit", "shape"};
    settings.known = readPeople({"cast"}, avatar.body, "--prior");
    const Avatar told = trainAvatar(testDevice(), avatar, capture, settings).avatar;
    // How deep the middle of a trunk is where its joint is, at rest; the mean over two, m.
    auto depthOf = [](const BodyModel& body, const Betas& shape) {
        const std::vector<double> betas(shape.begin(), shape.end());
        const std::vector<double> verts = shapedVertices(body, betas),
                                  joints = restJoints(body, betas);
        double sum = 0;
        for (size_t j : {joint::kSpine1, joint::kSpine3}) {
            double low = 1, high = -1;
            for (int32_t corner : body.faces) {
                const double* x = &verts[3 * size_t(corner)];
                if (std::abs(x[0]) > .05 || std::abs(x[1] - joints[3 * j + 1]) > .02) continue;
                low = std::min(low, x[2]), high = std::max(high, x[2]);
            }
            sum += high - low;
        }
        return sum / 2;
    };
    const double off = depthOf(told.body, told.betas) - depthOf(man.body, Betas{});
    EXPECT_LT(std::abs(off), .02) << off;
}

TEST(Train, TakesFramesOfSeveralSizesAndEmptyOnes) {
    test::Folder folder;
    Capture capture = tinyCapture(folder.path() / "capture");
    const fs::path pictures = folder.path() / "capture";
    for (const char* kind : {"images", "masks"}) {
        const fs::path path = pictures / kind / (capture.frames[1].name + ".png");
        writeImage(path,
                   resize(readImage(path, std::string_view(kind) == "masks" ? 1 : 3), 96, 96));
    }
    writeImage(pictures / "masks" / (capture.frames[2].name + ".png"), Image(128, 128, 1));
    Camera& camera = capture.frames[1].camera;
    camera = {.75 * camera.fx, .75 * camera.fy, .75 * camera.cx, .75 * camera.cy, 96, 96};

    Avatar avatar = tinyAvatar();
    TrainSettings settings;
    settings.out = folder.path() / "a";
    settings.pictureSeconds = 0;
    settings.stages = {"fit", "shape", "texels", "mesh"};
    const TrainResult result = trainAvatar(testDevice(), avatar, capture, settings);
    // The empty frame has moved nobody.
    for (float x : result.avatar.body.offsets) EXPECT_LT(std::abs(x), .1f);
}

TEST(Train, CropsAreNoLargerThanFrames) {
    test::Folder folder;
    const Capture capture = tinyCapture(folder.path() / "capture");  // 128 pixels a side
    auto offsetsWith = [&](int size) {
        Avatar avatar;
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        avatar.preset = tinyPreset();
        avatar.preset.shape.size = size;
        avatar.preset.shape.steps = 3;
        TrainSettings settings;
        settings.out = folder.path() / std::to_string(size);
        settings.pictureSeconds = 0;
        settings.stages = {"shape"};
        return trainAvatar(testDevice(), avatar, capture, settings).avatar.body.offsets;
    };
    const std::vector<float> offsets = offsetsWith(128);
    EXPECT_EQ(offsetsWith(256), offsets);
    EXPECT_NE(offsetsWith(64), offsets);
}

// Crops of half the frames' size blur what they teach; the last ones have the frames' own pixels.
TEST(Train, LastStepsSeeTheFramesOwnPixels) {
    test::Folder folder;
    Capture capture = tinyCapture(folder.path() / "capture");  // 128 pixels a side
    auto interiorWith = [&](double fine) {
        Avatar avatar;
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        avatar.preset = tinyPreset();
        avatar.preset.texture.textureSize = 128;
        avatar.preset.shape.steps = avatar.preset.texels.steps = 60;
        avatar.preset.texels.size = 64;
        avatar.preset.texels.coarse = 0;
        avatar.preset.texels.fine = fine;
        TrainSettings settings;
        settings.out = folder.path() / fmt::format("{}", fine);
        settings.pictureSeconds = 0;
        settings.stages = {"fit", "shape", "texels"};
        const TrainResult result = trainAvatar(testDevice(), avatar, capture, settings);
        const FrameMetrics metrics =
            meanMetrics(evaluateAvatar(testDevice(), result.avatar, result.capture));
        return std::ranges::find(metrics.figures, "psnr_interior",
                                 &std::pair<std::string, double>::first)
            ->second;
    };
    EXPECT_GT(interiorWith(.5), interiorWith(0) + .3);
}

// A person who fills more of a frame, or of a larger one, is worth more texels.
TEST(Train, TexturesAreAsFineAsFrames) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    Capture capture;
    capture.frames.resize(20);
    capture.theta.resize(20);
    capture.trans.assign(20, {0, 0, 3});
    auto sizeWith = [&](double focal, double texel) {
        for (Frame& frame : capture.frames) frame.camera.fx = frame.camera.fy = focal;
        return textureSizeFor(avatar.body, capture, texel);
    };
    EXPECT_EQ(sizeWith(750, 1), 512);    // 250 pixels a metre, as in the demo
    EXPECT_EQ(sizeWith(1500, 1), 1024);  // twice as many
    EXPECT_EQ(sizeWith(1500, 2), 512);
    EXPECT_EQ(sizeWith(9000, 1), 1024);  // as far as it goes
    // Who comes near in one frame of twenty is no reason, who does in five is.
    sizeWith(750, 1);
    capture.trans[7] = {0, 0, .5};
    EXPECT_EQ(textureSizeFor(avatar.body, capture, 1), 512);
    for (size_t i : {1u, 2u, 3u, 4u}) capture.trans[i] = {0, 0, 1};
    EXPECT_EQ(textureSizeFor(avatar.body, capture, 1), 1024);

    TrainSettings settings;
    settings.stages = {"fit", "texels"};
    auto decided = [&](Preset preset) {
        avatar.preset = std::move(preset);
        decideTextureSize(avatar, capture, settings);
        checkPreset(avatar.preset, "test");
        return std::pair(avatar.preset.texture.textureSize, avatar.preset.texture.block);
    };
    auto byFrames = [](const char* name) {
        Preset preset = presetByName(name);
        preset.texture.textureSize = 0;
        return preset;
    };
    EXPECT_EQ(decided(byFrames("small")), std::pair(1024, 2));
    EXPECT_EQ(decided(byFrames("ci")), std::pair(1024, 4));
    EXPECT_EQ(decided(presetByName("paper")), std::pair(512, 1));  // given: so be it
    // Texels that stay decide for the networks that paint over them.
    avatar.textureSize = 2048;
    avatar.texels.resize(3 * 2048 * 2048);
    settings.stages = {"mesh", "texture"};
    EXPECT_EQ(decided(byFrames("small")), std::pair(2048, 4));
}

TEST(Train, RefusesWhatIsNoAvatar) {
    test::Folder folder;
    expectInputError([&] { readAvatar(folder.path()); }, "avatar.toml");
    expectInputError([&] { readBodyArrays("nobody"); }, "--body");
}

}  // namespace
}  // namespace doppel
