// What known people tell of one who is seen from one side: held-out members of the cast, whose
// other side is known.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "engine/error.h"
#include "nn/body/joint.h"
#include "tests/files.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/bake.h"
#include "trainer/stages/colours/unseen_colours.h"
#include "trainer/stages/prior/expected_look.h"

namespace doppel {
namespace {

const BodyModel& body() {
    static const BodyModel model = bodyFromNpz(readBodyArrays("default"));
    return model;
}

const KnownPeople& cast() {
    static const KnownPeople people = readPeople({"cast"}, body(), "--prior");
    return people;
}

KnownPeople withoutMember(size_t member) {
    return readPeople({fmt::format("cast-{}", member)}, body(), "--prior");
}

// How well a member is seen from where z points (1: from before, -1: from behind).
std::vector<double> trustFrom(double z) {
    std::vector<double> trust;
    for (const glm::dvec3& normal : skinNormals(body())) {
        const double facing = z * normal.z;
        trust.push_back(facing > .25 ? std::pow(facing, 4) : 0);
    }
    return trust;
}

struct Told {
    size_t unseen = 0;
    double garments = 0;                   // part that is right, of what is not seen
    double colours = 0, coloursAlone = 0;  // mean distance, with and without the known
    double heights = 0, heightsAlone = 0;  // mean difference, m; without: of the skin
};

Told told(size_t member, double z, const std::function<bool(size_t)>& where) {
    const KnownPerson& person = cast().people[member];
    const std::vector<double> trust = trustFrom(z);
    std::vector<glm::dvec3> seen = person.colours;
    for (size_t v = 0; v < seen.size(); ++v)
        if (trust[v] == 0) seen[v] = glm::dvec3(0);
    const ExpectedLook look = expectedLook(withoutMember(member), body(), seen, trust);
    const UnseenColours with = unseenColours(body(), seen, trust, &look);
    const UnseenColours alone = unseenColours(body(), seen, trust);
    Told result;
    for (size_t v = 0; v < seen.size(); ++v) {
        if (trust[v] > 0 || !where(v)) continue;
        ++result.unseen;
        result.garments += look.garments[v] == person.garments[v];
        result.colours += glm::distance(with.colours[v], person.colours[v]);
        result.coloursAlone += glm::distance(alone.colours[v], person.colours[v]);
        result.heights += std::abs(double{look.heights[v]} - double{person.heights[v]});
        result.heightsAlone += double{person.heights[v]};
    }
    return result;
}

// Over every eighth of the cast.
Told toldOfMembers(double z, const std::function<bool(size_t)>& where) {
    Told sum;
    for (size_t member = 0; member < cast().people.size(); member += 8) {
        const Told one = told(member, z, where);
        sum.unseen += one.unseen;
        for (auto field : {&Told::garments, &Told::colours, &Told::coloursAlone, &Told::heights,
                           &Told::heightsAlone})
            sum.*field += one.*field;
    }
    for (auto field : {&Told::garments, &Told::colours, &Told::coloursAlone, &Told::heights,
                       &Told::heightsAlone})
        sum.*field /= double(sum.unseen);
    return sum;
}

TEST(KnownPeople, TheCastIsFiftyPeople) {
    ASSERT_EQ(cast().people.size(), 50u);
    for (const KnownPerson& person : cast().people) {
        ASSERT_EQ(person.garments.size(), size_t(body().vertexCount));
        std::array<size_t, kGarmentCount> counts{};
        for (Garment garment : person.garments) ++counts[number(garment)];
        for (size_t count : counts) EXPECT_GT(count, 20u);
        for (size_t v = 0; v < person.garments.size(); ++v)
            EXPECT_TRUE(person.garments[v] != Garment::Skin || person.heights[v] == 0);
    }
    EXPECT_FALSE(cast().digest.empty());
}

TEST(KnownPeople, MembersOfTheCastCanBeLeftOut) {
    const KnownPeople others = readPeople({"cast-7-19-49"}, body(), "--prior");
    ASSERT_EQ(others.people.size(), 47u);
    std::vector<size_t> whole(cast().people.size());
    std::iota(whole.begin(), whole.end(), size_t{0});
    for (size_t gone : {7u, 19u, 49u}) std::erase(whole, gone);
    for (size_t k = 0; k < whole.size(); ++k)
        EXPECT_EQ(others.people[k].colours, cast().people[whole[k]].colours) << k;
    EXPECT_NE(others.digest, cast().digest);
    for (const char* word : {"cast-50", "cast-", "cast-x", "cast-1-", "cast7"}) {
        const std::string said =
            test::messageOf<InputError>([&] { readPeople({word}, body(), "--prior"); });
        EXPECT_NE(said.find("--prior"), said.npos) << word;
    }
}

TEST(KnownPeople, TellTheBackOfWhoIsSeenFromBefore) {
    const Told all = toldOfMembers(1, [](size_t) { return true; });
    EXPECT_GT(all.unseen, 7 * size_t(body().vertexCount) / 3);
    EXPECT_GT(all.garments, .95);
    EXPECT_LT(all.colours, .85 * all.coloursAlone);
    EXPECT_LT(all.heights, .4 * all.heightsAlone);
}

TEST(KnownPeople, GiveAFaceToWhoIsSeenFromBehind) {
    const Told face = toldOfMembers(-1, [](size_t v) { return body().face[v] != 0; });
    EXPECT_GT(face.garments, .95);
    EXPECT_LT(face.colours, .75 * face.coloursAlone);
}

// Hardly anybody's belly is bare. Of who shows hers it is skin, and her back is as of those who
// show theirs.
TEST(KnownPeople, ABareBellyIsSkinBehindToo) {
    constexpr size_t kBare = 39;
    const KnownPerson& person = cast().people[kBare];
    auto isWaist = [](size_t v) {
        const float* weights = &body().weights[v * joint::kCount];
        return weights[joint::kSpine1] + weights[joint::kSpine2] > .5f;
    };
    const std::vector<double> trust = trustFrom(1);
    std::vector<glm::dvec3> seen = person.colours;
    for (size_t v = 0; v < seen.size(); ++v)
        if (trust[v] == 0) seen[v] = glm::dvec3(0);
    const ExpectedLook look = expectedLook(withoutMember(kBare), body(), seen, trust);
    std::array<size_t, 2> bare{}, right{};  // not seen, seen
    for (size_t v = 0; v < seen.size(); ++v) {
        if (!isWaist(v) || person.garments[v] != Garment::Skin) continue;
        const size_t which = trust[v] > 0;
        ++bare[which];
        right[which] += look.garments[v] == Garment::Skin;
    }
    for (size_t which : {0u, 1u}) {
        ASSERT_GT(bare[which], 50u);
        EXPECT_GT(double(right[which]), .95 * double(bare[which])) << which;
    }
}

// Whose forehead is higher than others': what they have hair on is seen to be skin, and what is
// seen of her own is a strip on the crown.
TEST(KnownPeople, HairIsWhatIsNoFacesColour) {
    const glm::dvec3 skin(.85, .7, .6), hair(.2, .15, .1);
    std::vector<glm::dvec3> seen(size_t(body().vertexCount), skin);
    const std::vector<double> trust = trustFrom(1);
    float top = 0;
    for (size_t v = 0; v < seen.size(); ++v)
        top = std::max(top, body().templateVertices[3 * v + 1]);
    for (size_t v = 0; v < seen.size(); ++v)
        if (body().templateVertices[3 * v + 1] > top - .03f) seen[v] = hair;
    const ExpectedLook look = expectedLook(cast(), body(), seen, trust);
    size_t behind = 0;
    for (size_t v = 0; v < seen.size(); ++v) {
        if (body().templateVertices[3 * v + 1] < top - .16f ||
            body().templateVertices[3 * v + 2] > -.02f)
            continue;
        ++behind;
        EXPECT_LT(glm::distance(look.colours[v], hair), .1) << v;
    }
    EXPECT_GT(behind, 20u);
}

// Long hair seen from before: bands on both sides of the face, from the crown to the chin. Nobody
// of the cast wears hair there; what lies behind it is hair all the same, and the face is not.
TEST(KnownPeople, WhatHairHidesIsHair) {
    const glm::dvec3 skin(.85, .66, .55), hair(.13, .08, .06), shirt(.7, .7, .72);
    const std::vector<float>& places = body().templateVertices;
    const std::vector<double> trust = trustFrom(1);
    float top = 0;
    for (size_t v = 0; v < trust.size(); ++v) top = std::max(top, places[3 * v + 1]);
    auto isHead = [&](size_t v) { return body().weights[v * joint::kCount + joint::kHead] > .9f; };
    std::vector<glm::dvec3> seen(trust.size(), shirt);
    for (size_t v = 0; v < seen.size(); ++v)
        if (isHead(v))
            seen[v] =
                places[3 * v + 1] > top - .06f || std::abs(places[3 * v]) > .035f ? hair : skin;
    const ExpectedLook look = expectedLook(cast(), body(), seen, trust);
    size_t behind = 0, haired = 0, faces = 0, skinned = 0;
    for (size_t v = 0; v < seen.size(); ++v) {
        if (!isHead(v)) continue;
        const float x = std::abs(places[3 * v]), y = places[3 * v + 1];
        if (trust[v] == 0 && x > .045f && y > top - .16f) {
            ++behind;
            haired += look.garments[v] == Garment::Hair;
        } else if (trust[v] > .3 && x < .03f && y < top - .07f) {
            ++faces;
            skinned += look.garments[v] == Garment::Skin;
        }
    }
    ASSERT_GT(behind, 50u);
    ASSERT_GT(faces, 50u);
    EXPECT_GT(double(haired), .95 * double(behind)) << haired << " of " << behind;
    EXPECT_GT(double(skinned), .95 * double(faces)) << skinned << " of " << faces;
}

// A head that is turned by a few degrees less than it seems has skin on its temples, where hair is
// to be expected: the back of the head does not take after them.
TEST(KnownPeople, TemplesOfSkinAreNotSpreadOverHair) {
    const glm::dvec3 skin(.36, .19, .11), hair(.24, .22, .2);  // 25 of L*a*b* apart
    ExpectedLook look;
    std::vector<glm::dvec3> seen;
    std::vector<double> trust;
    for (size_t v = 0; v < size_t(body().vertexCount); ++v) {
        const bool isHead = body().weights[v * joint::kCount + joint::kHead] > .9f;
        const bool isHair = isHead && !body().face[v];
        look.garments.push_back(isHair ? Garment::Hair : Garment::Skin);
        look.colours.push_back(isHair ? hair : skin);
        const float x = body().templateVertices[3 * v], z = body().templateVertices[3 * v + 2];
        seen.push_back(skin);
        trust.push_back(body().face[v] || (isHair && std::abs(x) > .05f && z > .04f) ? .5 : 0);
    }
    const UnseenColours colours = unseenColours(body(), seen, trust, &look);
    size_t behind = 0;
    double off = 0;
    for (size_t v = 0; v < seen.size(); ++v) {
        if (trust[v] > 0 || look.garments[v] != Garment::Hair ||
            body().templateVertices[3 * v + 2] > .02f)
            continue;
        ++behind;
        off += glm::distance(colours.colours[v], hair);
    }
    ASSERT_GT(behind, 50u);
    EXPECT_LT(off / double(behind), .2 * glm::distance(skin, hair));
}

TEST(KnownPeople, AreAvatarsToo) {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = body();
    const KnownPerson& member = cast().people[0];
    // A texel has the colour of its nearest vertex.
    avatar.textureSize = 256;
    avatar.texture.resize(3 * 256 * 256);
    const std::vector<TexelPlace> places = texelPlaces(body(), 256);
    for (size_t t = 0; t < places.size(); ++t) {
        if (places[t].face < 0) continue;
        const auto nearest =
            size_t(std::ranges::max_element(places[t].corners) - places[t].corners.begin());
        const glm::dvec3& colour =
            member.colours[size_t(body().faces[3 * size_t(places[t].face) + nearest])];
        for (int c = 0; c < 3; ++c) avatar.texture[3 * t + size_t(c)] = float(colour[c]);
    }
    setOffsets(avatar, offsetsOf(body(), member.heights));
    const test::Folder folder;
    writeAvatar(folder / "avatars" / "ann", avatar);
    const KnownPeople one = readPeople({(folder / "avatars").string()}, body(), "--prior");
    ASSERT_EQ(one.people.size(), 1u);
    size_t same = 0;
    double off = 0;
    for (size_t v = 0; v < member.garments.size(); ++v) {
        same += one.people[0].garments[v] == member.garments[v];
        if (one.people[0].garments[v] != Garment::Skin)
            off += std::abs(double{one.people[0].heights[v]} - double{member.heights[v]});
    }
    EXPECT_GT(double(same), .85 * double(member.garments.size()));
    EXPECT_LT(off / double(member.garments.size()), 1e-3);
    EXPECT_NE(one.digest, cast().digest);
    const KnownPeople both =
        readPeople({"cast", (folder / "avatars" / "ann").string()}, body(), "--prior");
    EXPECT_EQ(both.people.size(), 51u);

    BodyModel other = body();
    other.templateVertices[0] += .1f;
    other.file = "other.npz";
    auto refused = [](const std::vector<std::string>& from, const BodyModel& model,
                      const std::string& named) {
        const std::string said =
            test::messageOf<InputError>([&] { readPeople(from, model, "--prior"); });
        EXPECT_NE(said.find("--prior"), said.npos);
        EXPECT_NE(said.find(named), said.npos) << said;
    };
    refused({"cast"}, other, "other.npz");
    refused({(folder / "avatars").string()}, other, "ann");
    refused({(folder / "nobody").string()}, body(), "nobody");
    std::filesystem::create_directory(folder / "empty");
    refused({(folder / "empty").string()}, body(), "empty");
    refused({""}, body(), "\"\"");
    EXPECT_TRUE(readPeople({}, body(), "--prior").people.empty());

    // As `doppel avatar` leaves them; and whoever is being written does not tell of herself.
    writeAvatar(folder / "avatars" / "bea" / "avatar", avatar);
    const std::vector<std::string> all{(folder / "avatars").string()};
    EXPECT_EQ(readPeople(all, body(), "--prior").people.size(), 2u);
    const auto bea = folder / "avatars" / "bea" / "avatar";
    EXPECT_EQ(readPeople(all, body(), "--prior", bea).people.size(), 1u);
    EXPECT_EQ(readPeople(all, body(), "--prior", folder / "new").people.size(), 2u);
    const std::string herself =
        test::messageOf<InputError>([&] { readPeople({bea.string()}, body(), "--prior", bea); });
    EXPECT_NE(herself.find("bea"), herself.npos) << herself;
}

}  // namespace
}  // namespace doppel
