// The evaluation protocol on the synthetic actor, shown by herself: an avatar with the actor's own
// body and texture, so that right figures are known.
#include "trainer/eval/evaluate.h"
#include "trainer/stages/back_projection.h"
#include "trainer/stages/surface.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "engine/io/image.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/refusals.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/commands/eval.h"
#include "trainer/data/capture_writer.h"
#include "trainer/eval/clip_truth.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/stage.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

constexpr int kSize = 96;

class Evaluate : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<test::Folder>();
        Actor actor = readActor(assetFolder() / "actor", "woman");
        SyntheticOptions options;
        options.size = kSize;
        options.poseNoiseDegrees = options.transNoiseMetres = 0;
        capture_ = renderActor(testDevice(), actor, actorSession(4, 0, kActorDistance),
                               folder_->path() / "capture", options);
        avatar_.body = actor.body;
        avatar_.texture = actor.texture;
        avatar_.textureSize = actor.textureSize;
        avatar_.preset = presetByName("ci");
    }
    static void TearDownTestSuite() { folder_.reset(); }
    // The avatar as its files have it: a person's own body has no shape directions.
    static Avatar writable() {
        Avatar avatar = avatar_;
        avatar.bodyArrays = readNpz(assetFolder() / "actor/woman.npz");
        const int64_t vertices = avatar.body.vertexCount;
        avatar.bodyArrays.set(
            "shapedirs", Array::f32({vertices, 3, 10}, std::vector<float>(size_t(30 * vertices))));
        return avatar;
    }
    static std::unique_ptr<test::Folder> folder_;
    static Capture capture_;
    static Avatar avatar_;
};
std::unique_ptr<test::Folder> Evaluate::folder_;
Capture Evaluate::capture_;
Avatar Evaluate::avatar_;

TEST_F(Evaluate, ThePersonHerselfIsNearlyPerfect) {
    Evaluation e = evaluateCapture(testDevice(), avatar_, capture_);
    FrameMetrics mean = meanMetrics(e.frames);
    ASSERT_EQ(e.frames.size(), 4u);
    EXPECT_GT(mean.iou, .92);  // of 96 pixels: what is half covered may fall either way
    EXPECT_GT(mean.ssimFrame, .98);
    EXPECT_LT(mean.mseFrame, 10);
    EXPECT_FALSE(mean.lpips);
    // She turns by a quarter from frame to frame, in the renders as in the frames.
    EXPECT_GT(e.changeOfFrames, 1);
    EXPECT_NEAR(e.change, e.changeOfFrames, .1 * e.changeOfFrames);
    EXPECT_EQ(e.changeHeldStill, 0);
    // The whole frame is compared: a face painted over costs.
    Avatar other = avatar_;
    std::fill(other.texture.begin(), other.texture.end(), 0.f);
    EXPECT_GT(meanMetrics(evaluateCapture(testDevice(), other, capture_).frames).mseFrame,
              10 * mean.mseFrame);
}

TEST_F(Evaluate, AHeldPoseDoesNotFlicker) {
    Capture still = capture_;
    for (size_t i = 1; i < still.size(); ++i) {
        still.theta[i] = still.theta[0];
        still.trans[i] = still.trans[0];
    }
    Evaluation e = evaluateCapture(testDevice(), avatar_, still);
    EXPECT_EQ(e.change, 0);
    EXPECT_EQ(e.changeHeldStill, 0);
    EXPECT_GT(e.changeOfFrames, 1);
}

TEST_F(Evaluate, Scenes) {
    const double frame =
        meanMetrics(evaluateCapture(testDevice(), avatar_, capture_).frames).mseFrame;
    const double median =
        meanMetrics(
            evaluateCapture(testDevice(), avatar_, capture_, {.background = "median"}).frames)
            .mseFrame;
    // The studio wall does not move, but its noise, if any, is no longer the frame's own.
    EXPECT_GE(median, frame);
    EXPECT_LT(median, 20);
    fs::path black = folder_->path() / "black.png", small = folder_->path() / "small.png";
    writeImage(black, Image(kSize, kSize, 3, 0));
    writeImage(small, Image(kSize, 8, 3, 0));
    EXPECT_GT(
        meanMetrics(
            evaluateCapture(testDevice(), avatar_, capture_, {.background = black.string()}).frames)
            .mseFrame,
        500);
    expectInputError(
        [&] { evaluateCapture(testDevice(), avatar_, capture_, {.background = small.string()}); },
        "small.png: expected a picture of 96×96 pixels, as the frames have, found 96×8");
    expectInputError(
        [&] { evaluateCapture(testDevice(), avatar_, capture_, {.background = "gone.png"}); },
        "gone.png");
}

TEST_F(Evaluate, AReportShowsEveryFrame) {
    const fs::path out = folder_->path() / "report";
    evaluateCapture(testDevice(), avatar_, capture_, {.pictures = out});
    const std::string html = test::bytesOf(out / "report.html");
    for (const Frame& frame : capture_.frames) {
        EXPECT_NE(html.find(frame.name + ".png"), std::string::npos);
        EXPECT_TRUE(fs::exists(out / (frame.name + ".png")));
        const ImageSize head = imageSize(out / "heads" / (frame.name + ".png"));
        EXPECT_GT(head.width, 2 * 4 * 5);
        EXPECT_EQ(head.height % 4, 0);
    }
    EXPECT_NE(html.find("sharpness_head"), std::string::npos);
}

// Frames that an avatar was trained on have the poses that training found, which is said.
TEST_F(Evaluate, SaysWhosePosesItTakes) {
    const test::Folder folder;
    const std::string person = (folder / "avatar").string(), frames = (folder / "frames").string();
    writeAvatar(person, writable());
    Capture given = capture_, seen = capture_.subset({{0, 1, 3}});
    for (Trans& trans : given.trans) trans[0] += .1f;
    writeCapture(given, frames);
    writeTrainingPoses(person, given.subset({{0, 1, 3}}), seen);
    const auto evaluated = [&](std::vector<std::string> flags) {
        flags.insert(flags.begin(), {"eval", person, frames});
        const test::Outcome outcome = test::doppel(flags);
        EXPECT_EQ(outcome.status, 0) << outcome.err;
        return outcome;
    };
    const auto iou = [](const test::Outcome& outcome) {
        const std::string name = "silhouette IoU";
        return std::stod(outcome.out.substr(outcome.out.find(name) + name.size()));
    };
    const auto says = [](const std::string& text, const char* what) {
        return text.find(what) != std::string::npos;
    };
    constexpr const char* kTaken =
        "the poses that training found for them are taken; "
        "--given-poses leaves them as the capture has them";
    const test::Outcome trained = evaluated({"--frames", "0,1,3"});
    EXPECT_TRUE(says(trained.err, kTaken)) << trained.err;
    EXPECT_TRUE(says(trained.out, "3 frames, poses as training found them\n")) << trained.out;
    EXPECT_TRUE(says(trained.out, "was trained on")) << trained.out;
    EXPECT_GT(iou(trained), .95);
    const test::Outcome some = evaluated({});
    EXPECT_TRUE(says(some.out, "poses as training found them in 3, as given in 1\n")) << some.out;
    const test::Outcome asGiven = evaluated({"--given-poses"});
    EXPECT_FALSE(says(asGiven.err, kTaken)) << asGiven.err;
    EXPECT_TRUE(says(asGiven.out, "4 frames, poses as given\n")) << asGiven.out;
    EXPECT_LT(iou(asGiven), .8);
}

// The actress through her own eyes, her poses lost: her pictures find them again, colours better
// than outlines.
TEST_F(Evaluate, PicturesFindPoses) {
    Avatar avatar = avatar_;
    avatar.preset.shape.size = avatar.preset.texels.size = 96;
    const Capture right = capture_.subset({{0, 1}});
    Capture lost = right;
    for (size_t i = 0; i < lost.size(); ++i) {
        for (size_t k = 0; k < kThetaSize; ++k) lost.theta[i][k] += (k + i) % 3 ? .05f : -.05f;
        lost.trans[i][0] += .02f;
    }
    auto psnr = [&](const Capture& capture) {
        return meanMetrics(evaluateCapture(testDevice(), avatar, capture).frames).psnrBody;
    };
    Capture outlines = lost;
    fitPosesToMasks(testDevice(), avatar, outlines, 1);
    Capture colours = outlines, kept = right, far = lost.subset({{0}});
    fitPosesToPictures(testDevice(), avatar, colours, 1);
    // Without outlines it is a longer way than one round.
    EXPECT_GT(fitPosesToPictures(testDevice(), avatar, far, 1), 1);
    const double before = psnr(lost), byOutlines = psnr(outlines), byColours = psnr(colours);
    EXPECT_GT(byOutlines, before + 1);
    EXPECT_GT(byColours, byOutlines + .5);
    // Who is right wanders by what 96 pixels do not show, which is no reason to go on.
    EXPECT_LT(fitPosesToPictures(testDevice(), avatar, kept, 1), 4);
}

// The same as a user does it, with frames of a person who has an avatar: the capture that comes out
// drives it.
TEST_F(Evaluate, FitPutsAnAvatarIntoFrames) {
    Avatar avatar = writable();
    avatar.betas = {.4f};
    avatar.preset.shape.size = avatar.preset.texels.size = 96;
    const test::Folder folder;
    const std::string person = (folder / "avatar").string(), frames = (folder / "lost").string();
    writeAvatar(person, avatar);
    avatar = readAvatar(person);
    const std::map<std::string, std::string> before = test::tree(person);
    Capture lost = capture_.subset({{0, 1}});
    for (size_t i = 0; i < lost.size(); ++i) {
        for (size_t k = 0; k < kThetaSize; ++k) lost.theta[i][k] += (k + i) % 3 ? .05f : -.05f;
        lost.trans[i][0] += .02f;
    }
    writeCapture(lost, frames);
    auto fitted = [&](const std::string& to) {
        const std::string out = (folder / to).string();
        const test::Outcome outcome =
            test::doppel({"fit", frames, "--avatar", person, "--to", to, "--out", out, "--json"});
        EXPECT_EQ(outcome.status, 0) << outcome.err;
        const auto json = nlohmann::json::parse(outcome.out);
        EXPECT_GT(json["iou_after"].get<double>(), json["iou_before"].get<double>() + .02);
        return readCapture(out);
    };
    auto psnr = [&](const Capture& capture) {
        return meanMetrics(evaluateCapture(testDevice(), avatar, capture).frames).psnrBody;
    };
    const Capture masks = fitted("masks"), pictures = fitted("pictures");
    EXPECT_EQ(masks.betas, avatar.betas);
    EXPECT_EQ(pictures.betas, avatar.betas);
    EXPECT_GT(psnr(masks), psnr(lost) + 1);
    EXPECT_GT(psnr(pictures), psnr(masks) + .5);
    EXPECT_EQ(test::tree(person), before);

    const std::string out = (folder / "out").string();
    for (const auto& [words, sentence] :
         std::vector<std::pair<std::vector<std::string>, std::string>>{
             {{"--avatar", person, "--body", "default"}, "--body"},
             {{"--avatar", person, "--preset", "ci"}, "--preset"},
             {{"--to", "masks"}, "--avatar"},
             {{"--avatar", frames}, "avatar"}}) {
        std::vector<std::string> line{"fit", frames, "--out", out};
        line.insert(line.end(), words.begin(), words.end());
        const test::Outcome outcome = test::doppel(line);
        EXPECT_NE(outcome.status, 0);
        EXPECT_NE(outcome.sentence().find(sentence), std::string::npos) << outcome.err;
        EXPECT_FALSE(fs::exists(out));
    }
}

// Arms that hang beside the body are before it in pictures from the sides, where an outline does
// not show them: what the other pictures show of arm and flank does.
TEST_F(Evaluate, FewPicturesTellEachOtherWhereArmsAre) {
    constexpr size_t kSides[] = {1, 3};
    // Four, and six, two of which are seen twice.
    for (const Capture& right : {capture_, capture_.subset({{0, 1, 2, 3, 0, 2}})}) {
        Capture lost = right;
        for (size_t f : kSides)
            for (size_t shoulder : {joint::kLeftShoulder, joint::kRightShoulder})
                lost.theta[f][3 * shoulder + 1] += .2f;
        auto trained = [&](int others) {
            TrainResult result{.avatar = avatar_, .capture = lost, .fit = {}};
            Preset& preset = result.avatar.preset;
            preset.texture.textureSize = 128;
            preset.texels.size = 96;
            preset.texels.steps = 4;
            preset.texels.others = others;
            trainTexels(testDevice(), result, TrainSettings());
            return result.capture;
        };
        auto off = [&](const Capture& capture) {
            double sum = 0;
            for (size_t f : kSides) {
                const auto is = jointPlaces(avatar_.body, {}, capture.theta[f], capture.trans[f]);
                const auto was = jointPlaces(avatar_.body, {}, right.theta[f], right.trans[f]);
                for (size_t wrist : {joint::kLeftWrist, joint::kRightWrist})
                    sum += glm::length((is[wrist] - is[0]) - (was[wrist] - was[0])) / 4;
            }
            return sum;
        };
        const double before = off(lost), alone = off(trained(0)), told = off(trained(60));
        std::cout << right.size() << " pictures: wrists " << 1000 * before << " mm, "
                  << 1000 * alone << " alone, " << 1000 * told << " told\n";
        EXPECT_LT(told, .7 * before);
        EXPECT_LT(told, .8 * alone);
    }
}

// Her texture from her frames: what they show is back in its place.
TEST_F(Evaluate, FramesGiveTheTextureBack) {
    Avatar avatar = avatar_;
    FrameCache frames(capture_);
    const int size = 128;
    avatar.texture = backProject(testDevice(), avatar.body, capture_, frames, size, 0).texture;
    avatar.textureSize = size;
    for (float value : avatar.texture) {
        EXPECT_GE(value, 0);
        EXPECT_LE(value, 1);
    }
    Avatar grey = avatar;
    std::fill(grey.texture.begin(), grey.texture.end(), .5f);
    auto interior = [&](const Avatar& of) {
        const FrameMetrics mean = meanMetrics(evaluateCapture(testDevice(), of, capture_).frames);
        return std::ranges::find(mean.figures, "psnr_interior",
                                 &std::pair<std::string, double>::first)
            ->second;
    };
    const double own = interior(avatar);
    EXPECT_GT(own, 22);
    EXPECT_GT(own, interior(grey) + 8);
}

// A rectangle of the atlas has figures of its own: what is painted over elsewhere does not change
// them.
TEST_F(Evaluate, RegionsOfTheAtlas) {
    EvaluateSettings settings;
    settings.regions = {atlasRegion("left=0,0,.5,1", "--region"),
                        atlasRegion("right=.5,0,1,1", "--region")};
    auto psnr = [&](const Avatar& avatar, const char* name) {
        const FrameMetrics mean =
            meanMetrics(evaluateCapture(testDevice(), avatar, capture_, settings).frames);
        const auto found =
            std::ranges::find(mean.figures, name, &std::pair<std::string, double>::first);
        EXPECT_NE(found, mean.figures.end()) << name;
        return found == mean.figures.end() ? 0 : found->second;
    };
    Avatar other = avatar_;
    const int size = other.textureSize;
    for (int y = 0; y < size; ++y)
        std::fill_n(&other.texture[3 * size_t(y * size)], 3 * size / 2 - 12, 0.f);
    EXPECT_LT(psnr(other, "psnr_left"), psnr(avatar_, "psnr_left") - 5);
    EXPECT_NEAR(psnr(other, "psnr_right"), psnr(avatar_, "psnr_right"), .1);
    for (const char* wrong : {"", "print", "print=", "=0,0,1,1", "a b=0,0,1,1", "head=0,0,1,1",
                              "a=0,0,1", "a=0,0,1,1,", "a=.5,0,.5,1", "a=0,0,1,2", "a=0,nan,1,1"})
        expectInputError([&] { atlasRegion(wrong, "--region"); }, "--region: expected NAME=LEFT");
}

// What one side's frame shows is the other side's as well, and in its place: a texel is some 3 mm.
TEST_F(Evaluate, WhatNoFrameShowsIsTakenFromTheOtherSide) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const std::vector<size_t> one{1};  // she has turned by a quarter
    const Capture side = capture_.subset(one);
    FrameCache frames(side);
    constexpr int kTexels = 512;
    FirstTexels first = backProject(testDevice(), body, side, frames, kTexels, 0);
    fillUnseen(body, kTexels, {}, first);
    EXPECT_GT(first.part(kFromFrames), .1);
    EXPECT_GT(first.part(kFromOtherSide), .1);
    EXPECT_NEAR(first.part(kFromFrames) + first.part(kFromOtherSide) + first.part(kFromNeighbours),
                1, 1e-9);
    const std::vector<TexelPlace> places = texelPlaces(body, kTexels);
    auto placeOf = [&](size_t texel) {
        std::array<float, 3> x{};
        for (size_t k = 0; k < 3; ++k) {
            const auto v = size_t(body.faces[3 * size_t(places[texel].face) + k]);
            for (size_t c = 0; c < 3; ++c)
                x[c] += places[texel].corners[k] * body.templateVertices[3 * v + c];
        }
        return x;
    };
    size_t checked = 0;
    for (size_t i = 0; i < places.size(); i += 61) {
        EXPECT_EQ(first.origin[i] == kNoTexel, places[i].face < 0);
        if (first.origin[i] != kFromOtherSide) continue;
        const std::array<float, 3> here = placeOf(i);
        bool found = false;
        for (size_t j = 0; j < places.size() && !found; ++j) {
            if (first.origin[j] != kFromFrames) continue;
            if (!std::equal(&first.texture[3 * i], &first.texture[3 * i] + 3,
                            &first.texture[3 * j]))
                continue;
            const std::array<float, 3> there = placeOf(j);
            found = std::hypot(here[0] + there[0], here[1] - there[1], here[2] - there[2]) < .0075f;
        }
        EXPECT_TRUE(found) << i;
        ++checked;
    }
    EXPECT_GT(checked, 50u);
}

// Fills again, by texels that have changed since.
TEST_F(Evaluate, WhatNoFrameShowsFollowsWhatIsLearned) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const Capture side = capture_.subset({{1}});
    FrameCache frames(side);
    constexpr int kTexels = 128;
    const FirstTexels first = backProject(testDevice(), body, side, frames, kTexels, 0);
    FirstTexels again = first;
    fillUnseen(body, kTexels, {}, again);
    EXPECT_EQ(again.texture, first.texture);
    EXPECT_EQ(again.origin, first.origin);
    for (size_t i = 0; i < first.origin.size(); ++i)
        for (size_t c = 0; c < 3; ++c)
            again.texture[3 * i + c] =
                first.origin[i] == kFromFrames ? 1 - first.texture[3 * i + c] : .25f;
    fillUnseen(body, kTexels, {}, again);
    EXPECT_EQ(again.origin, first.origin);
    for (size_t i = 0; i < first.texture.size(); ++i) {
        if (first.origin[i / 3] == kNoTexel) continue;
        ASSERT_NEAR(again.texture[i], 1 - first.texture[i], 1e-3) << i;
    }
}

TEST_F(Evaluate, WithLpips) {
    // Weights of one: any network will do.
    Safetensors file;
    file.file = "ones";
    Graph graph(testDevice());
    lpipsFeatures(graph, LpipsNet::squeeze, graph.input({1, 3, 64, 64}),
                  [&](const std::string& name, const Shape& shape) {
                      auto count = size_t(elementCount(shape));
                      float value = shape.size() > 1 ? float(shape[0]) / float(count) : 0.1f;
                      file.tensors[name] = {shape, std::vector<float>(count, value)};
                      return graph.input(shape);
                  });
    for (size_t i = 0; i < lpipsChannels(LpipsNet::squeeze).size(); ++i) {
        int64_t channels = lpipsChannels(LpipsNet::squeeze)[i];
        std::vector<float> values(size_t(channels), 1.f);
        file.tensors[fmt::format("lin{}.model.1.weight", i)] = {{1, channels, 1, 1}, values};
    }
    // A channel that tells more than brightness.
    auto& first = file.tensors["features.0.weight"].values;
    for (size_t i = 0; i < first.size(); i += 2) first[i] = -first[i];
    Lpips lpips(testDevice(), LpipsNet::squeeze, {file});
    Evaluation e = evaluateCapture(testDevice(), avatar_, capture_, {.lpips = &lpips});
    FrameMetrics mean = meanMetrics(e.frames);
    ASSERT_TRUE(mean.lpips);
    Avatar other = avatar_;
    std::fill(other.texture.begin(), other.texture.end(), 0.f);
    EXPECT_GT(*meanMetrics(evaluateCapture(testDevice(), other, capture_, {.lpips = &lpips}).frames)
                   .lpips,
              *mean.lpips);
}

}  // namespace
}  // namespace doppel
