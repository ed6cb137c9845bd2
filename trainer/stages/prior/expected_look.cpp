#include "trainer/stages/prior/expected_look.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "engine/error.h"
#include "nn/body/mesh_topology.h"
#include "trainer/avatar/mix/lab.h"

namespace doppel {

namespace {

// Parts of a body, each of which may be dressed like somebody else's.
constexpr size_t kRegions = 5;
constexpr std::array<size_t, joint::kCount> regionsOfJoints() {
    enum : size_t { Head, Trunk, Arms, Legs, Feet };
    std::array<size_t, joint::kCount> regions{};
    regions.fill(Trunk);
    for (auto j : {joint::kHead, joint::kNeck}) regions[j] = Head;
    for (auto j :
         {joint::kLeftShoulder, joint::kRightShoulder, joint::kLeftElbow, joint::kRightElbow,
          joint::kLeftWrist, joint::kRightWrist, joint::kLeftHand, joint::kRightHand})
        regions[j] = Arms;
    for (auto j : {joint::kLeftHip, joint::kRightHip, joint::kLeftKnee, joint::kRightKnee})
        regions[j] = Legs;
    for (auto j : {joint::kLeftAnkle, joint::kRightAnkle, joint::kLeftFoot, joint::kRightFoot})
        regions[j] = Feet;
    return regions;
}
constexpr std::array<size_t, joint::kCount> kRegionOf = regionsOfJoints();
using Regions = std::array<double, kRegions>;

Regions regionsAt(const BodyModel& body, size_t v) {
    Regions shares{};
    for (size_t j = 0; j < joint::kCount; ++j)
        shares[kRegionOf[j]] += double{body.weights[v * joint::kCount + j]};
    return shares;
}

// A part of what is seen of a region that another wears differently, and that makes one e times as
// unlikely to tell about it.
constexpr double kDiffers = .01;
// What all of them together count still, for nobody wears just the same.
constexpr double kStrangers = .2;

// How much hair is to be expected over a face: of the known nobody's hangs there.
constexpr double kOverFace = .5;

// [people] Of each region how much each counts, summing to one.
std::vector<Regions> alike(const KnownPeople& known, const std::vector<Regions>& regions,
                           const std::vector<Garment>& garments, std::span<const double> seen) {
    std::vector<Regions> counts(known.people.size());
    Regions total{};
    for (size_t v = 0; v < regions.size(); ++v)
        for (size_t r = 0; r < kRegions; ++r) total[r] += seen[v] * regions[v][r];
    for (size_t p = 0; p < counts.size(); ++p)
        for (size_t v = 0; v < regions.size(); ++v)
            if (known.people[p].garments[v] != garments[v])
                for (size_t r = 0; r < kRegions; ++r) counts[p][r] += seen[v] * regions[v][r];
    for (size_t r = 0; r < kRegions; ++r) {
        double least = 1, sum = 0;
        for (Regions& each : counts) {
            each[r] = total[r] > 0 ? each[r] / total[r] : 0;
            least = std::min(least, each[r]);
        }
        for (Regions& each : counts) sum += each[r] = std::exp((least - each[r]) / kDiffers);
        for (Regions& each : counts) each[r] /= sum;
    }
    return counts;
}

// The mean colour of what wears a garment, each counting so much [V]; nothing where none does.
std::optional<glm::dvec3> toneOf(std::span<const glm::dvec3> colours,
                                 const std::vector<Garment>& garments, Garment garment,
                                 std::span<const double> counts) {
    constexpr double kLeast = 2;  // vertices
    glm::dvec3 sum(0);
    double total = 0;
    for (size_t v = 0; v < garments.size(); ++v)
        if (garments[v] == garment) sum += counts[v] * colours[v], total += counts[v];
    if (total < kLeast) return std::nullopt;
    return sum / total;
}

// Of hair, which may be a strip over a forehead, or begin where another's does not: what others
// have hair, the more of them the more it counts, and what has another colour than the face.
std::optional<glm::dvec3> hairTone(const KnownPeople& known, const BodyModel& body,
                                   std::span<const glm::dvec3> colours,
                                   std::span<const double> seen) {
    constexpr double kUnlike = 14;            // of L*a*b*
    constexpr double kFew = 10, kLeast = .2;  // vertices
    constexpr double kSeenWell = .1;
    glm::dvec3 face(0), sum(0);
    double faces = 0, total = 0;
    for (size_t v = 0; v < colours.size(); ++v)
        if (body.face[v]) face += seen[v] * labOf(colours[v]), faces += seen[v];
    if (faces < kFew) return std::nullopt;
    for (size_t v = 0; v < static_cast<size_t>(body.modelVertices); ++v) {
        const double unlike =
            glm::distance(labOf(colours[v]), face / faces) / kUnlike - 1;  // 0: hardly
        if (seen[v] < kSeenWell || unlike < 0) continue;
        const auto haired = std::ranges::count_if(known.people, [&](const KnownPerson& person) {
            return person.garments[v] == Garment::Hair;
        });
        const double count = unlike * seen[v] * static_cast<double>(haired) /
                             static_cast<double>(known.people.size());
        sum += count * colours[v];
        total += count;
    }
    if (total < kLeast) return std::nullopt;
    return sum / total;
}

// The colour of each garment.
std::array<glm::dvec3, kGarmentCount> tonesOf(const KnownPeople& known, const BodyModel& body,
                                              const std::vector<Garment>& garments,
                                              std::span<const glm::dvec3> colours,
                                              std::span<const double> seen) {
    std::array<glm::dvec3, kGarmentCount> tones{};
    for (size_t g = 0; g < kGarmentCount; ++g) {
        const auto garment = static_cast<Garment>(g);
        std::optional<glm::dvec3> tone;
        if (garment == Garment::Hair) tone = hairTone(known, body, colours, seen);
        if (!tone) tone = toneOf(colours, garments, garment, seen);
        if (!tone) {
            glm::dvec3 sum(0);
            double total = 0;
            for (const KnownPerson& person : known.people)
                for (size_t v = 0; v < person.garments.size(); ++v)
                    if (person.garments[v] == garment) sum += person.colours[v], ++total;
            tone = total > 0 ? sum / total : glm::dvec3(.5);
        }
        tones[g] = *tone;
    }
    return tones;
}

// [V of the model] What skin is there over its mean where this one's is seen, in the mean over the
// known who show some; 1 where none of them does.
std::vector<glm::dvec3> skinOver(const KnownPeople& known, const std::vector<Garment>& garments,
                                 std::span<const double> seen, size_t vertices) {
    std::vector<double> counts(vertices), shares(vertices);
    for (size_t v = 0; v < vertices; ++v)
        if (garments[v] == Garment::Skin) counts[v] = seen[v];
    const std::vector<double> all(vertices, 1);
    std::vector<glm::dvec3> over(vertices, glm::dvec3(0));
    for (const KnownPerson& person : known.people) {
        std::optional<glm::dvec3> tone =
            toneOf(person.colours, person.garments, Garment::Skin, counts);
        if (!tone) tone = toneOf(person.colours, person.garments, Garment::Skin, all);
        if (!tone) continue;
        for (size_t v = 0; v < vertices; ++v)
            if (person.garments[v] == Garment::Skin) {
                over[v] += person.colours[v] / glm::max(*tone, glm::dvec3(1e-3));
                ++shares[v];
            }
    }
    for (size_t v = 0; v < vertices; ++v)
        over[v] = shares[v] > 0 ? over[v] / shares[v] : glm::dvec3(1);
    return over;
}

// [V of the model] Whether hair hides a vertex of the head: some is seen to hang over the side of
// the face before it, at its height. It does not end right behind temple and cheek.
std::vector<char> behindHair(const BodyModel& body, const std::vector<Garment>& garments,
                             std::span<const double> seen, const std::vector<Regions>& regions) {
    constexpr double kSeenWell = .1, kOfHead = .5;
    constexpr double kHeight = .015, kBefore = .005, kMiddle = .03;  // m
    auto placeOf = [&](size_t v) {
        const float* x = &body.templateVertices[3 * v];
        return glm::dvec3(x[0], x[1], x[2]);
    };
    std::vector<size_t> head;
    for (size_t v = 0; v < regions.size(); ++v)
        if (regions[v][kRegionOf[joint::kHead]] > kOfHead) head.push_back(v);
    std::vector<glm::dvec3> hair;
    for (size_t v : head)
        if (body.face[v] && garments[v] == Garment::Hair && seen[v] >= kSeenWell &&
            std::abs(placeOf(v).x) > kMiddle)
            hair.push_back(placeOf(v));
    std::vector<char> behind(regions.size());
    for (size_t v : head) {
        if (seen[v] >= kSeenWell) continue;
        const glm::dvec3 place = placeOf(v);
        behind[v] = std::ranges::any_of(hair, [&](const glm::dvec3& strand) {
            return std::abs(strand.y - place.y) < kHeight && strand.z > place.z + kBefore &&
                   (strand.x * place.x > 0 || std::abs(place.x) < kMiddle);
        });
    }
    return behind;
}

// Heights step where garments end, and cloth does not.
void smoothHeights(const BodyModel& body, std::vector<float>& heights) {
    constexpr int kPasses = 5;
    const MeshTopology mesh = meshTopology(body.faces, body.vertexCount, body.file);
    for (int pass = 0; pass < kPasses; ++pass) {
        const std::vector<float> before = heights;
        for (size_t v = 0; v < heights.size(); ++v) {
            double sum = double{before[v]};
            const int32_t begin = mesh.adjacency.begin[v], end = mesh.adjacency.begin[v + 1];
            for (int32_t k = begin; k < end; ++k)
                sum += double{before[size_t(mesh.adjacency.neighbours[size_t(k)])]};
            heights[v] = static_cast<float>(sum / (1 + end - begin));
        }
    }
}

}  // namespace

ExpectedLook expectedLook(const KnownPeople& known, const BodyModel& body,
                          std::span<const glm::dvec3> colours, std::span<const double> trust) {
    const auto vertices = static_cast<size_t>(body.vertexCount),
               model = static_cast<size_t>(body.modelVertices);
    CHECK(!known.people.empty() && colours.size() == vertices && trust.size() == vertices,
          "people, and {} vertices", vertices);
    // Trust falls by the fourth power of the cosine to the camera; garments are seen from the side.
    std::vector<double> seen;
    for (double t : trust) seen.push_back(std::pow(std::clamp(t, 0., 1.), .25));
    std::vector<Regions> regions;
    for (size_t v = 0; v < model; ++v) regions.push_back(regionsAt(body, v));

    ExpectedLook look;
    std::vector<Regions> counts(known.people.size());
    for (Regions& each : counts) each.fill(1. / static_cast<double>(counts.size()));
    auto countAt = [&](size_t person, size_t v) {
        double sum = 0;
        for (size_t r = 0; r < kRegions; ++r) sum += counts[person][r] * regions[v][r];
        return sum;
    };
    // What is to be expected, where some of it is behind hair.
    auto expectedWith = [&](const std::vector<char>& haired) {
        std::vector<GarmentShares> expected(vertices);
        for (size_t v = 0; v < vertices; ++v) {
            double& hair = expected[v][number(Garment::Hair)];
            if (v >= model) {
                expected[v].fill(1. / kGarmentCount);
            } else if (haired[v]) {
                hair = 1;
            } else {
                for (size_t p = 0; p < counts.size(); ++p)
                    expected[v][number(known.people[p].garments[v])] += countAt(p, v);
                if (body.face[v]) hair = std::max(hair, kOverFace);
            }
        }
        return expected;
    };
    // First all tell as much, then those who wear the same; what hair hides, once it is found, is
    // hair.
    const std::vector<char> none(model);
    look.garments = segmentGarments(body, colours, seen, expectedWith(none));
    const std::vector<Regions> likely = alike(known, regions, look.garments, seen);
    for (size_t p = 0; p < counts.size(); ++p)
        for (size_t r = 0; r < kRegions; ++r)
            counts[p][r] = kStrangers * counts[p][r] + (1 - kStrangers) * likely[p][r];
    look.garments = segmentGarments(body, colours, seen, expectedWith(none));
    const std::vector<char> haired = behindHair(body, look.garments, seen, regions);
    if (std::ranges::count(haired, 1) > 0)
        look.garments = segmentGarments(body, colours, seen, expectedWith(haired));

    const std::array<glm::dvec3, kGarmentCount> tones =
        tonesOf(known, body, look.garments, colours, seen);
    const std::vector<glm::dvec3> skin = skinOver(known, look.garments, seen, model);
    for (size_t v = 0; v < vertices; ++v) {
        glm::dvec3 colour = tones[number(look.garments[v])];
        if (v < model && look.garments[v] == Garment::Skin)
            colour = glm::clamp(colour * skin[v], 0., 1.);
        look.colours.push_back(colour);
    }

    for (size_t v = 0; v < vertices; ++v) {
        double sum = 0, total = 0;
        if (v < model)
            for (size_t p = 0; p < known.people.size(); ++p) {
                if (known.people[p].garments[v] != look.garments[v]) continue;
                const double count = countAt(p, v);
                sum += count * double{known.people[p].heights[v]};
                total += count;
            }
        look.heights.push_back(static_cast<float>(total > 1e-6 ? sum / total : 0));
    }
    smoothHeights(body, look.heights);
    return look;
}

std::vector<float> offsetsOf(const BodyModel& body, std::span<const float> heights) {
    const std::vector<glm::dvec3> normals = skinNormals(body);
    std::vector<float> offsets;
    for (size_t v = 0; v < heights.size(); ++v)
        for (int c = 0; c < 3; ++c)
            offsets.push_back(static_cast<float>(double{heights[v]} * normals[v][c]));
    return offsets;
}

}  // namespace doppel
