// When feet stand on the ground: heel and toes of either foot, per frame.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "engine/files/npz.h"
#include "trainer/motion/retarget/proportions.h"

namespace doppel {

// 1 where it stands: left heel, left toe, right heel, right toe.
using FootContacts = std::array<uint8_t, 4>;
inline constexpr std::array<const char*, 4> kContactNames = {"left_heel", "left_toe", "right_heel",
                                                             "right_toe"};

// From poses whose ground is y = 0. A point stands from where it is lower than 3.5 cm and slower
// than .35 m/s until it is higher than 5.5 cm or faster than .6 m/s; both are taken from places
// averaged over a twentieth of a second, which noise hardly moves. Gaps shorter than .08 s are
// closed, and contacts shorter than .1 s are none.
std::vector<FootContacts> findContacts(std::span<const JointPose> poses, const Proportions& body,
                                       double fps);

// A file of so many frames: JSON with the four names, or an npz with arrays of them, [F] each of 0
// and 1 (docs/formats.md). InputErrors name the file, the field, what was expected and found.
std::vector<FootContacts> readContacts(const std::filesystem::path& path, size_t frames);
// The four arrays for an npz.
void addContacts(Npz& arrays, std::span<const FootContacts> contacts);

// One point's stay on one place.
struct Contact {
    size_t foot = 0, point = 0;  // 0 left, 1 right; 0 heel, 1 toe
    size_t first = 0, last = 0;  // frames, both of it
    // It goes further than 6 cm from the mean of its places: whoever slides does so on purpose, or
    // the estimate drifts, and holding the foot would tear the body.
    bool wanders = false;
};
// Runs of contacts. places: of the points, per frame as in FootContacts.
std::vector<Contact> stays(std::span<const FootContacts> contacts,
                           std::span<const std::array<glm::dvec3, 4>> places);

// Of all four contact points, per frame.
std::vector<std::array<glm::dvec3, 4>> contactPlaces(std::span<const JointPose> poses,
                                                     const Proportions& body);

}  // namespace doppel
