#include "trainer/avatar/bake.h"

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>

#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/networks.h"

namespace doppel {

namespace {

// A view counts fully from about a tenth of a frontal one on.
constexpr double kRestWeight = 0.02;

glm::dvec3 vertex(std::span<const float> verts, int32_t v) {
    const float* p = &verts[3 * static_cast<size_t>(v)];
    return {p[0], p[1], p[2]};
}

}  // namespace

std::vector<float> viewWeights(const BodyModel& body, std::span<const TexelPlace> places,
                               std::span<const float> verts) {
    std::vector<glm::dvec3> normals(static_cast<size_t>(body.vertexCount), glm::dvec3(0));
    for (size_t f = 0; f + 2 < body.faces.size(); f += 3) {
        glm::dvec3 a = vertex(verts, body.faces[f]);
        glm::dvec3 normal =
            glm::cross(vertex(verts, body.faces[f + 1]) - a, vertex(verts, body.faces[f + 2]) - a);
        for (size_t i = 0; i < 3; ++i) normals[static_cast<size_t>(body.faces[f + i])] += normal;
    }
    std::vector<float> weights;
    weights.reserve(places.size());
    for (const TexelPlace& place : places) {
        double weight = 0;
        if (place.face >= 0) {
            glm::dvec3 normal(0), point(0);
            for (size_t i = 0; i < 3; ++i) {
                int32_t v = body.faces[3 * static_cast<size_t>(place.face) + i];
                double share = static_cast<double>(place.corners[i]);
                double length = glm::length(normals[static_cast<size_t>(v)]);
                if (length > 0) normal += share / length * normals[static_cast<size_t>(v)];
                point += share * vertex(verts, v);
            }
            double lengths = glm::length(normal) * glm::length(point);
            double cosine = lengths > 0 ? -glm::dot(normal, point) / lengths : 0;
            weight = std::pow(std::max(cosine, 0.0), 4);
        }
        weights.push_back(static_cast<float>(weight));
    }
    return weights;
}

void spreadCharts(std::span<const TexelPlace> places, int size, std::vector<float>& texture) {
    CHECK(texture.size() == 3 * places.size(), "a texel has a place");
    // Ring by ring.
    auto side = static_cast<size_t>(size);
    std::vector<size_t> ring;
    std::vector<bool> covered(places.size());
    for (size_t i = 0; i < places.size(); ++i)
        if (places[i].face >= 0) ring.push_back(i), covered[i] = true;
    while (!ring.empty()) {
        std::vector<size_t> next;
        for (size_t from : ring) {
            size_t x = from % side, y = from / side;
            auto spread = [&](bool exists, size_t to) {
                if (!exists || covered[to]) return;
                covered[to] = true;
                std::copy_n(&texture[3 * from], 3, &texture[3 * to]);
                next.push_back(to);
            };
            spread(x > 0, from - 1);
            spread(x + 1 < side, from + 1);
            spread(y > 0, from - side);
            spread(y + 1 < side, from + side);
        }
        ring = std::move(next);
    }
}

TextureBaker::TextureBaker(const BodyModel& body, int size)
    : body_(body),
      size_(size),
      places_(texelPlaces(body, size)),
      sums_(3 * places_.size()),
      weights_(places_.size()) {}

void TextureBaker::add(std::span<const float> texture, std::span<const float> verts) {
    CHECK(texture.size() == sums_.size(), "a texture has {} numbers, not {}", sums_.size(),
          texture.size());
    std::vector<float> weights = viewWeights(body_, places_, verts);
    for (size_t i = 0; i < weights.size(); ++i) {
        auto weight = static_cast<double>(weights[i]);
        weights_[i] += weight;
        for (size_t c = 3 * i; c < 3 * i + 3; ++c)
            sums_[c] += weight * std::clamp(static_cast<double>(texture[c]), 0.0, 1.0);
    }
}

std::vector<float> TextureBaker::result(std::span<const float> rest) const {
    CHECK(rest.size() == sums_.size(), "the rest has {} numbers, not {}", sums_.size(),
          rest.size());
    std::vector<float> texture(sums_.size());
    for (size_t i = 0; i < places_.size(); ++i)
        for (size_t c = 3 * i; c < 3 * i + 3; ++c)
            texture[c] =
                static_cast<float>((sums_[c] + kRestWeight * static_cast<double>(rest[c])) /
                                   (weights_[i] + kRestWeight));
    spreadCharts(places_, size_, texture);
    return texture;
}

void bakeTexture(Device& device, Avatar& avatar, const std::vector<std::vector<float>>& views) {
    CHECK(!views.empty(), "there are views to bake");
    AvatarRenderer renderer(device, avatar, true, TextureKind::Refined);
    TextureBaker baker(avatar.body, avatar.textureSize);
    for (const std::vector<float>& verts : views) baker.add(renderer.texture(verts), verts);
    // As the network paints it, not as eight bits keep it: the same for an avatar from disk.
    TextureNet coarse(device, avatar);
    avatar.bakedTexture = baker.result(paintedTexture(device, coarse));
}

}  // namespace doppel
