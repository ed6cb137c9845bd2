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

glm::dvec2 toTexels(const BodyModel& body, int32_t uv, int size) {
    const float* p = &body.uvs[2 * static_cast<size_t>(uv)];
    return glm::dvec2(p[0], p[1]) * static_cast<double>(size) - 0.5;  // centres: whole numbers
}

double across(glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; }

// Barycentrics of the point of a triangle that is nearest to p, and its distance.
std::pair<glm::dvec3, double> nearestInTriangle(const std::array<glm::dvec2, 3>& t, glm::dvec2 p) {
    double area = across(t[1] - t[0], t[2] - t[0]);
    if (area != 0) {
        glm::dvec3 b(across(t[1] - p, t[2] - p), across(t[2] - p, t[0] - p),
                     across(t[0] - p, t[1] - p));
        b /= area;
        if (b.x >= 0 && b.y >= 0 && b.z >= 0) return {b, 0};
    }
    std::pair<glm::dvec3, double> best{glm::dvec3(1, 0, 0), INFINITY};
    for (int i = 0; i < 3; ++i) {
        int j = (i + 1) % 3;
        glm::dvec2 from = t[size_t(i)], edge = t[size_t(j)] - from;
        double length2 = glm::dot(edge, edge);
        double along = length2 > 0 ? std::clamp(glm::dot(p - from, edge) / length2, 0.0, 1.0) : 0;
        double distance = glm::length(p - from - along * edge);
        if (distance >= best.second) continue;
        best = {glm::dvec3(0), distance};
        best.first[i] = 1 - along;
        best.first[j] += along;
    }
    return best;
}

glm::dvec3 vertex(std::span<const float> verts, int32_t v) {
    const float* p = &verts[3 * static_cast<size_t>(v)];
    return {p[0], p[1], p[2]};
}

}  // namespace

std::vector<TexelPlace> texelPlaces(const BodyModel& body, int size) {
    constexpr double kReach = 1.5;  // texels; the diagonal neighbour of a chart's texel
    auto side = static_cast<size_t>(size);
    std::vector<TexelPlace> places(side * side);
    std::vector<double> distances(side * side, INFINITY);
    for (size_t f = 0; f < body.uvFaces.size() / 3; ++f) {
        std::array<glm::dvec2, 3> t;
        for (size_t i = 0; i < 3; ++i) t[i] = toTexels(body, body.uvFaces[3 * f + i], size);
        glm::dvec2 low = glm::min(t[0], glm::min(t[1], t[2])) - kReach;
        glm::dvec2 high = glm::max(t[0], glm::max(t[1], t[2])) + kReach;
        auto texel = [&](double x) {
            return static_cast<size_t>(std::clamp(x, 0.0, static_cast<double>(size - 1)));
        };
        for (size_t y = texel(std::ceil(low.y)); y <= texel(std::floor(high.y)); ++y)
            for (size_t x = texel(std::ceil(low.x)); x <= texel(std::floor(high.x)); ++x) {
                auto [b, distance] =
                    nearestInTriangle(t, {static_cast<double>(x), static_cast<double>(y)});
                if (distance > kReach || distance >= distances[y * side + x]) continue;
                distances[y * side + x] = distance;
                places[y * side + x] = {
                    static_cast<int32_t>(f),
                    {static_cast<float>(b.x), static_cast<float>(b.y), static_cast<float>(b.z)}};
            }
    }
    return places;
}

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
