// What colour a garment has on its own side of a seam. Texels and vertices beside a seam show some
// of both sides, for pictures have mixed them.
#pragma once

#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "nn/body/mesh_topology.h"
#include "trainer/avatar/mix/garments.h"

namespace doppel {

// [V] The garment's colours, of vertices of these colours [V], where none of another lies within
// two edges; along it and for eight edges beyond they spread in means, and farther off there is
// none. Nothing anywhere where it is worn by a handful of vertices.
std::vector<std::optional<glm::dvec3>> coloursAwayFromSeams(Garment garment,
                                                            std::span<const Garment> garments,
                                                            std::span<const glm::dvec3> colours,
                                                            const Adjacency& adjacency);

// How much of a texel between two garments is of the one that has one colour and not of what has
// the other, 0 to 1; nothing where that can't be told: where the two are alike, or the texel is
// unlike both, as a stripe may be, or piping along a hem.
std::optional<double> shareBetween(const glm::dvec3& texel, const glm::dvec3& own,
                                   const glm::dvec3& other);

}  // namespace doppel
