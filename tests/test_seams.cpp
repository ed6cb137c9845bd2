// Both sides of the atlas's seams: what a texture shows of them, and texels that are learned equal
// there.
#include "nn/body/seams.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>

#include "nn/body/texel_places.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/recorded_body.h"
#include "trainer/avatar/preset.h"
#include "trainer/stages/surface.h"

namespace doppel::test {
namespace {

constexpr int kSide = 512;

// [kSide,kSide,3] coloured by where on the body a texel lies, a colour a metre.
std::vector<float> painted(const BodyModel& body) {
    std::vector<float> texels(size_t{3} * kSide * kSide);
    const std::vector<TexelPlace> places = texelPlaces(body, kSide);
    for (size_t i = 0; i < places.size(); ++i) {
        if (places[i].face < 0) continue;
        for (size_t k = 0; k < 3; ++k) {
            const auto v = size_t(body.faces[3 * size_t(places[i].face) + k]);
            for (size_t c = 0; c < 3; ++c)
                texels[3 * i + c] += places[i].corners[k] * body.templateVertices[3 * v + c];
        }
    }
    return texels;
}

// The root of the mean square of the differences across seams.
double across(const SparseMatrix& seams, const std::vector<float>& texels) {
    double sum = 0;
    for (int64_t row = 0; row < seams.rows(); ++row)
        for (size_t c = 0; c < 3; ++c) {
            double difference = 0;
            for (auto n = size_t(seams.begin[size_t(row)]);
                 n < size_t(seams.begin[size_t(row) + 1]); ++n)
                difference +=
                    double{seams.value[n]} * double{texels[3 * size_t(seams.column[n]) + c]};
            sum += difference * difference / 3;
        }
    return std::sqrt(sum / double(seams.rows()));
}

TEST(Seams, BothSidesAreOnePlaceOnTheBody) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const SparseMatrix seams = seamDifferences(body, kSide);
    EXPECT_GT(seams.rows(), 1000);
    EXPECT_EQ(seams.columns, kSide * kSide);
    EXPECT_NEAR(across(seams, std::vector<float>(size_t{3} * kSide * kSide, .7f)), 0, 1e-6);
    // Two places that have no more to do with each other are half a metre apart; a texel is 5 mm.
    EXPECT_LT(across(seams, painted(body)), .02);
    std::vector<float> turned = painted(body);
    std::ranges::rotate(turned, turned.begin() + 3 * kSide * 40);
    EXPECT_GT(across(seams, turned), .1);
}

// What training makes of texels that differ on both sides of every seam.
TEST(Surface, SeamsCloseWhereAsked) {
    Folder folder;
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    const Capture capture = recordedBody(body, body.templateVertices, 4, 128, folder / "capture");
    constexpr int kTexels = 128;
    std::vector<float> texels(size_t{3} * kTexels * kTexels);
    for (size_t i = 0; i < texels.size(); ++i)  // darker to the right
        texels[i] = .3f + .4f * float(i / 3 % kTexels) / kTexels;
    const SparseMatrix seams = seamDifferences(body, kTexels);
    const auto after = [&](double weight) {
        SurfaceRun run{.stage = "texels",
                       .preset = presetByName("ci").texels,
                       .texels = texels,
                       .textureSize = kTexels,
                       .movesTexels = true};
        run.preset.size = 128;
        run.preset.steps = 30;
        run.preset.seams = weight;
        Capture now = capture;
        return across(seams, runSurface(testDevice(), body, now, run)->texels);
    };
    const double without = after(0), with = after(1);
    std::cout << "colours across seams differ by " << across(seams, texels) << ", by " << without
              << " after training, by " << with << " with their own loss\n";
    EXPECT_LT(with, .5 * without);
}

}  // namespace
}  // namespace doppel::test
