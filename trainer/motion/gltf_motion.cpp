// Animations of glTF files (*.glb, *.gltf), VRM avatars, VRM animations and FBX files as motions.
#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "engine/files/printable.h"
#include "engine/io/fbx_nodes.h"
#include "engine/io/gltf_nodes.h"
#include "trainer/data/pose.h"
#include "trainer/motion/skeleton_motion.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr size_t kMostFrames = 1'000'000, kMostPlaces = size_t{1} << 28;

glm::dquat quaternion(const std::array<double, 4>& q) { return {q[3], q[0], q[1], q[2]}; }

glm::dmat4 local(const glm::dvec3& move, const glm::dquat& turn, const glm::dvec3& scale) {
    glm::dmat4 matrix = glm::mat4_cast(turn);
    for (int c = 0; c < 3; ++c) matrix[c] *= scale[c];
    matrix[3] = glm::dvec4(move, 1);
    return matrix;
}

// The rotation in a matrix that also scales.
glm::dquat turnOf(const glm::dmat4& matrix) {
    const glm::dvec3 x = glm::normalize(glm::dvec3(matrix[0]));
    glm::dvec3 y(matrix[1]);
    y = glm::normalize(y - glm::dot(y, x) * x);
    return glm::normalize(glm::quat_cast(glm::dmat3(x, y, glm::cross(x, y))));
}

// Nodes in the world at a time of a clip, or as the file has them.
std::vector<glm::dmat4> worldOf(const GltfNodes& file, const GltfNodes::Clip* clip, double time) {
    std::vector<glm::dvec3> moves, scales;
    std::vector<glm::dquat> turns;
    for (const GltfNode& node : file.nodes) {
        moves.emplace_back(node.translation[0], node.translation[1], node.translation[2]);
        scales.emplace_back(node.scale[0], node.scale[1], node.scale[2]);
        turns.push_back(quaternion(node.rotation));
    }
    if (clip != nullptr)
        for (const GltfChannel& channel : clip->channels) {
            const auto v = channel.at(time);
            if (channel.path == GltfChannel::Path::Rotation)
                turns[channel.node] = quaternion(v);
            else
                (channel.path == GltfChannel::Path::Scale ? scales : moves)[channel.node] = {
                    v[0], v[1], v[2]};
        }
    std::vector<glm::dmat4> world;
    for (size_t n = 0; n < file.nodes.size(); ++n) {
        const glm::dmat4 own = local(moves[n], turns[n], scales[n]);
        world.push_back(file.nodes[n].parent < 0
                            ? own
                            : world[static_cast<size_t>(file.nodes[n].parent)] * own);
    }
    return world;
}

// With the scene before all nodes, on which they hang.
SkeletonMotion::Placement placementOf(const std::vector<glm::dmat4>& world) {
    SkeletonMotion::Placement placed{{glm::dquat(1, 0, 0, 0)}, {glm::dvec3(0)}};
    for (const glm::dmat4& matrix : world) {
        placed.rotation.push_back(turnOf(matrix));
        placed.position.emplace_back(matrix[3]);
    }
    return placed;
}

// Nodes may stand in a frame of a motion; the pose in which the skin was bound is the rest pose, if
// it is in the nodes' space and unit, which bones as long as the nodes' show.
std::vector<glm::dmat4> restOf(const GltfNodes& file) {
    const std::vector<glm::dmat4> asIs = worldOf(file, nullptr, 0);
    if (file.joints.empty()) return asIs;
    std::vector<std::optional<glm::dmat4>> bound(file.nodes.size());
    // The one that no other is above, since parents come first.
    const size_t top = *std::ranges::min_element(file.joints);
    const glm::dmat4 above = file.nodes[top].parent < 0
                                 ? glm::dmat4(1)
                                 : asIs[static_cast<size_t>(file.nodes[top].parent)];
    for (size_t j = 0; j < file.joints.size(); ++j) {
        glm::dmat4 inverse;
        for (int c = 0; c < 16; ++c)
            inverse[c / 4][c % 4] = file.inverseBind[j][static_cast<size_t>(c)];
        if (std::abs(glm::determinant(inverse)) < 1e-18) return asIs;
        bound[file.joints[j]] = above * glm::inverse(inverse);
    }
    double ours = 0, theirs = 0, off = 0;
    for (const size_t j : file.joints) {
        const int parent = file.nodes[j].parent;
        if (parent < 0 || !bound[static_cast<size_t>(parent)]) continue;
        const auto p = static_cast<size_t>(parent);
        const double one = glm::length(glm::dvec3(asIs[j][3] - asIs[p][3]));
        const double other = glm::length(glm::dvec3((*bound[j])[3] - (*bound[p])[3]));
        ours += one, theirs += other, off += std::abs(one - other);
    }
    if (!(ours > 0) || off > .02 * ours) return asIs;
    std::vector<glm::dmat4> rest = asIs;
    for (size_t n = 0; n < rest.size(); ++n) {
        if (bound[n])
            rest[n] = *bound[n];
        else if (file.nodes[n].parent >= 0) {
            const auto p = static_cast<size_t>(file.nodes[n].parent);
            rest[n] = rest[p] * glm::inverse(asIs[p]) * asIs[n];
        }
    }
    return rest;
}

// A file may hold several animations: the first of those that turn most joints.
const GltfNodes::Clip& clipOf(const GltfNodes& file, const fs::path& path) {
    if (file.clips.empty())
        throwInput("{}: animations: expected one that moves a skeleton, found none", path.string());
    const auto turned = [](const GltfNodes::Clip& clip) {
        return std::ranges::count(clip.channels, GltfChannel::Path::Rotation, &GltfChannel::path);
    };
    return *std::ranges::max_element(file.clips, {}, turned);
}

// As dense as most keys are.
double rateOf(const GltfNodes::Clip& clip) {
    std::vector<double> steps;
    for (const GltfChannel& channel : clip.channels)
        for (size_t k = 1; k < channel.times.size(); ++k)
            steps.push_back(channel.times[k] - channel.times[k - 1]);
    if (steps.empty()) return 30;
    const auto middle = steps.begin() + std::ptrdiff_t(steps.size() / 2);
    std::ranges::nth_element(steps, middle);
    const double rate = 1 / *middle, whole = std::round(rate);
    // Keys that are far apart are drawn curves, and not frames.
    if (rate < 10) return 30;
    return std::min(std::abs(rate - whole) < 5e-3 * rate ? whole : rate, 240.);
}

// metres: of a unit, 0 where the format does not say.
Motion motionOf(const GltfNodes& file, const fs::path& path, double metres) {
    const GltfNodes::Clip& clip = clipOf(file, path);
    SkeletonMotion source;
    source.file = path.string();
    source.rest = "nodes";
    source.metres = metres;
    source.joints.push_back({"scene", -1});
    for (const GltfNode& node : file.nodes) source.joints.push_back({node.name, node.parent + 1});
    // VRM says which bone is which, whatever it is called.
    for (const auto& [bone, node] : file.humanoid) source.joints[node + 1].name = bone;
    double begin = clip.channels[0].times[0], end = begin;
    for (const GltfChannel& channel : clip.channels) {
        begin = std::min(begin, channel.times.front());
        end = std::max(end, channel.times.back());
    }
    const double rate = rateOf(clip), count = std::floor((end - begin) * rate + 1e-3) + 1;
    if (!(count <= static_cast<double>(kMostFrames)) ||
        !(count * static_cast<double>(file.nodes.size()) <= static_cast<double>(kMostPlaces)))
        throwInput("{}: animation times: expected at most {} frames of {} nodes, found {}",
                   path.string(), std::min(kMostFrames, kMostPlaces / file.nodes.size()),
                   file.nodes.size(), count);
    source.frames = static_cast<size_t>(count);
    source.frameTime = 1 / rate;
    const SkeletonMotion::Placement rest = placementOf(restOf(file));
    source.placed = [&](int64_t frame) {
        if (frame < 0) return rest;
        return placementOf(worldOf(file, &clip, begin + static_cast<double>(frame) / rate));
    };
    Motion motion = motionFromSkeleton(source);
    if (!clip.name.empty()) motion.name = printable(clip.name);
    if (file.clips.size() > 1)
        motion.note =
            fmt::format("animation \"{}\" of {}; {}", motion.name, file.clips.size(), motion.note);
    return motion;
}

bool isGltf(std::string_view begin) {
    if (begin.starts_with("glTF")) return true;
    begin.remove_prefix(std::min(begin.find_first_not_of(" \t\r\n"), begin.size()));
    return begin.starts_with('{') && begin.find("\"asset\"") != std::string_view::npos;
}

const MotionFormat kGltf{{
    .looks = "a glTF animation (.glb, .gltf, .vrm, .vrma)",
    .ending = ".glb",
    .recognises = [](const fs::path& path,
                     std::string_view begin) { return isGltf(begin) || endingOf(path) == ".gltf"; },
    .read = [](const fs::path& path) { return motionOf(readGltfNodes(path), path, 1); },
}};

bool isFbx(std::string_view begin) {
    return begin.starts_with("Kaydara FBX Binary") || begin.starts_with("; FBX");
}

const MotionFormat kFbx{{
    .looks = "an FBX animation (.fbx)",
    .ending = ".fbx",
    .recognises = [](const fs::path&, std::string_view begin) { return isFbx(begin); },
    .read = [](const fs::path& path) { return motionOf(readFbxNodes(path), path, 0); },
}};

}  // namespace

}  // namespace doppel
