// Where a person's clothes are: each vertex is skin, hair or one of the clothes, told by its colour
// and by where on the body it lies.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "nn/body/body.h"

namespace doppel {

enum class Garment : uint8_t { Skin, Hair, Top, Bottom, Shoes };
inline constexpr size_t kGarmentCount = 5;
constexpr size_t number(Garment garment) { return static_cast<size_t>(garment); }

// [V,3] Colours of a texture [size,size,3] at the vertices; at a seam the mean of its sides.
std::vector<glm::dvec3> vertexColours(const BodyModel& body, std::span<const float> texture,
                                      int size);

// Of a texture [size,size,3] at a place of the atlas, bilinear.
glm::dvec3 colourAt(std::span<const float> texture, int size, const glm::dvec2& uv);

// [V] Of a texture [size,size,3], sRGB-encoded in [0,1].
//
// As GrabCut does in pictures (Rother, Kolmogorov, Blake, SIGGRAPH 2004), with five labels on a
// mesh: mixtures of Gaussians say how each garment is coloured, joints say what may be worn there,
// and neighbours of like colour agree. The mixtures are learned in rounds, first of vertices that
// can hardly be anything else (face and hands, crown, chest, thighs, feet).
std::vector<Garment> segmentGarments(const BodyModel& body, std::span<const float> texture,
                                     int size);

// How likely each garment is.
using GarmentShares = std::array<double, kGarmentCount>;
// The same by colours [V] of vertices that were seen so well, 0 (not at all) to 1, and by what is
// to be expected of them [V], shares that sum to one; empty: anything. What was not seen wears what
// is expected there and what its neighbours wear. Where little else is to be expected, colours are
// learned first.
std::vector<Garment> segmentGarments(const BodyModel& body, std::span<const glm::dvec3> colours,
                                     std::span<const double> seen,
                                     std::span<const GarmentShares> expected = {});

}  // namespace doppel
