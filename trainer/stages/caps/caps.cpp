#include "trainer/stages/caps/caps.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/error.h"
#include "nn/body/mesh_topology.h"
#include "trainer/avatar/rig.h"
#include "trainer/data/body_render.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/shared_work.h"
#include "trainer/stages/caps/cells.h"
#include "trainer/stages/stage.h"

namespace doppel {

namespace {

// Evenly taken: more would hardly carve more.
constexpr size_t kMostFrames = 96;
// Sides from which people are seen.
constexpr size_t kSides = 8;
// Somebody who is not seen from as many sides in a row has a hull that no mask has cut.
constexpr size_t kMostUnseen = 3;
// In fewer frames, one or none from a side, what trunk and limbs are off by looks like cloth. A
// head is one piece, whose place and turn are better known: what hangs beside it is hair. From
// fewer sides than this the hull has corners.
constexpr size_t kFewestFrames = 16, kFewestSidesOfHead = 6;
// What is nearer to the body than this is no part of a cap but where the cap takes root, m.
constexpr double kSkin = .015;
// How far around what lies beyond the preset's depth nearer cells belong to it, m.
constexpr double kAround = .03;

// The body at rest: places and normals.
struct RestBody {
    std::vector<glm::dvec3> places, normals;
};

RestBody restBody(const BodyModel& body, const Betas& betas) {
    const std::vector<double> verts =
        shapedVertices(body, std::vector<double>(betas.begin(), betas.end()));
    const std::vector<float> sums =
        areaNormals(std::vector<float>(verts.begin(), verts.end()), body.faces);
    RestBody rest;
    for (size_t i = 0; i < verts.size(); i += 3) {
        rest.places.emplace_back(verts[i], verts[i + 1], verts[i + 2]);
        const glm::dvec3 sum(sums[i], sums[i + 1], sums[i + 2]);
        rest.normals.push_back(sum / std::max(glm::length(sum), 1e-12));
    }
    return rest;
}

// Whether hair or loose cloth may hang on a vertex (hair alone: headAlone): not on face, arms,
// hands and feet, beside which masks hold what poses are off by.
bool carries(const BodyModel& body, size_t v, bool headAlone) {
    if (headAlone) return body.part[v] == kHead && !body.face[v];
    switch (body.part[v]) {
        case kHead:
        case kTorso:
        case kLeftThigh:
        case kRightThigh:
        case kLeftCalf:
        case kRightCalf:
            return !body.face[v];
        default:
            return false;
    }
}

// From which of kSides sides a frame shows the trunk.
size_t sideOf(const Theta& theta, const Trans& trans) {
    const glm::dvec3 toCamera = glm::inverse(jointRotation(theta, joint::kPelvis)) *
                                -glm::dvec3(trans[0], trans[1], trans[2]);
    const double turn = std::atan2(toCamera.x, toCamera.z) / (2 * std::numbers::pi) + 1;
    return static_cast<size_t>(std::lround(turn * kSides)) % kSides;
}

// The longest row of sides, around the person, without a frame.
size_t longestGap(const std::array<size_t, kSides>& frames) {
    size_t longest = 0;
    for (size_t first = 0; first < kSides; ++first) {
        size_t length = 0;
        while (length < kSides && frames[(first + length) % kSides] == 0) ++length;
        longest = std::max(longest, length);
    }
    return longest;
}

// Cells in which something is, around the body.
struct Hull {
    Cells cells;
    std::vector<int32_t> nearest;  // vertex of the body; -1: far from it
    std::vector<double> depth;     // m from the body's surface, negative inside
    std::vector<uint8_t> filled;   // what all sides' masks hold
    std::vector<uint8_t> needed;   // of it, what the body does not cover seen from two sides
};

Hull carve(Device& device, const BodyModel& body, const RestBody& rest, const Capture& capture,
           FrameCache& frames, const CapsPreset& preset, const std::vector<size_t>& chosen,
           bool headAlone) {
    Hull hull;
    hull.cells = cellsAround(rest.places, preset.reach, preset.cell);
    hull.nearest = nearestPoints(hull.cells, rest.places, preset.reach);
    hull.depth.assign(hull.cells.total(), INFINITY);
    std::vector<size_t> open;  // cells that masks may carve
    for (size_t i = 0; i < hull.cells.total(); ++i) {
        if (hull.nearest[i] < 0) continue;
        const auto v = static_cast<size_t>(hull.nearest[i]);
        const glm::dvec3 from = hull.cells.centre(hull.cells.place(i)) - rest.places[v];
        const bool outside = glm::dot(from, rest.normals[v]) > 0;
        hull.depth[i] = outside ? glm::length(from) : -glm::length(from);
        if (outside && carries(body, v, headAlone)) open.push_back(i);
    }
    const Rig rig(body, capture.betas);
    // In how many frames of each side: the picture has the cell; the mask holds it; the mask does
    // and the body leaves it free, so that no arm before it or behind it is what the mask shows.
    std::vector<std::array<uint8_t, kSides>> seen(open.size()), held(open.size()),
        free(open.size());
    BodyPoser poser(device, body);
    MeshDrawer drawer(device, body);
    for (size_t frame : chosen) {
        const Placement placed = rig.place(capture.theta[frame]);
        const Trans& t = capture.trans[frame];
        std::vector<Rig::Blend> skin;
        for (size_t v = 0; v < rest.places.size(); ++v) {
            skin.push_back(rig.skin(placed, v));
            skin.back().move += glm::dvec3(t[0], t[1], t[2]);
        }
        const size_t side = sideOf(capture.theta[frame], capture.trans[frame]);
        const Camera& camera = capture.frames[frame].camera;
        const auto picture = frames.load(frame);
        const std::vector<uint8_t> covered = drawer.mask(
            poser.pose(capture.theta[frame], capture.trans[frame], capture.betas).verts, camera);
        for (size_t n = 0; n < open.size(); ++n) {
            const size_t i = open[n];
            const Rig::Blend& by = skin[static_cast<size_t>(hull.nearest[i])];
            const glm::dvec3 p = by.turn * hull.cells.centre(hull.cells.place(i)) + by.move;
            if (p.z <= .05) continue;
            const auto [u, v] = camera.project({p.x, p.y, p.z});
            if (!(u >= 0 && v >= 0 && u < picture->width && v < picture->height)) continue;
            ++seen[n][side];
            const size_t pixel = static_cast<size_t>(v) * static_cast<size_t>(picture->width) +
                                 static_cast<size_t>(u);
            if (picture->mask[pixel] <= 127) continue;
            ++held[n][side];
            if (!covered[pixel]) ++free[n][side];
        }
    }
    hull.filled.assign(hull.cells.total(), 0);
    hull.needed = hull.filled;
    for (size_t n = 0; n < open.size(); ++n) {
        bool fills = true;
        size_t needs = 0;
        for (size_t side = 0; side < kSides; ++side) {
            fills &= held[n][side] >= preset.agree * seen[n][side];
            needs += free[n][side] > 0 && free[n][side] >= preset.agree * seen[n][side];
        }
        hull.filled[open[n]] = fills;
        hull.needed[open[n]] = fills && needs >= 2;
    }
    return hull;
}

// Calls visit for each of the 26 neighbours.
template <typename Visit>
void neighboursOf(const Cells& cells, size_t cell, const Visit& visit) {
    const glm::ivec3 at = cells.place(cell);
    for (int n = 0; n < 27; ++n) {
        const glm::ivec3 other = at + glm::ivec3(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
        if (n != 13 && cells.holds(other)) visit(cells.number(other));
    }
}

// Cells within so many steps of the first ones, of those that `may` be taken; sorted.
template <typename May>
std::vector<size_t> grown(const Cells& cells, const std::vector<size_t>& from, int steps,
                          const May& may) {
    std::vector<uint8_t> in(cells.total());
    std::vector<size_t> all = from, edge = from;
    for (size_t cell : from) in[cell] = 1;
    for (int step = 0; step < steps && !edge.empty(); ++step) {
        std::vector<size_t> next;
        for (size_t cell : edge)
            neighboursOf(cells, cell, [&](size_t other) {
                if (in[other] || !may(other)) return;
                in[other] = 1;
                next.push_back(other);
            });
        all.insert(all.end(), next.begin(), next.end());
        edge = std::move(next);
    }
    std::ranges::sort(all);
    return all;
}

// Cells that hang together, of those that are not 0; pieces of at least so many.
std::vector<std::vector<size_t>> pieces(const Cells& cells, std::vector<uint8_t> in, size_t least) {
    std::vector<std::vector<size_t>> found;
    for (size_t first = 0; first < in.size(); ++first) {
        if (!in[first]) continue;
        std::vector<size_t> piece{first};
        in[first] = 0;
        for (size_t n = 0; n < piece.size(); ++n)
            neighboursOf(cells, piece[n], [&](size_t other) {
                if (!in[other]) return;
                in[other] = 0;
                piece.push_back(other);
            });
        if (piece.size() >= least) found.push_back(std::move(piece));
    }
    return found;
}

bool isArm(size_t j) {
    return j == joint::kLeftCollar || j == joint::kRightCollar ||
           (j >= joint::kLeftShoulder && j <= joint::kRightHand);
}

// The mesh around what grew beyond the body, without what lies under the skin.
BodyCap capOf(const BodyModel& body, const RestBody& rest, const Hull& hull,
              const std::vector<uint8_t>& filled) {
    CellSurface surface = surfaceAround(hull.cells, filled);
    std::vector<int64_t> nearest;
    std::vector<uint8_t> under;
    for (const glm::dvec3& p : surface.vertices) {
        int32_t v = hull.nearest[hull.cells.number(
            glm::clamp(hull.cells.cellOf(p), glm::ivec3(0), hull.cells.count - 1))];
        // A surface ends within a cell of what it surrounds.
        nearest.push_back(std::max(v, 0));
        const auto at = static_cast<size_t>(nearest.back());
        under.push_back(glm::dot(p - rest.places[at], rest.normals[at]) < -.5 * hull.cells.side);
    }
    BodyCap cap;
    std::vector<int32_t> numbers(surface.vertices.size(), -1);
    std::vector<size_t> kept;
    for (const auto& face : surface.faces) {
        if (std::ranges::all_of(face, [&](int32_t v) { return under[static_cast<size_t>(v)]; }))
            continue;
        for (int32_t v : face) {
            int32_t& number = numbers[static_cast<size_t>(v)];
            if (number < 0) {
                number = static_cast<int32_t>(kept.size());
                kept.push_back(static_cast<size_t>(v));
            }
            cap.faces.push_back(number);
        }
    }
    for (size_t v : kept) {
        for (int axis = 0; axis < 3; ++axis)
            cap.vertices.push_back(static_cast<float>(surface.vertices[v][axis]));
        cap.nearest.push_back(nearest[v]);
    }
    // The weights of the skin next to it, without the arms, which hair and cloth do not follow, and
    // smooth, for the skin on the two sides of a gap is not.
    constexpr int kRounds = 20;
    constexpr size_t kJoints = joint::kCount;
    std::vector<float> weights;
    for (int64_t v : cap.nearest) {
        std::array<float, kJoints> row{};
        float sum = 0;
        for (size_t j = 0; j < kJoints; ++j)
            if (!isArm(j)) sum += row[j] = body.weights[static_cast<size_t>(v) * kJoints + j];
        if (sum < .05f) row[joint::kSpine3] = sum = 1;
        for (float w : row) weights.push_back(w / sum);
    }
    const auto C = static_cast<int64_t>(cap.nearest.size());
    const Adjacency around = meshTopology(cap.faces, C, "cap").adjacency;
    for (int round = 0; round < kRounds; ++round) {
        std::vector<float> next = weights;
        for (size_t v = 0; v < static_cast<size_t>(C); ++v) {
            const auto first = static_cast<size_t>(around.begin[v]),
                       last = static_cast<size_t>(around.begin[v + 1]);
            if (first == last) continue;
            for (size_t j = 0; j < kJoints; ++j) {
                float sum = 0;
                for (size_t k = first; k < last; ++k)
                    sum += weights[static_cast<size_t>(around.neighbours[k]) * kJoints + j];
                next[v * kJoints + j] =
                    .5f * weights[v * kJoints + j] + .5f * sum / static_cast<float>(last - first);
            }
        }
        weights = std::move(next);
    }
    cap.weights = std::move(weights);
    return cap;
}

}  // namespace

GrownCap growCap(Device& device, const BodyModel& body, const Capture& capture, FrameCache& frames,
                 const CapsPreset& preset) {
    const std::vector<size_t> chosen = evenly(capture.size(), kMostFrames);
    std::array<size_t, kSides> sides{};
    for (size_t frame : chosen) ++sides[sideOf(capture.theta[frame], capture.trans[frame])];
    if (const size_t gap = longestGap(sides); gap > kMostUnseen)
        return {.why = fmt::format("no frame shows the person from {} of {} sides in a row", gap,
                                   kSides)};
    const bool headAlone = capture.size() < kFewestFrames;
    const auto seen = std::ranges::count_if(sides, [](size_t count) { return count > 0; });
    if (headAlone && static_cast<size_t>(seen) < kFewestSidesOfHead)
        return {.why = fmt::format("{} frames are too few to tell hair and cloth from poses",
                                   capture.size())};
    const RestBody rest = restBody(body, capture.betas);
    const Hull hull = carve(device, body, rest, capture, frames, preset, chosen, headAlone);
    const Cells& cells = hull.cells;
    std::vector<size_t> deep;
    for (size_t i = 0; i < hull.filled.size(); ++i)
        if (hull.needed[i] && hull.depth[i] > preset.depth) deep.push_back(i);
    // Around it, what is nearer to the body.
    const int around = static_cast<int>(std::lround(kAround / preset.cell));
    std::vector<uint8_t> loose(cells.total());
    for (size_t i : grown(cells, deep, around,
                          [&](size_t i) { return hull.filled[i] && hull.depth[i] > kSkin; }))
        loose[i] = 1;
    const double litre = 1e-3 / (preset.cell * preset.cell * preset.cell);
    const auto least = static_cast<size_t>(std::ceil(preset.litres * litre));
    std::vector<uint8_t> filled(cells.total());
    GrownCap result;
    for (const std::vector<size_t>& piece :
         pieces(cells, std::move(loose), std::max(least, size_t{1}))) {
        result.litres += static_cast<double>(piece.size()) / litre;
        // It takes root in the body.
        const int root = static_cast<int>(std::ceil(kSkin / preset.cell)) + 1;
        for (size_t i : grown(cells, piece, root, [&](size_t i) {
                 return hull.depth[i] <= kSkin && hull.depth[i] > -2 * kSkin;
             }))
            filled[i] = 1;
    }
    if (result.litres == 0) return {.why = "the masks hold nothing far from the body"};
    result.cap = capOf(body, rest, hull, filled);
    return result;
}

void planCaps(Device&, const Avatar&, const Capture&, const TrainSettings&) {}

void trainCaps(Device& device, TrainResult& result, const TrainSettings& settings) {
    Avatar& avatar = result.avatar;
    if (settings.profileSteps > 0) return;
    if (!avatar.body.offsets.empty())
        throwInput(
            "stage caps: expected stage shape to be trained with it, for the avatar's offsets "
            "are of the body as it is now; --stages caps,shape,texels,mesh,texture,refine "
            "trains what stands on it");
    result.capture.betas = avatar.betas;
    FrameCache cache(result.capture);
    GrownCap grown = growCap(device, avatar.body, result.capture, cache, avatar.preset.caps);
    stopIfInterrupted(settings.ranks);
    if (!grown.cap) {
        fmt::print(stderr, "caps: none: {}\n", grown.why);
        return;
    }
    const std::optional<Npz> arrays = withCap(avatar.bodyArrays, *grown.cap, avatar.betas);
    if (!arrays) {
        fmt::print(stderr, "caps: none: the atlas has no room for {} faces\n",
                   grown.cap->faces.size() / 3);
        return;
    }
    avatar.bodyArrays = *arrays;
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    fmt::print(
        stderr,
        "caps: {:.1f} litres of hair or loose cloth are a surface of their own, of {} faces\n",
        grown.litres, grown.cap->faces.size() / 3);
}

}  // namespace doppel
