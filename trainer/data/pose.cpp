#include "trainer/data/pose.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr std::array<const char*, joint::kCount> kNames = {
    "pelvis",     "left_hip",    "right_hip",    "spine1",      "left_knee",     "right_knee",
    "spine2",     "left_ankle",  "right_ankle",  "spine3",      "left_foot",     "right_foot",
    "neck",       "left_collar", "right_collar", "head",        "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist",   "right_wrist", "left_hand",     "right_hand"};

}  // namespace

const char* jointName(size_t joint) {
    CHECK(joint < kNames.size(), "joint {} is one of 24", joint);
    return kNames[joint];
}

std::optional<size_t> jointNumber(std::string_view name) {
    const auto at = std::find(kNames.begin(), kNames.end(), name);
    if (at == kNames.end()) return {};
    return static_cast<size_t>(at - kNames.begin());
}

// ---- rotations ----------------------------------------------------------------------------------

glm::dquat quaternionOf(const glm::dvec3& axisAngle) {
    const double angle = glm::length(axisAngle);
    // sin(a/2)/a, whose limit at 0 is a half.
    const double scale = angle > 1e-9 ? std::sin(angle / 2) / angle : .5;
    return {std::cos(angle / 2), scale * axisAngle.x, scale * axisAngle.y, scale * axisAngle.z};
}

glm::dvec3 axisAngleOf(const glm::dquat& rotation) {
    const double side = rotation.w < 0 ? -1 : 1;
    const glm::dvec3 axis = side * glm::dvec3(rotation.x, rotation.y, rotation.z);
    const double sine = glm::length(axis);
    return axis * (sine > 1e-12 ? 2 * std::atan2(sine, side * rotation.w) / sine : 2.);
}

glm::dquat jointRotation(const Theta& theta, size_t joint) {
    return quaternionOf({theta[3 * joint], theta[3 * joint + 1], theta[3 * joint + 2]});
}

void setJointRotation(Theta& theta, size_t joint, const glm::dquat& rotation) {
    const glm::dvec3 axisAngle = axisAngleOf(rotation);
    for (int k = 0; k < 3; ++k)
        theta[3 * joint + static_cast<size_t>(k)] = static_cast<float>(axisAngle[k]);
}

glm::dquat turnBetween(const glm::dvec3& from, const glm::dvec3& to) {
    const double cosine = glm::dot(from, to);
    if (cosine < -1 + 1e-9) {
        const glm::dvec3 other = std::abs(from.y) < .9 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0);
        return quaternionOf(std::numbers::pi * glm::normalize(glm::cross(from, other)));
    }
    const glm::dvec3 axis = glm::cross(from, to);
    return glm::normalize(glm::dquat(1 + cosine, axis.x, axis.y, axis.z));
}

Theta thetaBetween(const Theta& one, const Theta& other, double share) {
    Theta between{};
    for (size_t j = 0; j < joint::kCount; ++j)
        setJointRotation(between, j,
                         glm::slerp(jointRotation(one, j), jointRotation(other, j), share));
    return between;
}

Trans transBetween(const Trans& one, const Trans& other, double share) {
    Trans between{};
    for (size_t c = 0; c < 3; ++c)
        between[c] = static_cast<float>((1 - share) * double(one[c]) + share * double(other[c]));
    return between;
}

void movePose(const RigidMotion& by, Theta& theta, Trans& trans) {
    if (by == RigidMotion{}) return;
    setJointRotation(theta, joint::kPelvis,
                     glm::quat_cast(by.rotation) * jointRotation(theta, joint::kPelvis));
    const glm::dvec3 pelvis(kRestPelvis[0], kRestPelvis[1], kRestPelvis[2]);
    const glm::dvec3 place =
        by.rotation * (pelvis + glm::dvec3(trans[0], trans[1], trans[2])) + by.translation - pelvis;
    for (int k = 0; k < 3; ++k) trans[static_cast<size_t>(k)] = static_cast<float>(place[k]);
}

// ---- files --------------------------------------------------------------------------------------

void requireFinite(std::span<const float> values, const std::string& what, size_t perFrame,
                   double most) {
    for (size_t i = 0; i < values.size(); ++i) {
        if (!std::isfinite(values[i])) {
            throwInput("{}: expected finite numbers, found {} in frame {}, element {}", what,
                       values[i], i / perFrame, i % perFrame);
        }
        if (std::abs(double(values[i])) > most) {
            throwInput("{}: expected numbers from {} to {}, found {} in frame {}, element {}", what,
                       -most, most, values[i], i / perFrame, i % perFrame);
        }
    }
}

Poses readPoses(const fs::path& path, bool needBetas) {
    const Npz npz = readNpz(path);
    const auto orient = npz.at("global_orient").requireShape({-1, 3}).toF32();
    const auto body = npz.at("body_pose").requireShape({-1, 69}).toF32();
    const auto transl = npz.at("transl").requireShape({-1, 3}).toF32();
    const auto file = path.string();
    requireFinite(orient, file + ": global_orient", 3, kMostRadians);
    requireFinite(body, file + ": body_pose", 69, kMostRadians);
    requireFinite(transl, file + ": transl", 3, kMostMetres);
    const size_t frames = orient.size() / 3;
    if (frames == 0) throwInput("{}: global_orient: expected one frame or more, found none", file);
    if (body.size() / 69 != frames) {
        throwInput("{}: body_pose: expected {} rows, as many as global_orient has, found {}", file,
                   frames, body.size() / 69);
    }
    if (transl.size() / 3 != frames) {
        throwInput("{}: transl: expected {} rows, as many as global_orient has, found {}", file,
                   frames, transl.size() / 3);
    }
    Poses poses;
    poses.theta.resize(frames);
    poses.trans.resize(frames);
    for (size_t f = 0; f < frames; ++f) {
        std::copy_n(orient.begin() + std::ptrdiff_t(3 * f), 3, poses.theta[f].begin());
        std::copy_n(body.begin() + std::ptrdiff_t(69 * f), 69, poses.theta[f].begin() + 3);
        std::copy_n(transl.begin() + std::ptrdiff_t(3 * f), 3, poses.trans[f].begin());
    }
    if (needBetas || npz.has("betas")) {
        const Array& array = npz.at("betas");
        // Some programs write [1, 10].
        if (array.shape != std::vector<int64_t>{1, 10}) array.requireShape({10});
        const auto betas = array.toF32();
        requireFinite(betas, file + ": betas", 10, kMostDeviations);
        std::copy(betas.begin(), betas.end(), poses.betas.begin());
    }
    if (const Array* fps = npz.find("fps")) poses.fps = fps->scalar();
    return poses;
}

Npz posesArrays(std::span<const Theta> theta, std::span<const Trans> trans, const Betas& betas) {
    const auto frames = static_cast<int64_t>(theta.size());
    std::vector<float> orient, body, transl;
    for (size_t f = 0; f < theta.size(); ++f) {
        orient.insert(orient.end(), theta[f].begin(), theta[f].begin() + 3);
        body.insert(body.end(), theta[f].begin() + 3, theta[f].end());
        transl.insert(transl.end(), trans[f].begin(), trans[f].end());
    }
    Npz poses;
    poses.set("betas", Array::f32({10}, betas));
    poses.set("global_orient", Array::f32({frames, 3}, orient));
    poses.set("body_pose", Array::f32({frames, 69}, body));
    poses.set("transl", Array::f32({frames, 3}, transl));
    return poses;
}

}  // namespace doppel
