#include "viewer/pose/take.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "engine/files/npz.h"

namespace doppel {

namespace fs = std::filesystem;

namespace {

// What a key changes: turns from the motion's pose to the key's, and the way from place to place.
struct Change {
    std::array<glm::dquat, joint::kCount> turn;
    glm::dvec3 place;
};

Change changeOf(const Keyframe& key, const Motion& motion) {
    const Pose under = motionPose(motion, key.time);
    Change change;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const glm::dquat before = quaternionOf(under.rotation[j]),
                         after = quaternionOf(key.pose.rotation[j]);
        // The pelvis's parent is the camera, which does not turn along with the body.
        change.turn[j] =
            j == joint::kPelvis ? glm::conjugate(before) * after : after * glm::conjugate(before);
        if (change.turn[j].w < 0) change.turn[j] = -change.turn[j];
    }
    change.place = key.pose.trans - under.trans;
    return change;
}

// From 1 at the key to 0 where the fade ends.
double weightAt(double distance, double fade) {
    if (!(distance < fade)) return 0;
    const double share = distance / fade;
    return 1 - share * share * (3 - 2 * share);
}

// Of the two that are the same rotation.
glm::dquat nearest(const glm::dquat& q, const glm::dquat& to) {
    return glm::dot(q, to) < 0 ? -q : q;
}

// A mean of rotations; `otherwise` where they cancel each other.
glm::dquat normalized(const glm::dquat& sum, const glm::dquat& otherwise) {
    const double length = glm::length(sum);
    return length > 1e-9 ? sum / length : otherwise;
}

Pose between(const Keyframe& from, const Keyframe& to, double time) {
    const double share = (time - from.time) / (to.time - from.time);
    Pose pose;
    for (size_t j = 0; j < joint::kCount; ++j)
        pose.rotation[j] = axisAngleOf(glm::slerp(quaternionOf(from.pose.rotation[j]),
                                                  quaternionOf(to.pose.rotation[j]), share));
    pose.trans = glm::mix(from.pose.trans, to.pose.trans, share);
    return pose;
}

}  // namespace

Pose motionPose(const Motion& motion, double time) {
    CHECK(motion.size() > 0, "a motion has frames");
    const double last = static_cast<double>(motion.size() - 1);
    const auto i = static_cast<size_t>(std::clamp(std::floor(time), 0., last));
    return poseOf(motion.theta[i], motion.trans[i]);
}

Pose poseAt(const Motion* motion, std::span<const Keyframe> keys, const Layer& layer, double time) {
    CHECK(motion || !keys.empty(), "there is something over time");
    const auto after = std::upper_bound(keys.begin(), keys.end(), time,
                                        [](double t, const Keyframe& key) { return t < key.time; });
    const Keyframe* next = after == keys.end() ? nullptr : &*after;
    const Keyframe* previous = after == keys.begin() ? nullptr : &*std::prev(after);
    if (previous && previous->time == time) return previous->pose;
    if (!motion) {
        if (!previous) return next->pose;
        return next ? between(*previous, *next, time) : previous->pose;
    }
    Pose pose = motionPose(*motion, time);
    const double reach =
        previous && next ? std::min(layer.fade, next->time - previous->time) : layer.fade;
    const double w0 = previous ? weightAt(time - previous->time, reach) : 0,
                 w1 = next ? weightAt(next->time - time, reach) : 0;
    if (w0 == 0 && w1 == 0) return pose;
    const Change a = previous ? changeOf(*previous, *motion) : Change{},
                 b = next ? changeOf(*next, *motion) : Change{};
    const glm::dquat none(1, 0, 0, 0);
    const bool overrides = layer.blend == Layer::Blend::Override;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const bool changesA = w0 > 0 && a.turn[j] != none, changesB = w1 > 0 && b.turn[j] != none;
        if (!changesA && !changesB) continue;
        const glm::dquat under = quaternionOf(pose.rotation[j]);
        if (overrides) {
            // A key that leaves the joint alone says nothing of it.
            const double v0 = changesA ? w0 : 0, v1 = changesB ? w1 : 0;
            glm::dquat sum = std::max(0., 1 - v0 - v1) * under;
            if (v0 > 0) sum = sum + v0 * nearest(quaternionOf(previous->pose.rotation[j]), under);
            if (v1 > 0) sum = sum + v1 * nearest(quaternionOf(next->pose.rotation[j]), under);
            pose.rotation[j] = axisAngleOf(normalized(sum, under));
            continue;
        }
        // The weighted mean of the turns, which all have w >= 0; what is left is for no turn.
        glm::dquat sum = std::max(0., 1 - w0 - w1) * none;
        if (w0 > 0) sum = sum + w0 * a.turn[j];
        if (w1 > 0) sum = sum + w1 * b.turn[j];
        const glm::dquat turn = normalized(sum, none);
        pose.rotation[j] = axisAngleOf(j == joint::kPelvis ? under * turn : turn * under);
    }
    const glm::dvec3 under = pose.trans, still(0);
    const auto add = [&](double weight, const Change& change, const Keyframe* key) {
        if (weight == 0 || change.place == still) return;
        pose.trans += weight * (overrides ? key->pose.trans - under : change.place);
    };
    add(w0, a, previous);
    add(w1, b, next);
    return pose;
}

Pose poseAt(const Take& take, double time) {
    return take.timed() ? poseAt(take.motion.get(), take.keys, take.layer, time) : take.pose;
}

// ---- files --------------------------------------------------------------------------------------

namespace {

// The arrays of a poses.npz, each name with `prefix` before it.
void setPoses(Npz& arrays, const std::string& prefix, std::span<const Theta> theta,
              std::span<const Trans> trans) {
    const Npz plain = posesArrays(theta, trans, {});
    for (const char* name : {"global_orient", "body_pose", "transl"})
        arrays.set(prefix + name, plain.at(name));
}

std::vector<double> columns(const Npz& arrays, const std::string& name, int64_t rows, int64_t width,
                            double most) {
    const std::vector<float> values = arrays.at(name).requireShape({rows, width}).toF32();
    requireFinite(values, arrays.file + ": " + name, static_cast<size_t>(width), most);
    return {values.begin(), values.end()};
}

// Rows of the three arrays whose names begin with `prefix`.
std::vector<Pose> posesIn(const Npz& arrays, const std::string& prefix, int64_t rows) {
    const auto root = columns(arrays, prefix + "global_orient", rows, 3, kMostRadians);
    const auto body = columns(arrays, prefix + "body_pose", rows, 69, kMostRadians);
    const auto place = columns(arrays, prefix + "transl", rows, 3, kMostMetres);
    std::vector<Pose> poses(static_cast<size_t>(rows));
    for (size_t i = 0; i < poses.size(); ++i) {
        for (size_t j = 0; j < joint::kCount; ++j)
            for (size_t k = 0; k < 3; ++k)
                poses[i].rotation[j][static_cast<int>(k)] =
                    j == 0 ? root[3 * i + k] : body[69 * i + 3 * (j - 1) + k];
        poses[i].trans = {place[3 * i], place[3 * i + 1], place[3 * i + 2]};
    }
    return poses;
}

}  // namespace

void writeTake(const fs::path& out, const Take& take, double fps) {
    if (!(fps > 0) || !(fps <= 10000))
        throwInput("{}: fps: expected frames per second, above 0 and up to 10000, found {}",
                   out.string(), fps);
    std::vector<Theta> theta, keyTheta;
    std::vector<Trans> trans, keyTrans;
    std::vector<double> times;
    for (const Keyframe& key : take.keys) {
        keyTheta.push_back(thetaOf(key.pose));
        keyTrans.push_back(transOf(key.pose));
        times.push_back(key.time);
    }
    if (take.motion) {
        for (size_t i = 0; i < take.motion->size(); ++i) {
            // Frames that no key touches keep the motion's numbers to the last bit.
            const Pose pose = poseAt(take, static_cast<double>(i));
            theta.push_back(thetaOf(pose));
            trans.push_back(transOf(pose));
        }
    } else if (take.keys.empty()) {
        theta.push_back(thetaOf(take.pose));
        trans.push_back(transOf(take.pose));
    } else {
        theta = keyTheta;
        trans = keyTrans;
    }
    Npz arrays = posesArrays(theta, trans, take.betas);
    arrays.set("fps", Array::scalarF64(fps));
    if (!times.empty())
        arrays.set("key_times", Array::f64({static_cast<int64_t>(times.size())}, times));
    if (take.motion && !times.empty()) {
        setPoses(arrays, "motion_", take.motion->theta, take.motion->trans);
        setPoses(arrays, "key_", keyTheta, keyTrans);
        arrays.set("key_fade", Array::scalarF64(take.layer.fade));
        arrays.set("key_blend", Array::scalarF64(static_cast<double>(take.layer.blend)));
    }
    writeNpz(out, arrays, false);
}

std::optional<Take> readTake(const fs::path& file) {
    std::error_code error;
    if (fs::is_directory(file, error) || endingOf(file) != ".npz") return std::nullopt;
    const Npz arrays = readNpz(file);
    if (!arrays.has("key_times")) return std::nullopt;
    Motion rows = readMotion(file);
    const auto frames = static_cast<int64_t>(rows.size());
    const bool layer = arrays.has("key_global_orient");
    const std::vector<double> times =
        arrays.at("key_times").requireShape({layer ? -1 : frames}).toF64();
    if (times.empty())
        throwInput("{}: key_times: expected one time or more, found none", file.string());
    for (size_t i = 0; i < times.size(); ++i)
        if (!(std::abs(times[i]) <= kLargestTime) ||
            (i > 0 && !(times[i] > times[i - 1] + kSameTime)))
            throwInput("{}: key_times: expected growing times up to {} frames, found {} in row {}",
                       file.string(), kLargestTime, times[i], i);
    Take take;
    take.betas = rows.betas;
    std::vector<Pose> poses;
    if (layer) {
        poses = posesIn(arrays, "key_", static_cast<int64_t>(times.size()));
        take.layer.fade = arrays.at("key_fade").scalar();
        if (!(take.layer.fade >= 0) || !(take.layer.fade <= kLongestFade))
            throwInput("{}: key_fade: expected 0 to {} frames, found {}", file.string(),
                       kLongestFade, take.layer.fade);
        const double blend = arrays.has("key_blend") ? arrays.at("key_blend").scalar() : 0;
        if (blend != 0 && blend != 1)
            throwInput("{}: key_blend: expected 0 (add) or 1 (override), found {}", file.string(),
                       blend);
        take.layer.blend = static_cast<Layer::Blend>(blend);
        const std::vector<Pose> under = posesIn(arrays, "motion_", frames);
        for (size_t i = 0; i < under.size(); ++i) {
            rows.theta[i] = thetaOf(under[i]);
            rows.trans[i] = transOf(under[i]);
        }
        take.motion = std::make_shared<const Motion>(std::move(rows));
    } else {
        for (size_t i = 0; i < rows.size(); ++i)
            poses.push_back(poseOf(rows.theta[i], rows.trans[i]));
    }
    for (size_t i = 0; i < poses.size(); ++i) take.keys.push_back({times[i], poses[i]});
    take.pose = take.keys[0].pose;
    return take;
}

}  // namespace doppel
