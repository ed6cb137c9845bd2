#include "trainer/stages/colours/unseen_colours.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "engine/error.h"
#include "nn/body/joint.h"
#include "nn/body/mesh_topology.h"
#include "trainer/avatar/mix/lab.h"

namespace doppel {

namespace {

// Of differences along a bone, around it, and along edges besides.
constexpr double kAlong = 1. / 100, kAround = 1, kEdges = 1e-4;
constexpr double kLeastArea = 1e-10;  // m2, twice
// Of what a vertex is off by that was seen as well as can be: it keeps its colour.
constexpr double kKeeps = 100;
// Between garments, of what is within one; and how far colours reach, m, where a look is expected.
constexpr double kAcross = 1e-3, kReach = .1;
// Of L*a*b*: what differs by more from what is expected is a print, a shadow, or not of its
// garment.
constexpr double kUnlike = 30;
// Of what rather has the colour of another garment: a temple that a face has painted is not spread
// over the back of a head.
constexpr double kAnothers = 1e-6;

// [24] Of each joint the direction of its bone, times itself: how much another is along it. Of the
// limbs it is the bone that begins there, or where none does the one that ends there. Trunk and
// head stand upright; the bones of neck and head lean forward.
std::vector<glm::dmat3> boneDirections(const BodyModel& body) {
    constexpr double kMiddle = .01;  // m from the middle plane
    const std::vector<double> places = restJoints(body, std::vector<double>(BodyModel::kShapes));
    std::vector<glm::dvec3> bones(joint::kCount, glm::dvec3(0, 1, 0));
    std::vector<char> begins(joint::kCount);
    for (size_t j = joint::kCount - 1; j > 0; --j) {
        const auto parent = static_cast<size_t>(body.parents[j]);
        const glm::dvec3 bone(places[3 * j] - places[3 * parent],
                              places[3 * j + 1] - places[3 * parent + 1],
                              places[3 * j + 2] - places[3 * parent + 2]);
        const double length = glm::length(bone);
        auto isLimb = [&](size_t k) { return std::abs(places[3 * k] - places[0]) > kMiddle; };
        if (length == 0) continue;
        if (isLimb(j) && !begins[j]) bones[j] = bone / length;
        if (isLimb(parent)) bones[parent] = bone / length, begins[parent] = 1;
    }
    std::vector<glm::dmat3> directions;
    for (const glm::dvec3& bone : bones) directions.push_back(glm::outerProduct(bone, bone));
    return directions;
}

// Of each garment that somebody wears somewhere the mean colour, L*a*b*.
using GarmentTones = std::array<std::optional<glm::dvec3>, kGarmentCount>;
GarmentTones tonesOf(const ExpectedLook& look) {
    std::array<glm::dvec3, kGarmentCount> sums{};
    std::array<double, kGarmentCount> counts{};
    for (size_t v = 0; v < look.garments.size(); ++v) {
        sums[number(look.garments[v])] += look.colours[v];
        ++counts[number(look.garments[v])];
    }
    GarmentTones tones;
    for (size_t g = 0; g < kGarmentCount; ++g)
        if (counts[g] > 0) tones[g] = labOf(sums[g] / counts[g]);
    return tones;
}

}  // namespace

UnseenColours unseenColours(const BodyModel& body, std::span<const glm::dvec3> seen,
                            std::span<const double> trust, const ExpectedLook* look) {
    const auto vertices = size_t(body.vertexCount);
    CHECK(seen.size() == vertices && trust.size() == vertices, "of {} vertices", vertices);
    const MeshTopology mesh = meshTopology(body.faces, body.vertexCount, body.file);
    UnseenColours result{{seen.begin(), seen.end()}, std::vector<char>(vertices)};

    // Whoever hangs together with a seen one.
    std::vector<size_t> next;
    for (size_t v = 0; v < vertices; ++v)
        if (trust[v] > 0) result.reached[v] = 1, next.push_back(v);
    while (!next.empty()) {
        const size_t v = next.back();
        next.pop_back();
        for (int32_t k = mesh.adjacency.begin[v]; k < mesh.adjacency.begin[v + 1]; ++k) {
            const auto n = size_t(mesh.adjacency.neighbours[size_t(k)]);
            if (!result.reached[n]) result.reached[n] = 1, next.push_back(n);
        }
    }

    const std::vector<glm::dmat3> bones = boneDirections(body);
    auto boneAt = [&](size_t v) {
        glm::dmat3 sum(0);
        for (size_t j = 0; j < joint::kCount; ++j)
            sum += double{body.weights[v * joint::kCount + j]} * bones[j];
        return sum;
    };
    auto placeOf = [&](size_t v) {
        const float* x = &body.templateVertices[3 * v];
        return glm::dvec3(x[0], x[1], x[2]);
    };
    std::vector<double> keeps;  // how much a vertex's colour counts
    const GarmentTones tones = look ? tonesOf(*look) : GarmentTones();
    auto likely = [&](size_t v) {
        const glm::dvec3 colour = labOf(seen[v]);
        const double own = glm::distance(colour, labOf(look->colours[v])), unlike = own / kUnlike;
        for (size_t g = 0; g < kGarmentCount; ++g)
            if (tones[g] && g != number(look->garments[v]) &&
                glm::distance(colour, *tones[g]) < own)
                return kAnothers;
        return std::exp(-unlike * unlike / 2);
    };
    for (size_t v = 0; v < vertices; ++v)
        keeps.push_back(!result.reached[v]     ? 1
                        : look && trust[v] > 0 ? kKeeps * trust[v] * likely(v)
                                               : kKeeps * trust[v]);
    // Lower half of the matrix.
    std::vector<Eigen::Triplet<double>> entries;
    for (size_t v = 0; v < vertices; ++v) entries.emplace_back(int(v), int(v), keeps[v]);
    // Edges hold together what faces without an area do not.
    for (size_t e = 0; e < mesh.edges.size() / 2; ++e) {
        const int a = mesh.edges[2 * e], b = mesh.edges[2 * e + 1];
        if (!result.reached[size_t(a)]) continue;
        entries.emplace_back(a, a, kEdges);
        entries.emplace_back(b, b, kEdges);
        entries.emplace_back(std::max(a, b), std::min(a, b), -kEdges);
    }
    std::vector<double> expects(vertices);
    for (size_t f = 0; f < body.faces.size() / 3; ++f) {
        const int32_t* face = &body.faces[3 * f];
        if (!result.reached[size_t(face[0])]) continue;
        // A face says nothing of the back of its head.
        if (body.face[size_t(face[0])] != body.face[size_t(face[1])] ||
            body.face[size_t(face[0])] != body.face[size_t(face[2])])
            continue;
        std::array<glm::dvec3, 3> x;
        glm::dmat3 bone(0);
        for (size_t k = 0; k < 3; ++k)
            x[k] = placeOf(size_t(face[k])), bone += boneAt(size_t(face[k])) / 3.;
        const glm::dvec3 cross = glm::cross(x[1] - x[0], x[2] - x[0]);
        const double twice = glm::length(cross);  // its area
        if (twice < kLeastArea) continue;
        glm::dmat3 spread = kAround * glm::dmat3(1) + (kAlong - kAround) * bone;
        if (look) {
            auto worn = [&](size_t k) { return look->garments[size_t(face[k])]; };
            if (worn(0) != worn(1) || worn(0) != worn(2)) spread *= kAcross;
            for (size_t k = 0; k < 3; ++k)
                expects[size_t(face[k])] += twice / 6 / (kReach * kReach);
        }
        // What grows from 0 to 1 from the opposite edge to a corner grows along this.
        std::array<glm::dvec3, 3> gradients;
        for (size_t k = 0; k < 3; ++k)
            gradients[k] = glm::cross(cross / twice, x[(k + 2) % 3] - x[(k + 1) % 3]) / twice;
        for (size_t i = 0; i < 3; ++i)
            for (size_t j = 0; j < 3; ++j)
                if (face[i] >= face[j])
                    entries.emplace_back(face[i], face[j],
                                         twice / 2 * glm::dot(gradients[i], spread * gradients[j]));
    }
    for (size_t v = 0; v < vertices; ++v) entries.emplace_back(int(v), int(v), expects[v]);
    const auto rows = Eigen::Index(vertices);
    Eigen::SparseMatrix<double> matrix(rows, rows);  // its lower half
    matrix.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
    CHECK(solver.info() == Eigen::Success, "whoever is reached has one solution");

    Eigen::MatrixX3d wanted(rows, 3);
    for (size_t v = 0; v < vertices; ++v)
        for (int c = 0; c < 3; ++c)
            wanted(int(v), c) =
                keeps[v] * seen[v][c] + (look ? expects[v] * look->colours[v][c] : 0);
    const Eigen::MatrixX3d colours = solver.solve(wanted);
    for (size_t v = 0; v < vertices; ++v)
        for (int c = 0; c < 3; ++c) result.colours[v][c] = colours(int(v), c);
    return result;
}

}  // namespace doppel
