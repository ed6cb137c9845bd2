#include "trainer/avatar/mix/giver.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "trainer/avatar/mix/lab.h"
#include "trainer/avatar/mix/seam_colours.h"

namespace doppel {

std::vector<Garments> spread(std::vector<Garments> garments, int edges,
                             const Adjacency& adjacency) {
    for (int ring = 0; ring < edges; ++ring) {
        std::vector<Garments> next = garments;
        for (size_t v = 0; v < garments.size(); ++v)
            for (int32_t n : adjacency.of(v)) next[v] |= garments[size_t(n)];
        garments = std::move(next);
    }
    return garments;
}

std::vector<Garments> garmentsAround(std::span<const Garment> garments, int edges,
                                     const Adjacency& adjacency) {
    std::vector<Garments> worn(garments.size());
    for (size_t v = 0; v < garments.size(); ++v) worn[v].set(number(garments[v]));
    return spread(std::move(worn), edges, adjacency);
}

Giver::Giver(const Avatar& avatar, const Adjacency& adjacency)
    : avatar_(&avatar),
      texture_(avatar.bakedTexture.empty() ? &avatar.texture : &avatar.bakedTexture),
      size_(avatar.textureSize) {
    CHECK(!texture_->empty(), "an avatar has a texture");
    garments_ = segmentGarments(avatar.body, *texture_, size_);
    colours_ = vertexColours(avatar.body, *texture_, size_);
    constexpr int kBeside = 2;
    beside_ = garmentsAround(garments_, kBeside, adjacency);
    for (size_t g = 0; g < kGarmentCount; ++g) {
        clean_[g] = coloursAwayFromSeams(static_cast<Garment>(g), garments_, colours_, adjacency);
        std::vector<glm::dvec3> own;
        for (size_t v = 0; v < garments_.size(); ++v)
            if (wears(static_cast<Garment>(g), v) && clean_[g][v] == colours_[v])
                own.push_back(labOf(colours_[v]));
        if (!own.empty()) mixtures_[g].emplace(std::move(own));
    }
}

glm::dvec3 Giver::offset(size_t v) const {
    const std::vector<float>& offsets = avatar_->body.offsets;
    return offsets.empty() ? glm::dvec3(0)
                           : glm::dvec3(offsets[3 * v], offsets[3 * v + 1], offsets[3 * v + 2]);
}

glm::dvec3 Giver::at(const glm::dvec2& uv) const { return colourAt(*texture_, size_, uv); }

std::optional<glm::dvec3> Giver::clean(const AtlasTexel& texel, Garment garment) const {
    glm::dvec3 sum(0);
    double count = 0;
    for (size_t v : texel.corners)
        if (const auto& colour = clean_[number(garment)][v]) sum += *colour, ++count;
    return count > 0 ? std::optional(sum / count) : std::nullopt;
}

double Giver::odds(const AtlasTexel& texel, Garment own, Garment other) const {
    constexpr double kMost = 4;
    const auto &ours = mixtures_[number(own)], &theirs = mixtures_[number(other)];
    if (!ours || !theirs) return 0;
    const glm::dvec3 lab = labOf(at(texel.uv));
    return std::clamp(theirs->cost(lab) - ours->cost(lab), -kMost, kMost);
}

Giver::Tone Giver::toneOf(std::span<const size_t> vertices) const {
    constexpr double kLeastSpread = 1;
    auto median = [](std::vector<double>& values) {
        const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
        std::ranges::nth_element(values, middle);
        return *middle;
    };
    Tone tone;
    for (int c = 0; c < 3; ++c) {
        std::vector<double> encoded, lab;
        for (size_t v : vertices) {
            encoded.push_back(colours_[v][c]);
            lab.push_back(labOf(colours_[v])[c]);
        }
        tone.middle[c] = median(encoded);
        tone.lab[c] = median(lab);
        for (double& x : lab) x = std::abs(x - tone.lab[c]);
        tone.spread[c] = std::max(kLeastSpread, median(lab));
    }
    return tone;
}

void Giver::recolour(const Giver& head, std::span<const size_t> taken,
                     std::span<const size_t> face) {
    constexpr size_t kFewest = 20;  // vertices that tell a colour
    auto skinOf = [](const Giver& giver, std::span<const size_t> of) {
        std::vector<size_t> skin;
        std::ranges::copy_if(of, std::back_inserter(skin),
                             [&](size_t v) { return giver.amidSkin(v); });
        return skin;
    };
    const std::vector<size_t> faceThere = skinOf(head, face), faceHere = skinOf(*this, face);
    std::vector<size_t> own = skinOf(*this, taken);
    if (faceHere.size() >= kFewest) {
        // A sleeve may have been taken for skin.
        constexpr double kLikeFace = 20;  // of a*, b*
        const glm::dvec3 like = toneOf(faceHere).lab;
        std::erase_if(own, [&](size_t v) {
            const glm::dvec3 lab = labOf(colours_[v]);
            return std::hypot(lab.y - like.y, lab.z - like.z) > kLikeFace;
        });
    }
    const std::vector<size_t> shared = skinOf(head, own);
    const bool shares = shared.size() >= kFewest;
    const std::span<const size_t> here = shares                  ? std::span(shared)
                                         : own.size() >= kFewest ? std::span(own)
                                                                 : std::span(faceHere),
                                  there = shares ? std::span(shared) : std::span(faceThere);
    if (here.size() < kFewest || there.size() < kFewest) return;
    from_ = toneOf(here);
    to_ = head.toneOf(there);
}

// Nothing else is near.
bool Giver::amidSkin(size_t v) const { return beside_[v] == Garments().set(number(Garment::Skin)); }

// How much of a place is skin by its colour, whatever its light; amid skin what shines or blushes
// is, too, and what has another colour is something that counts as skin by mistake.
double Giver::skinByColour(const glm::dvec3& colour, bool amid) const {
    constexpr double kSame = 3, kOther = 9;            // of the spread
    constexpr double kSameAmid = 25, kOtherAmid = 45;  // of a*, b*
    const glm::dvec3 lab = labOf(colour);
    const glm::dvec2 off(lab.y - from_->lab.y, lab.z - from_->lab.z);
    if (amid) return std::clamp((kOtherAmid - glm::length(off)) / (kOtherAmid - kSameAmid), 0., 1.);
    const double spreads = std::hypot(off.x / from_->spread.y, off.y / from_->spread.z);
    return std::clamp((kOther - spreads) / (kOther - kSame), 0., 1.);
}

glm::dvec3 Giver::recoloured(const glm::dvec3& skin) const {
    constexpr double kMostContrast = 1.5;  // of a lighter skin's shades, noise among them
    const glm::dvec3 &from = from_->middle, &to = to_->middle;
    const double factor =
        std::min((to.x + to.y + to.z) / std::max(from.x + from.y + from.z, .03), kMostContrast);
    return glm::max(to + (skin - from) * factor, 0.);
}

glm::dvec3 Giver::colour(size_t v) const {
    const glm::dvec3& shown = colours_[v];
    if (!from_ || !wears(Garment::Skin, v)) return shown;
    return glm::mix(shown, recoloured(shown), skinByColour(shown, amidSkin(v)));
}

// Where skin ends, texels have some of what lies beside it, and that part keeps its colour: as all
// skin, the blue of a collar would become black.
glm::dvec3 Giver::recoloured(const glm::dvec3& colour, const AtlasTexel& texel) const {
    if (!from_) return colour;
    double skin = 0;
    Garments beside;
    for (int i = 0; i < 3; ++i) {
        skin += texel.barycentrics[i] * wears(Garment::Skin, texel.corners[size_t(i)]);
        beside |= beside_[texel.corners[size_t(i)]];
    }
    if (!beside.test(number(Garment::Skin))) return colour;
    const auto amid = [&](size_t v) { return amidSkin(v); };
    if (const auto own = clean(texel, Garment::Skin)) {
        std::optional<double> least;
        for (Garment other : {Garment::Hair, Garment::Top, Garment::Bottom, Garment::Shoes}) {
            const auto theirs = beside.test(number(other)) ? clean(texel, other) : std::nullopt;
            if (!theirs) continue;
            if (const auto share = shareBetween(colour, *own, *theirs))
                least = std::min(least.value_or(1), *share);
        }
        // The part of it that is skin changes: as the skin beside it does where it is small, and by
        // its own shade where it is all.
        if (least)
            return colour +
                   *least * glm::mix(recoloured(*own) - *own, recoloured(colour) - colour, *least);
    }
    return glm::mix(colour, recoloured(colour),
                    skin * skinByColour(colour, std::ranges::all_of(texel.corners, amid)));
}

glm::dvec3 Giver::colour(const AtlasTexel& texel, const std::array<Garments, 3>& gone) const {
    constexpr double kStain = .3, kClean = .8;  // of a texel that is its own
    glm::dvec3 colour = at(texel.uv);
    for (size_t g = 0; g < kGarmentCount; ++g)
        for (size_t i = 0; i < 3; ++i) {
            if (!gone[i].test(g)) continue;
            const Garment garment = garments_[texel.corners[i]];
            const auto own = clean(texel, garment), other = clean(texel, static_cast<Garment>(g));
            if (!own || !other) continue;
            if (odds(texel, garment, static_cast<Garment>(g)) < 0)
                colour = *own;
            else if (const std::optional<double> share = shareBetween(colour, *own, *other))
                colour = glm::mix(*own, colour,
                                  std::clamp((*share - kStain) / (kClean - kStain), 0., 1.));
            break;
        }
    return recoloured(colour, texel);
}

}  // namespace doppel
