#include "trainer/avatar/formats/motion_files.h"

#include <cmath>
#include <functional>
#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/npz.h"
#include "trainer/data/pose.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr double kDegrees = 180 / 3.14159265358979323846;

const GltfAnimation& animationOf(const GltfScene& scene) {
    CHECK(scene.animation && !scene.animation->times.empty(), "a motion's file needs a motion");
    return *scene.animation;
}

glm::dquat rotationAt(const GltfScene& scene, size_t key, size_t joint) {
    const float* q = &scene.animation->rotations[4 * (key * scene.skeleton.size() + joint)];
    return {q[3], q[0], q[1], q[2]};
}

glm::dvec3 placeAt(const GltfScene& scene, size_t key) {
    glm::dvec3 place;
    for (int c = 0; c < 3; ++c) {
        const auto k = static_cast<size_t>(c);
        place[c] = double(scene.skeleton[0].position[k]) +
                   double(scene.animation->translations[3 * key + k]);
    }
    return place;
}

double rateOf(const GltfAnimation& animation) {
    const size_t keys = animation.times.size();
    if (keys < 2) return 30;
    const double rate = double(keys - 1) / (double(animation.times[keys - 1]) - animation.times[0]);
    const double whole = std::round(rate);
    return std::abs(rate - whole) < 1e-4 * rate ? whole : rate;
}

// Degrees about z, x and y whose product is the rotation, next to those before.
glm::dvec3 anglesOf(const glm::dquat& rotation, const glm::dvec3& before) {
    const glm::dmat3 m = glm::mat3_cast(rotation);
    const auto at = [&](int row, int column) { return m[column][row]; };
    const double sine = std::clamp(at(2, 1), -1., 1.);
    glm::dvec3 angles;  // z, x, y
    angles[1] = std::asin(sine) * kDegrees;
    if (std::abs(sine) < 1 - 1e-9) {
        angles[0] = std::atan2(-at(0, 1), at(1, 1)) * kDegrees;
        angles[2] = std::atan2(-at(2, 0), at(2, 2)) * kDegrees;
    } else {
        // The first and the last axis are one: it is turned by either.
        angles[2] = before[2];
        angles[0] = std::atan2(at(1, 0), at(0, 0)) * kDegrees - (sine > 0 ? 1 : -1) * before[2];
    }
    // The other three angles of the same rotation, where they are nearer.
    const auto near = [&](glm::dvec3 a) {
        for (int c = 0; c < 3; ++c) a[c] += 360 * std::round((before[c] - a[c]) / 360);
        return a;
    };
    const glm::dvec3 one = near(angles),
                     other = near({angles[0] + 180, 180 - angles[1], angles[2] + 180});
    const auto away = [&](const glm::dvec3& a) {
        return std::abs(a.x - before.x) + std::abs(a.y - before.y) + std::abs(a.z - before.z);
    };
    return away(other) < away(one) ? other : one;
}

}  // namespace

void writeBvh(const fs::path& out, const GltfScene& scene) {
    const GltfAnimation& animation = animationOf(scene);
    AtomicFile file(out);
    const size_t joints = scene.skeleton.size();
    std::string text = "HIERARCHY\n";
    std::vector<size_t> order;  // of the channels
    const std::function<void(size_t, int)> write = [&](size_t j, int depth) {
        order.push_back(j);
        const GltfJoint& joint = scene.skeleton[j];
        const std::string indent(static_cast<size_t>(depth), '\t');
        // Some programs add the root's offset to its place, and others do not: it has none.
        glm::dvec3 offset(0);
        if (joint.parent >= 0) {
            const auto& above = scene.skeleton[static_cast<size_t>(joint.parent)].position;
            offset = glm::dvec3(joint.position[0], joint.position[1], joint.position[2]) -
                     glm::dvec3(above[0], above[1], above[2]);
        }
        offset *= 100;
        text += fmt::format("{}{} {}\n{}{{\n{}\tOFFSET {:.6f} {:.6f} {:.6f}\n", indent,
                            joint.parent < 0 ? "ROOT" : "JOINT", joint.name, indent, indent,
                            offset.x, offset.y, offset.z);
        text += fmt::format("{}\tCHANNELS {} Zrotation Xrotation Yrotation\n", indent,
                            joint.parent < 0 ? "6 Xposition Yposition Zposition" : "3");
        bool leaf = true;
        for (size_t child = j + 1; child < joints; ++child)
            if (scene.skeleton[child].parent == static_cast<int>(j)) {
                leaf = false;
                write(child, depth + 1);
            }
        // A bone of five centimetres, the way the one before it goes.
        if (leaf) {
            const double length = glm::length(offset);
            const glm::dvec3 end = length > 1e-9 ? offset * (5 / length) : glm::dvec3(0, 5, 0);
            text += fmt::format(
                "{0}\tEnd Site\n{0}\t{{\n{0}\t\tOFFSET {1:.6f} {2:.6f} {3:.6f}\n{0}\t}}\n", indent,
                end.x, end.y, end.z);
        }
        text += indent + "}\n";
    };
    write(0, 0);
    const size_t keys = animation.times.size();
    text += fmt::format("MOTION\nFrames: {}\nFrame Time: {:.9f}\n", keys, 1 / rateOf(animation));
    std::vector<glm::dvec3> before(joints, glm::dvec3(0));
    for (size_t k = 0; k < keys; ++k) {
        const glm::dvec3 place = placeAt(scene, k) * 100.;
        text += fmt::format("{:.5f} {:.5f} {:.5f}", place.x, place.y, place.z);
        for (const size_t j : order) {
            before[j] = anglesOf(rotationAt(scene, k, j), before[j]);
            text += fmt::format(" {:.5f} {:.5f} {:.5f}", before[j].x, before[j].y, before[j].z);
        }
        text += '\n';
    }
    file.write(text);
    file.commit();
}

void writeAmass(const fs::path& out, const GltfScene& scene) {
    constexpr size_t kBodyJoints = 22, kWidth = 156;
    const GltfAnimation& animation = animationOf(scene);
    const size_t keys = animation.times.size();
    const glm::dquat zUp = glm::angleAxis(std::acos(0.), glm::dvec3(1, 0, 0));
    std::vector<double> poses, trans;
    for (size_t k = 0; k < keys; ++k) {
        for (size_t j = 0; j < kBodyJoints; ++j) {
            glm::dquat q = rotationAt(scene, k, j);
            if (j == 0) q = zUp * q;
            const glm::dvec3 v = axisAngleOf(q);
            poses.insert(poses.end(), {v.x, v.y, v.z});
        }
        poses.resize((k + 1) * kWidth, 0.);
        const glm::dvec3 place = zUp * placeAt(scene, k);
        for (int c = 0; c < 3; ++c) trans.push_back(place[c] - kRestPelvis[static_cast<size_t>(c)]);
    }
    const auto count = static_cast<int64_t>(keys);
    Npz npz;
    npz.set("poses", Array::f64({count, static_cast<int64_t>(kWidth)}, poses));
    npz.set("trans", Array::f64({count, 3}, trans));
    npz.set("betas", Array::f64({16}, std::vector<double>(16)));
    npz.set("dmpls", Array::f64({count, 8}, std::vector<double>(8 * keys)));
    npz.set("gender", Array::text("neutral"));
    npz.set("mocap_framerate", Array::scalarF64(rateOf(animation)));
    writeNpz(out, npz, true);
}

void writePosesJson(const fs::path& out, const GltfScene& scene) {
    const GltfAnimation& animation = animationOf(scene);
    AtomicFile file(out);
    nlohmann::ordered_json json{{"fps", rateOf(animation)}, {"up", "y"}, {"unit", "metre"}};
    for (const GltfJoint& joint : scene.skeleton) {
        json["joints"].push_back(joint.name);
        json["parents"].push_back(joint.parent);
        json["rest"].push_back(joint.position);
    }
    for (size_t k = 0; k < animation.times.size(); ++k) {
        nlohmann::ordered_json frame;
        const glm::dvec3 place = placeAt(scene, k);
        frame["translation"] = {place.x, place.y, place.z};
        for (size_t j = 0; j < scene.skeleton.size(); ++j) {
            const glm::dquat q = rotationAt(scene, k, j);
            frame["rotations"].push_back({q.x, q.y, q.z, q.w});
        }
        json["frames"].push_back(std::move(frame));
    }
    file.write(json.dump() + "\n");
    file.commit();
}

}  // namespace doppel
