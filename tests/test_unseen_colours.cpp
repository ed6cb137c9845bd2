// Colours of what no picture shows, from what one from the front does.
#include "trainer/stages/colours/unseen_colours.h"

#include <gtest/gtest.h>

#include "nn/body/joint.h"
#include "trainer/avatar/avatar.h"

namespace doppel {
namespace {

const glm::dvec3 kSkin(.8, .6, .5), kShirt(.7, .1, .1), kTrousers(.1, .2, .6), kGreen(0, 1, 0);

class UnseenColoursTest : public ::testing::Test {
protected:
    UnseenColoursTest() : body_(bodyFromNpz(readBodyArrays("default"))) {
        const auto vertices = size_t(body_.vertexCount);
        facing_.resize(vertices);
        std::vector<glm::dvec3> normals(vertices);
        auto at = [&](int32_t v) {
            const float* x = &body_.templateVertices[3 * size_t(v)];
            return glm::dvec3(x[0], x[1], x[2]);
        };
        for (size_t f = 0; f < body_.faces.size() / 3; ++f) {
            const int32_t* face = &body_.faces[3 * f];
            const glm::dvec3 normal =
                glm::cross(at(face[1]) - at(face[0]), at(face[2]) - at(face[0]));
            for (int k = 0; k < 3; ++k) normals[size_t(face[k])] += normal;
        }
        const std::vector<double> joints = restJoints(body_, std::vector<double>(10));
        const double waist = joints[3 * joint::kPelvis + 1] + .05;
        for (size_t v = 0; v < vertices; ++v) {
            facing_[v] = normals[v].z / std::max(1e-12, glm::length(normals[v]));
            const float* weights = &body_.weights[v * joint::kCount];
            auto moves = [&](std::initializer_list<int> with) {
                float sum = 0;
                for (int j : with) sum += weights[j];
                return sum > .5f;
            };
            const bool skin = moves({joint::kHead, joint::kNeck}) ||
                              moves({joint::kLeftHand, joint::kRightHand, joint::kLeftWrist,
                                     joint::kRightWrist, joint::kLeftElbow, joint::kRightElbow});
            const bool leg = body_.templateVertices[3 * v + 1] < waist &&
                             !moves({joint::kLeftShoulder, joint::kRightShoulder});
            worn_.push_back(skin ? kSkin : leg ? kTrousers : kShirt);
        }
    }

    BodyModel body_;
    std::vector<double> facing_;    // cosine between a vertex's normal and the front
    std::vector<glm::dvec3> worn_;  // short sleeves
};

TEST_F(UnseenColoursTest, ClothesEndBehindWhereTheyEndBefore) {
    std::vector<glm::dvec3> seen(worn_.size());
    std::vector<double> trust(worn_.size());
    for (size_t v = 0; v < worn_.size(); ++v)
        if (facing_[v] > .25) seen[v] = worn_[v], trust[v] = std::pow(facing_[v], 4);
    const UnseenColours found = unseenColours(body_, seen, trust);
    size_t unseen = 0, wrong = 0;
    double off = 0;
    for (size_t v = 0; v < worn_.size(); ++v) {
        if (trust[v] > 0) continue;
        ++unseen;
        off += glm::distance(found.colours[v], worn_[v]);
        ASSERT_TRUE(found.reached[v]);
        for (const glm::dvec3& other : {kSkin, kShirt, kTrousers})
            if (glm::distance(found.colours[v], other) <
                glm::distance(found.colours[v], worn_[v]) - 1e-9) {
                ++wrong;
                break;
            }
    }
    EXPECT_GT(unseen, worn_.size() / 2);
    EXPECT_LT(double(wrong), .02 * double(unseen));
    EXPECT_LT(off, .035 * double(unseen));  // .05 where all directions cost the same
}

// As a screen shines into the outline.
TEST_F(UnseenColoursTest, WhatIsHardlySeenIsHardlyTrusted) {
    std::vector<glm::dvec3> seen(worn_.size());
    std::vector<double> trust(worn_.size());
    for (size_t v = 0; v < worn_.size(); ++v) {
        if (facing_[v] > .35)
            seen[v] = worn_[v], trust[v] = 1;
        else if (facing_[v] > .25)
            seen[v] = kGreen, trust[v] = 1e-4;
    }
    const UnseenColours found = unseenColours(body_, seen, trust);
    for (size_t v = 0; v < worn_.size(); ++v)
        EXPECT_LT(facing_[v] < .25 ? found.colours[v].y : 0, .75) << v;
}

TEST_F(UnseenColoursTest, NothingSeenIsNothingFound) {
    const std::vector<double> trust(worn_.size());
    const UnseenColours found = unseenColours(body_, worn_, trust);
    EXPECT_EQ(std::ranges::count(found.reached, 1), 0);
    for (size_t v = 0; v < worn_.size(); ++v)
        EXPECT_LT(glm::distance(found.colours[v], worn_[v]), 1e-12);
}

}  // namespace
}  // namespace doppel
