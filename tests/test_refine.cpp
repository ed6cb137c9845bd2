// Stage 3 as a whole, and what is made of its textures: renders, baked textures, smooth motions.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <glm/gtc/quaternion.hpp>

#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/rendering.h"
#include "trainer/commands/train.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/smooth.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;

// ---- training -----------------------------------------------------------------------------------

Preset tinyPreset() {
    Preset preset = presetByName("ci");
    preset.texture.size = 64;
    preset.texture.textureSize = 64;
    preset.texture.block = 1;
    preset.texture.depth = 6;
    preset.texture.width = 4;
    preset.texture.steps = 60;
    preset.refine.size = 64;
    preset.refine.depth = 6;
    preset.refine.width = 4;
    preset.refine.discriminatorWidth = 2;
    preset.refine.faceSize = 16;
    preset.refine.steps = 120;
    preset.refine.lr = 2e-3;
    preset.refine.lrDiscriminator = 2e-4;
    return preset;
}

class Refine : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<test::Folder>();
        Actor actor = readActor(assetFolder() / "actor", "woman");
        SyntheticOptions options;
        options.size = 96;
        options.samples = 2;
        options.poseNoiseDegrees = 0;
        options.transNoiseMetres = 0;
        renderActor(testDevice(), actor, actorSession(6, 0, kActorDistance), capture(), options);
        runTrain(trainOptions({"texture"}, folder_->path() / "coarse"));
        fs::copy(folder_->path() / "coarse", avatar());
        runTrain(trainOptions({"refine"}, avatar()));
    }
    static void TearDownTestSuite() { folder_.reset(); }

    static TrainOptions trainOptions(std::vector<std::string> stages, const fs::path& out) {
        TrainOptions options;
        options.capture = capture();
        options.out = out;
        options.body = "default";
        options.stages = std::move(stages);
        options.preset = tinyPreset();
        options.pictureSeconds = 0;
        return options;
    }
    static fs::path capture() { return folder_->path() / "capture"; }
    static fs::path avatar() { return folder_->path() / "avatar"; }
    static fs::path coarse() { return folder_->path() / "coarse"; }
    static std::unique_ptr<test::Folder> folder_;
};
std::unique_ptr<test::Folder> Refine::folder_;

TEST_F(Refine, IsCloserToTheFramesThanTheCoarseTexture) {
    Avatar person = readAvatar(avatar());
    ASSERT_FALSE(person.refineNet.empty());
    ASSERT_FALSE(person.bakedTexture.empty());
    Capture frames = readCapture(capture());
    auto psnr = [&](TextureKind kind) {
        return meanMetrics(evaluateAvatar(testDevice(), person, frames, {}, kind)).psnrBody;
    };
    double coarse = psnr(TextureKind::Coarse), refined = psnr(TextureKind::Refined);
    EXPECT_GT(refined, coarse + 0.3);
    EXPECT_EQ(psnr(TextureKind::Best), refined);
    // One texture for all views is not as good, but it is of them.
    EXPECT_GT(psnr(TextureKind::Baked), coarse);
    // Curves of all losses.
    std::ifstream curve(avatar() / "log" / "losses_refine.csv");
    std::string header;
    std::getline(curve, header);
    EXPECT_EQ(header,
              "step,loss,reconstruction,misaligned,gan_image,gan_face,discriminator_image,"
              "discriminator_face");
    EXPECT_EQ(std::count(std::istreambuf_iterator<char>(curve), {}, '\n'), 120);
}

TEST_F(Refine, APoseHeldStillDoesNotFlicker) {
    Avatar person = readAvatar(avatar());
    Shot still = restShot(testDevice(), person, 96);
    auto change = [&](const std::vector<Shot>& shots, TextureKind kind) {
        return renderShots(testDevice(), person, shots,
                           {[&](size_t) { return plainBackground("#808080", still.camera); }},
                           folder_->path() / "pictures", 25, "test", kind);
    };
    for (TextureKind kind : {TextureKind::Coarse, TextureKind::Refined, TextureKind::Baked})
        EXPECT_EQ(change({still, still, still}, kind), 0);
    EXPECT_GT(change({still, turned(still, 0.1)}, TextureKind::Refined), 0.1);
}

TEST_F(Refine, TheTextureDependsOnTheView) {
    Avatar person = readAvatar(avatar());
    Shot front = restShot(testDevice(), person, 64), back = turned(front, 0.5);
    AvatarRenderer refined(testDevice(), person, true, TextureKind::Refined);
    std::vector<float> fromFront = refined.texture(refined.vertices(front.theta, front.trans));
    std::vector<float> fromBack = refined.texture(refined.vertices(back.theta, back.trans));
    EXPECT_NE(fromFront, fromBack);
    for (float value : fromFront) {
        EXPECT_GE(value, 0);
        EXPECT_LE(value, 1);
    }
    AvatarRenderer baked(testDevice(), person, true, TextureKind::Baked);
    EXPECT_EQ(baked.texture(baked.vertices(front.theta, front.trans)), person.bakedTexture);
}

TEST_F(Refine, TheSameSeedGivesTheSameBytes) {
    fs::path again = folder_->path() / "again";
    fs::copy(coarse(), again);
    runTrain(trainOptions({"refine"}, again));
    for (const char* name : {"refine_net.safetensors", "texture_baked.png", "preview.png"}) {
        std::string bytes = bytesOf(avatar() / name);
        EXPECT_FALSE(bytes.empty()) << name;
        EXPECT_EQ(bytesOf(again / name), bytes) << name;
    }
    TrainOptions other = trainOptions({"refine"}, again);
    other.common.seed = 2;
    other.restart = true;
    runTrain(other);
    EXPECT_NE(bytesOf(again / "refine_net.safetensors"),
              bytesOf(avatar() / "refine_net.safetensors"));
    // Training the coarse texture again makes the refinement of the old one void.
    TrainOptions texture = trainOptions({"texture"}, again);
    texture.preset.texture.steps = 1;
    texture.restart = true;
    runTrain(texture);
    EXPECT_FALSE(fs::exists(again / "refine_net.safetensors"));
    EXPECT_FALSE(fs::exists(again / "texture_baked.png"));
}

TEST_F(Refine, AblationsAndOptions) {
    fs::path out = folder_->path() / "ablation";
    fs::copy(coarse(), out);
    auto columns = [&](const TrainOptions& options) {
        runTrain(options);
        std::ifstream curve(out / "log" / "losses_refine.csv");
        std::string header;
        std::getline(curve, header);
        return header;
    };
    TrainOptions options = trainOptions({"refine"}, out);
    options.preset.refine.steps = 2;
    options.face = false;
    options.restart = true;
    EXPECT_EQ(columns(options),
              "step,loss,reconstruction,misaligned,gan_image,discriminator_image");
    options.gan = false;
    EXPECT_EQ(columns(options), "step,loss,reconstruction,misaligned");
    EXPECT_FALSE(readAvatar(out).preset.refine.imageDiscriminator);

    // The program's variants, with a network in place of one coarse texture, and batches.
    options = trainOptions({"texture", "refine"}, out);
    options.restart = true;
    options.preset.texture.steps = 2;
    options.preset.texture.constantInput = false;
    options.preset.refine.steps = 2;
    options.preset.refine.batch = 2;
    options.preset.refine.loss = GanLoss::Squares;
    options.preset.refine.region = Region::Union;
    options.preset.refine.masks = GanMasks::Own;
    options.preset.refine.apart = Misalignment::Rendered;
    options.preset.refine.residual = Residual::Program;
    options.preset.refine.dropout = 0.5;
    options.preset.refine.constantPart = 0;
    runTrain(options);
    Avatar read = readAvatar(out);
    EXPECT_EQ(read.preset.refine.residual, Residual::Program);
    Shot shot = restShot(testDevice(), read, 64);
    AvatarRenderer renderer(testDevice(), read);
    for (float value : renderer.texture(renderer.vertices(shot.theta, shot.trans)))
        ASSERT_TRUE(std::isfinite(value));
}

TEST_F(Refine, SaysWhatIsMissing) {
    Avatar person = readAvatar(coarse());
    expectInputError([&] { requireTexture(person, TextureKind::Refined, coarse()); },
                     "train stage refine first");
    expectInputError([&] { requireTexture(person, TextureKind::Baked, coarse()); },
                     "train stage refine first");
    EXPECT_NO_THROW(requireTexture(person, TextureKind::Best, coarse()));
    expectInputError([&] { textureKind("fine"); }, "found \"fine\"");
    expectInputError([&] { runTrain(trainOptions({"refine"}, folder_->path() / "nothing")); },
                     "train stage texture first");
    TrainOptions small = trainOptions({"refine"}, folder_->path() / "small");
    fs::copy(coarse(), small.out);
    small.preset.refine.size = 16;
    expectInputError([&] { runTrain(small); }, "image discriminator");
}

// ---- baked textures -----------------------------------------------------------------------------

struct Standing {
    Avatar avatar;
    std::vector<float> front, back;  // vertices

    Standing() {
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = bodyFromNpz(avatar.bodyArrays);
        Shot shot = restShot(testDevice(), avatar, 64), other = turned(shot, 0.5);
        AvatarRenderer renderer(testDevice(), avatar);
        front = renderer.vertices(shot.theta, shot.trans);
        back = renderer.vertices(other.theta, other.trans);
    }
};

std::vector<float> plain(int size, std::array<float, 3> colour) {
    std::vector<float> texture;
    for (int i = 0; i < size * size; ++i)
        texture.insert(texture.end(), colour.begin(), colour.end());
    return texture;
}

TEST(Bake, TexelsKnowWhereTheyLie) {
    constexpr int kTexels = 128;
    Standing body;
    std::vector<TexelPlace> places = texelPlaces(body.avatar.body, kTexels);
    size_t inside = 0, between = 0;
    for (size_t i = 0; i < places.size(); ++i) {
        if (places[i].face < 0) {
            ++between;
            continue;
        }
        ++inside;
        double sum = 0, u = 0, v = 0;
        for (size_t c = 0; c < 3; ++c) {
            auto uv = size_t(body.avatar.body.uvFaces[size_t(places[i].face) * 3 + c]);
            EXPECT_GE(places[i].corners[c], 0);
            sum += double(places[i].corners[c]);
            u += double(places[i].corners[c]) * double(body.avatar.body.uvs[2 * uv]);
            v += double(places[i].corners[c]) * double(body.avatar.body.uvs[2 * uv + 1]);
        }
        EXPECT_NEAR(sum, 1, 1e-5);
        // The place is the texel's centre, or at most a texel and a half away.
        double dx = u * kTexels - 0.5 - double(i % kTexels);
        double dy = v * kTexels - 0.5 - double(i / kTexels);
        EXPECT_LE(std::hypot(dx, dy), 1.5 + 1e-3);
    }
    EXPECT_GT(inside, between);
    EXPECT_GT(between, 0u);
}

TEST(Bake, EveryTexelIsOfTheViewsThatFaceIt) {
    constexpr int kTexels = 128;
    Standing body;
    const std::array<float, 3> red{1, 0, 0}, blue{0, 0, 1}, grey{0.5f, 0.5f, 0.5f};
    TextureBaker baker(body.avatar.body, kTexels);
    for (int k = 0; k < 4; ++k) {
        baker.add(plain(kTexels, red), body.front);
        baker.add(plain(kTexels, blue), body.back);
    }
    std::vector<float> texture = baker.result(plain(kTexels, grey));
    std::vector<TexelPlace> places = texelPlaces(body.avatar.body, kTexels);
    std::vector<float> seen = viewWeights(body.avatar.body, places, body.front);
    std::vector<float> seenBehind = viewWeights(body.avatar.body, places, body.back);
    size_t frontal = 0, never = 0;
    for (size_t i = 0; i < places.size(); ++i) {
        if (places[i].face < 0) continue;
        const float* c = &texture[3 * i];
        if (seen[i] > 0.5f && seenBehind[i] == 0) {
            ++frontal;
            EXPECT_GT(c[0], 0.97f);
            EXPECT_LT(c[2], 0.03f);
        }
        if (seen[i] == 0 && seenBehind[i] == 0) {
            ++never;
            EXPECT_EQ(c[0], 0.5f);
            EXPECT_EQ(c[1], 0.5f);
        }
    }
    EXPECT_GT(frontal, 500u);
    EXPECT_GT(never, 10u);
    // Between the charts there is no colour of its own: only what charts have.
    for (size_t i = 0; i < places.size(); ++i)
        if (places[i].face < 0) {
            bool found = false;
            for (size_t k = 0; k < places.size() && !found; ++k)
                found = places[k].face >= 0 &&
                        std::equal(&texture[3 * i], &texture[3 * i] + 3, &texture[3 * k]);
            ASSERT_TRUE(found) << i;
            if (i > 3000) break;
        }
}

TEST(Bake, OneTextureForAllViewsStaysItself) {
    constexpr int kTexels = 64;
    Standing body;
    Value value = uniform({kTexels, kTexels, 3}, 0, 1);
    std::vector<float> texture(value.data.begin(), value.data.end());
    TextureBaker baker(body.avatar.body, kTexels);
    baker.add(texture, body.front);
    baker.add(texture, body.back);
    std::vector<float> baked = baker.result(texture);
    std::vector<TexelPlace> places = texelPlaces(body.avatar.body, kTexels);
    for (size_t i = 0; i < places.size(); ++i) {
        if (places[i].face < 0) continue;
        for (size_t c = 3 * i; c < 3 * i + 3; ++c) ASSERT_NEAR(baked[c], texture[c], 1e-6);
    }
}

// ---- smooth motions -----------------------------------------------------------------------------

// Two poses' largest angle between the rotations of a joint.
double angleBetween(const Theta& a, const Theta& b) {
    auto q = [](const Theta& theta, size_t j) {
        glm::dvec3 v(theta[3 * j], theta[3 * j + 1], theta[3 * j + 2]);
        double angle = glm::length(v);
        return angle > 0 ? glm::angleAxis(angle, v / angle) : glm::dquat(1, 0, 0, 0);
    };
    double most = 0;
    for (size_t j = 0; j < 24; ++j)
        most = std::max(most, 2 * std::acos(std::min(1.0, std::abs(glm::dot(q(a, j), q(b, j))))));
    return most;
}

TEST(Smooth, APoseHeldStillStaysAndNothingIsNothing) {
    Motion motion;
    Value pose = uniform({72}, -2, 2);
    Theta theta;
    std::copy(pose.data.begin(), pose.data.end(), theta.begin());
    for (int i = 0; i < 9; ++i) {
        motion.theta.push_back(theta);
        motion.trans.push_back({1, 2, 3});
    }
    Motion same = smoothed(motion, 2);
    for (size_t i = 0; i < 9; ++i) {
        EXPECT_LT(angleBetween(same.theta[i], theta), 1e-5);
        for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(same.trans[i][c], motion.trans[i][c], 1e-6);
    }
    EXPECT_EQ(smoothed(motion, 0).theta, motion.theta);
}

TEST(Smooth, TurnsThroughHalfATurnStaySteady) {
    // A steady turn about y: the axis-angle vector jumps from +pi to -pi in the middle.
    Motion motion;
    for (int i = 0; i < 21; ++i) {
        double angle = 2.6 + 0.05 * i;
        if (angle > 3.14159265) angle -= 2 * 3.14159265358979;
        Theta theta{};
        theta[1] = static_cast<float>(angle);
        motion.theta.push_back(theta);
        motion.trans.push_back({static_cast<float>(i), 0, 2});
    }
    Motion smooth = smoothed(motion, 2);
    for (size_t i = 0; i < motion.size(); ++i) {
        EXPECT_LT(angleBetween(smooth.theta[i], motion.theta[i]), 1e-4) << i;
        EXPECT_NEAR(smooth.trans[i][0], motion.trans[i][0], 1e-5) << i;
    }
}

TEST(Smooth, TremorGoes) {
    Motion motion;
    Value noise = random({60, 75});
    for (size_t i = 0; i < 60; ++i) {
        Theta theta{};
        Trans trans{0, 0, 3};
        for (size_t k = 0; k < 72; ++k) theta[k] = 0.05f * float(noise.data[75 * i + k]);
        for (size_t k = 0; k < 3; ++k) trans[k] += 0.01f * float(noise.data[75 * i + 72 + k]);
        motion.theta.push_back(theta);
        motion.trans.push_back(trans);
    }
    auto tremor = [](const Motion& m) {
        double sum = 0;
        for (size_t i = 21; i < 40; ++i) sum += angleBetween(m.theta[i], m.theta[i - 1]);
        return sum;
    };
    EXPECT_LT(tremor(smoothed(motion, 2)), 0.3 * tremor(motion));
    EXPECT_EQ(smoothed(motion, 2).theta.front(), motion.theta.front());
    EXPECT_EQ(smoothed(motion, 2).theta.back(), motion.theta.back());
}

}  // namespace
}  // namespace doppel
