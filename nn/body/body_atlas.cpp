#include "nn/body/body_atlas.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

#include "nn/body/joint.h"
#include "nn/body/mesh_topology.h"

namespace doppel {

namespace {

using Point = std::array<double, 3>;

double dot(const Point& a, const Point& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

struct Side {
    Point direction, right, up;  // from the body to the eye; the picture's axes
};
// The picture's right is up x direction: seen from outside, nothing is mirrored.
constexpr std::array<Side, 6> kSides = {{
    {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}},
    {{0, 0, -1}, {-1, 0, 0}, {0, 1, 0}},
    {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}},
    {{-1, 0, 0}, {0, 0, 1}, {0, 1, 0}},
    {{0, 1, 0}, {1, 0, 0}, {0, 0, -1}},
    {{0, -1, 0}, {1, 0, 0}, {0, 0, 1}},
}};

struct Chart {
    std::vector<size_t> faces;
    double left = INFINITY, bottom = INFINITY, right = -INFINITY, top = -INFINITY;
    double density = 1;   // relative texels per metre
    double x = 0, y = 0;  // of the left top corner in the atlas

    double width() const { return density * (right - left); }
    double height() const { return density * (top - bottom); }
};

constexpr double kGap = 3.0 / 512;  // between charts: bilinear lookups and their gradients stay in

// Puts the charts, scaled, on shelves from the top down; returns the height that they take.
double pack(std::vector<Chart>& charts, const std::vector<size_t>& order, double scale) {
    double x = kGap, y = kGap, shelf = 0;
    for (size_t index : order) {
        Chart& chart = charts[index];
        double width = scale * chart.width(), height = scale * chart.height();
        if (x + width + kGap > 1) {
            x = kGap;
            y += shelf + kGap;
            shelf = 0;
        }
        if (x + width + kGap > 1) return INFINITY;
        chart.x = x;
        chart.y = y;
        x += width + kGap;
        shelf = std::max(shelf, height);
    }
    return y + shelf + kGap;
}

// A mesh in charts that have no places yet.
struct Charted {
    std::span<const float> vertices;
    std::span<const int32_t> faces;
    std::vector<int> side;  // of each face, into kSides
    std::vector<Chart> charts;
    std::vector<size_t> highestFirst;  // numbers of the charts

    // The charts where they are, each scaled by its density and this.
    Atlas atlas(double scale) const;
};

Point pointOf(std::span<const float> vertices, int32_t v) {
    const float* p = &vertices[3 * static_cast<size_t>(v)];
    return {p[0], p[1], p[2]};
}

Charted chartsOf(std::span<const float> vertices, std::span<const int32_t> faces,
                 std::span<const uint8_t> part) {
    size_t faceCount = faces.size() / 3;
    MeshTopology mesh = meshTopology(faces, static_cast<int64_t>(part.size()), "atlas");
    auto point = [&](size_t face, size_t corner) {
        return pointOf(vertices, faces[3 * face + corner]);
    };

    // Part and best side of every face.
    std::vector<int> facePart(faceCount), side(faceCount);
    std::vector<Point> normals(faceCount);
    for (size_t f = 0; f < faceCount; ++f) {
        std::array<int, 3> labels;
        for (size_t i = 0; i < 3; ++i) labels[i] = part[size_t(faces[3 * f + i])];
        std::ranges::sort(labels);
        facePart[f] = labels[1];  // the middle one of three is the majority's where there is one
        Point a = point(f, 0), b = point(f, 1), c = point(f, 2), n;
        for (size_t i = 0; i < 3; ++i) {
            size_t j = (i + 1) % 3, k = (i + 2) % 3;
            n[i] = (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j]);
        }
        double length = std::max(std::sqrt(dot(n, n)), 1e-30);
        for (double& x : n) x /= length;
        normals[f] = n;
        for (size_t s = 1; s < kSides.size(); ++s)
            if (dot(n, kSides[s].direction) > dot(n, kSides[size_t(side[f])].direction))
                side[f] = static_cast<int>(s);
    }
    // Where most neighbours are seen from another side, so is this face, unless it would be seen
    // too much from the edge: straighter seams and fewer charts.
    constexpr double kEdgeOn = 0.25;
    constexpr int kRounds = 8;
    auto neighbours = [&](size_t f) {
        return std::span(mesh.pairFaces)
            .subspan(size_t(mesh.pairBegin[f]), size_t(mesh.pairBegin[f + 1] - mesh.pairBegin[f]));
    };
    for (int round = 0; round < kRounds; ++round) {
        std::vector<int> before = side;
        for (size_t f = 0; f < faceCount; ++f) {
            std::array<int, kSides.size()> votes{};
            for (int32_t pair : neighbours(f))
                if (facePart[size_t(pair / 2)] == facePart[f])
                    ++votes[size_t(before[size_t(pair / 2)])];
            auto most = static_cast<size_t>(std::ranges::max_element(votes) - votes.begin());
            if (votes[most] >= 2 && dot(normals[f], kSides[most].direction) > kEdgeOn)
                side[f] = static_cast<int>(most);
        }
    }

    // Charts: what hangs together.
    std::vector<Chart> charts;
    std::vector<size_t> chartOf(faceCount, SIZE_MAX);
    for (size_t seed = 0; seed < faceCount; ++seed) {
        if (chartOf[seed] != SIZE_MAX) continue;
        Chart chart;
        chart.faces.push_back(seed);
        chartOf[seed] = charts.size();
        for (size_t i = 0; i < chart.faces.size(); ++i)
            for (int32_t pair : neighbours(chart.faces[i])) {
                auto g = static_cast<size_t>(pair / 2);
                if (chartOf[g] != SIZE_MAX || side[g] != side[seed] ||
                    facePart[g] != facePart[seed])
                    continue;
                chartOf[g] = charts.size();
                chart.faces.push_back(g);
            }
        if (facePart[seed] == kHead) chart.density = 2;
        const Side& view = kSides[size_t(side[seed])];
        for (size_t f : chart.faces)
            for (size_t i = 0; i < 3; ++i) {
                double x = dot(point(f, i), view.right), y = dot(point(f, i), view.up);
                chart.left = std::min(chart.left, x);
                chart.right = std::max(chart.right, x);
                chart.bottom = std::min(chart.bottom, y);
                chart.top = std::max(chart.top, y);
            }
        charts.push_back(std::move(chart));
    }

    std::vector<size_t> order(charts.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(
        order, [&](size_t a, size_t b) { return charts[a].height() > charts[b].height(); });
    return {vertices, faces, std::move(side), std::move(charts), std::move(order)};
}

Atlas Charted::atlas(double scale) const {
    Atlas atlas;
    atlas.chartCount = static_cast<int>(charts.size());
    atlas.uvFaces.resize(faces.size());
    for (const Chart& chart : charts) {
        const Side& view = kSides[size_t(side[chart.faces[0]])];
        const double texels = scale * chart.density;
        std::map<int32_t, int32_t> uvOf;  // of the chart's vertices
        for (size_t f : chart.faces)
            for (size_t i = 0; i < 3; ++i) {
                auto [place, isNew] =
                    uvOf.try_emplace(faces[3 * f + i], static_cast<int32_t>(atlas.uvs.size() / 2));
                atlas.uvFaces[3 * f + i] = place->second;
                if (!isNew) continue;
                const Point p = pointOf(vertices, faces[3 * f + i]);
                double u = chart.x + texels * (dot(p, view.right) - chart.left);
                double v = chart.y + texels * (chart.top - dot(p, view.up));
                atlas.uvs.push_back(static_cast<float>(std::clamp(u, 0.0, 1.0)));
                atlas.uvs.push_back(static_cast<float>(std::clamp(v, 0.0, 1.0)));
            }
    }
    return atlas;
}

// The largest scale up to `most` at which fits(scale) holds, for fits that end once and for all.
template <typename Fits>
double largestScale(double most, const Fits& fits) {
    if (fits(most)) return most;
    double low = 0, high = most;
    for (int i = 0; i < 50; ++i) {
        double middle = (low + high) / 2;
        (fits(middle) ? low : high) = middle;
    }
    return low;
}

// An atlas in cells, of which charts take rectangles.
class Room {
public:
    static constexpr int kCells = 512;

    explicit Room(const AtlasUse& use) : taken_(size_t{kCells} * kCells) {
        // A cell is taken where it comes near a face: cells' centres in the face's box, grown, that
        // lie within the face's three lines, moved outwards.
        for (size_t f = 0; f < use.uvFaces.size() / 3; ++f) {
            std::array<std::array<double, 2>, 3> p;
            std::array<double, 2> low{kCells, kCells}, high{0, 0};
            for (size_t k = 0; k < 3; ++k)
                for (size_t axis = 0; axis < 2; ++axis) {
                    p[k][axis] =
                        kCells * double(use.uvs[2 * size_t(use.uvFaces[3 * f + k]) + axis]);
                    low[axis] = std::min(low[axis], p[k][axis]);
                    high[axis] = std::max(high[axis], p[k][axis]);
                }
            for (int y = cell(low[1] - kMargin); y <= cell(high[1] + kMargin); ++y)
                for (int x = cell(low[0] - kMargin); x <= cell(high[0] + kMargin); ++x)
                    if (near(p, x + .5, y + .5)) taken_[size_t(y * kCells + x)] = 1;
        }
        sum();
    }

    // Places the charts, in their order, each in the first free rectangle from the top; false where
    // one finds none.
    bool place(std::vector<Chart>& charts, const std::vector<size_t>& order, double scale) const {
        Room left = *this;
        for (size_t index : order) {
            Chart& chart = charts[index];
            const int gap = static_cast<int>(std::ceil(kGap * kCells));
            const int w = static_cast<int>(std::ceil(scale * chart.width() * kCells)) + 2 * gap,
                      h = static_cast<int>(std::ceil(scale * chart.height() * kCells)) + 2 * gap;
            if (w > kCells || h > kCells) return false;
            bool found = false;
            for (int y = 0; y + h <= kCells && !found; ++y)
                for (int x = 0; x + w <= kCells && !found; ++x) {
                    if (left.taken(x, y, w, h) > 0) continue;
                    found = true;
                    chart.x = double(x + gap) / kCells;
                    chart.y = double(y + gap) / kCells;
                    for (int row = y; row < y + h - gap; ++row)
                        std::fill_n(left.taken_.begin() + row * kCells + x, w - gap, uint8_t{1});
                    left.sum();
                }
            if (!found) return false;
        }
        return true;
    }

private:
    static constexpr double kMargin = 1.5;  // cells

    static int cell(double x) { return std::clamp(static_cast<int>(std::floor(x)), 0, kCells - 1); }
    static bool near(const std::array<std::array<double, 2>, 3>& p, double x, double y) {
        const double area =
            (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
        const double sign = area < 0 ? -1 : 1;
        for (size_t k = 0; k < 3; ++k) {
            const auto &a = p[k], &b = p[(k + 1) % 3];
            const double dx = b[0] - a[0], dy = b[1] - a[1], length = std::hypot(dx, dy);
            if (sign * (dx * (y - a[1]) - dy * (x - a[0])) < -kMargin * length) return false;
        }
        return true;
    }

    // sums_[y][x]: taken cells above and left of x, y.
    void sum() {
        constexpr size_t kLine = kCells + 1;
        sums_.assign(kLine * kLine, 0);
        for (size_t y = 0; y < kCells; ++y)
            for (size_t x = 0, row = 0; x < kCells; ++x) {
                row += taken_[y * kCells + x];
                sums_[(y + 1) * kLine + x + 1] =
                    sums_[y * kLine + x + 1] + static_cast<int32_t>(row);
            }
    }
    int32_t taken(int x, int y, int w, int h) const {
        auto at = [&](int column, int line) {
            return sums_[size_t(line) * (kCells + 1) + size_t(column)];
        };
        return at(x + w, y + h) - at(x, y + h) - at(x + w, y) + at(x, y);
    }

    std::vector<uint8_t> taken_;
    std::vector<int32_t> sums_;
};

// Areas of all faces, of points with so many coordinates: m² on a mesh, parts of an atlas on its
// uvs.
double areaOf(std::span<const float> points, std::span<const int32_t> faces, size_t width) {
    double area = 0;
    for (size_t f = 0; f < faces.size(); f += 3) {
        std::array<Point, 3> p{};
        for (size_t k = 0; k < 3; ++k)
            for (size_t i = 0; i < width; ++i)
                p[k][i] = double(points[width * size_t(faces[f + k]) + i]);
        Point n{};
        for (size_t i = 0; i < 3; ++i) {
            const size_t j = (i + 1) % 3, k = (i + 2) % 3;
            n[i] = (p[1][j] - p[0][j]) * (p[2][k] - p[0][k]) -
                   (p[1][k] - p[0][k]) * (p[2][j] - p[0][j]);
        }
        area += std::sqrt(dot(n, n)) / 2;
    }
    return area;
}

}  // namespace

Atlas makeAtlas(std::span<const float> vertices, std::span<const int32_t> faces,
                std::span<const uint8_t> part) {
    Charted charted = chartsOf(vertices, faces, part);
    auto fits = [&](double scale) {
        return pack(charted.charts, charted.highestFirst, scale) <= 1;
    };
    double most = 1;
    while (fits(most) && most < 1e6) most *= 2;
    const double scale = largestScale(most, fits);
    pack(charted.charts, charted.highestFirst, scale);
    return charted.atlas(scale);
}

std::optional<Atlas> makeAtlasBeside(std::span<const float> vertices,
                                     std::span<const int32_t> faces, std::span<const uint8_t> part,
                                     const AtlasUse& other) {
    Charted charted = chartsOf(vertices, faces, part);
    for (Chart& chart : charted.charts) chart.density = 1;
    const double most = std::sqrt(areaOf(other.uvs, other.uvFaces, 2) /
                                  std::max(areaOf(other.vertices, other.faces, 3), 1e-12));
    const Room room(other);
    auto fits = [&](double scale) {
        return room.place(charted.charts, charted.highestFirst, scale);
    };
    double scale = most;
    while (!fits(scale)) {
        scale *= .93;
        if (scale < most / 8) return std::nullopt;
    }
    return charted.atlas(scale);
}

}  // namespace doppel
