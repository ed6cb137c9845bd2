#include "trainer/motion/retarget/feet.h"

#include <algorithm>
#include <cmath>

#include "trainer/motion/retarget/limb.h"

namespace doppel {

namespace {

using namespace joint;

constexpr double kBlend = .2;          // seconds before and after a stay
constexpr double kDrift = .15;         // seconds, deviation of the mean that a sliding foot follows
constexpr double kRise = .015;         // metres that a standing point may go up and down by noise
constexpr double kStraightest = .998;  // of a leg's length: beyond, knees would snap
constexpr double kMostShift = .3;      // metres, of the root
const glm::dvec3 kAcross(1, 0, 1);

double median(std::vector<double> values) {
    if (values.empty()) return 0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::ranges::nth_element(values, middle);
    return *middle;
}

bool standing(const FootContacts& contacts) {
    return std::ranges::any_of(contacts, [](uint8_t flag) { return flag != 0; });
}

double lowest(const Proportions& body, const JointPose& pose) {
    const PlacedJoints joints = placed(body, pose);
    return std::min(lowestOfSole(body, joints, 0), lowestOfSole(body, joints, 1));
}

// From 0 to 1 with neither speed nor acceleration at the ends.
double eased(double x) {
    x = std::clamp(x, 0., 1.);
    return x * x * x * (x * (6 * x - 15) + 10);
}

// A foot's frames before anything is moved.
struct FootPath {
    std::vector<glm::dvec3> hip, ankle;
    std::vector<double> low;  // of the sole
};

FootPath pathOf(const Proportions& body, std::span<const JointPose> poses, size_t foot) {
    FootPath path;
    for (const JointPose& pose : poses) {
        const PlacedJoints joints = placed(body, pose);
        path.hip.push_back(joints.place[kLeftHip + foot]);
        path.ankle.push_back(joints.place[kLeftAnkle + foot]);
        path.low.push_back(lowestOfSole(body, joints, foot));
    }
    return path;
}

using Places = std::vector<std::array<glm::dvec3, 4>>;

size_t numberOf(const Contact& stay) { return 2 * stay.foot + stay.point; }
size_t lengthOf(const Contact& stay) { return stay.last - stay.first + 1; }

// One place on the ground for each stay: the mean of where the point is, and heel and toe that
// stand at once as far from each other as the foot has them then. A few sweeps of Gauss and Seidel.
// Of those that wander it says nothing.
std::vector<glm::dvec3> anchorsOf(const std::vector<Contact>& stays, const Places& places) {
    struct Couple {
        size_t other;
        double frames;
        glm::dvec3 apart;  // from the other's place to this one's
    };
    std::vector<glm::dvec3> means(stays.size(), glm::dvec3(0));
    for (size_t s = 0; s < stays.size(); ++s) {
        for (size_t f = stays[s].first; f <= stays[s].last; ++f)
            means[s] += kAcross * places[f][numberOf(stays[s])];
        means[s] /= double(lengthOf(stays[s]));
    }
    std::vector<std::vector<Couple>> couples(stays.size());
    for (size_t h = 0; h < stays.size(); ++h)
        for (size_t t = 0; t < stays.size(); ++t) {
            if (stays[h].point != 0 || stays[t].point != 1 || stays[h].foot != stays[t].foot ||
                stays[h].wanders || stays[t].wanders)
                continue;
            const size_t first = std::max(stays[h].first, stays[t].first),
                         last = std::min(stays[h].last, stays[t].last);
            if (first > last) continue;
            glm::dvec3 apart(0);
            for (size_t f = first; f <= last; ++f)
                apart += kAcross * (places[f][numberOf(stays[t])] - places[f][numberOf(stays[h])]);
            const double frames = double(last - first + 1);
            couples[h].push_back({t, frames, -apart / frames});
            couples[t].push_back({h, frames, apart / frames});
        }
    constexpr double kStiff = 10;  // of a couple against a mean, both per frame
    std::vector<glm::dvec3> anchors = means;
    for (int sweep = 0; sweep < 40; ++sweep)
        for (size_t s = 0; s < stays.size(); ++s) {
            double weight = double(lengthOf(stays[s]));
            glm::dvec3 sum = weight * means[s];
            for (const Couple& couple : couples[s]) {
                const double stiff = kStiff * couple.frames;
                sum += stiff * (anchors[couple.other] + couple.apart);
                weight += stiff;
            }
            anchors[s] = sum / weight;
        }
    return anchors;
}

// Where a point that stands should be in each frame of its stay: its anchor, or, where it wanders,
// its own way without what trembles.
std::vector<glm::dvec3> wayOf(const Contact& stay, const glm::dvec3& anchor, const Places& places,
                              double fps) {
    if (!stay.wanders) return std::vector<glm::dvec3>(lengthOf(stay), anchor);
    std::vector<glm::dvec3> way;
    for (size_t f = stay.first; f <= stay.last; ++f)
        way.push_back(kAcross * places[f][numberOf(stay)]);
    return smoothOverTime(way, kDrift * fps);
}

// How high a standing point should be in each frame of its stay: on the ground, or where the source
// already rolls off it, as far above as there. Where somebody has said that it stands, it stands.
std::vector<double> heightsOf(const Contact& stay, const Places& source, double fps, bool given) {
    if (given) return std::vector<double>(lengthOf(stay));
    std::vector<double> heights;
    for (size_t f = stay.first; f <= stay.last; ++f) heights.push_back(source[f][numberOf(stay)].y);
    const double usual = median(heights);
    for (double& height : heights) height = std::max(0., height - usual - kRise);
    return smoothOverTime(heights, .03 * fps);
}

// How a foot is to be moved in each frame, and how much of that a stay asks for.
struct FootMoves {
    std::vector<glm::dvec3> move;
    std::vector<double> weight;  // 1 within stays, 0 far from them
};

FootMoves movesOf(size_t foot, const std::vector<Contact>& stays,
                  const std::vector<glm::dvec3>& anchors, const Places& source,
                  const Places& target, double fps, bool given) {
    const size_t frames = target.size();
    const auto blend = std::max<size_t>(1, static_cast<size_t>(std::lround(kBlend * fps)));
    FootMoves moves{std::vector<glm::dvec3>(frames, glm::dvec3(0)), std::vector<double>(frames)};
    for (size_t s = 0; s < stays.size(); ++s) {
        const Contact& stay = stays[s];
        if (stay.foot != foot) continue;
        // A blend ends where another stay begins, and between two that touch it takes half of it
        // from each.
        size_t before = blend, after = blend;
        for (const Contact& other : stays) {
            if (other.foot != foot) continue;
            const auto within = [&](size_t gap) {
                return gap > 0 ? std::min(blend, gap) : std::max<size_t>(1, blend / 2);
            };
            if (other.last < stay.first)
                before = std::min(before, within(stay.first - other.last - 1));
            if (other.first > stay.last)
                after = std::min(after, within(other.first - stay.last - 1));
        }
        const std::vector<double> heights = heightsOf(stay, source, fps, given);
        const std::vector<glm::dvec3> way = wayOf(stay, anchors[s], target, fps);
        const size_t begin = stay.first - std::min(stay.first, before),
                     end = std::min(frames - 1, stay.last + after);
        for (size_t f = begin; f <= end; ++f) {
            const size_t held = std::clamp(f, stay.first, stay.last);
            const size_t away = f < held ? held - f : f - held;
            const double weight = 1 - eased(double(away) / double((f < held ? before : after) + 1));
            const glm::dvec3& place = target[held][numberOf(stay)];
            glm::dvec3 move = way[held - stay.first] - place;
            move.y = heights[held - stay.first] - place.y;
            moves.move[f] += weight * move;
            moves.weight[f] += weight;
        }
    }
    for (size_t f = 0; f < frames; ++f) {
        moves.move[f] /= std::max(1., moves.weight[f]);
        moves.weight[f] = std::min(1., moves.weight[f]);
    }
    return moves;
}

// How far the hip has to go up for the leg to be so long; 0 where the foot is too far to the side.
double riseFor(const glm::dvec3& hip, const glm::dvec3& goal, double length) {
    const glm::dvec3 off = (hip - goal) * kAcross;
    const double square = length * length - glm::dot(off, off);
    return square > 0 ? goal.y + std::sqrt(square) - hip.y : 0;
}

}  // namespace

void standOnGround(const Proportions& source, std::span<const JointPose> sourcePoses,
                   std::span<const FootContacts> contacts, const Proportions& target,
                   std::vector<JointPose>& poses) {
    const bool any = std::ranges::any_of(contacts, standing);
    std::vector<double> above;
    for (size_t f = 0; f < poses.size(); ++f)
        if (!any || standing(contacts[f]))
            above.push_back(lowest(target, poses[f]) -
                            std::max(0., any ? 0. : lowest(source, sourcePoses[f])));
    const double shift = median(above);
    for (JointPose& pose : poses) pose.pelvis.y -= shift;
}

size_t keepFeet(const Proportions& source, std::span<const JointPose> sourcePoses,
                std::span<const FootContacts> contacts, bool given, const Proportions& target,
                std::vector<JointPose>& poses, double fps) {
    const size_t frames = poses.size();
    const Places theirs = contactPlaces(sourcePoses, source), ours = contactPlaces(poses, target);
    std::vector<Contact> held = stays(contacts, theirs);
    if (given)
        for (Contact& stay : held) stay.wanders = false;
    const std::vector<glm::dvec3> anchors = anchorsOf(held, ours);
    std::array<FootPath, 2> paths;
    std::array<FootMoves, 2> moves;
    for (size_t foot : {0, 1}) {
        paths[foot] = pathOf(target, poses, foot);
        moves[foot] = movesOf(foot, held, anchors, theirs, ours, fps, given);
        std::vector<double> below;
        for (size_t f = 0; f < frames; ++f)
            below.push_back(std::max(0., -paths[foot].low[f] - moves[foot].move[f].y));
        const std::vector<double> lift = smoothAbove(below, .03 * fps);
        for (size_t f = 0; f < frames; ++f) moves[foot].move[f].y += lift[f];
    }
    // The root goes where the knees stay as bent as they were, as a mean of the feet that stand.
    std::vector<double> rise(frames), lower(frames);
    for (size_t f = 0; f < frames; ++f) {
        double total = 0;
        for (size_t foot : {0, 1}) {
            const double weight = moves[foot].weight[f];
            const glm::dvec3 &hip = paths[foot].hip[f], &ankle = paths[foot].ankle[f];
            rise[f] +=
                weight * riseFor(hip, ankle + moves[foot].move[f], glm::distance(hip, ankle));
            total += weight;
        }
        rise[f] = std::clamp(rise[f] / std::max(1., total), -kMostShift, kMostShift);
    }
    rise = smoothOverTime(rise, .08 * fps);
    std::array<double, 2> length{};
    for (size_t foot : {0, 1}) length[foot] = lengthOf(target, legOf(foot));
    const auto longest = [&](size_t foot, size_t f) {
        const double was = glm::distance(paths[foot].hip[f], paths[foot].ankle[f]);
        return std::max(kStraightest * length[foot], std::min(was, .9999 * length[foot]));
    };
    for (size_t f = 0; f < frames; ++f)
        for (size_t foot : {0, 1}) {
            const glm::dvec3 hip = paths[foot].hip[f] + glm::dvec3(0, rise[f], 0);
            const glm::dvec3 goal = paths[foot].ankle[f] + moves[foot].move[f];
            if (glm::distance(hip, goal) <= longest(foot, f)) continue;
            const double down = -riseFor(hip, goal, longest(foot, f));
            lower[f] = std::max(lower[f], moves[foot].weight[f] * std::min(down, kMostShift));
        }
    lower = smoothAbove(lower, .05 * fps);
    for (size_t f = 0; f < frames; ++f) {
        const glm::dvec3 shift(0, rise[f] - lower[f], 0);
        poses[f].pelvis += shift;
        for (size_t foot : {0, 1}) {
            const glm::dvec3 hip = paths[foot].hip[f] + shift;
            glm::dvec3 goal = paths[foot].ankle[f] + moves[foot].move[f];
            const double far = glm::distance(hip, goal);
            if (far > longest(foot, f)) goal = hip + (goal - hip) * (longest(foot, f) / far);
            reach(target, legOf(foot), goal, poses[f]);
        }
    }
    return held.size();
}

}  // namespace doppel
