// Surfaces beyond a body's: cells and what surrounds them, charts beside an atlas, bodies with more
// vertices, and caps grown from masks of people whose hair is known.
#include "trainer/stages/caps/caps.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "nn/body/body_atlas.h"
#include "nn/body/texel_places.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/tiny_training.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/mix/mix.h"
#include "trainer/avatar/mix/worn_caps.h"
#include "trainer/data/body_render.h"
#include "trainer/eval/evaluate.h"
#include "trainer/motion/synthetic.h"
#include "trainer/stages/caps/cells.h"
#include "trainer/stages/train.h"

namespace doppel {
namespace {

Cells cube(int count, double side) { return {glm::ivec3(count), glm::dvec3(0), side}; }

std::vector<uint8_t> ball(const Cells& cells, const glm::dvec3& centre, double radius) {
    std::vector<uint8_t> inside;
    for (size_t i = 0; i < cells.total(); ++i)
        inside.push_back(glm::distance(cells.centre(cells.place(i)), centre) < radius);
    return inside;
}

double volumeOf(const std::vector<glm::dvec3>& vertices,
                const std::vector<std::array<int32_t, 3>>& faces) {
    double six = 0;  // of tetrahedra with the origin, positive where faces look outwards
    for (const auto& f : faces)
        six += glm::dot(vertices[size_t(f[0])],
                        glm::cross(vertices[size_t(f[1])], vertices[size_t(f[2])]));
    return six / 6;
}

TEST(Cells, ASurfaceSurroundsThemAndLooksOutwards) {
    const Cells cells = cube(32, .01);
    const CellSurface surface = surfaceAround(cells, ball(cells, glm::dvec3(.16), .08));
    EXPECT_NEAR(volumeOf(surface.vertices, surface.faces),
                4 * std::numbers::pi / 3 * .08 * .08 * .08, .06 * .00214);
    for (const glm::dvec3& p : surface.vertices)
        EXPECT_NEAR(glm::distance(p, glm::dvec3(.16)), .08, .006);
    // Closed: each edge once in each direction.
    std::map<std::pair<int32_t, int32_t>, int> edges;
    for (const auto& f : surface.faces)
        for (size_t k = 0; k < 3; ++k) ++edges[{f[k], f[(k + 1) % 3]}];
    for (const auto& [edge, times] : edges) {
        EXPECT_EQ(times, 1);
        EXPECT_TRUE(edges.contains({edge.second, edge.first}));
    }
}

TEST(Cells, KnowThePointsNextToThem) {
    std::mt19937 random(7);
    auto number = [&] { return static_cast<double>(random()) / 4294967296.; };
    std::vector<glm::dvec3> points;
    for (int i = 0; i < 200; ++i) points.emplace_back(.3 * number(), .3 * number(), .3 * number());
    const Cells cells = cellsAround(points, .05, .01);
    const std::vector<int32_t> nearest = nearestPoints(cells, points, .04);
    size_t other = 0;
    for (size_t i = 0; i < cells.total(); ++i) {
        const glm::dvec3 centre = cells.centre(cells.place(i));
        double least = INFINITY;
        for (const glm::dvec3& p : points) least = std::min(least, glm::distance(p, centre));
        if (nearest[i] < 0) {
            EXPECT_GT(least, .04 - .01);  // a sweep may miss by less than a cell
            continue;
        }
        const double found = glm::distance(points[size_t(nearest[i])], centre);
        EXPECT_LE(found, .04);
        other += found > least + 1e-9;
        EXPECT_LT(found, least + .015);
    }
    EXPECT_LT(other, cells.total() / 100);
}

const Npz& bodyArrays() {
    static const Npz arrays = readBodyArrays("default");
    return arrays;
}
const BodyModel& body() {
    static const BodyModel model = bodyFromNpz(bodyArrays());
    return model;
}

// A ball that hangs on a joint, its centre as far behind it as is said: hair, on the head's.
BodyCap ballOn(size_t joint, double radius, double behind) {
    const Cells cells = cube(static_cast<int>(2 * radius / .01) + 8, .01);
    const glm::dvec3 middle = .005 * glm::dvec3(cells.count);
    const CellSurface surface = surfaceAround(cells, ball(cells, middle, radius));
    const std::vector<double> joints = restJoints(body(), std::vector<double>(10));
    const double* place = &joints[3 * joint];
    const glm::dvec3 centre(place[0], place[1], place[2] - behind);
    int64_t nearest = 0;
    for (int64_t v = 0; v < body().vertexCount; ++v) {
        auto distance = [&](int64_t of) {
            const float* p = &body().templateVertices[size_t(3 * of)];
            return glm::distance(glm::dvec3(p[0], p[1], p[2]), centre);
        };
        if (distance(v) < distance(nearest)) nearest = v;
    }
    BodyCap cap;
    for (const glm::dvec3& p : surface.vertices) {
        for (int k = 0; k < 3; ++k)
            cap.vertices.push_back(static_cast<float>(p[k] - middle[k] + centre[k]));
        cap.nearest.push_back(nearest);
        std::array<float, joint::kCount> row{};
        row[joint] = 1;
        cap.weights.insert(cap.weights.end(), row.begin(), row.end());
    }
    for (const auto& f : surface.faces) cap.faces.insert(cap.faces.end(), f.begin(), f.end());
    return cap;
}

BodyCap ballOfHair(double radius, double behind) { return ballOn(joint::kHead, radius, behind); }

TEST(Caps, ABodyTakesThemAndGivesThemBack) {
    Betas betas{};
    betas[0] = 1.5f;
    const BodyCap cap = ballOfHair(.06, .15);
    const auto arrays = withCap(bodyArrays(), cap, betas);
    ASSERT_TRUE(arrays);
    const BodyModel capped = bodyFromNpz(*arrays);
    EXPECT_EQ(capped.modelVertices, body().vertexCount);
    EXPECT_EQ(capped.capVertices(), int64_t(cap.nearest.size()));
    EXPECT_TRUE(isModelOf(body(), capped));
    EXPECT_TRUE(isModelOf(body(), body()));
    EXPECT_FALSE(isModelOf(capped, body()));

    // The model is as it was, to the last bit, and the cap where it was grown.
    const std::vector<double> wide(betas.begin(), betas.end());
    EXPECT_EQ(restJoints(capped, wide), restJoints(body(), wide));
    const std::vector<double> shaped = shapedVertices(capped, wide),
                              alone = shapedVertices(body(), wide);
    EXPECT_TRUE(std::equal(alone.begin(), alone.end(), shaped.begin()));
    for (size_t i = 0; i < cap.vertices.size(); ++i)
        EXPECT_NEAR(shaped[alone.size() + i], double{cap.vertices[i]}, 1e-6);

    const BodyModel back = bodyFromNpz(withoutCap(*arrays));
    EXPECT_EQ(back.templateVertices, body().templateVertices);
    EXPECT_EQ(back.faces, body().faces);
    EXPECT_EQ(back.uvs, body().uvs);
    EXPECT_EQ(back.weights, body().weights);
    EXPECT_EQ(back.jointRegressor, body().jointRegressor);
    EXPECT_EQ(back.capVertices(), 0);
}

TEST(Caps, SizesOfTheModelAreChecked) {
    const Npz good = *withCap(bodyArrays(), ballOfHair(.04, .15), Betas{});
    auto refused = [&](std::vector<int64_t> sizes) {
        Npz bad = good;
        bad.set("model_size", Array::i64({int64_t(sizes.size())}, sizes));
        EXPECT_THROW(bodyFromNpz(bad), InputError);
    };
    const BodyModel capped = bodyFromNpz(good);
    refused({0, capped.modelFaces, capped.modelUvs});
    refused({capped.vertexCount + 1, capped.modelFaces, capped.modelUvs});
    refused({capped.modelVertices, capped.faceCount, capped.modelUvs});
    refused({capped.modelVertices, capped.modelFaces, capped.modelUvs - 1});
    refused({capped.modelVertices, capped.modelFaces});
}

// No texel is two faces', and none of the body's has changed.
TEST(Caps, ChartsLieWhereTheAtlasIsEmpty) {
    const BodyModel capped = bodyFromNpz(*withCap(bodyArrays(), ballOfHair(.07, .2), Betas{}));
    constexpr int kSize = 512;
    const std::vector<TexelPlace> before = texelPlaces(body(), kSize),
                                  after = texelPlaces(capped, kSize);
    size_t taken = 0;
    for (size_t i = 0; i < before.size(); ++i) {
        if (before[i].face >= 0) {
            EXPECT_EQ(after[i].face, before[i].face);
        }
        taken += before[i].face < 0 && after[i].face >= capped.modelFaces;
    }
    // A ball of 7 cm has 616 cm², a hundredth of an atlas and more.
    EXPECT_GT(taken, size_t{kSize} * kSize / 200);
    for (float x : capped.uvs) EXPECT_TRUE(x >= 0 && x <= 1);
}

// Skin-coloured, but for the cap, which is red.
Avatar wearing(const Npz& arrays) {
    Avatar avatar;
    avatar.bodyArrays = arrays;
    avatar.body = bodyFromNpz(arrays);
    avatar.preset = presetByName("ci");
    avatar.textureSize = 256;
    for (const TexelPlace& place : texelPlaces(avatar.body, 256)) {
        const bool hair = place.face >= avatar.body.modelFaces;
        for (float c : {hair ? .9f : .7f, hair ? .1f : .6f, hair ? .1f : .5f})
            avatar.texture.push_back(c);
    }
    spreadCharts(texelPlaces(avatar.body, 256), 256, avatar.texture);
    return avatar;
}

TEST(Caps, AreWornByOthers) {
    const Avatar bare = wearing(bodyArrays());
    const BodyCap hair = ballOfHair(.07, .2);
    const Avatar giver = wearing(*withCap(bodyArrays(), hair, Betas{}));
    ASSERT_EQ(capPieces(giver.body).size(), 1u);
    EXPECT_EQ(capPieces(giver.body)[0].garment, Garment::Hair);

    const Mix mix = mixAvatars({.base = &bare, .hair = &giver});
    EXPECT_TRUE(mix.capsWorn);
    ASSERT_EQ(mix.avatar.body.capVertices(), giver.body.capVertices());
    const auto first = size_t(3 * bare.body.vertexCount);
    for (size_t i = 0; i < hair.vertices.size(); ++i)
        EXPECT_NEAR(mix.avatar.body.templateVertices[first + i], hair.vertices[i], 1e-4f);
    const auto colours = vertexColours(mix.avatar.body, mix.avatar.texture, 256);
    for (size_t v = size_t(bare.body.vertexCount); v < colours.size(); ++v)
        EXPECT_GT(colours[v].x - colours[v].y, .6) << v;
    // Who has another's hair leaves her own, and another's shirt is no hair.
    EXPECT_EQ(mixAvatars({.base = &giver, .hair = &bare}).avatar.body.capVertices(), 0);
    EXPECT_EQ(mixAvatars({.base = &bare, .top = &giver}).avatar.body.capVertices(), 0);
    EXPECT_GT(mixAvatars({.base = &giver, .top = &bare}).avatar.body.capVertices(), 0);
}

// What somebody with this cap shows, turning once, and her own poses.
Capture turning(const std::filesystem::path& folder, const Npz& arrays, int frames = 16) {
    Actor actor;
    actor.body = bodyFromNpz(arrays);
    actor.textureSize = 4;
    actor.texture.assign(48, .5f);
    std::vector<MotionFrame> motion = actorSession(16, 0, kActorDistance);
    motion.resize(size_t(frames));
    SyntheticOptions options;
    options.size = 256;
    options.samples = 1;
    options.poseNoiseDegrees = options.transNoiseMetres = 0;
    return renderActor(testDevice(), actor, motion, folder, options);
}

CapsPreset onPreset() { return presetByName("ci").caps; }

TEST(Caps, GrowFromMasksWhereHairIs) {
    test::Folder folder;
    const double radius = .07, behind = .2;
    const BodyCap hair = ballOfHair(radius, behind);
    const Capture capture = turning(folder / "hair", *withCap(bodyArrays(), hair, Betas{}));
    FrameCache frames(capture);
    const GrownCap grown = growCap(testDevice(), body(), capture, frames, onPreset());
    ASSERT_TRUE(grown.cap) << grown.why;
    // A ball has 1.4 litres; where it nears the head it is the body's.
    EXPECT_GT(grown.litres, 1.0);
    EXPECT_LT(grown.litres, 2.2);
    glm::dvec3 centre(0), truth(0);
    for (size_t v = 0; v < hair.nearest.size(); ++v)
        truth +=
            glm::dvec3(hair.vertices[3 * v], hair.vertices[3 * v + 1], hair.vertices[3 * v + 2]) /
            double(hair.nearest.size());
    double farthest = 0;
    for (size_t v = 0; v < grown.cap->nearest.size(); ++v) {
        const glm::dvec3 p(grown.cap->vertices[3 * v], grown.cap->vertices[3 * v + 1],
                           grown.cap->vertices[3 * v + 2]);
        farthest = std::max(farthest, glm::distance(p, truth));
        centre += p / double(grown.cap->nearest.size());
        double sum = 0;
        for (size_t j = 0; j < joint::kCount; ++j)
            sum += double{grown.cap->weights[v * joint::kCount + j]};
        EXPECT_NEAR(sum, 1, 1e-4);
    }
    EXPECT_LT(glm::distance(centre, truth), .025);
    EXPECT_LT(farthest, radius + .05);
}

TEST(Caps, DoNotGrowOnABodyThatFillsItsMasks) {
    test::Folder folder;
    const Capture capture = turning(folder / "bare", bodyArrays());
    FrameCache frames(capture);
    const GrownCap grown = growCap(testDevice(), body(), capture, frames, onPreset());
    EXPECT_FALSE(grown.cap) << grown.litres;
    EXPECT_NE(grown.why.find("nothing far from the body"), std::string::npos) << grown.why;
}

TEST(Caps, NeedToBeSeenFromAround) {
    test::Folder folder;
    const Capture capture =
        turning(folder / "front", *withCap(bodyArrays(), ballOfHair(.07, .2), Betas{}), 4);
    FrameCache frames(capture);
    const GrownCap grown = growCap(testDevice(), body(), capture, frames, onPreset());
    EXPECT_FALSE(grown.cap);
    EXPECT_NE(grown.why.find("sides in a row"), std::string::npos) << grown.why;
}

// A frame from a side says too little of where a trunk is, and enough of a head.
TEST(Caps, OfFewFramesGrowOnHeadsAlone) {
    test::Folder folder;
    const auto grownOf = [&](const std::string& name, const BodyCap& worn,
                             const std::vector<size_t>& chosen) {
        const Capture all = turning(folder / name, *withCap(bodyArrays(), worn, Betas{}));
        const Capture some = all.subset(chosen);
        FrameCache frames(some);
        return growCap(testDevice(), body(), some, frames, onPreset());
    };
    const GrownCap hair = grownOf("hair", ballOfHair(.07, .2), {0, 2, 4, 6, 8, 10, 12, 14});
    ASSERT_TRUE(hair.cap) << hair.why;
    EXPECT_GT(hair.litres, .5);  // a half of the ball is next to the shoulders
    EXPECT_LT(hair.litres, 1.4);
    const BodyCap bag = ballOn(joint::kPelvis, .07, .2);
    EXPECT_FALSE(grownOf("few", bag, {0, 2, 4, 6, 8, 10, 12, 14}).cap);
    EXPECT_TRUE(grownOf("all", bag, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}).cap);
    const GrownCap fromFive = grownOf("five", ballOfHair(.07, .2), {0, 2, 5, 8, 12});
    EXPECT_FALSE(fromFive.cap) << fromFive.litres;
    EXPECT_NE(fromFive.why.find("5 frames are too few"), std::string::npos) << fromFive.why;
}

// Through a training and back from disk; a second training of the same finds it done.
TEST(Caps, AreAStageOfTheTraining) {
    test::Folder folder;
    const Capture capture =
        turning(folder / "hair", *withCap(bodyArrays(), ballOfHair(.07, .2), Betas{}));
    Avatar avatar;
    avatar.bodyArrays = bodyArrays();
    avatar.body = body();
    avatar.preset = test::tinyPreset();
    TrainSettings settings;
    settings.out = folder / "avatar";
    settings.pictureSeconds = 0;
    settings.stages = {"caps", "shape", "texels"};
    const TrainResult result = trainAvatar(testDevice(), avatar, capture, settings);
    const Avatar& trained = result.avatar;
    EXPECT_GT(trained.body.capVertices(), 100);
    EXPECT_EQ(int64_t(trained.body.offsets.size()), 3 * trained.body.vertexCount);
    const Avatar read = readAvatar(folder / "avatar");
    EXPECT_EQ(read.body.capVertices(), trained.body.capVertices());
    EXPECT_EQ(read.body.offsets, trained.body.offsets);
    EXPECT_TRUE(isTrained(read, avatar, capture, Precision::Single, settings));
    // Another cap alone would leave the offsets without their body.
    TrainSettings alone = settings;
    alone.stages = {"caps"};
    const std::string message =
        test::messageOf<InputError>([&] { trainAvatar(testDevice(), read, capture, alone); });
    EXPECT_NE(message.find("expected stage shape to be trained with it"), std::string::npos)
        << message;
    EXPECT_EQ(readAvatar(folder / "avatar").body.offsets, read.body.offsets);
    // Its outline is nearer to the masks than the body's alone.
    TrainSettings without = settings;
    without.out = folder / "without";
    without.stages = {"shape", "texels"};
    const TrainResult bare = trainAvatar(testDevice(), avatar, capture, without);
    EXPECT_GT(test::meanIou(testDevice(), trained, result.capture, false),
              test::meanIou(testDevice(), bare.avatar, bare.capture, false));
}

}  // namespace
}  // namespace doppel
