#include "trainer/avatar/mix/mix.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>
#include <sstream>

#include "nn/body/mesh_topology.h"
#include "tests/files.h"
#include "trainer/avatar/bake.h"
#include "trainer/commands/cli.h"

namespace doppel {
namespace {

constexpr int kSize = 256;  // of textures
using Colour = std::array<float, 3>;
constexpr Colour kBlack{.06f, .04f, .03f}, kBrown{.4f, .25f, .1f}, kBlue{.1f, .2f, .6f},
    kRed{.7f, .1f, .1f}, kGrey{.5f, .5f, .52f}, kGreen{.1f, .4f, .15f}, kPale{.85f, .68f, .6f},
    kDark{.45f, .3f, .22f};

// A person painted onto the model, who wears what she is told to at each vertex.
struct Painted {
    std::array<Colour, kGarmentCount> colours{};  // skin, hair, top, bottom, shoes
    // Whether the sleeves reach the wrists, and hair the waist.
    bool longSleeves = false, longHair = false;
    // Whether legs are bare down to socks, which are shoes here, and the top covers the hips; shoes
    // as high as those socks under trousers.
    bool bareLegs = false, longTop = false, boots = false;
    bool bareShoulders = false;  // above sleeves
};
constexpr Painted kAnn{{kPale, kBrown, kBlue, kGrey, kGreen}};
constexpr Painted kBea{{kDark, kBlack, kRed, kGreen, kGrey}, true};

const BodyModel& body() {
    static const BodyModel model = bodyFromNpz(readBodyArrays("default"));
    return model;
}

Garment wornAt(const Painted& person, size_t v) {
    const float* weights = &body().weights[v * joint::kCount];
    const auto most =
        static_cast<size_t>(std::max_element(weights, weights + joint::kCount) - weights);
    const float y = body().templateVertices[3 * v + 1], z = body().templateVertices[3 * v + 2];
    switch (most) {
        case joint::kHead:
            return body().face[v] ? Garment::Skin : Garment::Hair;
        case joint::kNeck:
            return person.longHair && z < .04f ? Garment::Hair : Garment::Skin;
        case joint::kLeftWrist:
        case joint::kRightWrist:
        case joint::kLeftHand:
        case joint::kRightHand:
            return Garment::Skin;
        case joint::kLeftElbow:
        case joint::kRightElbow:
            return person.longSleeves ? Garment::Top : Garment::Skin;
        case joint::kLeftFoot:
        case joint::kRightFoot:
        case joint::kLeftAnkle:
        case joint::kRightAnkle:
            if (y < (person.bareLegs || person.boots ? -.9f : -1.02f)) return Garment::Shoes;
            return person.bareLegs ? Garment::Skin : Garment::Bottom;
        case joint::kPelvis:
        case joint::kLeftHip:
        case joint::kRightHip:
            if (person.longTop && y > -.32f) return Garment::Top;
            return person.bareLegs && y < -.5f ? Garment::Skin : Garment::Bottom;
        case joint::kLeftKnee:
        case joint::kRightKnee:
            if ((person.bareLegs || person.boots) && y < -.9f) return Garment::Shoes;
            return person.bareLegs ? Garment::Skin : Garment::Bottom;
        case joint::kLeftShoulder:
        case joint::kRightShoulder:
            return person.bareShoulders && std::abs(body().templateVertices[3 * v]) < .25f
                       ? Garment::Skin
                       : Garment::Top;
        case joint::kLeftCollar:
        case joint::kRightCollar:
            return person.bareShoulders ? Garment::Skin : Garment::Top;
        default:
            if (person.bareShoulders && y > .12f) return Garment::Skin;
            return person.longHair && z < .01f && std::abs(body().templateVertices[3 * v]) < .08f
                       ? Garment::Hair
                       : Garment::Top;
    }
}

// [size,size,3] Texels of colours [V], with noise.
std::vector<float> paint(const std::function<Colour(size_t)>& colourOf) {
    std::mt19937 random(1);
    std::normal_distribution<float> noise(0, .02f);
    const std::vector<TexelPlace> places = texelPlaces(body(), kSize);
    std::vector<float> texture(3 * places.size());
    for (size_t t = 0; t < places.size(); ++t) {
        if (places[t].face < 0) continue;
        const auto nearest =
            size_t(std::ranges::max_element(places[t].corners) - places[t].corners.begin());
        const Colour colour = colourOf(size_t(body().faces[3 * size_t(places[t].face) + nearest]));
        for (size_t c = 0; c < 3; ++c) texture[3 * t + c] = colour[c] + noise(random);
    }
    return texture;
}

Avatar avatarOf(const Painted& person, float forward = 0) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = body();
    std::vector<float> offsets(3 * size_t(body().vertexCount));
    for (size_t v = 0; v < size_t(body().vertexCount); ++v) offsets[3 * v + 2] = forward;
    setOffsets(avatar, offsets);
    avatar.texture = paint([&](size_t v) { return person.colours[number(wornAt(person, v))]; });
    avatar.textureSize = kSize;
    return avatar;
}

Colour meanWhere(const Avatar& avatar, const std::function<bool(size_t)>& where) {
    const auto colours = vertexColours(avatar.body, avatar.texture, avatar.textureSize);
    glm::dvec3 sum(0);
    double count = 0;
    for (size_t v = 0; v < colours.size(); ++v) {
        if (!where(v)) continue;
        sum += colours[v];
        ++count;
    }
    EXPECT_GT(count, 20);
    return {float(sum.x / count), float(sum.y / count), float(sum.z / count)};
}

void expectColour(const Colour& found, const Colour& expected) {
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[c], expected[c], .04f) << "channel " << c;
}

auto movedBy(std::initializer_list<joint::Number> joints) {
    return [joints = std::vector(joints)](size_t v) {
        float sum = 0;
        for (joint::Number j : joints) sum += body().weights[v * joint::kCount + j];
        return sum > .95f;
    };
}

double partThatAgrees(const Painted& person, const std::vector<Garment>& garments) {
    double same = 0;
    for (size_t v = 0; v < garments.size(); ++v) same += garments[v] == wornAt(person, v);
    return same / double(garments.size());
}

TEST(Garments, AreToldByColourAndPlace) {
    for (const Painted& person : {kAnn, kBea})
        EXPECT_GT(partThatAgrees(person, segmentGarments(body(), avatarOf(person).texture, kSize)),
                  .98);
    Painted longHair = kAnn;
    longHair.longHair = true;
    EXPECT_GT(partThatAgrees(longHair, segmentGarments(body(), avatarOf(longHair).texture, kSize)),
              .97);
    // A short skirt over legs is no long one.
    Painted skirt = kAnn;
    skirt.bareLegs = true;
    EXPECT_GT(partThatAgrees(skirt, segmentGarments(body(), avatarOf(skirt).texture, kSize)), .98);
}

TEST(Garments, SleevesMayBeginBelowBareShoulders) {
    Painted bare = kAnn;
    bare.bareShoulders = true;
    const Avatar ann = avatarOf(bare), bea = avatarOf(kBea);
    const auto sleeves = [&](size_t v) {
        return wornAt(bare, v) == Garment::Top &&
               movedBy({joint::kLeftShoulder, joint::kRightShoulder})(v);
    };
    const std::vector<Garment> garments = segmentGarments(body(), ann.texture, kSize);
    size_t wrong = 0, all = 0;
    for (size_t v = 0; v < garments.size(); ++v)
        if (sleeves(v)) ++all, wrong += garments[v] != Garment::Top;
    ASSERT_GT(all, 50u);
    EXPECT_LT(wrong, all / 20);
    // Of another's skin they keep their colour, and shoulders take hers.
    const Avatar mixed = mixAvatars({.base = &bea, .top = &ann}).avatar;
    expectColour(meanWhere(mixed, sleeves), kBlue);
    const auto shoulders = [&](size_t v) {
        return wornAt(bare, v) == Garment::Skin &&
               movedBy({joint::kSpine3, joint::kLeftCollar, joint::kRightCollar})(v);
    };
    expectColour(meanWhere(mixed, shoulders), kDark);
}

TEST(Garments, APrintIsOfItsShirt) {
    auto printed = [](size_t v) {
        const float* x = &body().templateVertices[3 * v];
        return std::hypot(x[0], x[1] - .1f) < .06f && x[2] > .03f;
    };
    const std::vector<float> texture = paint(
        [&](size_t v) { return printed(v) ? kBrown : kAnn.colours[number(wornAt(kAnn, v))]; });
    const std::vector<Garment> garments = segmentGarments(body(), texture, kSize);
    size_t prints = 0;
    for (size_t v = 0; v < garments.size(); ++v)
        if (printed(v)) {
            ++prints;
            EXPECT_EQ(garments[v], Garment::Top) << "vertex " << v;
        }
    EXPECT_GT(prints, 20u);
}

TEST(Mix, OfOneIsThatOne) {
    const Avatar ann = avatarOf(kAnn, .01f);
    const Mix mix = mixAvatars({.base = &ann, .top = &ann});
    EXPECT_EQ(mix.avatar.body.offsets, ann.body.offsets);
    EXPECT_EQ(mix.unseen, 0);
    EXPECT_NEAR(mix.given[0], 1, 1e-9);
    const std::vector<TexelPlace> places = texelPlaces(body(), kSize);
    for (size_t t = 0; t < places.size(); ++t)
        for (size_t c = 0; c < 3 && places[t].face >= 0; ++c)
            ASSERT_NEAR(mix.avatar.texture[3 * t + c], ann.texture[3 * t + c], 1e-5f);
}

TEST(Mix, TakesAGarmentWithItsSurfaceAndNothingElse) {
    const Avatar ann = avatarOf(kAnn), bea = avatarOf(kBea, .01f);
    const Mix mix = mixAvatars({.base = &ann, .top = &bea});
    const auto chest = movedBy({joint::kSpine2, joint::kSpine3});
    const auto forearms = movedBy({joint::kLeftElbow, joint::kRightElbow});
    const auto hands = movedBy({joint::kLeftHand, joint::kRightHand});
    const auto legs = movedBy({joint::kLeftKnee, joint::kRightKnee});
    expectColour(meanWhere(mix.avatar, chest), kRed);
    expectColour(meanWhere(mix.avatar, forearms), kRed);
    expectColour(meanWhere(mix.avatar, hands), kPale);
    expectColour(meanWhere(mix.avatar, legs), kGrey);
    EXPECT_GT(mix.given[3], .2);
    for (size_t v = 0; v < size_t(body().vertexCount); ++v) {
        const float forward = mix.avatar.body.offsets[3 * v + 2];
        if (chest(v)) {
            EXPECT_NEAR(forward, .01f, 1e-4f);
        } else if (legs(v) || hands(v)) {
            EXPECT_NEAR(forward, 0, 1e-4f);
        }
    }

    // The other way round arms show that were under sleeves: those of whom gives the top, in the
    // colour of the other's face.
    const Mix bare = mixAvatars({.base = &bea, .top = &ann});
    expectColour(meanWhere(bare.avatar, chest), kBlue);
    expectColour(meanWhere(bare.avatar, forearms), kDark);
    expectColour(meanWhere(bare.avatar, hands), kDark);
}

TEST(Mix, SkinHasTheColourOfTheHeads) {
    const Avatar ann = avatarOf(kAnn), bea = avatarOf(kBea);
    const Mix mix = mixAvatars({.base = &ann, .head = &bea});
    expectColour(meanWhere(mix.avatar, [](size_t v) { return body().face[v] != 0; }), kDark);
    expectColour(meanWhere(mix.avatar, movedBy({joint::kLeftHand, joint::kRightHand})), kDark);
    expectColour(meanWhere(mix.avatar, movedBy({joint::kSpine2, joint::kSpine3})), kBlue);
    // Hair goes with the head unless it is somebody else's.
    const auto crown = [](size_t v) { return body().templateVertices[3 * v + 1] > .5f; };
    expectColour(meanWhere(mix.avatar, crown), kBlack);
    expectColour(meanWhere(mixAvatars({.base = &ann, .head = &bea, .hair = &ann}).avatar, crown),
                 kBrown);
}

// Pictures show some of a shirt in the texels of the skin beside it. Under another head's colours
// that part stays a shirt's: as dark skin it would be black, a line around the neck.
TEST(Mix, SkinEndsWithoutADarkLine) {
    Avatar ann = avatarOf(kAnn);
    const Avatar bea = avatarOf(kBea);
    const std::vector<TexelPlace> places = texelPlaces(body(), kSize);
    const MeshTopology mesh = meshTopology(body().faces, body().vertexCount, "body");
    const auto besideTop = [&](size_t v) {
        for (int32_t k = mesh.adjacency.begin[v]; k < mesh.adjacency.begin[v + 1]; ++k)
            if (wornAt(kAnn, size_t(mesh.adjacency.neighbours[size_t(k)])) == Garment::Top)
                return true;
        return false;
    };
    std::vector<size_t> rim;
    for (size_t t = 0; t < places.size(); ++t) {
        if (places[t].face < 0) continue;
        size_t skin = 0, beside = 0;
        for (size_t i = 0; i < 3; ++i) {
            const auto v = size_t(body().faces[3 * size_t(places[t].face) + i]);
            skin += wornAt(kAnn, v) == Garment::Skin;
            beside += besideTop(v);
        }
        if (skin < 3 || beside == 0) continue;
        rim.push_back(t);
        // None at the corners, which tell what is skin, and two thirds in the middle.
        const float shirt = 2 * std::ranges::min(places[t].corners);
        for (size_t c = 0; c < 3; ++c)
            ann.texture[3 * t + c] = std::lerp(kPale[c], kBlue[c], shirt);
    }
    ASSERT_GT(rim.size(), 100u);
    const Mix mix = mixAvatars({.base = &ann, .head = &bea});
    const auto light = [](const auto* c) {
        return .2126 * double(c[0]) + .7152 * double(c[1]) + .0722 * double(c[2]);
    };
    const double darkest = std::min(light(kDark.data()), light(kBlue.data()));
    double deepest = 0;
    for (const size_t t : rim)
        deepest = std::max(deepest, darkest - light(&mix.avatar.texture[3 * t]));
    EXPECT_LT(deepest, .06);
}

TEST(Mix, HandsAreWhoseTheyAre) {
    const Avatar ann = avatarOf(kAnn), bea = avatarOf(kBea, .01f);
    const Mix mix = mixAvatars({.base = &ann, .hands = &bea});
    const auto hands = movedBy({joint::kLeftHand, joint::kRightHand});
    const auto chest = movedBy({joint::kSpine2, joint::kSpine3});
    expectColour(meanWhere(mix.avatar, hands), kPale);  // as the face is
    for (size_t v = 0; v < size_t(body().vertexCount); ++v) {
        const float forward = mix.avatar.body.offsets[3 * v + 2];
        if (hands(v)) {
            EXPECT_NEAR(forward, .01f, 1e-4f);
        } else if (chest(v)) {
            EXPECT_NEAR(forward, 0, 1e-4f);
        }
    }
    EXPECT_GT(mix.given[6], .02);
    EXPECT_LT(mix.given[6], .3);
}

// From the command line, with folders: what each gives, and the seam at the waist and the ankles.
TEST(Mix, IsACommand) {
    test::Folder folder;
    writeAvatar(folder / "ann", avatarOf(kAnn));
    writeAvatar(folder / "bea", avatarOf(kBea, .01f));
    std::ostringstream out, err;
    ASSERT_EQ(
        runCommandLine({"mix", (folder / "ann").string(), "--bottom", (folder / "bea").string(),
                        "--shoes", (folder / "bea").string(), "--out", (folder / "mixed").string()},
                       out, err),
        0)
        << err.str();
    const Avatar mixed = readAvatar(folder / "mixed");
    expectColour(meanWhere(mixed, movedBy({joint::kLeftKnee, joint::kRightKnee})), kGreen);
    expectColour(meanWhere(mixed, movedBy({joint::kLeftFoot, joint::kRightFoot})), kGrey);
    expectColour(meanWhere(mixed, movedBy({joint::kSpine2, joint::kSpine3})), kBlue);
    // Neighbours go over into each other: no edge tears where one surface is a centimetre before
    // the other.
    const MeshTopology mesh = meshTopology(body().faces, body().vertexCount, "body");
    double steepest = 0;
    for (size_t e = 0; e < mesh.edges.size() / 2; ++e) {
        const auto a = size_t(mesh.edges[2 * e]), b = size_t(mesh.edges[2 * e + 1]);
        steepest = std::max(steepest, std::abs(double(mixed.body.offsets[3 * a + 2]) -
                                               double(mixed.body.offsets[3 * b + 2])));
    }
    EXPECT_GT(steepest, 1e-4);
    EXPECT_LT(steepest, .006);
}

TEST(Mix, WhatHairCoveredTakesAfterTheGarmentAround) {
    Painted covered = kAnn;
    covered.longHair = true;
    const Avatar ann = avatarOf(covered), bea = avatarOf(kBea);
    const Mix mix = mixAvatars({.base = &ann, .hair = &bea});
    EXPECT_GT(mix.unseen, .01);
    expectColour(meanWhere(mix.avatar,
                           [&](size_t v) {
                               return wornAt(covered, v) == Garment::Hair &&
                                      movedBy({joint::kSpine2, joint::kSpine3})(v);
                           }),
                 kBlue);
}

// [V] Of legs, how high above the soles: shares of heights.
auto onLegs(float from, float to) {
    return [=](size_t v) {
        const float y = body().templateVertices[3 * v + 1];
        return y > from && y < to;
    };
}

TEST(Mix, ShoesUnderAnothersSkirtAreWholeAndSocksAreTheSkirts) {
    Painted skirted = kBea;
    skirted.bareLegs = true;
    skirted.colours[number(Garment::Shoes)] = kBlack;
    const Avatar ann = avatarOf(kAnn), bea = avatarOf(skirted);
    const Mix mix = mixAvatars({.base = &ann, .bottom = &bea});
    expectColour(meanWhere(mix.avatar, onLegs(-2, -1.05f)), kGreen);    // ann's shoes
    expectColour(meanWhere(mix.avatar, onLegs(-1.0f, -.93f)), kBlack);  // bea's socks
    expectColour(meanWhere(mix.avatar, onLegs(-.85f, -.6f)), kPale);    // legs of ann's colour
    EXPECT_LT(mix.unseen, .01);
}

TEST(Mix, TrousersReachATopThatIsShorterThanTheirs) {
    Painted covering = kBea;
    covering.longTop = true;
    const Avatar ann = avatarOf(kAnn), bea = avatarOf(covering);
    const Mix mix = mixAvatars({.base = &bea, .top = &ann});
    const auto hips = [](size_t v) {
        const float y = body().templateVertices[3 * v + 1];
        return wornAt(kAnn, v) == Garment::Bottom && y > -.25f;
    };
    expectColour(meanWhere(mix.avatar, hips), kGreen);
}

TEST(Mix, TrousersHangDownOverAnothersShoes) {
    Painted boots = kAnn;
    boots.boots = true;
    Painted low = kBea;
    low.colours[number(Garment::Shoes)] = kBlack;
    const Avatar ann = avatarOf(boots), bea = avatarOf(low);
    // Bea's shoes end below where ann's trousers do.
    const Mix mix = mixAvatars({.base = &ann, .shoes = &bea});
    expectColour(meanWhere(mix.avatar, onLegs(-1, -.93f)), kGrey);
    expectColour(meanWhere(mix.avatar, onLegs(-2, -1.06f)), kBlack);
}

// Texels beside a seam show some of the other side, which goes with it.
TEST(Mix, HemsAreWithoutWhatWasWornBelow) {
    Avatar ann = avatarOf(kAnn);
    const Avatar bea = avatarOf(kBea);
    const std::vector<TexelPlace> places = texelPlaces(body(), kSize);
    const MeshTopology mesh = meshTopology(body().faces, body().vertexCount, "body");
    std::vector<size_t> hem;
    for (size_t t = 0; t < places.size(); ++t) {
        if (places[t].face < 0) continue;
        bool top = true, beside = false;
        for (size_t i = 0; i < 3; ++i) {
            const auto v = size_t(body().faces[3 * size_t(places[t].face) + i]);
            top = top && wornAt(kAnn, v) == Garment::Top;
            beside = beside || std::ranges::any_of(mesh.adjacency.of(v), [](int32_t n) {
                         return wornAt(kAnn, size_t(n)) == Garment::Bottom;
                     });
        }
        if (!top || !beside) continue;
        hem.push_back(t);
        for (size_t c = 0; c < 3; ++c) ann.texture[3 * t + c] = std::lerp(kBlue[c], kGrey[c], .75f);
    }
    ASSERT_GT(hem.size(), 50u);
    const Mix mix = mixAvatars({.base = &ann, .bottom = &bea});
    double grey = 0;
    for (size_t t : hem) {
        const float* texel = &mix.avatar.texture[3 * t];
        grey += double(texel[0] - kBlue[0]) / double(kGrey[0] - kBlue[0]) / double(hem.size());
    }
    EXPECT_LT(grey, .25);
    // Where the trousers stay, so do the texels.
    const Mix same = mixAvatars({.base = &ann, .hair = &bea});
    for (size_t t : hem) EXPECT_NEAR(same.avatar.texture[3 * t], ann.texture[3 * t], 1e-5f);
}

// What shines on pale skin is no white spot on dark skin.
TEST(Mix, ShadesOfSkinAreInProportion) {
    Avatar ann = avatarOf(kAnn);
    const Avatar bea = avatarOf(kBea);
    const auto forearms = movedBy({joint::kLeftElbow, joint::kRightElbow});
    const std::vector<TexelPlace> places = texelPlaces(body(), kSize);
    std::vector<size_t> shining;
    for (size_t t = 0; t < places.size(); t += 7) {
        if (places[t].face < 0 || !forearms(size_t(body().faces[3 * size_t(places[t].face)])))
            continue;
        shining.push_back(t);
        for (size_t c = 0; c < 3; ++c) ann.texture[3 * t + c] = .97f;
    }
    ASSERT_GT(shining.size(), 50u);
    const Mix mix = mixAvatars({.base = &ann, .head = &bea});
    for (size_t t : shining)
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(mix.avatar.texture[3 * t + c], .97f * kDark[c] / kPale[c], .06f);
}

TEST(Mix, IsLitAsItsBaseIs) {
    Avatar ann = avatarOf(kAnn);
    ann.light.assign(24, .1f);
    const Avatar bea = avatarOf(kBea);
    EXPECT_EQ(mixAvatars({.base = &ann, .top = &bea}).avatar.light, ann.light);
}

TEST(Mix, ShapeIsOfTheBodyUnderClothes) {
    Avatar ann = avatarOf(kAnn), bea = avatarOf(kBea, .01f);
    bea.betas[0] = 1.5f;
    const Mix mix = mixAvatars({.base = &ann, .shape = &bea});
    EXPECT_EQ(mix.avatar.betas, bea.betas);
    EXPECT_EQ(mix.avatar.body.offsets, ann.body.offsets);
}

TEST(Mix, OtherBodiesAreRefused) {
    const Avatar ann = avatarOf(kAnn);
    Avatar other = avatarOf(kBea);
    other.body.templateVertices[0] += .1f;
    other.body.file = "other.npz";
    const std::string message =
        test::messageOf<InputError>([&] { mixAvatars({.base = &ann, .top = &other}); });
    EXPECT_NE(message.find("other.npz: expected the body model of"), std::string::npos) << message;
}

}  // namespace
}  // namespace doppel
