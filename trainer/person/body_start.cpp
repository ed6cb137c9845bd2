#include "trainer/person/body_start.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "trainer/person/heads.h"

namespace doppel {

namespace {

using glm::dmat3;
using glm::dquat;
using glm::dvec3;
using namespace landmark;

constexpr double kPi = std::numbers::pi;

// A frame with this x axis, and its y axis as near to `up` as that leaves. Where they are in one
// line, as landmarks that mean nothing may be, it is the identity.
dmat3 frameOf(const dvec3& x, const dvec3& up) {
    const dvec3 across = glm::cross(x, up);
    if (!(glm::length(across) > 1e-9)) return dmat3(1);
    const dvec3 a = glm::normalize(x);
    const dvec3 c = glm::normalize(across);
    return {a, glm::cross(c, a), c};
}

// The smallest rotation that takes one direction to the other; none, where there is no direction.
dquat swing(const dvec3& from, const dvec3& to) {
    if (!(glm::length(from) * glm::length(to) > 1e-9)) return {1, 0, 0, 0};
    return {glm::normalize(from), glm::normalize(to)};
}

// At most so many radians of it.
dquat atMost(const dquat& rotation, double most) {
    const dvec3 turn = axisAngleOf(rotation);
    const double angle = glm::length(turn);
    return angle <= most ? rotation : quaternionOf(turn * (most / angle));
}

dvec3 withoutPart(const dvec3& v, const dvec3& along) {
    const dvec3 a = along / std::max(glm::length(along), 1e-9);
    return v - glm::dot(v, a) * a;
}

// From heel to the tip of the big toe, as landmarks have them, metres of the body.
constexpr double kFootLength = .22;

// In the order of FacePoints.
constexpr std::array kFaceLandmarks{kNose, kLeftEye, kRightEye, kLeftEar, kRightEar};

// Shoulders and face are off by so much before a neck is known to be bent, metres.
constexpr double kNeckDoubt = .05;

// A point of a body, in metres about its middle, and where it is seen.
struct Seen {
    dvec3 point;
    Landmark landmark;
};

// The translation that puts the points where they are seen, in the mean square; residual: pixels.
// f (x + tx) / (z + tz) = u − cx is linear in t once multiplied out; weighed by 1 / (z + tz), of
// the turn before, the errors are pixels.
dvec3 stand(const std::vector<Seen>& seen, const Camera& camera, double* residual = nullptr) {
    dvec3 t(0, 0, 3);
    for (int turn = 0; turn < 5; ++turn) {
        Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * 1e-9;
        Eigen::Vector3d right = Eigen::Vector3d::Zero();
        for (const auto& [point, landmark] : seen) {
            const double depth = std::max(point.z + t.z, .1);
            const double u = landmark.picture[0] - camera.cx, v = landmark.picture[1] - camera.cy;
            const Eigen::Vector3d rowU(camera.fx, 0, -u), rowV(0, camera.fy, -v);
            const double weight = landmark.visibility * landmark.presence + .01;
            const double w = weight / (depth * depth);
            normal += w * (rowU * rowU.transpose() + rowV * rowV.transpose());
            right += w * (rowU * (u * point.z - camera.fx * point.x) +
                          rowV * (v * point.z - camera.fy * point.y));
        }
        const Eigen::Vector3d solved = normal.ldlt().solve(right);
        t = {solved[0], solved[1], std::max(solved[2], .3)};
    }
    if (residual) {
        double squares = 0, weights = 0;
        for (const auto& [point, landmark] : seen) {
            const dvec3 p = point + t;
            const auto uv = camera.project({p.x, p.y, std::max(p.z, .1)});
            const double weight = landmark.visibility * landmark.presence + .01;
            squares += weight * (std::pow(uv[0] - landmark.picture[0], 2) +
                                 std::pow(uv[1] - landmark.picture[1], 2));
            weights += weight;
        }
        *residual = std::sqrt(squares / weights);
    }
    return t;
}

}  // namespace

double angleOfLens(double focalLength) { return std::atan(18 / focalLength) * 360 / kPi; }

Camera cameraOfAngle(int width, int height, double degrees) {
    const double focal = std::max(width, height) / (2 * std::tan(degrees * kPi / 360));
    return {focal, focal, width / 2., height / 2., width, height};
}

Betas betasOfHeight(const BodyModel& body, double metres) {
    // Height is nearly linear in the shape; Newton's steps of least length.
    std::array<double, BodyModel::kShapes> beta{};
    const auto height = [&](std::span<const double> shape) {
        const std::vector<double> points = shapedVertices(body, shape);
        double low = points[1], high = points[1];
        for (size_t i = 1; i < points.size(); i += 3) {
            low = std::min(low, points[i]);
            high = std::max(high, points[i]);
        }
        return high - low;
    };
    for (int turn = 0; turn < 4; ++turn) {
        const double now = height(beta);
        std::array<double, BodyModel::kShapes> slope;
        double squares = 1e-12;
        for (size_t k = 0; k < beta.size(); ++k) {
            auto other = beta;
            other[k] += .1;
            slope[k] = (height(other) - now) / .1;
            squares += slope[k] * slope[k];
        }
        for (size_t k = 0; k < beta.size(); ++k) beta[k] += (metres - now) * slope[k] / squares;
    }
    Betas betas{};
    std::ranges::transform(beta, betas.begin(), [](double b) { return float(b); });
    return betas;
}

std::optional<size_t> landmarkOfJoint(size_t number) {
    switch (number) {
        case joint::kLeftHip:
            return kLeftHip;
        case joint::kRightHip:
            return kRightHip;
        case joint::kLeftKnee:
            return kLeftKnee;
        case joint::kRightKnee:
            return kRightKnee;
        case joint::kLeftAnkle:
            return kLeftAnkle;
        case joint::kRightAnkle:
            return kRightAnkle;
        case joint::kLeftShoulder:
            return kLeftShoulder;
        case joint::kRightShoulder:
            return kRightShoulder;
        case joint::kLeftElbow:
            return kLeftElbow;
        case joint::kRightElbow:
            return kRightElbow;
        case joint::kLeftWrist:
            return kLeftWrist;
        case joint::kRightWrist:
            return kRightWrist;
        default:
            return {};
    }
}

BodyPoser3d::BodyPoser3d(const BodyModel& body, const Betas& betas) {
    const std::vector<double> joints =
        restJoints(body, std::vector<double>(betas.begin(), betas.end()));
    for (size_t j = 0; j < joint::kCount; ++j) {
        parents_[j] = body.parents[j];
        rest_[j] = {joints[3 * j], joints[3 * j + 1], joints[3 * j + 2]};
    }
}

dvec3 BodyPoser3d::restTrunk() const {
    return (rest_[joint::kLeftShoulder] + rest_[joint::kRightShoulder] - rest_[joint::kLeftHip] -
            rest_[joint::kRightHip]) /
           2.;
}

PersonLandmarks BodyPoser3d::atJoints(const PersonLandmarks& person, const Camera& camera) const {
    // Metres of the body, the means over four synthetic actors.
    constexpr double kHipsOut = .025, kHipsUp = .040, kShouldersForward = .014;
    PersonLandmarks moved = person;
    const auto at = [&](size_t i) {
        const Point3& p = person.points[i].world;
        return dvec3(p[0], p[1], p[2]);
    };
    std::vector<Seen> seen;
    for (size_t i = kLeftShoulder; i < kCount; ++i) seen.push_back({at(i), person.points[i]});
    const double distance = stand(seen, camera).z;
    const dvec3 up = (at(kLeftShoulder) + at(kRightShoulder) - at(kLeftHip) - at(kRightHip)) / 2.;
    const dvec3 across = at(kLeftHip) + at(kLeftShoulder) - at(kRightHip) - at(kRightShoulder);
    const double trunk = glm::length(up), area = glm::length(glm::cross(across, up));
    if (!(trunk > .05 && area > .1 * trunk * glm::length(across))) return moved;
    const dmat3 frame = frameOf(across, up);  // to the left, up, forward
    const double scale = trunk / glm::length(restTrunk());
    const auto move = [&](size_t i, const dvec3& by) {
        const dvec3 d = frame * by * scale;
        Landmark& point = moved.points[i];
        const double depth = std::max(distance + point.world[2], .1 * distance);
        point.picture[0] += camera.fx / depth * d.x;
        point.picture[1] += camera.fy / depth * d.y;
        for (size_t k = 0; k < 3; ++k) point.world[k] += d[glm::length_t(k)];
    };
    move(kLeftHip, {-kHipsOut, -kHipsUp, 0});
    move(kRightHip, {kHipsOut, -kHipsUp, 0});
    move(kLeftShoulder, {0, 0, -kShouldersForward});
    move(kRightShoulder, {0, 0, -kShouldersForward});
    return moved;
}

BodyStart BodyPoser3d::operator()(const PersonLandmarks& person, const Camera& camera,
                                  const std::optional<dmat3>& face) const {
    // Across and down the picture is surer than the landmarks in space, of which only depths are
    // taken. What they measure puts the hips at a distance, in metres of their own.
    std::vector<Seen> seen;
    for (size_t i = kLeftShoulder; i < kCount; ++i) {
        const Point3& p = person.points[i].world;
        seen.push_back({{p[0], p[1], p[2]}, person.points[i]});
    }
    const double distance = stand(seen, camera).z;
    const auto at = [&](size_t i) {
        const Landmark& point = person.points[i];
        const double depth = std::max(distance + point.world[2], .1 * distance);
        return dvec3((point.picture[0] - camera.cx) / camera.fx * depth,
                     (point.picture[1] - camera.cy) / camera.fy * depth, point.world[2]);
    };
    const auto bone = [&](size_t from, size_t to) { return at(to) - at(from); };
    const auto restBone = [&](size_t from, size_t to) { return rest_[to] - rest_[from]; };
    std::array<dquat, joint::kCount> turned;  // in the parent's frame
    turned.fill(dquat(1, 0, 0, 0));

    // Trunk: the pelvis by the hips, the chest by the shoulders, and between them the spine.
    const dvec3 up = (at(kLeftShoulder) + at(kRightShoulder) - at(kLeftHip) - at(kRightHip)) / 2.;
    const dvec3 restUp = restTrunk();
    const dmat3 hips = frameOf(bone(kRightHip, kLeftHip), up) *
                       glm::transpose(frameOf(restBone(joint::kRightHip, joint::kLeftHip), restUp));
    const dmat3 shoulders =
        frameOf(bone(kRightShoulder, kLeftShoulder), up) *
        glm::transpose(frameOf(restBone(joint::kRightShoulder, joint::kLeftShoulder), restUp));
    const dquat pelvis = glm::quat_cast(hips);
    const dquat twist = atMost(glm::inverse(pelvis) * glm::quat_cast(shoulders), 1.2);
    turned[joint::kPelvis] = pelvis;
    const dquat third = quaternionOf(axisAngleOf(twist) / 3.);
    turned[joint::kSpine1] = turned[joint::kSpine2] = turned[joint::kSpine3] = third;
    const dquat chest = pelvis * third * third * third;

    // Head: as the face looks, or by the ears, and the nose before them and a little below.
    dmat3 head;
    if (face) {
        // As if in the picture's middle: turned with the ray on which it is seen.
        const Point3& nose = person.points[kNose].picture;
        const dvec3 ray((nose[0] - camera.cx) / camera.fx, (nose[1] - camera.cy) / camera.fy, 1);
        head = glm::mat3_cast(swing({0, 0, 1}, ray)) * *face;
    } else {
        const dvec3 ears = bone(kRightEar, kLeftEar);
        const dvec3 nose = at(kNose) - (at(kLeftEar) + at(kRightEar)) / 2.;
        head = frameOf(ears, glm::cross(nose, ears)) *
               glm::transpose(frameOf({1, 0, 0}, glm::cross(dvec3(0, -.25, 1), dvec3(1, 0, 0))));
    }
    const dquat nod = atMost(glm::inverse(chest) * glm::quat_cast(head), 1.2);
    // Which way a head is tilted the picture shows. How far it is turned about its own axis is
    // guessed from depths, which exaggerate: half of it is nearer the truth.
    const dquat aside = glm::normalize(dquat(nod.w, 0, nod.y, 0));
    const dquat looks =
        face ? chest * nod
             : chest * nod * glm::inverse(aside) * quaternionOf(axisAngleOf(aside) / 2.);
    // The neck takes half of it. Where that puts the head far from where nose, eyes and ears are
    // seen, as above a back that is not straight, it bends there, across the view.
    const double scale = glm::length(up) / glm::length(restUp);
    const dquat between = chest * quaternionOf(axisAngleOf(glm::inverse(chest) * looks) / 2.);
    const dvec3 neckBone = between * restBone(joint::kNeck, joint::kHead) * scale;
    const dvec3 shouldersToNeck =
        rest_[joint::kNeck] - (rest_[joint::kLeftShoulder] + rest_[joint::kRightShoulder]) / 2.;
    const dvec3 skull =
        (at(kLeftShoulder) + at(kRightShoulder)) / 2. + chest * shouldersToNeck * scale + neckBone;
    dvec3 off(0);
    double weights = 1e-9;
    for (size_t k = 0; k < kFace.size(); ++k) {
        const Landmark& point = person.points[kFaceLandmarks[k]];
        const double weight = point.visibility * point.presence;
        off += weight * (at(kFaceLandmarks[k]) - looks * kFace[k] * scale - skull);
        weights += weight;
    }
    off = withoutPart(off / weights, skull + dvec3(0, 0, distance));
    const double away = glm::dot(off, off), unsure = std::pow(kNeckDoubt * scale, 2);
    const dquat neck =
        atMost(swing(neckBone, neckBone + off * (away / (away + unsure))), 1.0) * between;
    turned[joint::kNeck] = glm::inverse(chest) * neck;
    turned[joint::kHead] = atMost(glm::inverse(neck) * looks, 1.2);

    // A limb's upper bone points where the landmarks do; about itself it is turned so that the
    // plane of its hinge is the one in which the limb is bent, as far as it is bent.
    struct Limb {
        size_t upper, lower, end;        // joints
        size_t upperAt, lowerAt, endAt;  // landmarks
        dvec3 bends;                     // where the lower bone goes from the rest pose
    };
    const Limb limbs[] = {
        {joint::kLeftShoulder,
         joint::kLeftElbow,
         joint::kLeftWrist,
         kLeftShoulder,
         kLeftElbow,
         kLeftWrist,
         {0, 0, 1}},
        {joint::kRightShoulder,
         joint::kRightElbow,
         joint::kRightWrist,
         kRightShoulder,
         kRightElbow,
         kRightWrist,
         {0, 0, 1}},
        {joint::kLeftHip,
         joint::kLeftKnee,
         joint::kLeftAnkle,
         kLeftHip,
         kLeftKnee,
         kLeftAnkle,
         {0, 0, -1}},
        {joint::kRightHip,
         joint::kRightKnee,
         joint::kRightAnkle,
         kRightHip,
         kRightKnee,
         kRightAnkle,
         {0, 0, -1}},
    };
    // As it points in the rest pose, a little outwards; soles are flat on the ground.
    const auto restFoot = [&](bool left) {
        dvec3 foot = left ? restBone(joint::kLeftAnkle, joint::kLeftFoot)
                          : restBone(joint::kRightAnkle, joint::kRightFoot);
        foot.y = 0;
        return foot;
    };
    // From heel to toes. The landmarks in space make feet half as long as they are, and their depth
    // little or wrong, from behind above all. The tip is where its ray is a foot's length from the
    // heel, which is as deep as the ankle: of two such places the one that is more to the front,
    // as the shin has it.
    const double footLength = kFootLength * scale;
    const auto footOf = [&](const Limb& limb) {
        const bool left = limb.end == joint::kLeftAnkle;
        const auto ray = [&](size_t i) {
            const Point3& p = person.points[i].picture;
            return dvec3((p[0] - camera.cx) / camera.fx, (p[1] - camera.cy) / camera.fy, 1);
        };
        const double depth = std::max(distance + person.points[limb.endAt].world[2], .1 * distance);
        const dvec3 heel = ray(left ? kLeftHeel : kRightHeel) * depth,
                    tip = ray(left ? kLeftFootTip : kRightFootTip);
        // (depth - middle)² along the ray. Where the foot lies across the view a length that is off
        // by a tenth would turn it by 26 degrees, so that what is small is made smaller.
        const double along = glm::dot(tip, tip), middle = glm::dot(tip, heel) / along;
        const double square = std::max(
            0., middle * middle - (glm::dot(heel, heel) - footLength * footLength) / along);
        const double doubt = std::pow(.4 * footLength, 2) / along;
        const double root = square / std::sqrt(square + doubt + 1e-12);
        const dvec3 shin = bone(limb.lowerAt, limb.endAt);
        const dvec3 forward =
            swing(pelvis * restBone(limb.lower, limb.end), shin) * pelvis * restFoot(left);
        const dvec3 near = tip * (middle - root) - heel, far = tip * (middle + root) - heel;
        return glm::dot(near, forward) > glm::dot(far, forward) ? near : far;
    };
    for (const Limb& limb : limbs) {
        const bool leg = limb.upper == joint::kLeftHip || limb.upper == joint::kRightHip;
        const dquat parent = leg ? pelvis : chest, back = glm::inverse(parent);
        const dvec3 upper = back * bone(limb.upperAt, limb.lowerAt);
        const dvec3 lower = back * bone(limb.lowerAt, limb.endAt);
        const dvec3 restUpper = restBone(limb.upper, limb.lower);
        const dvec3 restLower = restBone(limb.lower, limb.end);
        const dquat straight = swing(restUpper, upper);
        const dvec3 restPlane = glm::normalize(withoutPart(limb.bends, restUpper));
        // The sine of the bend weighs against what an unbent limb does: a leg's plane is then its
        // foot's, an arm's that of the smallest turn.
        const dvec3 bent = withoutPart(lower, upper) / std::max(glm::length(lower), 1e-9);
        dvec3 plane = straight * restPlane;
        const dvec3 foot = leg ? footOf(limb) : dvec3(0);
        if (leg) {
            plane += -2. * withoutPart(back * foot, upper) / std::max(glm::length(foot), 1e-6);
            plane /= std::max(glm::length(plane), 1e-9);
        }
        // Knees' depths are off by what a bend of 15 degrees is; what elbows say is surer than the
        // smallest turn.
        const double sine = glm::length(bent);
        plane = leg ? plane + bent * sine : .3 * plane + bent * std::min(1., sine / .3);
        const dquat hinge = glm::quat_cast(frameOf(upper, withoutPart(plane, upper)) *
                                           glm::transpose(frameOf(restUpper, restPlane)));
        turned[limb.upper] = hinge;
        turned[limb.lower] = atMost(swing(restLower, glm::inverse(hinge) * lower), 2.8);
        if (!leg) continue;
        const dquat shin = parent * hinge * turned[limb.lower];
        turned[limb.end] =
            atMost(swing(restFoot(limb.end == joint::kLeftAnkle), glm::inverse(shin) * foot), .8);
    }

    // Joints about the pelvis, in the camera's axes.
    std::array<dquat, joint::kCount> global;
    std::array<dvec3, joint::kCount> place;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const int parent = parents_[j];
        global[j] = parent < 0 ? turned[j] : global[size_t(parent)] * turned[j];
        place[j] = parent < 0 ? dvec3(0)
                              : place[size_t(parent)] +
                                    global[size_t(parent)] * (rest_[j] - rest_[size_t(parent)]);
    }
    seen.clear();
    for (size_t j = 0; j < joint::kCount; ++j)
        if (const auto number = landmarkOfJoint(j))
            seen.push_back({place[j], person.points[*number]});
    BodyStart start;
    const dvec3 t = stand(seen, camera, &start.residual);
    for (size_t j = 0; j < joint::kCount; ++j) setJointRotation(start.theta, j, turned[j]);
    // The pelvis stands at rest_0 + trans.
    for (size_t k = 0; k < 3; ++k)
        start.trans[k] = float(t[glm::length_t(k)] - rest_[0][glm::length_t(k)]);
    return start;
}

std::array<float, 75> openPoseKeypoints(const PersonLandmarks& person) {
    std::array<float, 75> keypoints{};
    const auto put = [&](size_t k, std::initializer_list<size_t> from) {
        double x = 0, y = 0, sure = 1;
        for (size_t i : from) {
            const Landmark& point = person.points[i];
            x += point.picture[0] / double(from.size());
            y += point.picture[1] / double(from.size());
            sure = std::min(sure, point.visibility * point.presence);
        }
        keypoints[3 * k] = float(x);
        keypoints[3 * k + 1] = float(y);
        keypoints[3 * k + 2] = float(sure);
    };
    put(0, {kNose});
    put(1, {kLeftShoulder, kRightShoulder});
    put(8, {kLeftHip, kRightHip});
    constexpr std::array<std::pair<size_t, size_t>, 18> kPairs{{{2, kRightShoulder},
                                                                {3, kRightElbow},
                                                                {4, kRightWrist},
                                                                {5, kLeftShoulder},
                                                                {6, kLeftElbow},
                                                                {7, kLeftWrist},
                                                                {9, kRightHip},
                                                                {10, kRightKnee},
                                                                {11, kRightAnkle},
                                                                {12, kLeftHip},
                                                                {13, kLeftKnee},
                                                                {14, kLeftAnkle},
                                                                {15, kRightEye},
                                                                {16, kLeftEye},
                                                                {17, kRightEar},
                                                                {18, kLeftEar},
                                                                {19, kLeftFootTip},
                                                                {22, kRightFootTip}}};
    for (const auto& [k, i] : kPairs) put(k, {i});
    put(21, {kLeftHeel});
    put(24, {kRightHeel});
    return keypoints;
}

}  // namespace doppel
