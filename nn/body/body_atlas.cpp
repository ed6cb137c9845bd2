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

}  // namespace

Atlas makeAtlas(std::span<const float> vertices, std::span<const int32_t> faces,
                std::span<const uint8_t> part) {
    size_t faceCount = faces.size() / 3;
    MeshTopology mesh = meshTopology(faces, static_cast<int64_t>(part.size()), "atlas");
    auto point = [&](size_t face, size_t corner) {
        const float* p = &vertices[3 * static_cast<size_t>(faces[3 * face + corner])];
        return Point{p[0], p[1], p[2]};
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

    // The largest scale at which they fit.
    std::vector<size_t> order(charts.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(
        order, [&](size_t a, size_t b) { return charts[a].height() > charts[b].height(); });
    double low = 0, high = 1;
    while (pack(charts, order, high) <= 1 && high < 1e6) high *= 2;
    for (int i = 0; i < 50; ++i) {
        double middle = (low + high) / 2;
        (pack(charts, order, middle) <= 1 ? low : high) = middle;
    }
    pack(charts, order, low);

    Atlas atlas;
    atlas.chartCount = static_cast<int>(charts.size());
    atlas.uvFaces.resize(faces.size());
    for (const Chart& chart : charts) {
        const Side& view = kSides[size_t(side[chart.faces[0]])];
        double scale = low * chart.density;
        std::map<int32_t, int32_t> uvOf;  // of the chart's vertices
        for (size_t f : chart.faces)
            for (size_t i = 0; i < 3; ++i) {
                auto [place, isNew] =
                    uvOf.try_emplace(faces[3 * f + i], static_cast<int32_t>(atlas.uvs.size() / 2));
                atlas.uvFaces[3 * f + i] = place->second;
                if (!isNew) continue;
                double u = chart.x + scale * (dot(point(f, i), view.right) - chart.left);
                double v = chart.y + scale * (chart.top - dot(point(f, i), view.up));
                atlas.uvs.push_back(static_cast<float>(std::clamp(u, 0.0, 1.0)));
                atlas.uvs.push_back(static_cast<float>(std::clamp(v, 0.0, 1.0)));
            }
    }
    return atlas;
}

}  // namespace doppel
