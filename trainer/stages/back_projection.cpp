#include "trainer/stages/back_projection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <optional>

#include "nn/ops/raster.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/mix/lab.h"
#include "trainer/data/body_render.h"
#include "trainer/data/progress.h"
#include "trainer/stages/colours/unseen_colours.h"
#include "trainer/stages/rim.h"

namespace doppel {

namespace {

// What lies behind what is seen by more than this, m, is hidden.
constexpr double kHidden = 0.012;
// Weight of the least cosine to the camera, 14 degrees from its side: what is seen by a smaller one
// is as good as not seen, and its picture is the outline's.
constexpr float kLeastFacing = .0037f;
// How far from a mirror image, m, what is seen stands for it.
constexpr double kMirrored = .015;
// Samples of the depth per pixel and axis, in pictures of up to so many pixels.
constexpr int kSamples = 2;
constexpr int64_t kSampledPixels = int64_t{1} << 20;

// Depths of a mesh in one size of picture, several samples to a pixel.
class DepthMap {
public:
    DepthMap(Device& device, const BodyModel& body, const Camera& camera)
        : graph_(device), width_(camera.width), height_(camera.height) {
        samples_ = int64_t{width_} * height_ <= kSampledPixels ? kSamples : 1;
        verts_ = graph_.input({body.vertexCount, 3});
        camera_ = graph_.input(kCameraShape);
        RasterMesh mesh = rasterMesh(graph_, body.faces, body.vertexCount);
        seen_ =
            visibilityBuffer(graph_, mesh, verts_, camera_, height_ * samples_, width_ * samples_);
        graph_.output(seen_.surface);
        graph_.compile();
    }
    bool fits(const Camera& camera) const {
        return camera.width == width_ && camera.height == height_;
    }
    void draw(std::span<const float> verts, Camera camera) {
        camera.fx *= samples_, camera.fy *= samples_, camera.cx *= samples_, camera.cy *= samples_;
        graph_.write(verts_, verts);
        graph_.write(camera_, cameraValues(rasterCamera(camera)));
        graph_.run();
        surface_ = graph_.read<float>(seen_.surface);
    }
    // At a place in the picture, pixels; 0 where nothing is seen.
    double at(double u, double v) const {
        const auto x = static_cast<int64_t>(u * samples_), y = static_cast<int64_t>(v * samples_);
        if (u < 0 || v < 0 || x >= width_ * samples_ || y >= height_ * samples_) return 0;
        return static_cast<double>(
            surface_[static_cast<size_t>(4 * (y * width_ * samples_ + x)) + 3]);
    }

private:
    Graph graph_;
    int width_, height_, samples_ = 1;
    Tensor verts_, camera_;
    VisibilityBuffer seen_;
    std::vector<float> surface_;
};

// How much the pixels outside a mask, on its border, on its rim and inside count.
constexpr std::array<float, 4> kWeights{0, 1e-4f, 1e-2f, 1};

// A frame as texels take from it.
struct View {
    std::vector<uint8_t> rgb;      // [H,W,3]
    std::vector<uint8_t> weights;  // [H,W] which of kWeights
};

// The pixels on a mask's rim count little, and those on its border, or of the rim that is asked
// for, have the colours of the inside, so that a texel which nobody saw otherwise has no halo.
View viewOf(const Picture& picture, int asked) {
    const int w = picture.width, h = picture.height, rim = std::max(2, asked);
    std::vector<uint8_t> outside(picture.mask.size());
    std::ranges::transform(picture.mask, outside.begin(),
                           [](uint8_t m) { return static_cast<uint8_t>(m > 127 ? 0 : 255); });
    const std::vector<uint8_t> near = dilateMask(outside, w, h, 1),
                               far = dilateMask(outside, w, h, rim);
    View view{withoutRim(picture, std::max(1, asked), 1), std::vector<uint8_t>(outside.size())};
    for (size_t i = 0; i < outside.size(); ++i)
        view.weights[i] = outside[i] ? 0 : near[i] ? 1 : far[i] ? 2 : 3;
    return view;
}

// m, of a texel on the template, in the mean.
double texelEdge(const BodyModel& body, const std::vector<TexelPlace>& places) {
    double area = 0;
    for (size_t f = 0; f < body.faces.size(); f += 3) {
        auto corner = [&](size_t k) {
            const float* v = &body.templateVertices[3 * static_cast<size_t>(body.faces[f + k])];
            return glm::dvec3(v[0], v[1], v[2]);
        };
        area += glm::length(glm::cross(corner(1) - corner(0), corner(2) - corner(0))) / 2;
    }
    const auto texels = static_cast<double>(
        std::ranges::count_if(places, [](const TexelPlace& place) { return place.face >= 0; }));
    return std::sqrt(area / std::max(1., texels));
}

// For each texel that is not known, the known one nearest to its mirror image on the template,
// nearer than so much, m, or -1.
std::vector<int64_t> mirrorImages(const BodyModel& body, const std::vector<TexelPlace>& places,
                                  const std::vector<uint8_t>& known, double near) {
    constexpr double kSameSide = 0.5;  // cosine between the normals
    const double plane = restJoints(body, std::vector<double>(BodyModel::kShapes))[0];
    struct Point {
        glm::dvec3 place, normal;
    };
    auto corner = [&](size_t face, size_t k) {
        const float* v = &body.templateVertices[3 * static_cast<size_t>(body.faces[3 * face + k])];
        return glm::dvec3(v[0], v[1], v[2]);
    };
    auto pointOf = [&](const TexelPlace& place) {
        const auto face = static_cast<size_t>(place.face);
        const glm::dvec3 a = corner(face, 0), b = corner(face, 1), c = corner(face, 2);
        const glm::dvec3 normal = glm::cross(b - a, c - a);
        return Point{double{place.corners[0]} * a + double{place.corners[1]} * b +
                         double{place.corners[2]} * c,
                     normal / std::max(glm::length(normal), 1e-12)};
    };
    // Known texels by cells of space as wide as the search reaches.
    using Cell = std::array<int, 3>;
    auto cellOf = [&](const glm::dvec3& p) {
        return Cell{static_cast<int>(std::floor(p.x / near)),
                    static_cast<int>(std::floor(p.y / near)),
                    static_cast<int>(std::floor(p.z / near))};
    };
    std::map<Cell, std::vector<size_t>> cells;
    for (size_t i = 0; i < places.size(); ++i)
        if (known[i] && places[i].face >= 0) cells[cellOf(pointOf(places[i]).place)].push_back(i);
    std::vector<int64_t> mirrored(places.size(), -1);
    for (size_t i = 0; i < places.size(); ++i) {
        if (known[i] || places[i].face < 0) continue;
        Point image = pointOf(places[i]);
        image.place.x = 2 * plane - image.place.x;
        image.normal.x = -image.normal.x;
        const Cell centre = cellOf(image.place);
        double nearest = near;
        for (int n = 0; n < 27; ++n) {
            const auto cell = cells.find(
                {centre[0] + n % 3 - 1, centre[1] + n / 3 % 3 - 1, centre[2] + n / 9 - 1});
            if (cell == cells.end()) continue;
            for (size_t other : cell->second) {
                const Point point = pointOf(places[other]);
                const double distance = glm::distance(point.place, image.place);
                if (distance >= nearest || glm::dot(point.normal, image.normal) < kSameSide)
                    continue;
                nearest = distance;
                mirrored[i] = static_cast<int64_t>(other);
            }
        }
    }
    return mirrored;
}

// What the known texels show at the body's vertices.
struct SeenVertices {
    std::vector<glm::dvec3> colours;  // [V]
    std::vector<double> trust;        // [V] 0 to 1
};

// trust [size,size]: how well the known ones were seen.
SeenVertices atVertices(const BodyModel& body, const std::vector<TexelPlace>& places,
                        std::span<const float> texture, const std::vector<uint8_t>& known,
                        const std::vector<double>& trust) {
    const auto vertices = static_cast<size_t>(body.vertexCount);
    SeenVertices seen{std::vector<glm::dvec3>(vertices), std::vector<double>(vertices)};
    std::vector<double> shares(vertices);
    for (size_t i = 0; i < places.size(); ++i) {
        if (!known[i] || places[i].face < 0) continue;
        const float* rgb = &texture[3 * i];
        const double trusted = std::min(1.0, trust[i]);
        for (size_t k = 0; k < 3; ++k) {
            const auto v =
                static_cast<size_t>(body.faces[3 * static_cast<size_t>(places[i].face) + k]);
            const auto share = double{places[i].corners[k]};
            seen.colours[v] += share * trusted * glm::dvec3(rgb[0], rgb[1], rgb[2]);
            seen.trust[v] += share * trusted;
            shares[v] += share;
        }
    }
    for (size_t v = 0; v < vertices; ++v) {
        if (seen.trust[v] > 0) seen.colours[v] /= seen.trust[v];
        if (shares[v] > 0) seen.trust[v] /= shares[v];
    }
    return seen;
}

// Takes back mirror images of another garment than is to be expected where they would be: a head
// that is turned by a few degrees less than it seems has the edge of its face there. Where garments
// meet, colours tell.
void dropOtherGarments(const BodyModel& body, const std::vector<TexelPlace>& places,
                       std::span<const float> texture, const ExpectedLook& look,
                       std::vector<int64_t>& mirrored) {
    constexpr double kUnlike = 20;  // of L*a*b*
    struct Worn {
        Garment nearest;  // corner's
        bool all;         // corners wear it
    };
    auto wornAt = [&](size_t texel) {
        const TexelPlace& place = places[texel];
        const int32_t* face = &body.faces[3 * static_cast<size_t>(place.face)];
        const auto nearest = std::ranges::max_element(place.corners) - place.corners.begin();
        auto at = [&](ptrdiff_t k) { return look.garments[static_cast<size_t>(face[k])]; };
        return Worn{at(nearest), at(0) == at(1) && at(0) == at(2)};
    };
    auto isUnlike = [&](size_t texel, size_t image) {
        glm::dvec3 expected(0);
        for (size_t k = 0; k < 3; ++k)
            expected += double{places[texel].corners[k]} *
                        look.colours[static_cast<size_t>(
                            body.faces[3 * static_cast<size_t>(places[texel].face) + k])];
        const float* rgb = &texture[3 * image];
        return glm::distance(labOf({rgb[0], rgb[1], rgb[2]}), labOf(expected)) > kUnlike;
    };
    for (size_t i = 0; i < mirrored.size(); ++i) {
        if (mirrored[i] < 0) continue;
        const auto image = static_cast<size_t>(mirrored[i]);
        const Worn here = wornAt(i), there = wornAt(image);
        if (here.nearest != there.nearest || (!(here.all && there.all) && isUnlike(i, image)))
            mirrored[i] = -1;
    }
}

// Texels that are not known from those that are, along the body's surface; `trust` [size,size] says
// how well these were seen. Those for which none is left stay unknown. What is expected tells as
// well.
void takeFromNeighbours(const BodyModel& body, const std::vector<TexelPlace>& places,
                        const std::vector<double>& trust, const std::optional<ExpectedLook>& look,
                        FirstTexels& first, std::vector<uint8_t>& known) {
    const SeenVertices seen = atVertices(body, places, first.texture, known, trust);
    const UnseenColours unseen =
        unseenColours(body, seen.colours, seen.trust, look ? &*look : nullptr);
    for (size_t i = 0; i < places.size(); ++i) {
        if (known[i] || places[i].face < 0) continue;
        glm::dvec3 sum(0);
        bool reached = true;
        for (size_t k = 0; k < 3; ++k) {
            const auto v =
                static_cast<size_t>(body.faces[3 * static_cast<size_t>(places[i].face) + k]);
            sum += double{places[i].corners[k]} * unseen.colours[v];
            reached = reached && unseen.reached[v];
        }
        if (!reached) continue;
        known[i] = 1;
        // Linear elements may overshoot what was seen.
        for (int c = 0; c < 3; ++c)
            first.texture[3 * i + static_cast<size_t>(c)] =
                static_cast<float>(std::clamp(sum[c], 0.0, 1.0));
    }
}

// As fillUnseen(), with mirror images that are nearer than so much, m.
void fill(const BodyModel& body, const std::vector<TexelPlace>& places, int size,
          const KnownPeople& people, double near, FirstTexels& first) {
    std::vector<double> trust = first.trust;
    std::vector<uint8_t> known(places.size());
    for (size_t i = 0; i < places.size(); ++i) known[i] = first.origin[i] == kFromFrames;
    std::vector<int64_t> mirrored = mirrorImages(body, places, known, near);
    std::optional<ExpectedLook> look;
    if (!people.people.empty()) {
        const SeenVertices seen = atVertices(body, places, first.texture, known, trust);
        look = expectedLook(people, body, seen.colours, seen.trust);
        first.heights = look->heights;
        dropOtherGarments(body, places, first.texture, *look, mirrored);
    }
    for (size_t i = 0; i < places.size(); ++i) {
        if (known[i] || places[i].face < 0) continue;
        first.origin[i] = mirrored[i] < 0 ? kFromNeighbours : kFromOtherSide;
    }
    for (size_t i = 0; i < places.size(); ++i) {
        if (first.origin[i] != kFromOtherSide) continue;
        const auto other = static_cast<size_t>(mirrored[i]);
        std::copy_n(&first.texture[3 * other], 3, &first.texture[3 * i]);
        known[i] = 1;
        trust[i] = trust[other];
    }
    takeFromNeighbours(body, places, trust, look, first, known);
    fillHoles(first.texture, known, static_cast<size_t>(size), static_cast<size_t>(size));
}

}  // namespace

double FirstTexels::part(TexelOrigin from) const {
    const auto all = static_cast<double>(
        origin.size() - static_cast<size_t>(std::ranges::count(origin, uint8_t{kNoTexel})));
    return static_cast<double>(std::ranges::count(origin, uint8_t{from})) / std::max(all, 1.0);
}

FirstTexels backProject(Device& device, const BodyModel& body, const Capture& capture,
                        FrameCache& frames, int size, int rim, Ranks* ranks,
                        const KnownPeople& people) {
    rim = rimBeforeScreen(capture, frames, rim, ranks);
    capture.requireMasks();
    BodyPoser poser(device, body);
    std::unique_ptr<DepthMap> depths;
    const std::vector<TexelPlace> places = texelPlaces(body, size);
    std::vector<double> sums(3 * places.size()), totals(places.size());
    const size_t count = std::min(capture.size(), kProjectedFrames);
    const auto ranksCount = static_cast<size_t>(sizeOf(ranks));
    const size_t own = static_cast<size_t>(rankOf(ranks)),
                 mine = (count + ranksCount - 1 - own) / ranksCount;
    const auto frameOf = [&](size_t k) { return (k * ranksCount + own) * capture.size() / count; };
    Progress progress("first texels", static_cast<int64_t>(mine));
    auto project = [&](size_t k, const View& view) {
        const size_t f = frameOf(k);
        const Camera& camera = capture.frames[f].camera;
        const PosedMesh posed = poser.pose(capture.theta[f], capture.trans[f], capture.betas);
        if (!depths || !depths->fits(camera))
            depths = std::make_unique<DepthMap>(device, body, camera);
        depths->draw(posed.verts, camera);
        const std::vector<float> facing = viewWeights(body, places, posed.verts);
        const int w = camera.width, h = camera.height;
        for (size_t i = 0; i < places.size(); ++i) {
            if (places[i].face < 0 || !(facing[i] > kLeastFacing)) continue;
            double x[3] = {0, 0, 0};
            for (size_t corner = 0; corner < 3; ++corner) {
                const auto v = static_cast<size_t>(
                    body.faces[3 * static_cast<size_t>(places[i].face) + corner]);
                for (size_t c = 0; c < 3; ++c)
                    x[c] += double{places[i].corners[corner]} * double{posed.verts[3 * v + c]};
            }
            if (!(x[2] > 0)) continue;
            const double u = camera.fx * x[0] / x[2] + camera.cx;
            const double v = camera.fy * x[1] / x[2] + camera.cy;
            const double seen = depths->at(u, v);
            if (seen == 0 || x[2] > seen + kHidden) continue;
            const int column = static_cast<int>(u), row = static_cast<int>(v);
            const double weight =
                double{facing[i]} *
                double{kWeights[view.weights[static_cast<size_t>(row * w + column)]]};
            if (!(weight > 0)) continue;
            // Bilinear, clamped at the border.
            const double s = std::clamp(u - .5, 0.0, w - 1.0), t = std::clamp(v - .5, 0.0, h - 1.0);
            const int x0 = static_cast<int>(s), y0 = static_cast<int>(t);
            const int x1 = std::min(x0 + 1, w - 1), y1 = std::min(y0 + 1, h - 1);
            auto pixel = [&](int px, int py, size_t c) {
                const uint8_t colour = view.rgb[static_cast<size_t>(py * w + px) * 3 + c];
                return double{static_cast<float>(colour) / 255};
            };
            for (size_t c = 0; c < 3; ++c) {
                const double above = std::lerp(pixel(x0, y0, c), pixel(x1, y0, c), s - x0);
                const double below = std::lerp(pixel(x0, y1, c), pixel(x1, y1, c), s - x0);
                sums[3 * i + c] += weight * std::lerp(above, below, t - y0);
            }
            totals[i] += weight;
        }
        progress.update(static_cast<int64_t>(k) + 1);
    };
    inParallel(
        mine, [&](size_t k) { return viewOf(*frames.load(frameOf(k)), rim); },
        [&](size_t k, const View& view) {
            if (!interrupted()) project(k, view);
        });
    stopIfInterrupted(ranks);
    sumOverRanks(ranks, sums);
    sumOverRanks(ranks, totals);
    FirstTexels first{std::vector<float>(sums.size()),
                      std::vector<uint8_t>(totals.size()),
                      std::move(totals),
                      {}};
    for (size_t i = 0; i < places.size(); ++i) {
        if (places[i].face < 0) continue;
        first.origin[i] = first.trust[i] > 1e-12 ? kFromFrames : kFromNeighbours;
        if (first.origin[i] != kFromFrames) continue;
        for (size_t c = 0; c < 3; ++c)
            first.texture[3 * i + c] = static_cast<float>(sums[3 * i + c] / first.trust[i]);
    }
    fill(body, places, size, people, kMirrored, first);
    return first;
}

void fillUnseen(const BodyModel& body, int size, const KnownPeople& people, FirstTexels& first) {
    const std::vector<TexelPlace> places = texelPlaces(body, size);
    fill(body, places, size, people, std::min(kMirrored, 2 * texelEdge(body, places)), first);
}

}  // namespace doppel
