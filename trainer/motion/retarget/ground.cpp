#include "trainer/motion/retarget/ground.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "engine/error.h"
#include "trainer/motion/retarget/limb.h"
#include "trainer/motion/upright.h"

namespace doppel {

namespace {

constexpr double kRadians = 3.14159265358979323846 / 180;
constexpr double kSlow = .35;   // m/s: a foot that stands, noise included
constexpr double kLayer = .12;  // metres within which half of the lowest points have to be
constexpr double kCell = .25;   // metres: points nearer than that are one place
constexpr double kNoise = .02;  // metres: of a place's height
constexpr double kStandingTilt = 4 * kRadians;  // deviation of a standing body's axis from upright
constexpr double kCameraTilt = 10 * kRadians;   // of a camera from level

// The person's poses in the motion's world, as the file had them before cameras.
JointPose poseInWorld(const Motion& motion, const Proportions& body, size_t frame) {
    Theta theta = motion.theta[frame];
    Trans trans = motion.trans[frame];
    if (!motion.views.empty()) {
        const RigidMotion& view = motion.views[frame];
        const glm::dmat3 back = glm::transpose(view.rotation);
        movePose({back, -(back * view.translation)}, theta, trans);
    }
    JointPose pose;
    for (size_t j = 0; j < joint::kCount; ++j) pose.local[j] = jointRotation(theta, j);
    pose.pelvis = body.rest[0] + glm::dvec3(trans[0], trans[1], trans[2]);
    return pose;
}

struct Standing {
    glm::dvec3 sum{0};
    size_t count = 0;
};

// From between the ankles to the neck, of those who stand with straight legs.
void addStanding(const Proportions& body, const PlacedJoints& joints, Standing& standing) {
    using namespace joint;
    for (size_t side : {0, 1})
        if (glm::distance(joints.place[kLeftHip + side], joints.place[kLeftAnkle + side]) <
            .95 * lengthOf(body, legOf(side)))
            return;
    const glm::dvec3 feet = (joints.place[kLeftAnkle] + joints.place[kRightAnkle]) / 2.;
    const glm::dvec3 legs = joints.place[kPelvis] - feet, axis = joints.place[kNeck] - feet;
    if (glm::dot(glm::normalize(legs), glm::normalize(axis)) < .98) return;
    standing.sum += glm::normalize(axis);
    ++standing.count;
}

// Where half of the numbers are closest together: the middle of that range, and its width.
std::pair<double, double> densestHalf(std::vector<double> values) {
    std::ranges::sort(values);
    const size_t half = (values.size() + 1) / 2;
    std::pair<double, double> best{values[0], std::numeric_limits<double>::infinity()};
    for (size_t i = 0; i + half <= values.size(); ++i)
        if (const double width = values[i + half - 1] - values[i]; width < best.second)
            best = {values[i + half / 2], width};
    return best;
}

std::array<glm::dvec3, 2> acrossOf(const glm::dvec3& up) {
    const glm::dvec3 other = std::abs(up.x) < .7 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 0, 1);
    const glm::dvec3 first = glm::normalize(glm::cross(up, other));
    return {first, glm::cross(up, first)};
}

// Up, between what the camera and the bodies say, and the plane through the points that lie near
// the ground: three unknowns, two small angles and the height, and weights that forget what lies
// far from the plane.
glm::dvec3 tilted(glm::dvec3 up, double deviation, const std::vector<glm::dvec3>& points) {
    const glm::dvec3 given = up;
    double height = 0;
    for (int round = 0; round < 6; ++round) {
        const auto across = acrossOf(up);
        std::vector<double> heights;
        for (const glm::dvec3& p : points) heights.push_back(glm::dot(p, up));
        if (round == 0) height = densestHalf(heights).first;
        // One mean for each place where feet stood, so that standing long somewhere is no evidence.
        std::map<std::array<int, 2>, std::pair<glm::dvec3, double>> cells;
        for (size_t i = 0; i < points.size(); ++i) {
            const double off = (heights[i] - height) / (round < 2 ? 3 * kNoise : 1.5 * kNoise);
            const double weight = 1 / (1 + off * off * off * off);
            std::array<int, 2> cell;
            for (size_t k = 0; k < 2; ++k)
                cell[k] = static_cast<int>(std::floor(glm::dot(points[i], across[k]) / kCell));
            auto& [sum, total] = cells[cell];
            sum += weight * points[i];
            total += weight;
        }
        Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
        Eigen::Vector3d right = Eigen::Vector3d::Zero();
        for (const auto& [cell, mean] : cells) {
            if (mean.second < .5) continue;
            const glm::dvec3 place = mean.first / mean.second;
            const Eigen::Vector3d row(glm::dot(place, across[0]), glm::dot(place, across[1]), -1);
            normal += row * row.transpose() / (kNoise * kNoise);
            right -= row * glm::dot(place, up) / (kNoise * kNoise);
        }
        for (int k = 0; k < 2; ++k) {
            const double now = glm::dot(up - given, across[static_cast<size_t>(k)]);
            normal(k, k) += 1 / (deviation * deviation);
            right(k) -= now / (deviation * deviation);
        }
        normal(2, 2) += 1e-6;
        const Eigen::Vector3d step = normal.ldlt().solve(right);
        if (!step.allFinite()) return given;
        up = glm::normalize(up + step(0) * across[0] + step(1) * across[1]);
        height = step(2);
    }
    return up;
}

}  // namespace

std::optional<GroundFrame> groundOf(const Motion& motion, const Proportions& body) {
    const size_t frames = motion.size();
    CHECK(frames > 0, "a motion has frames");
    const glm::dquat upright = uprightRotation(motion);
    glm::dvec3 up = glm::conjugate(upright) * glm::dvec3(0, 1, 0);
    const bool beforeCamera = up.y < -.5;
    // Contact points of each frame: left heel and toe, right heel and toe.
    std::vector<std::array<glm::dvec3, 4>> points(frames);
    Standing standing;
    for (size_t f = 0; f < frames; ++f) {
        const PlacedJoints joints = placed(body, poseInWorld(motion, body, f));
        for (size_t foot : {0, 1}) {
            const auto two = contactPoints(body, joints, foot);
            points[f][2 * foot] = two[0];
            points[f][2 * foot + 1] = two[1];
        }
        addStanding(body, joints, standing);
    }
    double deviation = kCameraTilt;
    if (beforeCamera && standing.count > 0) {
        const glm::dvec3 axis = glm::normalize(standing.sum);
        const double camera = 1 / (kCameraTilt * kCameraTilt),
                     bodies = 1 / (kStandingTilt * kStandingTilt);
        up = glm::normalize(camera * up + bodies * axis);
        deviation = 1 / std::sqrt(camera + bodies);
    }
    const double rate = motion.fps > 0 ? motion.fps : 30;
    const auto lowestPoints = [&](bool slow) {
        std::vector<glm::dvec3> lowest;
        for (size_t f = 0; f < frames; ++f) {
            std::optional<glm::dvec3> best;
            for (size_t k = 0; k < 4; ++k) {
                const size_t before = f > 0 ? f - 1 : f, after = std::min(f + 1, frames - 1);
                const double seconds = double(std::max<size_t>(after - before, 1)) / rate;
                const double speed = glm::distance(points[after][k], points[before][k]) / seconds;
                if (slow && speed > kSlow) continue;
                if (!best || glm::dot(points[f][k], up) < glm::dot(*best, up)) best = points[f][k];
            }
            if (best) lowest.push_back(*best);
        }
        return lowest;
    };
    std::vector<glm::dvec3> lowest = lowestPoints(true);
    // Who never stands still, as on a treadmill that is not told, has a ground too.
    const bool still = lowest.size() >= std::max<size_t>(1, frames / 10);
    if (!still) lowest = lowestPoints(false);
    if (beforeCamera && still) up = tilted(up, deviation, lowest);
    std::vector<double> heights;
    for (const glm::dvec3& point : lowest) heights.push_back(glm::dot(point, up));
    const auto [height, width] = densestHalf(heights);
    if (width > kLayer) return {};
    // The world's own axes, turned the shortest way.
    GroundFrame ground;
    const glm::dvec3 straight = upright * up;
    ground.rotation = glm::mat3_cast(turnBetween(straight, {0, 1, 0}) * upright);
    ground.translation = {0, -height, 0};
    return ground;
}

std::vector<JointPose> onGround(const Motion& motion, const Proportions& body,
                                const GroundFrame& ground) {
    const glm::dquat turn = glm::quat_cast(ground.rotation);
    std::vector<JointPose> poses;
    for (size_t f = 0; f < motion.size(); ++f) {
        JointPose pose = poseInWorld(motion, body, f);
        pose.local[0] = turn * pose.local[0];
        pose.pelvis = ground.rotation * pose.pelvis + ground.translation;
        poses.push_back(pose);
    }
    return poses;
}

void fromGround(const std::vector<JointPose>& poses, const Proportions& body,
                const GroundFrame& ground, Motion& motion) {
    CHECK(poses.size() == motion.size(), "as many poses as frames");
    const glm::dmat3 back = glm::transpose(ground.rotation);
    for (size_t f = 0; f < poses.size(); ++f) {
        Theta& theta = motion.theta[f];
        Trans& trans = motion.trans[f];
        for (size_t j = 0; j < joint::kCount; ++j) {
            const glm::dquat turn =
                j == 0 ? glm::quat_cast(back) * poses[f].local[0] : poses[f].local[j];
            setJointRotation(theta, j, turn);
        }
        const glm::dvec3 place = back * (poses[f].pelvis - ground.translation) - body.rest[0];
        for (int k = 0; k < 3; ++k) trans[static_cast<size_t>(k)] = static_cast<float>(place[k]);
        if (!motion.views.empty()) movePose(motion.views[f], theta, trans);
    }
}

}  // namespace doppel
