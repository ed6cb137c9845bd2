#include "trainer/avatar/mix/mix.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "nn/body/mesh_topology.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/mix/lab.h"

namespace doppel {

namespace {

using Colour = std::array<double, 3>;

// Colours of skin: their middle and how far they spread about it, in L*a*b*.
struct Tone {
    glm::dvec3 middle{0}, spread{0};
};

// One that gives something.
struct Giver {
    const Avatar* avatar = nullptr;
    const std::vector<float>* texture = nullptr;  // [size,size,3]
    int size = 0;
    std::vector<Garment> garments;  // [V]
    std::vector<Colour> colours;    // [V] sRGB-encoded, skin as the head's
    // What skin is, and what it is to be: Reinhard, Ashikhmin, Gooch, Shirley, Color Transfer
    // between Images, IEEE Computer Graphics and Applications 2001, of medians.
    Tone from, to;
    bool recoloured = false;

    bool wears(Garment garment, size_t v) const { return garments[v] == garment; }

    // Bilinear, at a place of the atlas.
    Colour at(double u, double v) const {
        const double most = size - 1;
        const double x = std::clamp(u * size - .5, 0., most),
                     y = std::clamp(v * size - .5, 0., most);
        const auto left = size_t(x), top = size_t(y), side = size_t(size);
        const size_t right = std::min(left + 1, side - 1), below = std::min(top + 1, side - 1);
        const double across = x - double(left), down = y - double(top);
        Colour colour{};
        auto add = [&](size_t row, size_t column, double share) {
            for (size_t c = 0; c < 3; ++c)
                colour[c] += share * double{(*texture)[3 * (row * side + column) + c]};
        };
        add(top, left, (1 - across) * (1 - down));
        add(top, right, across * (1 - down));
        add(below, left, (1 - across) * down);
        add(below, right, across * down);
        return colour;
    }

    // skin: how much of the place is skin, 0 to 1.
    Colour matched(const Colour& colour, double skin) const {
        if (skin <= 0 || !recoloured) return colour;
        const glm::dvec3 lab = labOf(colour);
        return srgbOf(glm::mix(
            lab, to.middle + (lab - from.middle) * glm::clamp(to.spread / from.spread, .5, 2.),
            glm::dvec3(skin)));
    }
};

// Of these vertices.
Tone toneOf(const Giver& giver, const std::vector<size_t>& vertices) {
    constexpr double kLeastSpread = 1;
    auto median = [](std::vector<double>& values) {
        const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
        std::ranges::nth_element(values, middle);
        return *middle;
    };
    Tone tone;
    for (int c = 0; c < 3; ++c) {
        std::vector<double> values;
        for (size_t v : vertices) values.push_back(labOf(giver.colours[v])[c]);
        tone.middle[c] = median(values);
        for (double& x : values) x = std::abs(x - tone.middle[c]);
        tone.spread[c] = std::max(kLeastSpread, median(values));
    }
    return tone;
}

void requireOneBody(const Avatar& base, const Avatar& other) {
    const BodyModel &a = base.body, &b = other.body;
    if (a.templateVertices == b.templateVertices && a.faces == b.faces && a.uvs == b.uvs &&
        a.uvFaces == b.uvFaces)
        return;
    throwInput(
        "{}: expected the body model of {} ({} vertices), found another ({} vertices); train "
        "both with the same --body",
        b.file, a.file, a.vertexCount, b.vertexCount);
}

constexpr size_t kNobody = SIZE_MAX;

// What the mixed person wears, and who gives it.
struct Worn {
    Garment garment = Garment::Top;
    size_t giver = kNobody;
};

// Higher ones lie over lower ones.
constexpr std::array<int, kGarmentCount> kLayers = {0, 4, 3, 1, 2};
int layerOf(Garment garment) { return kLayers[number(garment)]; }

// What hair covers, or another's longer clothes, is of the garment that lies around it, ring by
// ring.
void nameCovered(std::vector<Worn>& worn, const Adjacency& adjacency) {
    std::vector<char> named(worn.size());
    for (size_t v = 0; v < worn.size(); ++v)
        named[v] = worn[v].giver != kNobody && worn[v].garment != Garment::Hair;
    for (bool grows = true; grows;) {
        std::vector<std::pair<size_t, Garment>> ring;
        for (size_t v = 0; v < worn.size(); ++v) {
            if (named[v] || worn[v].giver != kNobody) continue;
            std::array<int, kGarmentCount> beside{};
            for (int32_t i = adjacency.begin[v]; i < adjacency.begin[v + 1]; ++i) {
                const auto n = size_t(adjacency.neighbours[size_t(i)]);
                if (named[n]) ++beside[number(worn[n].garment)];
            }
            const auto most = std::ranges::max_element(beside);
            if (*most > 0) ring.emplace_back(v, static_cast<Garment>(most - beside.begin()));
        }
        for (const auto& [v, garment] : ring) worn[v].garment = garment, named[v] = 1;
        grows = !ring.empty();
    }
}

// Values of vertices that somebody gives spread over the others, in sweeps of means (Gauss-Seidel):
// first along the garment, then over all that is left.
void spread(std::vector<Colour>& values, const std::vector<Worn>& worn,
            const Adjacency& adjacency) {
    constexpr int kSweeps = 200;
    std::vector<char> known(worn.size());
    for (size_t v = 0; v < worn.size(); ++v) known[v] = worn[v].giver != kNobody;
    for (bool alongGarment : {true, false}) {
        const std::vector<char> fixed = known;
        for (int sweep = 0; sweep < kSweeps; ++sweep)
            for (size_t v = 0; v < worn.size(); ++v) {
                if (fixed[v]) continue;
                Colour sum{};
                double count = 0;
                for (int32_t i = adjacency.begin[v]; i < adjacency.begin[v + 1]; ++i) {
                    const auto n = size_t(adjacency.neighbours[size_t(i)]);
                    if (!known[n] || (alongGarment && worn[n].garment != worn[v].garment)) continue;
                    for (size_t c = 0; c < 3; ++c) sum[c] += values[n][c];
                    ++count;
                }
                if (count == 0) continue;
                for (size_t c = 0; c < 3; ++c) values[v][c] = sum[c] / count;
                known[v] = 1;
            }
    }
}

// How surely a texel of this colour is of the garment that has one colour in its triangle's corners
// and not of what has the other; negative where the two can't be told apart.
double sureOf(const Colour& texel, const Colour& own, const Colour& other) {
    constexpr double kContrast = .08;  // of sRGB, along the axis between the two
    double along = 0, length2 = 0;
    for (size_t c = 0; c < 3; ++c) {
        along += (texel[c] - other[c]) * (own[c] - other[c]);
        length2 += (own[c] - other[c]) * (own[c] - other[c]);
    }
    if (length2 < kContrast * kContrast) return -1;
    return std::clamp(4 * (along / length2 - .5) + .5, 0., 1.);
}

}  // namespace

Mix mixAvatars(const MixParts& parts) {
    constexpr int kOffsetPasses = 4;  // of means over neighbours, which lie a centimetre apart
    constexpr int kCoveredRings = 3;
    constexpr size_t kFewestOfSkin = 20;  // vertices that tell its colour
    CHECK(parts.base, "there is a base");

    // Each avatar once, in the order of Mix::given.
    std::vector<Giver> givers;
    auto giverOf = [&](const Avatar* avatar) {
        const auto found = std::ranges::find(givers, avatar, &Giver::avatar);
        if (found != givers.end()) return size_t(found - givers.begin());
        requireOneBody(*parts.base, *avatar);
        Giver giver;
        giver.avatar = avatar;
        giver.texture = avatar->bakedTexture.empty() ? &avatar->texture : &avatar->bakedTexture;
        giver.size = avatar->textureSize;
        CHECK(!giver.texture->empty(), "an avatar has a texture");
        giver.garments = segmentGarments(avatar->body, *giver.texture, giver.size);
        giver.colours = vertexColours(avatar->body, *giver.texture, giver.size);
        givers.push_back(std::move(giver));
        return givers.size() - 1;
    };
    const size_t base = giverOf(parts.base);
    auto partOf = [&](const Avatar* avatar, size_t fallback) {
        return avatar ? giverOf(avatar) : fallback;
    };
    const size_t head = partOf(parts.head, base), hair = partOf(parts.hair, head),
                 top = partOf(parts.top, base), bottom = partOf(parts.bottom, base),
                 shoes = partOf(parts.shoes, base);
    if (parts.shape) requireOneBody(*parts.base, *parts.shape);

    const BodyModel& body = parts.base->body;
    const auto vertices = static_cast<size_t>(body.vertexCount);
    const MeshTopology mesh = meshTopology(body.faces, body.vertexCount, body.file);

    std::vector<Worn> worn(vertices);
    std::vector<char> onHead(vertices);
    for (size_t v = 0; v < vertices; ++v) {
        const float* weights = &body.weights[v * joint::kCount];
        onHead[v] = body.face[v] || weights[joint::kHead] + weights[joint::kNeck] > .5f;
        auto take = [&](Garment garment, std::initializer_list<size_t> from) {
            for (size_t k : from)
                if (worn[v].giver == kNobody && givers[k].wears(garment, v)) worn[v] = {garment, k};
        };
        take(Garment::Hair, {hair});
        take(Garment::Top, {top});
        take(Garment::Shoes, {shoes});
        take(Garment::Bottom, {bottom});
        if (onHead[v])
            take(Garment::Skin, {head, hair, base, top});
        else
            take(Garment::Skin, {base, top, bottom, shoes, head});
    }
    nameCovered(worn, mesh.adjacency);
    // Beside what was covered a garment has its shadow, and colours that pictures have mixed.
    for (int ring = 0; ring < kCoveredRings; ++ring) {
        std::vector<size_t> rim;
        for (size_t v = 0; v < vertices; ++v)
            for (int32_t i = mesh.adjacency.begin[v]; i < mesh.adjacency.begin[v + 1]; ++i) {
                const Worn& beside = worn[size_t(mesh.adjacency.neighbours[size_t(i)])];
                if (beside.giver == kNobody && beside.garment == worn[v].garment) rim.push_back(v);
            }
        for (size_t v : rim) worn[v].giver = kNobody;
    }

    // Skin becomes what the head's giver has in the same places, and where clothes hide that, what
    // her face has.
    for (size_t k = 0; k < givers.size(); ++k) {
        std::vector<size_t> taken, shared, face;
        for (size_t v = 0; v < vertices; ++v) {
            if (worn[v].giver == k && worn[v].garment == Garment::Skin) {
                taken.push_back(v);
                if (givers[head].wears(Garment::Skin, v)) shared.push_back(v);
            }
            if (body.face[v] && givers[head].wears(Garment::Skin, v)) face.push_back(v);
        }
        if (k == head || taken.size() < kFewestOfSkin || face.size() < kFewestOfSkin) continue;
        const bool shares = shared.size() >= kFewestOfSkin;
        givers[k].from = toneOf(givers[k], shares ? shared : taken);
        givers[k].to = toneOf(givers[head], shares ? shared : face);
        givers[k].recoloured = true;
    }
    for (Giver& giver : givers)
        for (size_t v = 0; v < vertices; ++v)
            giver.colours[v] = giver.matched(giver.colours[v], giver.wears(Garment::Skin, v));

    Mix mix;
    const std::array<std::pair<Garment, size_t>, 6> roles{{{Garment::Skin, base},
                                                           {Garment::Skin, head},
                                                           {Garment::Hair, hair},
                                                           {Garment::Top, top},
                                                           {Garment::Bottom, bottom},
                                                           {Garment::Shoes, shoes}}};
    for (size_t v = 0; v < vertices; ++v) {
        const double one = 1. / double(vertices);
        const auto [garment, giver] = worn[v];
        if (giver == kNobody) mix.unseen += one;
        for (size_t role = 0; role < roles.size(); ++role)
            if (giver == roles[role].second &&
                (role == 0 || (garment == roles[role].first && (role != 1 || onHead[v]))))
                mix.given[role] += one;
    }

    // Shares of the givers, and of nobody, which go over into each other across seams.
    const size_t choices = givers.size() + 1;
    auto choiceOf = [&](size_t v) {
        return worn[v].giver == kNobody ? givers.size() : worn[v].giver;
    };
    std::vector<std::vector<double>> shares(choices, std::vector<double>(vertices));
    for (size_t v = 0; v < vertices; ++v) shares[choiceOf(v)][v] = 1;
    for (std::vector<double>& share : shares)
        for (int pass = 0; pass < kOffsetPasses; ++pass) {
            std::vector<double> next = share;
            for (size_t v = 0; v < vertices; ++v) {
                const int32_t from = mesh.adjacency.begin[v], to = mesh.adjacency.begin[v + 1];
                double sum = 0;
                for (int32_t i = from; i < to; ++i)
                    sum += share[size_t(mesh.adjacency.neighbours[size_t(i)])];
                if (to > from) next[v] = (share[v] + sum / (to - from)) / 2;
            }
            share = std::move(next);
        }

    auto offsetOf = [&](size_t k, size_t v) {
        Colour offset{};
        const std::vector<float>& offsets = givers[k].avatar->body.offsets;
        for (size_t c = 0; c < 3 && !offsets.empty(); ++c) offset[c] = double{offsets[3 * v + c]};
        return offset;
    };
    std::vector<Colour> filledOffsets(vertices), filledColours(vertices);
    for (size_t v = 0; v < vertices; ++v)
        if (const size_t k = worn[v].giver; k != kNobody) {
            filledOffsets[v] = offsetOf(k, v);
            filledColours[v] = givers[k].colours[v];
        }
    spread(filledOffsets, worn, mesh.adjacency);
    spread(filledColours, worn, mesh.adjacency);

    Avatar& avatar = mix.avatar;
    avatar.body = body;
    avatar.bodyArrays = parts.base->bodyArrays;
    avatar.betas = (parts.shape ? parts.shape : parts.base)->betas;
    avatar.preset = parts.base->preset;
    std::vector<float> offsets(3 * vertices);
    for (size_t v = 0; v < vertices; ++v)
        for (size_t c = 0; c < 3; ++c) {
            // The one giver's number to the last bit, where there is one.
            double sum = 0, all = 0;
            for (size_t k = 0; k < choices; ++k) {
                const double share = shares[k][v];
                if (share == 0) continue;
                all += share;
                sum += share * (k < givers.size() ? offsetOf(k, v)[c] : filledOffsets[v][c]);
            }
            offsets[3 * v + c] = float(sum / all);
        }
    setOffsets(avatar, offsets);

    // A triangle's corners may be of several givers. Within a garment they go over into each other;
    // the uppermost of several garments ends where its giver's picture says so, else with a narrow
    // seam.
    auto sharpen = [&](std::vector<double>& share, const std::array<size_t, 3>& corners,
                       size_t upper, const auto& colourOf) {
        const size_t k = choiceOf(upper);
        if (std::ranges::all_of(corners, [&](size_t v) { return choiceOf(v) == k; })) {
            std::ranges::fill(share, 0);
            share[k] = 1;
            return;
        }
        if (std::ranges::all_of(corners,
                                [&](size_t v) { return worn[v].garment == worn[upper].garment; }))
            return;
        double sure = -1, others = 0;
        if (k < givers.size()) {
            Colour own{}, other{};
            double owns = 0;
            for (size_t v : corners) {
                const bool its = choiceOf(v) == k;
                owns += its;
                for (size_t c = 0; c < 3; ++c) (its ? own : other)[c] += givers[k].colours[v][c];
            }
            for (size_t c = 0; c < 3; ++c) own[c] /= owns, other[c] /= 3 - owns;
            sure = sureOf(colourOf(k), own, other);
        }
        for (size_t i = 0; i < choices; ++i) {
            share[i] = std::pow(share[i], 4);
            if (i != k) others += share[i];
        }
        if (sure >= 0 && others > 0) {
            for (double& x : share) x *= (1 - sure) / others;
            share[k] = sure;
        } else {
            for (double& x : share) x /= others + share[k];
        }
    };

    int size = 0;
    for (const Giver& giver : givers) size = std::max(size, giver.size);
    const std::vector<TexelPlace> places = texelPlaces(body, size);
    std::vector<float> texture(3 * places.size());
    for (size_t t = 0; t < places.size(); ++t) {
        const TexelPlace& place = places[t];
        if (place.face < 0) continue;
        const double u = (double(t % size_t(size)) + .5) / size,
                     down = (double(t / size_t(size)) + .5) / size;
        std::vector<double> share(choices), skinOf(choices);
        Colour filled{};
        size_t upper = 0;  // the corner with the uppermost garment
        std::array<size_t, 3> corners{};
        for (size_t i = 0; i < 3; ++i) {
            const size_t v = corners[i] = size_t(body.faces[3 * size_t(place.face) + i]);
            const double corner = double{place.corners[i]};
            share[choiceOf(v)] += corner;
            for (size_t c = 0; c < 3; ++c) filled[c] += corner * filledColours[v][c];
            for (size_t k = 0; k < givers.size(); ++k)
                skinOf[k] += corner * givers[k].wears(Garment::Skin, v);
            if (layerOf(worn[v].garment) > layerOf(worn[corners[upper]].garment)) upper = i;
        }
        auto colourOf = [&](size_t k) {
            return k < givers.size() ? givers[k].matched(givers[k].at(u, down), skinOf[k]) : filled;
        };
        sharpen(share, corners, corners[upper], colourOf);
        Colour sum{};
        for (size_t k = 0; k < choices; ++k) {
            if (share[k] == 0) continue;
            const Colour colour = colourOf(k);
            for (size_t c = 0; c < 3; ++c) sum[c] += share[k] * colour[c];
        }
        for (size_t c = 0; c < 3; ++c) texture[3 * t + c] = float(sum[c]);
    }
    spreadCharts(places, size, texture);
    avatar.texture = std::move(texture);
    avatar.textureSize = size;
    avatar.preset.texture.textureSize = size;
    return mix;
}

}  // namespace doppel
