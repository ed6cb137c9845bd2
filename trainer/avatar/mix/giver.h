// One of the avatars that an avatar is mixed of: what it wears, and which colours it shows.
#pragma once

#include <array>
#include <bitset>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "nn/body/mesh_topology.h"
#include "trainer/avatar/avatar.h"
#include "trainer/avatar/mix/colour_mixture.h"
#include "trainer/avatar/mix/garments.h"

namespace doppel {

// A texel of the atlas, inside a triangle of the body.
struct AtlasTexel {
    glm::dvec2 uv;
    std::array<size_t, 3> corners;  // vertices of its triangle
    glm::dvec3 barycentrics;
};

using Garments = std::bitset<kGarmentCount>;
// [V] All that vertices within so many edges have of these [V], their own among it.
std::vector<Garments> spread(std::vector<Garments> garments, int edges, const Adjacency& adjacency);
// Of garments that are worn, one per vertex.
std::vector<Garments> garmentsAround(std::span<const Garment> garments, int edges,
                                     const Adjacency& adjacency);

// Colours are sRGB-encoded, in [0,1].
class Giver {
public:
    Giver(const Avatar& avatar, const Adjacency& adjacency);

    const Avatar& avatar() const { return *avatar_; }
    const std::vector<Garment>& garments() const { return garments_; }  // [V]
    bool wears(Garment garment, size_t v) const { return garments_[v] == garment; }
    glm::dvec3 offset(size_t v) const;  // m

    // Of a vertex and of a texel, skin in the colour that it is to have. A texel is without what it
    // shows of garments that are gone beside its corners: worn near them here, and not in the mix.
    glm::dvec3 colour(size_t v) const;
    glm::dvec3 colour(const AtlasTexel& texel, const std::array<Garments, 3>& gone) const;

    // How much more likely (log) a texel is of one garment than of another, as they are worn here;
    // between -4 and 4, and 0 where one of them is not.
    double odds(const AtlasTexel& texel, Garment own, Garment other) const;

    // Skin becomes what the head's giver has in these vertices, whose skin the mix takes from here;
    // where clothes hide that, what the face has, instead of these, or of the face if they are few.
    void recolour(const Giver& head, std::span<const size_t> taken, std::span<const size_t> face);

private:
    // Colours of skin: their middle, and in L*a*b* middle and spread.
    struct Tone {
        glm::dvec3 middle{0}, lab{0}, spread{0};
    };
    Tone toneOf(std::span<const size_t> vertices) const;
    glm::dvec3 at(const glm::dvec2& uv) const;
    std::optional<glm::dvec3> clean(const AtlasTexel& texel, Garment garment) const;
    bool amidSkin(size_t v) const;
    double skinByColour(const glm::dvec3& colour, bool amid) const;
    glm::dvec3 recoloured(const glm::dvec3& skin) const;
    glm::dvec3 recoloured(const glm::dvec3& colour, const AtlasTexel& texel) const;

    const Avatar* avatar_;
    const std::vector<float>* texture_;  // [size,size,3]
    int size_;
    std::vector<Garment> garments_;
    std::vector<glm::dvec3> colours_;  // [V] as they are shown
    // [V] Of each garment, its colours away from its seams.
    std::array<std::vector<std::optional<glm::dvec3>>, kGarmentCount> clean_;
    std::array<std::optional<ColourMixture>, kGarmentCount> mixtures_;
    std::vector<Garments> beside_;  // [V] what is worn within two edges
    // What skin is, and what it is to be. Another skin in the same light has the same shades times
    // a factor, in encoded values too: a power of a factor is one.
    std::optional<Tone> from_, to_;
};

}  // namespace doppel
