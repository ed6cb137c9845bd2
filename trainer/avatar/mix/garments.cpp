#include "trainer/avatar/mix/garments.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/glm.hpp>
#include <optional>

#include "engine/error.h"
#include "nn/body/mesh_topology.h"
#include "trainer/avatar/mix/colour_mixture.h"
#include "trainer/avatar/mix/lab.h"

namespace doppel {

namespace {

using Costs = std::array<double, kGarmentCount>;

// What it costs, in nats, that a vertex which moves with a joint is of a garment.
constexpr double kNever = 30;
struct Place {
    joint::Number joint;
    Costs costs;  // skin, hair, top, bottom, shoes
};
constexpr std::array<Place, joint::kCount> kPlaces = {{
    {joint::kPelvis, {6, 4, 2, 0, kNever}},
    {joint::kLeftHip, {2, 6, 3, 0, kNever}},
    {joint::kRightHip, {2, 6, 3, 0, kNever}},
    {joint::kSpine1, {6, 3, 0, 2, kNever}},
    {joint::kLeftKnee, {1, kNever, kNever, 0, 2}},
    {joint::kRightKnee, {1, kNever, kNever, 0, 2}},
    {joint::kSpine2, {4, 2, 0, kNever, kNever}},
    {joint::kLeftAnkle, {1, kNever, kNever, 0, .5}},
    {joint::kRightAnkle, {1, kNever, kNever, 0, .5}},
    {joint::kSpine3, {2, 2, 0, kNever, kNever}},
    {joint::kLeftFoot, {6, kNever, kNever, 2, 0}},
    {joint::kRightFoot, {6, kNever, kNever, 2, 0}},
    {joint::kNeck, {0, 1, 1, kNever, kNever}},
    {joint::kLeftCollar, {1, 1, 0, kNever, kNever}},
    {joint::kRightCollar, {1, 1, 0, kNever, kNever}},
    {joint::kHead, {0, 0, kNever, kNever, kNever}},
    {joint::kLeftShoulder, {1, 2, 0, kNever, kNever}},
    {joint::kRightShoulder, {1, 2, 0, kNever, kNever}},
    {joint::kLeftElbow, {.5, kNever, .5, kNever, kNever}},
    {joint::kRightElbow, {.5, kNever, .5, kNever, kNever}},
    {joint::kLeftWrist, {0, kNever, 1, kNever, kNever}},
    {joint::kRightWrist, {0, kNever, 1, kNever, kNever}},
    {joint::kLeftHand, {0, kNever, kNever, kNever, kNever}},
    {joint::kRightHand, {0, kNever, kNever, kNever, kNever}},
}};
constexpr Costs kFace = {0, 6, kNever, kNever, kNever};  // besides

// Vertices that can hardly be anything else.
std::vector<std::optional<Garment>> sureGarments(const BodyModel& body) {
    const auto vertices = static_cast<size_t>(body.vertexCount);
    auto share = [&](size_t v, std::initializer_list<joint::Number> joints) {
        double sum = 0;
        for (joint::Number j : joints) sum += double{body.weights[v * joint::kCount + j]};
        return sum;
    };
    std::vector<std::optional<Garment>> sure(vertices);
    std::vector<size_t> chest, thighs, scalp;
    for (size_t v = 0; v < vertices; ++v) {
        if (share(v, {joint::kSpine2, joint::kSpine3}) > .8) chest.push_back(v);
        if (share(v, {joint::kLeftHip, joint::kRightHip}) > .9) thighs.push_back(v);
        if (share(v, {joint::kLeftFoot, joint::kRightFoot}) > .8) sure[v] = Garment::Shoes;
        if (body.face[v] || share(v, {joint::kLeftHand, joint::kRightHand}) > .9)
            sure[v] = Garment::Skin;
        else if (share(v, {joint::kHead}) > .9)
            scalp.push_back(v);
    }
    // The front half of the trunk, for hair may hang down the other.
    std::ranges::sort(chest, std::greater{},
                      [&](size_t v) { return body.templateVertices[3 * v + 2]; });
    for (size_t i = 0; i < chest.size() / 2; ++i) sure[chest[i]] = Garment::Top;
    // The upper half of the thighs, for shorts and skirts end below.
    std::ranges::sort(thighs, std::greater{},
                      [&](size_t v) { return body.templateVertices[3 * v + 1]; });
    for (size_t i = 0; i < thighs.size() / 2; ++i) sure[thighs[i]] = Garment::Bottom;
    // The upper two fifths of the head without its face.
    std::ranges::sort(scalp, std::greater{},
                      [&](size_t v) { return body.templateVertices[3 * v + 1]; });
    for (size_t i = 0; i < scalp.size() * 2 / 5; ++i) sure[scalp[i]] = Garment::Hair;
    return sure;
}

// Those of which little else is to be expected.
std::vector<std::optional<Garment>> sureOf(std::span<const GarmentShares> expected) {
    constexpr double kSure = .9;
    std::vector<std::optional<Garment>> sure(expected.size());
    for (size_t v = 0; v < expected.size(); ++v) {
        const auto most = std::ranges::max_element(expected[v]);
        if (*most > kSure) sure[v] = static_cast<Garment>(most - expected[v].begin());
    }
    return sure;
}

// Hair may hang over a face, and a shirt may be open: a sure vertex of one garment that has rather
// the colour of another's sure ones is not sure. [V] Which vertices have, sure or not.
std::vector<char> doubt(Garment garment, Garment other, std::span<const glm::dvec3> colours,
                        std::span<const double> seen, std::vector<std::optional<Garment>>& sure) {
    constexpr double kSeenWell = .05, kApart = 14;  // of L*a*b*
    auto medianOf = [&](Garment of) -> std::optional<glm::dvec3> {
        glm::dvec3 median;
        for (int c = 0; c < 3; ++c) {
            std::vector<double> values;
            for (size_t v = 0; v < sure.size(); ++v)
                if (sure[v] == of && seen[v] >= kSeenWell) values.push_back(colours[v][c]);
            if (values.empty()) return std::nullopt;
            const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
            std::ranges::nth_element(values, middle);
            median[c] = *middle;
        }
        return median;
    };
    std::vector<char> others(sure.size());
    const auto own = medianOf(garment), theirs = medianOf(other);
    if (!own || !theirs || glm::distance(*own, *theirs) < kApart) return others;
    for (size_t v = 0; v < sure.size(); ++v) {
        others[v] = seen[v] >= kSeenWell &&
                    glm::distance(colours[v], *theirs) < glm::distance(colours[v], *own);
        if (others[v] && sure[v] == garment) sure[v].reset();
    }
    return others;
}

// A print has colours of hair, a fold those of trousers: an island of a garment that no sure vertex
// has takes the garment that it borders on most. Of skin, which shows at knees and between clothes,
// and of tops, whose sleeves may begin below bare shoulders, only small ones.
void removeIslands(std::vector<std::optional<Garment>>& labels,
                   const std::vector<std::optional<Garment>>& sure, const Adjacency& adjacency) {
    constexpr size_t kSmall = 30;  // vertices
    std::vector<char> visited(labels.size());
    for (size_t start = 0; start < labels.size(); ++start) {
        if (visited[start]) continue;
        const Garment garment = *labels[start];
        std::vector<size_t> island{start};
        std::array<size_t, kGarmentCount> borders{};
        bool isSure = false;
        visited[start] = 1;
        for (size_t i = 0; i < island.size(); ++i) {
            const size_t v = island[i];
            isSure = isSure || sure[v] == garment;
            for (int32_t k = adjacency.begin[v]; k < adjacency.begin[v + 1]; ++k) {
                const auto n = size_t(adjacency.neighbours[size_t(k)]);
                if (labels[n] != garment)
                    ++borders[number(*labels[n])];
                else if (!visited[n]) {
                    visited[n] = 1;
                    island.push_back(n);
                }
            }
        }
        if (isSure ||
            ((garment == Garment::Skin || garment == Garment::Top) && island.size() >= kSmall))
            continue;
        const auto most = std::ranges::max_element(borders);
        if (*most == 0) continue;  // all of a mesh's part, as eyes may be
        for (size_t v : island) labels[v] = static_cast<Garment>(most - borders.begin());
    }
}

}  // namespace

glm::dvec3 colourAt(std::span<const float> texture, int size, const glm::dvec2& uv) {
    const glm::dvec2 place = glm::clamp(uv * double(size) - .5, 0., double(size - 1));
    const auto left = size_t(place.x), top = size_t(place.y), side = size_t(size);
    const size_t right = std::min(left + 1, side - 1), below = std::min(top + 1, side - 1);
    const glm::dvec2 share = place - glm::dvec2(left, top);
    auto texel = [&](size_t row, size_t column) {
        const float* colour = &texture[3 * (row * side + column)];
        return glm::dvec3(colour[0], colour[1], colour[2]);
    };
    return glm::mix(glm::mix(texel(top, left), texel(top, right), share.x),
                    glm::mix(texel(below, left), texel(below, right), share.x), share.y);
}

std::vector<glm::dvec3> vertexColours(const BodyModel& body, std::span<const float> texture,
                                      int size) {
    CHECK(texture.size() == 3 * size_t(size) * size_t(size), "a texture is square");
    const auto vertices = static_cast<size_t>(body.vertexCount);
    std::vector<glm::dvec3> colours(vertices);
    std::vector<double> counts(vertices);
    auto texel = [&](float at) {
        return std::min(size_t(std::max(0.0, double{at} * size)), size_t(size) - 1);
    };
    for (size_t corner = 0; corner < body.faces.size(); ++corner) {
        const auto v = static_cast<size_t>(body.faces[corner]);
        const float* uv = &body.uvs[2 * static_cast<size_t>(body.uvFaces[corner])];
        const float* colour = &texture[3 * (texel(uv[1]) * size_t(size) + texel(uv[0]))];
        colours[v] += glm::dvec3(colour[0], colour[1], colour[2]);
        ++counts[v];
    }
    for (size_t v = 0; v < vertices; ++v) colours[v] /= std::max(counts[v], 1.0);
    return colours;
}

std::vector<Garment> segmentGarments(const BodyModel& body, std::span<const float> texture,
                                     int size) {
    const std::vector<glm::dvec3> colours = vertexColours(body, texture, size);
    return segmentGarments(body, colours, std::vector<double>(colours.size(), 1));
}

std::vector<Garment> segmentGarments(const BodyModel& body, std::span<const glm::dvec3> srgb,
                                     std::span<const double> seen,
                                     std::span<const GarmentShares> expected) {
    constexpr int kRounds = 4, kSweeps = 15;
    constexpr double kAgree = 1.5;       // nats, of neighbours of one colour
    constexpr double kRareCost = 18;     // nats, of a garment that hardly a vertex has
    constexpr size_t kFewest = 20;       // vertices to learn colours from
    constexpr double kSeenWell = .3;     // enough for that
    constexpr double kLeastShare = .01;  // of a garment that nobody is known to wear there
    // Who is known says better what may be worn where.
    const double placesCount = expected.empty() ? 1 : .2;

    const auto vertices = static_cast<size_t>(body.vertexCount);
    CHECK(srgb.size() == vertices && seen.size() == vertices, "of {} vertices", vertices);
    const MeshTopology mesh = meshTopology(body.faces, body.vertexCount, body.file);
    std::vector<glm::dvec3> colours;
    for (const glm::dvec3& colour : srgb) colours.push_back(labOf(colour));

    std::vector<Costs> places(vertices);
    for (size_t v = 0; v < vertices; ++v)
        for (size_t g = 0; g < kGarmentCount; ++g) {
            for (const Place& place : kPlaces)
                places[v][g] += placesCount *
                                double{body.weights[v * joint::kCount + place.joint]} *
                                place.costs[g];
            if (body.face[v]) places[v][g] += placesCount * kFace[g];
            if (!expected.empty()) places[v][g] -= std::log(kLeastShare + expected[v][g]);
        }

    // As in GrabCut, agreement wears off over twice the mean squared difference.
    const size_t edges = mesh.edges.size() / 2;
    std::vector<double> agree(edges);
    for (size_t e = 0; e < edges; ++e) {
        const glm::dvec3 difference =
            colours[size_t(mesh.edges[2 * e])] - colours[size_t(mesh.edges[2 * e + 1])];
        agree[e] = glm::dot(difference, difference);
    }
    auto both = [&](size_t e) {
        return std::min(seen[size_t(mesh.edges[2 * e])], seen[size_t(mesh.edges[2 * e + 1])]);
    };
    double differences = 0, pairs = 0;
    for (size_t e = 0; e < edges; ++e) differences += both(e) * agree[e], pairs += both(e);
    const double mean = pairs > 0 ? differences / pairs : 0;
    for (size_t e = 0; e < edges; ++e) {
        const double same = mean > 0 ? std::exp(-agree[e] / (2 * mean)) : 1;
        agree[e] = kAgree * std::lerp(1., same, both(e));
    }

    std::vector<std::optional<Garment>> sure =
        expected.empty() ? sureGarments(body) : sureOf(expected);
    // A bare belly is expected to be shirt, as most people's are, and would teach that shirts have
    // the colour of skin.
    std::vector<std::array<char, kGarmentCount>> others(vertices);
    for (Garment garment : {Garment::Top, Garment::Bottom})
        for (Garment other : {Garment::Skin, Garment::Top, Garment::Bottom}) {
            if (other == garment || (expected.empty() && other != Garment::Skin)) continue;
            const std::vector<char> theirs = doubt(garment, other, colours, seen, sure);
            if (!expected.empty())
                for (size_t v = 0; v < vertices; ++v) others[v][number(garment)] |= theirs[v];
        }
    if (!expected.empty()) doubt(Garment::Skin, Garment::Hair, colours, seen, sure);
    std::vector<std::optional<Garment>> labels = sure;
    for (int round = 0; round < kRounds; ++round) {
        std::vector<Costs> costs = places;
        for (size_t g = 0; g < kGarmentCount; ++g) {
            std::vector<glm::dvec3> known;
            for (size_t v = 0; v < vertices; ++v)
                if (labels[v] && number(*labels[v]) == g && seen[v] >= kSeenWell && !others[v][g])
                    known.push_back(colours[v]);
            std::optional<ColourMixture> mixture;
            if (known.size() >= kFewest) mixture.emplace(std::move(known));
            for (size_t v = 0; v < vertices; ++v)
                if (seen[v] > 0)
                    costs[v][g] += seen[v] * (mixture ? mixture->cost(colours[v]) : kRareCost);
        }
        // Mean field: each vertex's shares given those of its neighbours.
        std::vector<Costs> shares(vertices), support(vertices);
        for (int sweep = 0; sweep <= kSweeps; ++sweep) {
            for (size_t v = 0; v < vertices; ++v) {
                Costs& q = shares[v];
                for (size_t g = 0; g < kGarmentCount; ++g) q[g] = support[v][g] - costs[v][g];
                const double most = std::ranges::max(q);
                double sum = 0;
                for (double& x : q) sum += x = std::exp(x - most);
                for (double& x : q) x /= sum;
                support[v] = {};
            }
            for (size_t e = 0; e < edges; ++e) {
                const auto a = size_t(mesh.edges[2 * e]), b = size_t(mesh.edges[2 * e + 1]);
                for (size_t g = 0; g < kGarmentCount; ++g) {
                    support[a][g] += agree[e] * shares[b][g];
                    support[b][g] += agree[e] * shares[a][g];
                }
            }
        }
        for (size_t v = 0; v < vertices; ++v)
            labels[v] =
                static_cast<Garment>(std::ranges::max_element(shares[v]) - shares[v].begin());
        removeIslands(labels, sure, mesh.adjacency);
    }
    std::vector<Garment> result;
    for (const std::optional<Garment>& label : labels) result.push_back(*label);
    return result;
}

}  // namespace doppel
