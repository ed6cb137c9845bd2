#include "trainer/motion/retarget/contacts.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "engine/files/json_depth.h"
#include "trainer/motion/retarget/limb.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr double kLow = .035, kHigh = .055;   // metres
constexpr double kSlow = .35, kFast = .6;     // m/s
constexpr double kAverage = .05;              // seconds, deviation
constexpr double kGap = .08, kShortest = .1;  // seconds
constexpr double kWander = .06;               // metres

// Runs of `value` that are shorter than so many frames become the other one; those at the ends only
// where `ends`.
void dropShort(std::vector<FootContacts>& contacts, size_t k, uint8_t value, double frames,
               bool ends) {
    const size_t count = contacts.size();
    for (size_t begin = 0; begin < count;) {
        size_t end = begin;
        while (end < count && contacts[end][k] == contacts[begin][k]) ++end;
        const bool atEnd = begin == 0 || end == count;
        if (contacts[begin][k] == value && double(end - begin) < frames && (ends || !atEnd))
            for (size_t f = begin; f < end; ++f) contacts[f][k] = static_cast<uint8_t>(1 - value);
        begin = end;
    }
}

uint8_t flagOf(double value, const std::string& what, size_t frame) {
    if (value != 0 && value != 1)
        throwInput("{}: expected 0 or 1, found {} in frame {}", what, value, frame);
    return value != 0;
}

void requireFrames(size_t found, size_t frames, const std::string& what) {
    if (found != frames)
        throwInput("{}: expected {} flags, one for each of the motion's frames, found {}", what,
                   frames, found);
}

std::vector<FootContacts> contactsFromJson(const fs::path& path, size_t frames) {
    const std::string file = path.string();
    const std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{256} << 20);
    requireShallowJson({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, file, 4);
    const auto json = nlohmann::json::parse(bytes.begin(), bytes.end(), nullptr, false);
    if (!json.is_object())
        throwInput(
            "{}: expected a JSON object with left_heel, left_toe, right_heel and right_toe, "
            "found none",
            file);
    std::vector<FootContacts> contacts(frames);
    for (size_t k = 0; k < kContactNames.size(); ++k) {
        const std::string what = file + ": " + kContactNames[k];
        const auto at = json.find(kContactNames[k]);
        if (at == json.end() || !at->is_array())
            throwInput("{}: expected a list of 0 and 1, found {}", what,
                       at == json.end() ? "none" : at->type_name());
        requireFrames(at->size(), frames, what);
        for (size_t f = 0; f < frames; ++f) {
            const auto& value = (*at)[f];
            if (!value.is_boolean() && !value.is_number())
                throwInput("{}: expected 0 or 1, found a {} in frame {}", what, value.type_name(),
                           f);
            contacts[f][k] = flagOf(
                value.is_boolean() ? double(value.get<bool>()) : value.get<double>(), what, f);
        }
    }
    return contacts;
}

}  // namespace

std::vector<std::array<glm::dvec3, 4>> contactPlaces(std::span<const JointPose> poses,
                                                     const Proportions& body) {
    std::vector<std::array<glm::dvec3, 4>> places;
    for (const JointPose& pose : poses) {
        const PlacedJoints joints = placed(body, pose);
        const auto left = contactPoints(body, joints, 0), right = contactPoints(body, joints, 1);
        places.push_back({left[0], left[1], right[0], right[1]});
    }
    return places;
}

std::vector<FootContacts> findContacts(std::span<const JointPose> poses, const Proportions& body,
                                       double fps) {
    const size_t frames = poses.size();
    const auto places = contactPlaces(poses, body);
    std::vector<FootContacts> contacts(frames);
    for (size_t k = 0; k < 4; ++k) {
        std::vector<glm::dvec3> path;
        for (const auto& four : places) path.push_back(four[k]);
        path = smoothOverTime(path, kAverage * fps);
        bool standing = false;
        for (size_t f = 0; f < frames; ++f) {
            const size_t before = f > 0 ? f - 1 : f, after = std::min(f + 1, frames - 1);
            const double seconds = double(std::max<size_t>(after - before, 1)) / fps;
            const double speed = glm::distance(path[after], path[before]) / seconds;
            standing =
                standing ? path[f].y < kHigh && speed < kFast : path[f].y < kLow && speed < kSlow;
            contacts[f][k] = standing;
        }
        dropShort(contacts, k, 0, kGap * fps, false);
        // Where a frame lasts longer than that, one is enough.
        dropShort(contacts, k, 1, kShortest * fps, false);
    }
    return contacts;
}

std::vector<FootContacts> readContacts(const fs::path& path, size_t frames) {
    if (endingOf(path) == ".json") return contactsFromJson(path, frames);
    if (endingOf(path) != ".npz")
        throwInput("{}: expected contacts as .json or .npz, found another name", path.string());
    const Npz npz = readNpz(path);
    std::vector<FootContacts> contacts(frames);
    for (size_t k = 0; k < kContactNames.size(); ++k) {
        const std::vector<float> flags = npz.at(kContactNames[k]).requireShape({-1}).toF32();
        const std::string what = path.string() + ": " + kContactNames[k];
        requireFrames(flags.size(), frames, what);
        for (size_t f = 0; f < frames; ++f)
            contacts[f][k] = flagOf(static_cast<double>(flags[f]), what, f);
    }
    return contacts;
}

void addContacts(Npz& arrays, std::span<const FootContacts> contacts) {
    for (size_t k = 0; k < kContactNames.size(); ++k) {
        std::vector<int32_t> flags;
        for (const FootContacts& four : contacts) flags.push_back(four[k]);
        arrays.set(kContactNames[k], Array::i32({static_cast<int64_t>(flags.size())}, flags));
    }
}

std::vector<Contact> stays(std::span<const FootContacts> contacts,
                           std::span<const std::array<glm::dvec3, 4>> places) {
    std::vector<Contact> found;
    for (size_t k = 0; k < 4; ++k)
        for (size_t f = 0; f < contacts.size(); ++f) {
            if (!contacts[f][k]) continue;
            if (f > 0 && contacts[f - 1][k])
                found.back().last = f;
            else
                found.push_back({k / 2, k % 2, f, f, false});
        }
    for (Contact& stay : found) {
        const auto place = [&](size_t f) {
            return places[f][2 * stay.foot + stay.point] * glm::dvec3(1, 0, 1);
        };
        glm::dvec3 mean(0);
        for (size_t f = stay.first; f <= stay.last; ++f) mean += place(f);
        mean /= double(stay.last - stay.first + 1);
        for (size_t f = stay.first; f <= stay.last; ++f)
            stay.wanders = stay.wanders || glm::distance(place(f), mean) > kWander;
    }
    return found;
}

}  // namespace doppel
