// Motions that `doppel export --out FILE.json` wrote, or that follow docs/formats.md: joints with
// names, parents and rest places, and of each frame the root's place and all rotations.
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/json_depth.h"
#include "engine/files/printable.h"
#include "trainer/data/capture_notes.h"
#include "trainer/motion/skeleton_motion.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

using nlohmann::json;

constexpr uint64_t kMostBytes = uint64_t{1} << 30;
constexpr size_t kMostJoints = 1000, kMostFrames = 1'000'000;

const json& listOf(const json& object, const char* name, const std::string& where) {
    const auto found = object.is_object() ? object.find(name) : object.end();
    if (found == object.end() || !found->is_array())
        throwInput("{}: {}: expected a list, found {}", where, name,
                   found == object.end() ? "none" : found->type_name());
    return *found;
}

const json& listOf(const json& object, const char* name, size_t count, const std::string& where) {
    const json& list = listOf(object, name, where);
    if (list.size() != count)
        throwInput("{}: {}: expected {} of them, found {}", where, name, count, list.size());
    return list;
}

template <size_t N>
std::array<double, N> numbersOf(const json& value, const std::string& where) {
    std::array<double, N> numbers{};
    if (!value.is_array() || value.size() != N)
        throwInput("{}: expected {} numbers, found {}", where, N, value.type_name());
    for (size_t i = 0; i < N; ++i) {
        if (!value[i].is_number())
            throwInput("{}: expected numbers, found {}", where, value[i].type_name());
        numbers[i] = value[i].get<double>();
    }
    return numbers;
}

glm::dvec3 placeOf(const json& value, const std::string& where) {
    const auto v = numbersOf<3>(value, where);
    return {v[0], v[1], v[2]};
}

glm::dquat rotationOf(const json& value, const std::string& where) {
    const auto q = numbersOf<4>(value, where);  // x y z w
    const glm::dquat turn(q[3], q[0], q[1], q[2]);
    const double length = glm::length(turn);
    if (!(length > 1e-6) || !(length < 1e6))
        throwInput("{}: expected a quaternion, found one of length {}", where, length);
    return turn / length;
}

struct Skeleton {
    std::vector<SkeletonMotion::Joint> joints;
    std::vector<glm::dvec3> rest;
};

Skeleton skeletonOf(const json& root, const std::string& file) {
    Skeleton skeleton;
    const json& names = listOf(root, "joints", file);
    const size_t count = names.size();
    if (count == 0 || count > kMostJoints)
        throwInput("{}: joints: expected 1 to {}, found {}", file, kMostJoints, count);
    const json &parents = listOf(root, "parents", count, file),
               &rest = listOf(root, "rest", count, file);
    for (size_t j = 0; j < count; ++j) {
        const json& parent = parents[j];
        if (!names[j].is_string() || !parent.is_number_integer() ||
            parent.get<int64_t>() >= static_cast<int64_t>(j) ||
            parent.get<int64_t>() < (j == 0 ? -1 : 0))
            throwInput(
                "{}: parents: expected -1 for the first joint and for each other one an earlier "
                "joint, found {} for joint {}",
                file, printable(parent.dump()), j);
        skeleton.joints.push_back(
            {names[j].get<std::string>(), static_cast<int>(parent.get<int64_t>())});
        skeleton.rest.push_back(placeOf(rest[j], file + ": rest"));
    }
    return skeleton;
}

SkeletonMotion::Placement placementOf(const Skeleton& skeleton, const glm::dvec3& root,
                                      const std::vector<glm::dquat>& turns) {
    SkeletonMotion::Placement placed;
    for (size_t j = 0; j < skeleton.joints.size(); ++j) {
        if (skeleton.joints[j].parent < 0) {
            placed.rotation.push_back(turns[j]);
            placed.position.push_back(root);
            continue;
        }
        const auto parent = static_cast<size_t>(skeleton.joints[j].parent);
        placed.rotation.push_back(placed.rotation[parent] * turns[j]);
        placed.position.push_back(placed.position[parent] +
                                  placed.rotation[parent] *
                                      (skeleton.rest[j] - skeleton.rest[parent]));
    }
    return placed;
}

Motion readJsonMotion(const fs::path& path) {
    const std::string file = path.string();
    const std::vector<uint8_t> bytes = readWholeFile(path, kMostBytes);
    requireShallowJson({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, file, 5);
    const json root = json::parse(bytes.begin(), bytes.end(), nullptr, false);
    if (!root.is_object())
        throwInput("{}: expected a JSON object with joints and frames, found none", file);
    const Skeleton skeleton = skeletonOf(root, file);
    const json& frames = listOf(root, "frames", file);
    if (frames.empty() || frames.size() > kMostFrames)
        throwInput("{}: frames: expected 1 to {}, found {}", file, kMostFrames, frames.size());
    std::vector<glm::dvec3> places;
    std::vector<std::vector<glm::dquat>> turns;
    for (size_t f = 0; f < frames.size(); ++f) {
        const std::string where = fmt::format("{}: frame {}", file, f);
        const json& all = listOf(frames[f], "rotations", skeleton.joints.size(), where);
        places.push_back(placeOf(listOf(frames[f], "translation", where), where + ": translation"));
        turns.emplace_back();
        for (const json& one : all) turns.back().push_back(rotationOf(one, where + ": rotations"));
    }
    const auto fps = root.find("fps");
    const double rate =
        checkedFps(fps != root.end() && fps->is_number() ? fps->get<double>() : 30, file + ": fps");
    const std::vector<glm::dquat> still(skeleton.joints.size(), glm::dquat(1, 0, 0, 0));
    return motionFromSkeleton(
        {file, "rest", skeleton.joints, frames.size(), 1 / rate, 1, [&](int64_t frame) {
             if (frame < 0) return placementOf(skeleton, skeleton.rest[0], still);
             const auto f = static_cast<size_t>(frame);
             return placementOf(skeleton, places[f], turns[f]);
         }});
}

const MotionFormat kJson{{
    .looks = "poses as JSON, as export writes them",
    .recognises =
        [](const fs::path&, std::string_view begin) {
            begin.remove_prefix(std::min(begin.find_first_not_of(" \t\r\n"), begin.size()));
            return begin.starts_with('{') && begin.find("\"joints\"") != std::string_view::npos &&
                   begin.find("\"asset\"") == std::string_view::npos &&
                   begin.find("\"doppel_pose\"") == std::string_view::npos;
        },
    .read = readJsonMotion,
}};

}  // namespace

}  // namespace doppel
