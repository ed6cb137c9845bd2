// Points of faces: where they lie on the body, how frames' wishes for them are counted, and what
// they teach of a face that outlines do not show.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>

#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/recorded_body.h"
#include "trainer/avatar/preset.h"
#include "trainer/data/body_render.h"
#include "trainer/person/heads.h"
#include "trainer/stages/surface.h"

namespace doppel::test {
namespace {

glm::dvec3 placeOf(const BodyModel& body, std::span<const float> verts, size_t point) {
    glm::dvec3 place(0);
    for (size_t k = 3 * point; k < 3 * point + 3; ++k) {
        const auto v = 3 * static_cast<size_t>(body.facePoints.corners[k]);
        place +=
            double{body.facePoints.weights[k]} * glm::dvec3(verts[v], verts[v + 1], verts[v + 2]);
    }
    return place;
}

// By points whose numbers in Face Mesh are well known.
TEST(DefaultBody, KnowsWhereAFaceHasItsPoints) {
    for (const char* name : {"default", "default-full"}) {
        const BodyModel body = bodyFromNpz(readBodyArrays(name));
        const auto at = [&](size_t point) { return placeOf(body, body.templateVertices, point); };
        ASSERT_EQ(body.facePoints.trust.size(), kFacePoints);
        EXPECT_GT(std::ranges::count_if(body.facePoints.trust, [](float t) { return t > .3f; }),
                  400);
        const glm::dvec3 nose = at(1), chin = at(152), forehead = at(10), leftEye = at(263),
                         rightEye = at(33), leftMouth = at(291), rightMouth = at(61);
        for (const glm::dvec3& middle : {nose, chin, forehead}) EXPECT_NEAR(middle.x, 0, 1e-3);
        EXPECT_NEAR(leftEye.x, .043, .004);  // outer corners
        EXPECT_NEAR(leftMouth.x, .023, .004);
        EXPECT_NEAR(glm::length(leftEye - rightEye * glm::dvec3(-1, 1, 1)), 0, 1e-3);
        EXPECT_NEAR(glm::length(leftMouth - rightMouth * glm::dvec3(-1, 1, 1)), 0, 1e-3);
        EXPECT_GT(nose.z, leftEye.z + .02);
        EXPECT_GT(forehead.y, leftEye.y + .03);
        EXPECT_GT(leftEye.y, nose.y);
        EXPECT_GT(nose.y, leftMouth.y);
        EXPECT_GT(leftMouth.y, chin.y + .02);
    }
}

TEST(FaceTargets, CountWhereTheFaceIsSeen) {
    const BodyModel body = bodyFromNpz(readBodyArrays("default"));
    BodyPoser poser(testDevice(), body);
    const auto confidences = [&](double turn, const SeenFace& seen) {
        Theta theta{};
        setJointRotation(theta, joint::kPelvis,
                         quaternionOf({M_PI, 0, 0}) * quaternionOf({0, turn, 0}));
        const std::vector<float> targets =
            faceTargets(body, poser.pose(theta, {0, 0, 3}, {}).verts, seen);
        std::vector<double> result;
        for (size_t i = 0; i < targets.size(); i += 3) {
            result.push_back(double{targets[i + 2]});
        }
        return result;
    };
    const SeenFace seen(kFacePoints, {30, 40, .5f});
    const std::vector<double> front = confidences(0, seen), left = confidences(1.2, seen),
                              right = confidences(-1.2, seen), back = confidences(M_PI, seen);
    for (size_t p : {size_t{1}, size_t{33}, size_t{263}, size_t{152}})
        EXPECT_NEAR(front[p], .5 * double{body.facePoints.trust[p]}, .15) << p;
    // Beside the ears: on the outline from the front, and from the sides one of them is hidden.
    for (size_t p : {size_t{234}, size_t{454}}) {
        EXPECT_GT(front[p], 0);
        EXPECT_LT(front[p], .3 * double{body.facePoints.trust[p]});
        EXPECT_GT(std::max(left[p], right[p]), .4 * double{body.facePoints.trust[p]});
        EXPECT_EQ(std::min(left[p], right[p]), 0);
    }
    // But for what nostrils have inside.
    EXPECT_GT(std::ranges::count(back, 0.), std::ptrdiff_t(kFacePoints) - 20);
    for (double confidence : confidences(0, {})) EXPECT_EQ(confidence, 0);
}

// Somebody whose eyes, nose and mouth are a centimetre lower than the model's, which outlines
// hardly show.
struct LongBrow {
    BodyModel model = bodyFromNpz(readBodyArrays("default"));
    std::vector<float> truth = model.templateVertices;
    Folder folder;
    Capture capture;

    LongBrow() {
        const std::vector<float> shares = faceShares(model);
        for (size_t v = 0; v < shares.size(); ++v) truth[3 * v + 1] -= .01f * shares[v];
        capture = recordedBody(model, truth, 8, 256, folder / "capture");
        BodyModel person = model;
        person.templateVertices = truth;
        BodyPoser poser(testDevice(), person);
        for (size_t f = 0; f < capture.size(); ++f) {
            const PosedMesh posed = poser.pose(capture.theta[f], capture.trans[f], capture.betas);
            SeenFace seen;
            for (size_t p = 0; p < kFacePoints; ++p) {
                const glm::dvec3 at = placeOf(model, posed.verts, p);
                const auto [u, v] = capture.frames[f].camera.project({at.x, at.y, at.z});
                seen.push_back({float(u), float(v), 1});
            }
            capture.faces.push_back(f % 2 == 0 ? seen : SeenFace());
        }
    }
    // How far points of the face are off, mm in the mean.
    double error(std::vector<float> rest) const {
        double sum = 0;
        for (size_t p = 0; p < kFacePoints; ++p)
            sum += glm::length(placeOf(model, rest, p) - placeOf(model, truth, p));
        return 1000 * sum / double(kFacePoints);
    }
};

TEST(Surface, FacesTakeTheShapeThatTheirPointsShow) {
    LongBrow person;
    const double before = person.error(person.model.templateVertices);
    EXPECT_GT(before, 7);
    const auto after = [&](double weight) {
        SurfaceRun run{.stage = "shape", .preset = presetByName("ci").shape, .movesOffsets = true};
        run.preset.size = 256;
        run.preset.steps = 60;
        run.preset.facePoints = weight;
        Capture capture = person.capture;
        const auto learned = runSurface(testDevice(), person.model, capture, run);
        std::vector<float> rest = person.model.templateVertices;
        for (size_t i = 0; i < rest.size(); ++i) rest[i] += learned->offsets[i];
        return person.error(rest);
    };
    const double without = after(0), with = after(1);
    std::cout << "points of the face are off by " << before << " mm, " << without
              << " after outlines alone, " << with << " with points\n";
    EXPECT_GT(without, .6 * before);
    EXPECT_LT(with, .4 * before);
}

}  // namespace
}  // namespace doppel::test
