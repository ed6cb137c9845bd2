// A picture of a clip, and what the networks say of each of its pixels.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/io/image.h"
#include "trainer/person/blazepose.h"

namespace doppel {

// How surely each pixel [H,W] is the person's, [0, 1]: the mask of the square, turned back; 0
// outside of it.
std::vector<float> personShare(const PersonLandmarks& person, int width, int height);

// The same, with its landmarks' feet in doubt where the mask does not have them: it loses the one
// behind.
std::vector<float> personShareWithFeet(const PersonLandmarks& person, int width, int height);

// Left and right are one; a head has its neck, a forearm its hand.
enum class PicturedPart : uint8_t { Head, Trunk, UpperArm, Forearm, Thigh, Calf, Foot };
inline constexpr size_t kPicturedParts = 7;

// [H,W]: of each pixel, the PicturedPart whose landmarks' lines are next to it.
std::vector<uint8_t> picturedPartsOf(const PersonLandmarks& person, int width, int height);

struct ClipView {
    Image rgb;
    std::vector<float> share;   // [H,W], personShareWithFeet()
    std::vector<uint8_t> part;  // [H,W], picturedPartsOf()
    double side = 0;            // of the networks' square about the person, pixels
};

ClipView clipViewOf(const PersonLandmarks& person, Image rgb);

}  // namespace doppel
