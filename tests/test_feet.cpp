// Toes are closed, as shoes are, and stay so in what is learned of them.
#include "nn/body/feet.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <random>
#include <set>

#include "nn/body/joint.h"
#include "nn/body/mesh_topology.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/recorded_body.h"
#include "trainer/avatar/avatar.h"
#include "trainer/stages/train.h"

namespace doppel::test {
namespace {

struct Feet : testing::Test {
    BodyModel body = bodyFromNpz(readBodyArrays("default"));
    std::vector<float> shares = toeShares(body);
    std::vector<float> closed = closedToes(body);

    std::vector<float> rest(const std::vector<float>& offsets) const {
        std::vector<float> rows = body.templateVertices;
        std::ranges::transform(rows, offsets, rows.begin(), std::plus());
        return rows;
    }
    static glm::dvec3 at(const std::vector<float>& rows, size_t v) {
        return {rows[3 * v], rows[3 * v + 1], rows[3 * v + 2]};
    }
    bool isToe(size_t v) const { return shares[v] > .9f; }
    // What part of what is seen of the left toes from above lies 2 mm or more below a convex front
    // of the foot. Slits make that.
    double slits(const std::vector<float>& rows) const {
        std::vector<std::pair<std::array<glm::dvec3, 3>, bool>>
            faces;  // and whether they are toes'
        std::vector<glm::dvec3> places;
        glm::dvec3 low(1e9), high(-1e9);
        for (size_t f = 0; f < body.faces.size(); f += 3) {
            std::array<glm::dvec3, 3> face;
            bool own = true, toes = true;
            for (size_t k = 0; k < 3; ++k) {
                const auto v = static_cast<size_t>(body.faces[f + k]);
                face[k] = at(rows, v);
                own = own && body.weights[kJointCount * v + joint::kLeftFoot] > .1f;
                toes = toes && isToe(v);
            }
            if (!own) continue;
            places.insert(places.end(), face.begin(), face.end());
            faces.emplace_back(face, toes);
            if (!toes) continue;
            for (const glm::dvec3& p : face) low = glm::min(low, p), high = glm::max(high, p);
        }
        std::mt19937 random(1);
        std::normal_distribution<double> normal;
        std::vector<std::pair<glm::dvec3, double>> planes(3000);
        for (auto& [way, height] : planes) {
            way = glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
            height = -1e9;
            for (const glm::dvec3& place : places) height = std::max(height, glm::dot(way, place));
        }
        double seen = 0, deep = 0;
        constexpr double kStep = .0012;
        for (double x = low.x; x < high.x; x += kStep)
            for (double z = low.z; z < high.z; z += kStep) {
                double top = -1e9;
                bool toe = false;
                for (const auto& [face, toes] : faces) {
                    const auto& [a, b, c] = face;
                    const double area = (b.x - a.x) * (c.z - a.z) - (c.x - a.x) * (b.z - a.z);
                    if (std::abs(area) < 1e-12) continue;
                    const double s = ((x - a.x) * (c.z - a.z) - (c.x - a.x) * (z - a.z)) / area;
                    const double t = ((b.x - a.x) * (z - a.z) - (x - a.x) * (b.z - a.z)) / area;
                    if (s < 0 || t < 0 || s + t > 1) continue;
                    const double y = (1 - s - t) * a.y + s * b.y + t * c.y;
                    if (y > top) top = y, toe = toes;
                }
                if (!toe) continue;
                double depth = 1e9;
                for (const auto& [way, height] : planes)
                    depth = std::min(depth, height - glm::dot(way, glm::dvec3(x, top, z)));
                ++seen;
                deep += depth > .002;
            }
        return deep / seen;
    }
};

TEST_F(Feet, AreConvexInFrontOnceToesAreClosed) {
    EXPECT_GT(slits(body.templateVertices), .01);
    EXPECT_LT(slits(rest(closed)), .004);
    for (size_t v = 0; v < shares.size(); ++v) {
        const glm::dvec3 moved = at(closed, v);
        EXPECT_LT(glm::length(moved), .02) << v;
        if (shares[v] == 0) {
            EXPECT_EQ(moved, glm::dvec3(0)) << v;
        }
    }
    // Nothing is turned over that is to be seen.
    double turned = 0, all = 0;
    const std::vector<float> after = rest(closed);
    for (size_t f = 0; f < body.faces.size(); f += 3) {
        const auto cross = [&](const std::vector<float>& rows) {
            std::array<glm::dvec3, 3> p;
            for (size_t k = 0; k < 3; ++k) p[k] = at(rows, static_cast<size_t>(body.faces[f + k]));
            return glm::cross(p[1] - p[0], p[2] - p[0]);
        };
        if (!isToe(static_cast<size_t>(body.faces[f]))) continue;
        const glm::dvec3 now = cross(after);
        all += glm::length(now);
        if (glm::dot(now, cross(body.templateVertices)) < 0) turned += glm::length(now);
    }
    EXPECT_LT(turned, .03 * all);
}

TEST_F(Feet, MoveInFrontAsOne) {
    const SparseMatrix together = movedWithToes(body, closed, .008);
    std::mt19937 random(1);
    std::normal_distribution<float> normal;
    std::vector<float> noise(closed.size());
    std::ranges::generate(noise, [&] { return normal(random); });
    const std::vector<float> moved = together.times(noise, 3),
                             ones = together.times(std::vector<float>(closed.size(), 1), 3);
    for (size_t i = 0; i < ones.size(); ++i) {
        EXPECT_NEAR(ones[i], 1, 1e-5);
        if (shares[i / 3] == 0) {
            EXPECT_EQ(moved[i], noise[i]);
        }
    }
    // Next to each other across a slit, and far along the surface.
    const MeshTopology mesh = meshTopology(body.faces, body.vertexCount, body.file);
    const std::vector<float> rows = rest(closed);
    double apart = 0, before = 0;
    int pairs = 0;
    for (size_t v = 0; v < shares.size(); ++v) {
        if (!isToe(v)) continue;
        std::set<int32_t> ring{static_cast<int32_t>(v)};
        for (int k = 0; k < 5; ++k)
            for (int32_t w : std::set(ring)) {
                const auto next = mesh.adjacency.of(static_cast<size_t>(w));
                ring.insert(next.begin(), next.end());
            }
        for (size_t w = 0; w < v; ++w) {
            if (!isToe(w) || ring.contains(static_cast<int32_t>(w)) ||
                glm::distance(at(rows, v), at(rows, w)) > .002)
                continue;
            apart += glm::distance(at(moved, v), at(moved, w));
            before += glm::distance(at(noise, v), at(noise, w));
            ++pairs;
        }
    }
    EXPECT_GT(pairs, 15);
    EXPECT_LT(apart, .05 * before);
}

// Who wears shoes that are 12 mm longer than feet, as outlines show.
TEST_F(Feet, OfWhoWearsShoesHaveNoSlits) {
    std::vector<float> shoes = rest(closed);
    for (size_t v = 0; v < shares.size(); ++v) shoes[3 * v + 2] += .012f * shares[v];
    EXPECT_LT(slits(shoes), .004);
    Folder folder;
    const Capture capture = recordedBody(body, shoes, 12, 384, folder / "capture");
    // Forwards, mm: how far toes are from where they are.
    const auto missing = [&](const std::vector<float>& offsets) {
        double sum = 0, count = 0;
        for (size_t v = 0; v < shares.size(); ++v)
            if (isToe(v)) {
                sum += 1000 * double{shoes[3 * v + 2] - rest(offsets)[3 * v + 2]};
                ++count;
            }
        return sum / count;
    };
    const auto learned = [&](double toes) {
        Avatar avatar;
        avatar.bodyArrays = readBodyArrays("default");
        avatar.body = body;
        avatar.preset = presetByName("ci");
        avatar.preset.shape.size = 384;
        avatar.preset.shape.steps = 80;
        avatar.preset.shape.toes = toes;
        TrainSettings settings;
        settings.stages = {"shape"};
        return trainAvatar(testDevice(), std::move(avatar), capture, settings).avatar.body.offsets;
    };
    const std::vector<float> together = learned(presetByName("ci").shape.toes), each = learned(0);
    EXPECT_LT(slits(rest(together)), .01);
    EXPECT_GT(slits(rest(each)), .03);
    EXPECT_LT(missing(together), 8);
}

}  // namespace
}  // namespace doppel::test
