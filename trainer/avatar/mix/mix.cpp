#include "trainer/avatar/mix/mix.h"

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <map>

#include "engine/error.h"
#include "nn/body/mesh_topology.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/mix/lab.h"
#include "trainer/avatar/mix/worn_caps.h"

namespace doppel {

namespace {

// Colours of skin: their middle and how far they spread about it, in L*a*b*.
struct Tone {
    glm::dvec3 middle{0}, spread{0};
};

// One that gives something.
struct Giver {
    const Avatar* avatar = nullptr;
    const std::vector<float>* texture = nullptr;  // [size,size,3]
    int size = 0;
    std::vector<Garment> garments;    // [V]
    std::vector<glm::dvec3> colours;  // [V] sRGB-encoded, skin as the head's
    // What skin is, and what it is to be: Reinhard, Ashikhmin, Gooch, Shirley, Color Transfer
    // between Images, IEEE Computer Graphics and Applications 2001, of medians.
    Tone from, to;
    bool recoloured = false;

    bool wears(Garment garment, size_t v) const { return garments[v] == garment; }

    glm::dvec3 offset(size_t v) const {
        const std::vector<float>& offsets = avatar->body.offsets;
        return offsets.empty() ? glm::dvec3(0)
                               : glm::dvec3(offsets[3 * v], offsets[3 * v + 1], offsets[3 * v + 2]);
    }

    glm::dvec3 at(const glm::dvec2& uv) const { return colourAt(*texture, size, uv); }

    // How much of a texel is skin by its colour, whatever its light: where skin ends, texels have
    // some of what lies beside it, and that part keeps its colour. As all skin, the blue of a
    // collar would become black.
    double skinIn(const glm::dvec3& lab) const {
        constexpr double kSame = 3, kOther = 9;  // of the spread
        const double off = std::hypot((lab.y - from.middle.y) / from.spread.y,
                                      (lab.z - from.middle.z) / from.spread.z);
        return std::clamp((kOther - off) / (kOther - kSame), 0., 1.);
    }

    // skin: how much of the place is skin, 0 to 1.
    glm::dvec3 matched(const glm::dvec3& colour, double skin) const {
        if (skin <= 0 || !recoloured) return colour;
        constexpr double kMostChange = 2;  // of the spread
        const glm::dvec3 lab = labOf(colour);
        skin *= skinIn(lab);
        const glm::dvec3 scale = glm::clamp(to.spread / from.spread, 1 / kMostChange, kMostChange);
        return srgbOf(glm::mix(lab, to.middle + (lab - from.middle) * scale, skin));
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

// What the mixed person wears at a vertex, and who gives it.
struct Worn {
    Garment garment = Garment::Top;
    size_t giver = kNobody;
};

// Higher ones lie over lower ones.
constexpr std::array<int, kGarmentCount> kLayers = {0, 4, 3, 1, 2};
int layerOf(Garment garment) { return kLayers[number(garment)]; }

// How surely a texel of this colour is of the garment that has one colour in its triangle's corners
// and not of what has the other; negative where the two can't be told apart.
double sureOf(const glm::dvec3& texel, const glm::dvec3& own, const glm::dvec3& other) {
    constexpr double kContrast = .08;  // of sRGB
    const glm::dvec3 axis = own - other;
    const double length2 = glm::dot(axis, axis);
    if (length2 < kContrast * kContrast) return -1;
    return std::clamp(4 * (glm::dot(texel - other, axis) / length2 - .5) + .5, 0., 1.);
}

class Mixer {
public:
    explicit Mixer(const MixParts& parts)
        : parts_(parts),
          body_(parts.base->body),
          vertices_(size_t(body_.vertexCount)),
          around_(meshTopology(body_.faces, body_.vertexCount, body_.file).adjacency),
          worn_(vertices_),
          onHead_(vertices_),
          onHands_(vertices_) {
        base_ = giverOf(parts.base);
        auto partOf = [&](const Avatar* avatar, size_t fallback) {
            return avatar ? giverOf(avatar) : fallback;
        };
        head_ = partOf(parts.head, base_), hair_ = partOf(parts.hair, head_);
        top_ = partOf(parts.top, base_), bottom_ = partOf(parts.bottom, base_);
        shoes_ = partOf(parts.shoes, base_), hands_ = partOf(parts.hands, base_);
        if (parts.shape) requireOneBody(*parts.base, *parts.shape);
    }

    Mix mix() {
        dress();
        nameCovered();
        leaveRims();
        recolourSkin();
        Mix mix;
        tell(mix);
        Avatar& avatar = mix.avatar;
        avatar.body = body_;
        avatar.bodyArrays = parts_.base->bodyArrays;
        avatar.betas = (parts_.shape ? parts_.shape : parts_.base)->betas;
        avatar.preset = parts_.base->preset;
        setOffsets(avatar, mixedOffsets());
        for (const Giver& giver : givers_)
            avatar.textureSize = std::max(avatar.textureSize, giver.size);
        avatar.texture = mixedTexture(avatar.textureSize);
        avatar.preset.texture.textureSize = avatar.textureSize;
        return mix;
    }

private:
    // Each avatar once.
    size_t giverOf(const Avatar* avatar) {
        const auto found = std::ranges::find(givers_, avatar, &Giver::avatar);
        if (found != givers_.end()) return size_t(found - givers_.begin());
        requireOneBody(*parts_.base, *avatar);
        Giver giver;
        giver.avatar = avatar;
        giver.texture = avatar->bakedTexture.empty() ? &avatar->texture : &avatar->bakedTexture;
        giver.size = avatar->textureSize;
        CHECK(!giver.texture->empty(), "an avatar has a texture");
        giver.garments = segmentGarments(avatar->body, *giver.texture, giver.size);
        giver.colours = vertexColours(avatar->body, *giver.texture, giver.size);
        givers_.push_back(std::move(giver));
        return givers_.size() - 1;
    }

    std::span<const int32_t> neighboursOf(size_t v) const {
        return std::span(around_.neighbours)
            .subspan(size_t(around_.begin[v]), size_t(around_.begin[v + 1] - around_.begin[v]));
    }
    // Numbers of the givers; one more is nobody's.
    size_t choices() const { return givers_.size() + 1; }
    size_t choiceOf(size_t v) const { return std::min(worn_[v].giver, givers_.size()); }

    void dress() {
        for (size_t v = 0; v < vertices_; ++v) {
            const float* weights = &body_.weights[v * joint::kCount];
            onHead_[v] = body_.face[v] || weights[joint::kHead] + weights[joint::kNeck] > .5f;
            onHands_[v] = weights[joint::kLeftWrist] + weights[joint::kLeftHand] +
                              weights[joint::kRightWrist] + weights[joint::kRightHand] >
                          .5f;
            auto take = [&](Garment garment, std::initializer_list<size_t> from) {
                for (size_t k : from)
                    if (worn_[v].giver == kNobody && givers_[k].wears(garment, v))
                        worn_[v] = {garment, k};
            };
            take(Garment::Hair, {hair_});
            take(Garment::Top, {top_});
            take(Garment::Shoes, {shoes_});
            take(Garment::Bottom, {bottom_});
            if (onHead_[v])
                take(Garment::Skin, {head_, hair_, base_, top_});
            else if (onHands_[v])
                take(Garment::Skin, {hands_, base_, top_, head_});
            else
                take(Garment::Skin, {base_, top_, bottom_, shoes_, head_});
        }
    }

    // What hair covers, or another's longer clothes, is of the garment that lies around it, ring by
    // ring.
    void nameCovered() {
        std::vector<char> named(vertices_);
        for (size_t v = 0; v < vertices_; ++v)
            named[v] = worn_[v].giver != kNobody && worn_[v].garment != Garment::Hair;
        for (bool grows = true; grows;) {
            std::vector<std::pair<size_t, Garment>> ring;
            for (size_t v = 0; v < vertices_; ++v) {
                if (named[v] || worn_[v].giver != kNobody) continue;
                std::array<int, kGarmentCount> beside{};
                for (int32_t n : neighboursOf(v))
                    if (named[size_t(n)]) ++beside[number(worn_[size_t(n)].garment)];
                const auto most = std::ranges::max_element(beside);
                if (*most > 0) ring.emplace_back(v, static_cast<Garment>(most - beside.begin()));
            }
            for (const auto& [v, garment] : ring) worn_[v].garment = garment, named[v] = 1;
            grows = !ring.empty();
        }
    }

    // Beside what was covered a garment has its shadow, and colours that pictures have mixed.
    void leaveRims() {
        constexpr int kRings = 3;
        for (int ring = 0; ring < kRings; ++ring) {
            std::vector<size_t> rim;
            for (size_t v = 0; v < vertices_; ++v)
                if (std::ranges::any_of(neighboursOf(v), [&](int32_t n) {
                        const Worn& beside = worn_[size_t(n)];
                        return beside.giver == kNobody && beside.garment == worn_[v].garment;
                    }))
                    rim.push_back(v);
            for (size_t v : rim) worn_[v].giver = kNobody;
        }
    }

    // Skin becomes what the head's giver has in the same places, and where clothes hide that, what
    // her face has.
    void recolourSkin() {
        constexpr size_t kFewest = 20;  // vertices that tell its colour
        std::vector<size_t> face;
        for (size_t v = 0; v < vertices_; ++v)
            if (body_.face[v] && givers_[head_].wears(Garment::Skin, v)) face.push_back(v);
        for (size_t k = 0; k < givers_.size(); ++k) {
            std::vector<size_t> taken, shared;
            for (size_t v = 0; v < vertices_; ++v) {
                if (worn_[v].giver != k || worn_[v].garment != Garment::Skin) continue;
                taken.push_back(v);
                if (givers_[head_].wears(Garment::Skin, v)) shared.push_back(v);
            }
            if (k == head_ || taken.size() < kFewest || face.size() < kFewest) continue;
            const bool shares = shared.size() >= kFewest;
            givers_[k].from = toneOf(givers_[k], shares ? shared : taken);
            givers_[k].to = toneOf(givers_[head_], shares ? shared : face);
            givers_[k].recoloured = true;
        }
        for (Giver& giver : givers_)
            for (size_t v = 0; v < vertices_; ++v)
                giver.colours[v] = giver.matched(giver.colours[v], giver.wears(Garment::Skin, v));
    }

    void tell(Mix& mix) const {
        const std::array<std::pair<Garment, size_t>, 7> roles{{{Garment::Skin, base_},
                                                               {Garment::Skin, head_},
                                                               {Garment::Hair, hair_},
                                                               {Garment::Top, top_},
                                                               {Garment::Bottom, bottom_},
                                                               {Garment::Shoes, shoes_},
                                                               {Garment::Skin, hands_}}};
        for (size_t v = 0; v < vertices_; ++v) {
            const double one = 1. / double(vertices_);
            const auto [garment, giver] = worn_[v];
            if (giver == kNobody) mix.unseen += one;
            for (size_t role = 0; role < roles.size(); ++role)
                if (giver == roles[role].second &&
                    (role == 0 || (garment == roles[role].first && (role != 1 || onHead_[v]) &&
                                   (role != 6 || onHands_[v]))))
                    mix.given[role] += one;
        }
    }

    // [V] What the givers have, spread over what nobody gives, in sweeps of means (Gauss-Seidel):
    // first along the garment, then over all that is left.
    template <typename Of>
    std::vector<glm::dvec3> filled(const Of& of) const {
        constexpr int kSweeps = 200;
        std::vector<glm::dvec3> values(vertices_);
        std::vector<char> known(vertices_);
        for (size_t v = 0; v < vertices_; ++v)
            if (worn_[v].giver != kNobody) values[v] = of(givers_[worn_[v].giver], v), known[v] = 1;
        for (bool alongGarment : {true, false}) {
            const std::vector<char> fixed = known;
            for (int sweep = 0; sweep < kSweeps; ++sweep)
                for (size_t v = 0; v < vertices_; ++v) {
                    if (fixed[v]) continue;
                    glm::dvec3 sum(0);
                    double count = 0;
                    for (int32_t at : neighboursOf(v)) {
                        const auto n = size_t(at);
                        if (!known[n] || (alongGarment && worn_[n].garment != worn_[v].garment))
                            continue;
                        sum += values[n];
                        ++count;
                    }
                    if (count == 0) continue;
                    values[v] = sum / count;
                    known[v] = 1;
                }
        }
        return values;
    }

    // [V,3] Across seams the givers' surfaces go over into each other.
    std::vector<float> mixedOffsets() const {
        constexpr int kPasses = 4;  // of means over neighbours, which lie a centimetre apart
        std::vector<std::vector<double>> shares(choices(), std::vector<double>(vertices_));
        for (size_t v = 0; v < vertices_; ++v) shares[choiceOf(v)][v] = 1;
        for (std::vector<double>& share : shares)
            for (int pass = 0; pass < kPasses; ++pass) {
                std::vector<double> next = share;
                for (size_t v = 0; v < vertices_; ++v) {
                    const auto beside = neighboursOf(v);
                    double sum = 0;
                    for (int32_t n : beside) sum += share[size_t(n)];
                    if (!beside.empty()) next[v] = (share[v] + sum / double(beside.size())) / 2;
                }
                share = std::move(next);
            }
        const std::vector<glm::dvec3> covered =
            filled([](const Giver& giver, size_t v) { return giver.offset(v); });
        std::vector<float> offsets;
        for (size_t v = 0; v < vertices_; ++v) {
            glm::dvec3 sum(0);
            double all = 0;
            for (size_t k = 0; k < choices(); ++k) {
                const double share = shares[k][v];
                if (share == 0) continue;
                all += share;
                sum += share * (k < givers_.size() ? givers_[k].offset(v) : covered[v]);
            }
            // Where there is one giver, its numbers to the last bit.
            for (int c = 0; c < 3; ++c) offsets.push_back(float(sum[c] / all));
        }
        return offsets;
    }

    // A texel of the mixed texture.
    struct Texel {
        glm::dvec2 uv;
        std::array<size_t, 3> corners;  // vertices of its triangle
        std::vector<double> share,
            skin;           // of each choice: how much of it is here; how much is skin
        glm::dvec3 filled;  // what nobody's are
    };

    glm::dvec3 colourOf(const Texel& texel, size_t k) const {
        return k < givers_.size() ? givers_[k].matched(givers_[k].at(texel.uv), texel.skin[k])
                                  : texel.filled;
    }

    // A triangle's corners may be of several givers. Within a garment they go over into each other;
    // the uppermost of several garments ends where its giver's picture says so, else with a narrow
    // seam.
    void sharpen(Texel& texel) const {
        constexpr double kNarrow = 4;  // power of the shares
        const size_t upper = std::ranges::max(texel.corners, {},
                                              [&](size_t v) { return layerOf(worn_[v].garment); });
        const size_t k = choiceOf(upper);
        const auto ofTheSame = [&](size_t v) { return worn_[v].garment == worn_[upper].garment; };
        if (std::ranges::all_of(texel.corners, ofTheSame)) return;
        double sure = -1;
        if (k < givers_.size()) {
            glm::dvec3 own(0), other(0);
            double owns = 0;
            for (size_t v : texel.corners) {
                const bool its = choiceOf(v) == k;
                owns += its;
                (its ? own : other) += givers_[k].colours[v];
            }
            if (owns < 3) sure = sureOf(colourOf(texel, k), own / owns, other / (3 - owns));
        }
        double others = 0;
        for (size_t i = 0; i < choices(); ++i) {
            texel.share[i] = std::pow(texel.share[i], kNarrow);
            if (i != k) others += texel.share[i];
        }
        const double own =
            sure >= 0 && others > 0 ? sure : texel.share[k] / (others + texel.share[k]);
        for (double& share : texel.share) share *= others > 0 ? (1 - own) / others : 0;
        texel.share[k] = own;
    }

    // [size,size,3]
    std::vector<float> mixedTexture(int size) const {
        const std::vector<glm::dvec3> covered =
            filled([](const Giver& giver, size_t v) { return giver.colours[v]; });
        const std::vector<TexelPlace> places = texelPlaces(body_, size);
        std::vector<float> texture(3 * places.size());
        for (size_t t = 0; t < places.size(); ++t) {
            const TexelPlace& place = places[t];
            if (place.face < 0) continue;
            Texel texel{(glm::dvec2(t % size_t(size), t / size_t(size)) + .5) / double(size),
                        {},
                        std::vector<double>(choices()),
                        std::vector<double>(choices()),
                        glm::dvec3(0)};
            for (size_t i = 0; i < 3; ++i) {
                const auto v = size_t(body_.faces[3 * size_t(place.face) + i]);
                const double corner = double{place.corners[i]};
                texel.corners[i] = v;
                texel.share[choiceOf(v)] += corner;
                texel.filled += corner * covered[v];
                for (size_t k = 0; k < givers_.size(); ++k)
                    texel.skin[k] += corner * givers_[k].wears(Garment::Skin, v);
            }
            sharpen(texel);
            glm::dvec3 sum(0);
            for (size_t k = 0; k < choices(); ++k)
                if (texel.share[k] > 0) sum += texel.share[k] * colourOf(texel, k);
            for (int c = 0; c < 3; ++c) texture[3 * t + size_t(c)] = float(sum[c]);
        }
        spreadCharts(places, size, texture);
        return texture;
    }

    const MixParts& parts_;
    const BodyModel& body_;
    const size_t vertices_;
    const Adjacency around_;
    std::vector<Giver> givers_;
    size_t base_ = 0, head_ = 0, hair_ = 0, top_ = 0, bottom_ = 0, shoes_ = 0, hands_ = 0;
    std::vector<Worn> worn_;
    std::vector<char> onHead_, onHands_;
};

}  // namespace

Mix mixAvatars(const MixParts& parts) {
    CHECK(parts.base, "there is a base");
    // Bodies are mixed without their caps, which then come with what they are a part of.
    std::map<const Avatar*, Avatar> plain;
    auto modelOf = [&](const Avatar* avatar) -> const Avatar* {
        if (!avatar) return nullptr;
        return &plain.try_emplace(avatar, withoutCap(*avatar)).first->second;
    };
    MixParts models;
    for (auto part : {&MixParts::base, &MixParts::head, &MixParts::hair, &MixParts::top,
                      &MixParts::bottom, &MixParts::shoes, &MixParts::hands, &MixParts::shape})
        models.*part = modelOf(parts.*part);
    Mix mix = Mixer(models).mix();

    auto either = [](const Avatar* giver, const Avatar* other) { return giver ? giver : other; };
    std::vector<WornPiece> worn;
    for (const auto& [garment, giver] :
         {std::pair(Garment::Hair, either(parts.hair, either(parts.head, parts.base))),
          std::pair(Garment::Top, either(parts.top, parts.base)),
          std::pair(Garment::Bottom, either(parts.bottom, parts.base))})
        for (CapPiece& piece : capPieces(giver->body))
            if (piece.garment == garment) worn.push_back({giver, std::move(piece)});
    mix.capsWorn = wearCaps(mix.avatar, worn);
    return mix;
}

}  // namespace doppel
