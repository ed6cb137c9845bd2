#include "trainer/avatar/mix/mix.h"

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <map>

#include "engine/error.h"
#include "nn/body/mesh_topology.h"
#include "trainer/avatar/bake.h"
#include "trainer/avatar/mix/giver.h"
#include "trainer/avatar/mix/worn_caps.h"

namespace doppel {

namespace {

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

class Mixer {
public:
    explicit Mixer(const MixParts& parts)
        : parts_(parts),
          body_(parts.base->body),
          vertices_(size_t(body_.vertexCount)),
          around_(meshTopology(body_.faces, body_.vertexCount, body_.file).adjacency),
          worn_(vertices_),
          gone_(vertices_),
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
        dressAnkles();
        dressWaist();
        nameCovered();
        leaveRims();
        recolourSkin();
        findGone();
        findNearness();
        Mix mix;
        tell(mix);
        Avatar& avatar = mix.avatar;
        avatar.body = body_;
        avatar.bodyArrays = parts_.base->bodyArrays;
        avatar.betas = (parts_.shape ? parts_.shape : parts_.base)->betas;
        avatar.preset = parts_.base->preset;
        avatar.light = parts_.base->light;
        setOffsets(avatar, mixedOffsets());
        for (const Giver& giver : givers_)
            avatar.textureSize = std::max(avatar.textureSize, giver.avatar().textureSize);
        avatar.texture = mixedTexture(avatar.textureSize);
        avatar.preset.texture.textureSize = avatar.textureSize;
        return mix;
    }

private:
    // Each avatar once.
    size_t giverOf(const Avatar* avatar) {
        const auto found =
            std::ranges::find(givers_, avatar, [](const Giver& giver) { return &giver.avatar(); });
        if (found != givers_.end()) return size_t(found - givers_.begin());
        requireOneBody(*parts_.base, *avatar);
        givers_.emplace_back(*avatar, around_);
        return givers_.size() - 1;
    }

    // Numbers of the givers; one more is nobody's.
    size_t choices() const { return givers_.size() + 1; }
    size_t choiceOf(size_t v) const { return std::min(worn_[v].giver, givers_.size()); }

    void dress() {
        // Beside a garment that is not worn a giver's skin has its shadow, and some of its colour.
        constexpr int kShadow = 3;  // edges
        std::vector<std::vector<Garments>> around;
        std::vector<Garments> worn(givers_.size());
        for (const Giver& giver : givers_)
            around.push_back(garmentsAround(giver.garments(), kShadow, around_));
        for (size_t k = 0; k < givers_.size(); ++k) worn[k].set(number(Garment::Skin));
        worn[hair_].set(number(Garment::Hair)), worn[top_].set(number(Garment::Top));
        worn[shoes_].set(number(Garment::Shoes)), worn[bottom_].set(number(Garment::Bottom));
        for (size_t v = 0; v < vertices_; ++v) {
            const float* weights = &body_.weights[v * joint::kCount];
            onHead_[v] = body_.face[v] || weights[joint::kHead] + weights[joint::kNeck] > .5f;
            onHands_[v] = weights[joint::kLeftWrist] + weights[joint::kLeftHand] +
                              weights[joint::kRightWrist] + weights[joint::kRightHand] >
                          .5f;
            auto take = [&](Garment garment, size_t k) {
                if (worn_[v].giver == kNobody && givers_[k].wears(garment, v))
                    worn_[v] = {garment, k};
            };
            take(Garment::Hair, hair_);
            take(Garment::Top, top_);
            take(Garment::Shoes, shoes_);
            take(Garment::Bottom, bottom_);
            auto takeSkin = [&](std::initializer_list<size_t> from) {
                if (!body_.face[v] && !onHands_[v])
                    for (size_t k : from)
                        if ((around[k][v] & ~worn[k]).none()) take(Garment::Skin, k);
                for (size_t k : from) take(Garment::Skin, k);
            };
            if (onHead_[v])
                takeSkin({head_, hair_, base_, top_});
            else if (onHands_[v])
                takeSkin({hands_, base_, top_, head_});
            else
                takeSkin({base_, top_, bottom_, shoes_, head_});
        }
    }

    // Where neither the shoes are whose they are, for trousers covered them, nor the trousers or
    // the skirt, for shoes or socks came up to them: trousers hang down over it, and below bare
    // legs there are the socks and shoes that were worn with them.
    void dressAnkles() {
        std::vector<char> visited(vertices_);
        for (size_t start = 0; start < vertices_; ++start) {
            if (visited[start] || worn_[start].giver != kNobody) continue;
            std::vector<size_t> gap{start};
            visited[start] = 1;
            bool onFeet = false;
            int trousers = 0, skin = 0;  // beside it
            for (size_t i = 0; i < gap.size(); ++i) {
                const float* weights = &body_.weights[gap[i] * joint::kCount];
                onFeet = onFeet || weights[joint::kLeftAnkle] + weights[joint::kRightAnkle] +
                                           weights[joint::kLeftFoot] + weights[joint::kRightFoot] >
                                       .5f;
                for (int32_t at : around_.of(gap[i])) {
                    const auto n = size_t(at);
                    if (worn_[n].giver != kNobody) {
                        trousers += worn_[n].garment == Garment::Bottom;
                        skin += worn_[n].garment == Garment::Skin;
                    } else if (!visited[n])
                        visited[n] = 1, gap.push_back(n);
                }
            }
            if (!onFeet) continue;
            for (size_t v : gap) worn_[v] = {Garment::Bottom, trousers > skin ? kNobody : bottom_};
        }
    }

    // Where a top ends above the trousers or the skirt of another, they go up to it.
    void dressWaist() {
        for (size_t v = 0; v < vertices_; ++v)
            if (worn_[v].giver == kNobody && givers_[top_].wears(Garment::Bottom, v) &&
                givers_[bottom_].wears(Garment::Top, v))
                worn_[v].garment = Garment::Bottom;
    }

    // What hair covers, or another's longer clothes, is of the garment that lies around it, ring by
    // ring.
    void nameCovered() {
        std::vector<char> named(vertices_);
        for (size_t v = 0; v < vertices_; ++v)
            named[v] = (worn_[v].giver != kNobody && worn_[v].garment != Garment::Hair) ||
                       worn_[v].garment == Garment::Bottom;
        for (bool grows = true; grows;) {
            std::vector<std::pair<size_t, Garment>> ring;
            for (size_t v = 0; v < vertices_; ++v) {
                if (named[v] || worn_[v].giver != kNobody) continue;
                std::array<int, kGarmentCount> beside{};
                for (int32_t n : around_.of(v))
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
                if (std::ranges::any_of(around_.of(v), [&](int32_t n) {
                        const Worn& beside = worn_[size_t(n)];
                        return beside.giver == kNobody && beside.garment == worn_[v].garment;
                    }))
                    rim.push_back(v);
            for (size_t v : rim) worn_[v].giver = kNobody;
        }
    }

    void recolourSkin() {
        std::vector<size_t> face;
        for (size_t v = 0; v < vertices_; ++v)
            if (body_.face[v]) face.push_back(v);
        for (size_t k = 0; k < givers_.size(); ++k) {
            std::vector<size_t> taken;
            for (size_t v = 0; v < vertices_; ++v)
                if (worn_[v].giver == k && worn_[v].garment == Garment::Skin) taken.push_back(v);
            if (k != head_) givers_[k].recolour(givers_[head_], taken, face);
        }
    }

    void findGone() {
        constexpr int kNear = 3;
        for (size_t k = 0; k < givers_.size(); ++k) {
            const std::vector<Garments> around =
                garmentsAround(givers_[k].garments(), kNear, around_);
            std::vector<Garments> worn(vertices_);
            for (size_t v = 0; v < vertices_; ++v)
                if (worn_[v].giver == k) worn[v].set(number(givers_[k].garments()[v]));
            worn = spread(std::move(worn), kNear, around_);
            for (size_t v = 0; v < vertices_; ++v)
                if (worn_[v].giver == k) gone_[v] = around[v] & ~worn[v];
        }
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
                    for (int32_t at : around_.of(v)) {
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

    // [V] Means over neighbours, which lie a centimetre apart.
    std::vector<double> smoothed(std::vector<double> values, int passes) const {
        for (int pass = 0; pass < passes; ++pass) {
            std::vector<double> next = values;
            for (size_t v = 0; v < vertices_; ++v) {
                const auto beside = around_.of(v);
                double sum = 0;
                for (int32_t n : beside) sum += values[size_t(n)];
                if (!beside.empty()) next[v] = (values[v] + sum / double(beside.size())) / 2;
            }
            values = std::move(next);
        }
        return values;
    }

    void findNearness() {
        constexpr int kPasses = 3;
        for (size_t g = 0; g < kGarmentCount; ++g) {
            std::vector<double> worn;
            for (const Worn& at : worn_) worn.push_back(number(at.garment) == g);
            nearness_[g] = smoothed(std::move(worn), kPasses);
        }
    }

    // [V,3] Across seams the givers' surfaces go over into each other.
    std::vector<float> mixedOffsets() const {
        constexpr int kPasses = 4;
        std::vector<std::vector<double>> shares(choices(), std::vector<double>(vertices_));
        for (size_t v = 0; v < vertices_; ++v) shares[choiceOf(v)][v] = 1;
        for (std::vector<double>& share : shares) share = smoothed(std::move(share), kPasses);
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

    // [choices] How much of a texel each has. Within a garment they go over into each other; the
    // uppermost of several garments ends where its giver's picture says so within a centimetre, and
    // where that does not tell, in the middle.
    std::vector<double> sharesOf(const AtlasTexel& texel) const {
        constexpr double kSteep = 16;  // nats from no share of the smoothed seam to all
        constexpr double kSharp = 2;
        const auto [a, b, c] = texel.corners;
        const size_t upper =
            std::ranges::max({a, b, c}, {}, [&](size_t v) { return layerOf(worn_[v].garment); });
        const Garment garment = worn_[upper].garment;
        const size_t k = choiceOf(upper);
        std::vector<double> above(choices()), below(choices());
        double near = 0, odds = 0, all = 0, beneath = 0;
        for (int i = 0; i < 3; ++i) {
            const size_t v = texel.corners[size_t(i)];
            const double corner = texel.barycentrics[i];
            near += corner * nearness_[number(garment)][v];
            const bool its = worn_[v].garment == garment;
            (its ? above : below)[choiceOf(v)] += corner;
            (its ? all : beneath) += corner;
            if (!its && k < givers_.size())
                odds += corner * givers_[k].odds(texel, garment, givers_[k].garments()[v]);
        }
        if (beneath == 0) return above;
        if (all == 0) return below;
        odds = odds / beneath + kSteep * (near - .5);
        const double share = 1 / (1 + std::exp(-kSharp * odds));
        std::vector<double> shares;
        for (size_t i = 0; i < choices(); ++i)
            shares.push_back(share * above[i] / all + (1 - share) * below[i] / beneath);
        return shares;
    }

    glm::dvec3 colourOf(const AtlasTexel& texel, size_t k) const {
        std::array<Garments, 3> gone;
        for (size_t i = 0; i < 3; ++i)
            if (worn_[texel.corners[i]].giver == k) gone[i] = gone_[texel.corners[i]];
        return givers_[k].colour(texel, gone);
    }

    // [size,size,3]
    std::vector<float> mixedTexture(int size) const {
        const std::vector<glm::dvec3> covered =
            filled([](const Giver& giver, size_t v) { return giver.colour(v); });
        const std::vector<TexelPlace> places = texelPlaces(body_, size);
        std::vector<float> texture(3 * places.size());
        for (size_t t = 0; t < places.size(); ++t) {
            const TexelPlace& place = places[t];
            if (place.face < 0) continue;
            AtlasTexel texel{.uv = (glm::dvec2(t % size_t(size), t / size_t(size)) + .5) /
                                   double(size)};
            glm::dvec3 sum(0), filled(0);
            for (size_t i = 0; i < 3; ++i) {
                const auto v = size_t(body_.faces[3 * size_t(place.face) + i]);
                texel.corners[i] = v;
                texel.barycentrics[int(i)] = double{place.corners[i]};
                filled += texel.barycentrics[int(i)] * covered[v];
            }
            const std::vector<double> shares = sharesOf(texel);
            for (size_t k = 0; k < choices(); ++k)
                if (shares[k] > 0)
                    sum += shares[k] * (k < givers_.size() ? colourOf(texel, k) : filled);
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
    // [V] Garments that a vertex's giver wears within three edges of it, and the mix does not.
    std::vector<Garments> gone_;
    // [V] How much of each garment is worn around a vertex, 0 to 1.
    std::array<std::vector<double>, kGarmentCount> nearness_;
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
