#include "trainer/motion/room.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

#include "trainer/data/random.h"

namespace doppel {

namespace {

using glm::dvec3;

double cell(uint64_t seed, int64_t x, int64_t y) {
    return uniformOf(seed + uint64_t(x) * 0x632be59bd9b4e019u, uint64_t(y) + 0x51ed2701u);
}

// Value noise: smooth between random numbers at whole coordinates, [0,1).
double noise(uint64_t seed, double x, double y) {
    const double fx = std::floor(x), fy = std::floor(y);
    const auto ix = int64_t(fx), iy = int64_t(fy);
    const auto ease = [](double t) { return t * t * (3 - 2 * t); };
    const double a = ease(x - fx), b = ease(y - fy);
    return (1 - b) * ((1 - a) * cell(seed, ix, iy) + a * cell(seed, ix + 1, iy)) +
           b * ((1 - a) * cell(seed, ix, iy + 1) + a * cell(seed, ix + 1, iy + 1));
}

double clouds(uint64_t seed, double x, double y) {
    return .5 * noise(seed, x, y) + .3 * noise(seed + 1, 2.3 * x, 2.3 * y) +
           .2 * noise(seed + 2, 5.1 * x, 5.1 * y);
}

// A colour that a thing in a room may have.
dvec3 paint(uint64_t seed, uint64_t number) {
    static const std::array<dvec3, 9> kPaints{{{.55, .16, .14},
                                               {.16, .27, .45},
                                               {.20, .38, .27},
                                               {.78, .70, .55},
                                               {.16, .16, .18},
                                               {.80, .62, .50},
                                               {.62, .44, .20},
                                               {.42, .33, .45},
                                               {.85, .85, .82}}};
    const dvec3 base = kPaints[size_t(uniformOf(seed, 3 * number) * double(kPaints.size()))];
    return base * (.75 + .5 * uniformOf(seed, 3 * number + 1));
}

double stripes(double x, double width) { return x / width - std::floor(x / width); }

}  // namespace

Room::Room(uint64_t seed) : seed_(seed) {
    const auto add = [&](dvec3 low, dvec3 high, Look look) {
        boxes_.push_back({low, high, look, seed * 1000 + boxes_.size()});
    };
    // Shelves to the left, with books; each shelf's side shows books as well.
    for (int shelf = 0; shelf < 5; ++shelf) {
        const double top = -.95 + .42 * shelf;
        add({-2.05, top, 4.2}, {-.75, top + .04, 4.58}, Look::Wood);
        add({-2.0, top + .1 + .04 * (shelf % 2), 4.25}, {-.8, top + .42, 4.5}, Look::Books);
    }
    for (double x : {-2.08, -.76}) add({x, -.95, 4.2}, {x + .04, kFloor, 4.58}, Look::Wood);
    add({1.25, -1.2, 4.4}, {2.1, 1.05, 4.55}, Look::Cloth);  // a curtain
    add({.2, -.55, 4.53}, {.95, .1, 4.58}, Look::Picture);   // pictures on the wall
    add({-.55, -.75, 4.53}, {-.05, -.2, 4.58}, Look::Picture);
    add({.15, .55, 3.9}, {1.15, kFloor, 4.5}, Look::Wood);  // a cupboard, things on it
    add({.25, .28, 4.1}, {.42, .55, 4.25}, Look::Cloth);
    add({.55, .34, 4.05}, {.95, .55, 4.35}, Look::Books);
    add({1.35, .5, 2.9}, {1.95, kFloor, 3.5}, Look::Cloth);  // an armchair
    add({1.75, .1, 2.9}, {1.95, .6, 3.5}, Look::Cloth);
    add({-1.65, .72, 3.0}, {-1.15, kFloor, 3.45}, Look::Wood);  // a box, a plant on it
    add({-1.6, .2, 3.05}, {-1.2, .72, 3.4}, Look::Leaf);
    add({-1.0, kFloor - .012, 1.6}, {1.0, kFloor, 3.3}, Look::Rug);
}

dvec3 Room::lookOf(Look look, uint64_t seed, double u, double v) const {
    switch (look) {
        case Look::Wallpaper: {
            const dvec3 base(.66, .63, .55);
            const double dx = stripes(u + .1 * (int(std::floor(v / .2)) % 2), .2) - .5,
                         dy = stripes(v, .2) - .5;
            const bool spot = dx * dx + dy * dy < .05;
            return (spot ? dvec3(.52, .48, .50) : base) * (.9 + .2 * clouds(seed, 2 * u, 2 * v));
        }
        case Look::Boards: {
            const double board = std::floor(u / .11);
            const double grain = clouds(seed, 40 * u, 1.5 * v + 7 * board);
            const double seam = stripes(u, .11) < .04 ? .6 : 1;
            return dvec3(.58, .43, .30) * (.7 + .4 * grain) * seam *
                   (.85 + .3 * uniformOf(seed, uint64_t(board + 1000)));
        }
        case Look::Plaster:
            return dvec3(.80, .79, .76) * (.94 + .1 * clouds(seed, 3 * u, 3 * v));
        case Look::Books: {
            const auto book = uint64_t(std::floor(u / .035) + 5000);
            const double edge = stripes(u, .035);
            const bool title = std::abs(stripes(v, .3) - .5) < .12 && edge > .3 && edge < .7;
            const dvec3 colour = paint(seed, book);
            return title ? dvec3(.85, .78, .6) : colour * (edge < .12 ? .45 : 1);
        }
        case Look::Wood: {
            const double ring = stripes(3 * u + .6 * clouds(seed, 2 * u, 9 * v), .25);
            return dvec3(.50, .34, .22) * (.75 + .35 * ring + .2 * noise(seed, 60 * u, 4 * v));
        }
        case Look::Cloth: {
            const double fold = .5 + .5 * std::sin(38 * u + 2 * clouds(seed, 3 * u, 2 * v));
            return paint(seed, 1) * (.55 + .5 * fold) * (.92 + .16 * noise(seed, 200 * u, 200 * v));
        }
        case Look::Picture: {
            const double c = clouds(seed, 4 * u, 4 * v);
            return c < .45 ? paint(seed, 2) : c < .55 ? paint(seed, 3) : paint(seed, 4);
        }
        case Look::Rug: {
            const double a = stripes(u, .3) - .5, b = stripes(v, .3) - .5;
            const double ring = std::abs(a) + std::abs(b);
            const dvec3 base = ring < .2   ? dvec3(.72, .62, .45)
                               : ring < .5 ? dvec3(.48, .17, .15)
                                           : dvec3(.16, .2, .33);
            return base * (.8 + .4 * noise(seed, 90 * u, 90 * v));
        }
        case Look::Leaf:
            return dvec3(.16, .36, .14) * (.4 + 1.3 * clouds(seed, 14 * u, 14 * v));
    }
    return {};
}

std::array<float, 3> Room::colour(const dvec3& origin, const dvec3& direction,
                                  const std::vector<dvec3>& feet) const {
    constexpr double kSide = 2.6, kCeiling = -1.4;
    double nearest = std::numeric_limits<double>::infinity();
    int axis = 0;
    Look look = Look::Plaster;
    uint64_t seed = seed_;
    // The walls, from within.
    const auto wall = [&](int which, double at, Look as) {
        const double along = direction[which];
        const double t = (at - origin[which]) / along;
        if (std::abs(along) < 1e-12 || t <= 0 || t >= nearest) return;
        nearest = t, axis = which, look = as, seed = seed_;
    };
    wall(2, kBack, Look::Wallpaper);
    wall(1, kFloor, Look::Boards);
    wall(1, kCeiling, Look::Plaster);
    wall(0, -kSide, Look::Wallpaper);
    wall(0, kSide, Look::Plaster);
    wall(2, -1, Look::Plaster);
    for (const Box& box : boxes_) {
        double in = 0, out = nearest;
        int side = -1;
        for (int k = 0; k < 3 && in < out; ++k) {
            const double inverse = 1 / direction[k];
            double a = (box.low[k] - origin[k]) * inverse, b = (box.high[k] - origin[k]) * inverse;
            if (a > b) std::swap(a, b);
            if (a > in) in = a, side = k;
            out = std::min(out, b);
        }
        if (side < 0 || in >= out) continue;
        nearest = in, axis = side, look = box.look, seed = box.seed;
    }
    const dvec3 p = origin + nearest * direction;
    const double u = axis == 0 ? p.z : p.x, v = axis == 1 ? p.z : p.y;
    dvec3 colour = lookOf(look, seed, u, v);
    // A lamp near the ceiling, before the wall.
    const dvec3 way = dvec3(.6, -1.2, 2.2) - p;
    const double facing = std::abs(way[axis]) / glm::length(way);
    colour *= .45 + .75 * facing / (1 + .12 * glm::dot(way, way)) + (axis == 1 ? .1 : 0);
    if (axis == 1 && p.y > kFloor - .1) {
        for (const dvec3& foot : feet) {
            const double x = (p.x - foot.x) / .35, z = (p.z - foot.z) / .22;
            colour *= 1 - .6 * std::exp(-(x * x + z * z));
        }
    }
    colour = glm::clamp(colour, 0., 1.);
    return {float(colour.x), float(colour.y), float(colour.z)};
}

}  // namespace doppel
