#include "nn/body/fingers.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <queue>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "nn/body/mesh_topology.h"

namespace doppel {

namespace {

constexpr size_t kFingers = 5, kThumb = 4;          // of a hand, the thumb last
constexpr double kLeastFinger = .015;               // m that it stands off
constexpr double kNearBase = .01, kNearTip = .005;  // m along the skin
constexpr int kSpreads = 200;  // of weights over the knuckles, some fifteen edges wide
// Degrees for a curl of 1, from the tip to the knuckle.
constexpr std::array<double, 3> kFingerCurl{14, 28, 20}, kThumbCurl{15, 8, 12};
// A finger from its knuckle on: where the web between the fingers begins, in parts of what is
// free of it; the middle joint and the last, in parts of all.
constexpr double kKnuckle = .3, kMiddle = .47, kLast = .76;
constexpr double kSoft = .2;  // a joint's skin, in parts of what is free
// The thumb turns at its root in the palm, this part of the way from the wrist to its web, and ends
// beside the fingers by so much of the angle.
constexpr double kThumbRoot = .3, kThumbJoint = .45, kThumbAside = .7;
// Fingers taper: side by side they touch where they point at each other a little.
constexpr double kFingerAside = 1.25;

struct Finger {
    std::vector<size_t> free;  // vertices beyond the webs
    glm::dvec3 base{}, tip{};
    double length() const { return glm::length(tip - base); }
    glm::dvec3 along() const { return glm::normalize(tip - base); }
};

struct Hand {
    std::vector<size_t> vertices;
    std::array<Finger, kFingers> fingers;
    glm::dvec3 wrist{}, palm{};  // palm: a direction, out of it
};

struct Mesh {
    std::vector<glm::dvec3> at;
    Adjacency adjacency;
};

constexpr double kFar = 1e9;  // m; no edges lead there

// How far each vertex of a hand is from the forearm, along edges; negative: not of the hand.
std::vector<double> awayFromArm(const Mesh& mesh, const std::vector<uint8_t>& ofHand) {
    std::vector<double> away(ofHand.size(), -1);
    using Entry = std::pair<double, size_t>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> next;
    for (size_t v = 0; v < ofHand.size(); ++v) {
        if (!ofHand[v]) continue;
        const bool atArm = std::ranges::any_of(mesh.adjacency.of(v),
                                               [&](int32_t n) { return !ofHand[size_t(n)]; });
        away[v] = atArm ? 0 : kFar;
        if (atArm) next.emplace(0, v);
    }
    while (!next.empty()) {
        const auto [distance, v] = next.top();
        next.pop();
        if (distance > away[v]) continue;
        for (const int32_t n : mesh.adjacency.of(v)) {
            const auto to = static_cast<size_t>(n);
            const double there = distance + glm::length(mesh.at[to] - mesh.at[v]);
            if (there >= away[to]) continue;
            away[to] = there;
            next.emplace(there, to);
        }
    }
    return away;
}

// What stands off: sinking a level from the farthest vertex on, pieces of the hand beyond it grow
// and meet; one that is kLeastFinger long by then is a finger, and ends where it first meets
// another.
std::vector<Finger> fingersOf(const Mesh& mesh, const std::vector<size_t>& hand,
                              const std::vector<double>& away) {
    struct Piece {
        double peak;
        std::vector<size_t> vertices;
        bool ended = false;  // met another finger
    };
    std::vector<size_t> order = hand;
    std::ranges::stable_sort(order, [&](size_t a, size_t b) { return away[a] > away[b]; });
    std::vector<int> pieceOf(away.size(), -1);
    std::vector<Piece> pieces;
    std::vector<Finger> fingers;
    const auto end = [&](Piece& piece, double level) {
        if (std::exchange(piece.ended, true)) return;
        Finger finger{.free = piece.vertices};
        const auto middle = [&](auto&& counts) {
            glm::dvec3 sum{};
            int count = 0;
            for (const size_t v : finger.free)
                if (counts(away[v])) sum += mesh.at[v], ++count;
            return sum / static_cast<double>(std::max(count, 1));
        };
        finger.base = middle([&](double d) { return d < level + kNearBase; });
        finger.tip = middle([&](double d) { return d > piece.peak - kNearTip; });
        fingers.push_back(std::move(finger));
    };
    for (const size_t v : order) {
        int mine = static_cast<int>(pieces.size());
        pieces.push_back({.peak = away[v], .vertices = {v}});
        pieceOf[v] = mine;
        for (const int32_t n : mesh.adjacency.of(v)) {
            int other = pieceOf[static_cast<size_t>(n)];
            if (other < 0 || other == mine) continue;
            if (pieces[size_t(other)].peak > pieces[size_t(mine)].peak) std::swap(mine, other);
            Piece &higher = pieces[size_t(mine)], &lower = pieces[size_t(other)];
            if (lower.peak - away[v] >= kLeastFinger) {
                end(lower, away[v]);
                end(higher, away[v]);
            }
            for (const size_t moved : lower.vertices) pieceOf[moved] = mine;
            higher.vertices.insert(higher.vertices.end(), lower.vertices.begin(),
                                   lower.vertices.end());
            lower.vertices.clear();
        }
    }
    return fingers;
}

std::optional<Hand> handOf(const BodyModel& body, const Mesh& mesh, size_t side) {
    Hand hand;
    std::vector<uint8_t> ofHand(mesh.at.size());
    for (size_t v = 0; v < ofHand.size(); ++v) {
        const float* row = &body.weights[size_t(kJointCount) * v];
        ofHand[v] = row[joint::kLeftWrist + side] + row[joint::kLeftHand + side] > .5f;
        if (ofHand[v]) hand.vertices.push_back(v);
    }
    // What does not hang together would be left behind where fingers bend: nails, say.
    const std::vector<double> away = awayFromArm(mesh, ofHand);
    if (std::ranges::find(away, kFar) != away.end()) return std::nullopt;
    std::vector<Finger> found = fingersOf(mesh, hand.vertices, away);
    if (found.size() != kFingers) return std::nullopt;
    const std::vector<double> joints = restJoints(body, std::vector<double>(BodyModel::kShapes));
    const double* wrist = &joints[3 * (joint::kLeftWrist + side)];
    hand.wrist = {wrist[0], wrist[1], wrist[2]};
    // Nobody's thumb reaches as far as the little finger.
    std::ranges::stable_sort(found, [&](const Finger& a, const Finger& b) {
        return glm::length(a.tip - hand.wrist) > glm::length(b.tip - hand.wrist);
    });
    std::ranges::move(found, hand.fingers.begin());
    glm::dvec3 along{};
    for (size_t f = 0; f < kThumb; ++f) along += hand.fingers[f].tip - hand.wrist;
    along = glm::normalize(along);
    const glm::dvec3 toThumb = hand.fingers[kThumb].tip - hand.wrist;
    hand.palm = glm::normalize(glm::cross(along, toThumb)) * (side == 0 ? 1. : -1.);
    return hand;
}

// How much of each vertex goes with a finger: all beyond the webs, nothing behind its knuckle or on
// other fingers, and evenly in between.
std::vector<double> weightsOf(const Mesh& mesh, const Hand& hand, size_t which,
                              const glm::dvec3& knuckle, const glm::dvec3& along) {
    enum : uint8_t { Fixed, Free };
    std::vector<double> weights(mesh.at.size());
    std::vector<uint8_t> kind(mesh.at.size(), Fixed);
    for (const size_t v : hand.vertices)
        if (glm::dot(mesh.at[v] - knuckle, along) > 0) kind[v] = Free;
    for (size_t f = 0; f < kFingers; ++f)
        for (const size_t v : hand.fingers[f].free) {
            kind[v] = Fixed;
            weights[v] = f == which ? 1 : 0;
        }
    for (int i = 0; i < kSpreads; ++i)
        for (const size_t v : hand.vertices) {
            if (kind[v] == Fixed) continue;
            double sum = 0;
            for (const int32_t n : mesh.adjacency.of(v)) sum += weights[size_t(n)];
            weights[v] = sum / static_cast<double>(mesh.adjacency.of(v).size());
        }
    return weights;
}

double smoothStep(double x) {
    x = std::clamp(x, 0., 1.);
    return x * x * (3 - 2 * x);
}

// p turned about an axis through a pivot.
glm::dvec3 turned(const glm::dvec3& p, const glm::dvec3& pivot, const glm::dvec3& axis,
                  double angle) {
    const glm::dvec3 r = p - pivot;
    return pivot + std::cos(angle) * r + std::sin(angle) * glm::cross(axis, r) +
           (1 - std::cos(angle)) * glm::dot(axis, r) * axis;
}

struct Entry {
    int32_t finger;
    std::array<float, FingerRig::kEntryNumbers> numbers;
};

// The turns of one hand's fingers, and what their vertices take of them.
void addHand(FingerRig& rig, std::vector<std::vector<Entry>>& entries, const Mesh& mesh,
             const Hand& hand, size_t side) {
    // Directions within the palm.
    const auto flat = [&](const glm::dvec3& x) {
        return glm::normalize(x - glm::dot(x, hand.palm) * hand.palm);
    };
    glm::dvec3 ahead{};
    for (size_t f = 0; f < kThumb; ++f) ahead += hand.fingers[f].along();
    ahead = flat(ahead);
    for (size_t f = 0; f < kFingers; ++f) {
        const Finger& finger = hand.fingers[f];
        const bool thumb = f == kThumb;
        const double length = finger.length(), whole = (1 + kKnuckle) * length;
        const glm::dvec3 along = finger.along();
        const glm::dvec3 knuckle = thumb ? hand.wrist + kThumbRoot * (finger.base - hand.wrist)
                                         : finger.base - kKnuckle * length * along;
        const glm::dvec3 outOfPalm = thumb ? glm::normalize(finger.base - knuckle) : along;
        const std::array<glm::dvec3, 3> pivots{
            thumb ? finger.base + kThumbJoint * length * along : knuckle + kLast * whole * along,
            thumb ? finger.base : knuckle + kMiddle * whole * along, knuckle};
        const glm::dvec3 across = glm::normalize(glm::cross(along, hand.palm));
        const glm::dvec3 now = flat(thumb ? finger.tip - knuckle : along);
        const double aside =
            std::asin(std::clamp(glm::dot(glm::cross(now, ahead), hand.palm), -1., 1.)) *
            (thumb ? kThumbAside : kFingerAside);
        const auto number = static_cast<int32_t>(rig.amounts.size() / size_t(FingerRig::kTurns));
        const auto addTurn = [&](const glm::dvec3& pivot, const glm::dvec3& axis, double angle,
                                 size_t amount) {
            for (const double x : {pivot.x, pivot.y, pivot.z, axis.x, axis.y, axis.z, angle})
                rig.turns.push_back(static_cast<float>(x));
            rig.amounts.push_back(static_cast<int32_t>(2 * side + amount));
        };
        for (size_t j = 0; j < 3; ++j)
            addTurn(pivots[j], across,
                    (thumb ? kThumbCurl : kFingerCurl)[j] * std::numbers::pi / 180, 0);
        addTurn(knuckle, hand.palm, aside, 1);
        const std::vector<double> weights = weightsOf(mesh, hand, f, knuckle, outOfPalm);
        for (const size_t v : hand.vertices) {
            if (weights[v] < 1e-4) continue;
            const auto share = [&](size_t j) {
                return static_cast<float>(
                    smoothStep(glm::dot(mesh.at[v] - pivots[j], along) / (kSoft * length) + .5));
            };
            entries[v].push_back(
                {number, {static_cast<float>(weights[v]), share(0), share(1), 1, 1}});
        }
    }
}

}  // namespace

FingerRig fingerRig(const BodyModel& body) {
    Mesh mesh;
    const std::vector<float> rest = body.restVertices();
    for (size_t v = 0; v < static_cast<size_t>(body.modelVertices); ++v)
        mesh.at.emplace_back(rest[3 * v], rest[3 * v + 1], rest[3 * v + 2]);
    const auto ofModel = std::span(body.faces).first(3 * static_cast<size_t>(body.modelFaces));
    mesh.adjacency = meshTopology(ofModel, body.modelVertices, body.file).adjacency;
    FingerRig rig;
    std::vector<std::vector<Entry>> entries(static_cast<size_t>(body.vertexCount));
    for (const size_t side : {0u, 1u}) {
        const std::optional<Hand> hand = handOf(body, mesh, side);
        if (!hand) return {};
        addHand(rig, entries, mesh, *hand, side);
    }
    // Whose fingers have no length, or whose thumb lies on them, has no directions to bend in.
    if (!std::ranges::all_of(rig.turns, [](float x) { return std::isfinite(x); })) return {};
    rig.begin.push_back(0);
    for (const std::vector<Entry>& list : entries) {
        for (const Entry& entry : list) {
            rig.fingers.push_back(entry.finger);
            rig.entries.insert(rig.entries.end(), entry.numbers.begin(), entry.numbers.end());
        }
        rig.begin.push_back(static_cast<int32_t>(rig.fingers.size()));
    }
    return rig;
}

std::vector<float> bentFingers(const FingerRig& rig, std::span<const float> verts,
                               const HandAmounts& amounts) {
    std::vector<float> bent(verts.begin(), verts.end());
    for (size_t v = 0; v + 1 < rig.begin.size(); ++v) {
        const glm::dvec3 p{verts[3 * v], verts[3 * v + 1], verts[3 * v + 2]};
        glm::dvec3 sum = p;
        for (auto e = size_t(rig.begin[v]); e < size_t(rig.begin[v + 1]); ++e) {
            const float* entry = &rig.entries[size_t(FingerRig::kEntryNumbers) * e];
            glm::dvec3 q = p;
            for (size_t j = 0; j < size_t(FingerRig::kTurns); ++j) {
                const size_t turn = size_t(FingerRig::kTurns) * size_t(rig.fingers[e]) + j;
                const float* t = &rig.turns[size_t(FingerRig::kTurnNumbers) * turn];
                const double amount = amounts[size_t(rig.amounts[turn])];
                q = turned(q, {t[0], t[1], t[2]}, {t[3], t[4], t[5]},
                           double{t[6]} * double{entry[1 + j]} * amount);
            }
            sum += double{entry[0]} * (q - p);
        }
        for (size_t c = 0; c < 3; ++c)
            bent[3 * v + c] = static_cast<float>(sum[static_cast<int>(c)]);
    }
    return bent;
}

}  // namespace doppel
