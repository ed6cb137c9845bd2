#include "trainer/person/masks/mask.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kEpsilon = 5e-3;  // of guidedFilter()
constexpr double kIsland = .05;    // of the largest part

// By colours, of the square's side: the network's own pixel, the windows that lead along
// edges, the cells in which colours are counted, and how far beyond the network's mask is looked.
constexpr double kBlurShare = 1. / 256, kLedShare = 1. / 256, kCellShare = 1. / 24,
                 kReachShare = 3. / 64;
constexpr double kLeastUnsure = .002;  // shares between this and the rest are decided by colours
constexpr double kLeastPrior = .03;    // what the network is taken to be sure of at most
constexpr double kMostFavour = 4;
constexpr float kContradicts = 3;  // a favour, as kMostFavour

// Means over windows of 2 radius + 1 pixels a side, cut at the picture's border; by running sums.
std::vector<double> windowMeans(const std::vector<double>& x, int width, int height, int radius) {
    const auto w = size_t(width), h = size_t(height);
    std::vector<double> across(x.size()), means(x.size());
    const auto pass = [radius](const double* from, double* to, size_t count, size_t step) {
        const auto n = std::ptrdiff_t(count);
        double sum = 0;
        for (std::ptrdiff_t i = 0; i < std::min<std::ptrdiff_t>(radius, n); ++i)
            sum += from[size_t(i) * step];
        for (std::ptrdiff_t i = 0; i < n; ++i) {
            if (i + radius < n) sum += from[size_t(i + radius) * step];
            if (i - radius > 0) sum -= from[size_t(i - radius - 1) * step];
            const auto begin = std::max<std::ptrdiff_t>(i - radius, 0);
            const auto end = std::min<std::ptrdiff_t>(i + radius, n - 1);
            to[size_t(i) * step] = sum / double(end - begin + 1);
        }
    };
    for (size_t y = 0; y < h; ++y) pass(&x[y * w], &across[y * w], w, 1);
    for (size_t i = 0; i < w; ++i) pass(&across[i], &means[i], h, w);
    return means;
}

// Leaves out what is not connected to the largest part, nor nearly as large.
void dropIslands(std::vector<uint8_t>& mask, int width, int height) {
    std::vector<int> part(mask.size(), -1);
    std::vector<size_t> sizes, waiting;
    for (size_t start = 0; start < mask.size(); ++start) {
        if (!mask[start] || part[start] >= 0) continue;
        const int number = int(sizes.size());
        sizes.push_back(0);
        waiting.push_back(start);
        part[start] = number;
        while (!waiting.empty()) {
            const size_t at = waiting.back();
            waiting.pop_back();
            ++sizes.back();
            const int x = int(at % size_t(width)), y = int(at / size_t(width));
            for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
                if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height) continue;
                const size_t next = size_t(y + dy) * size_t(width) + size_t(x + dx);
                if (!mask[next] || part[next] >= 0) continue;
                part[next] = number;
                waiting.push_back(next);
            }
        }
    }
    if (sizes.empty()) return;
    const double least = kIsland * double(*std::ranges::max_element(sizes));
    for (size_t i = 0; i < mask.size(); ++i)
        if (part[i] >= 0 && double(sizes[size_t(part[i])]) < least) mask[i] = 0;
}

}  // namespace

std::vector<float> guidedFilter(const Image& rgb, const std::vector<float>& share, int radius,
                                double epsilon) {
    const int w = rgb.width, h = rgb.height;
    const size_t n = size_t(w) * size_t(h);
    CHECK(rgb.channels == 3 && share.size() == n && radius >= 1, "a share has the picture's size");
    const auto means = [&](const std::vector<double>& x) { return windowMeans(x, w, h, radius); };
    std::array<std::vector<double>, 3> colour, mean, covariance;
    std::array<std::array<std::vector<double>, 3>, 3> colours;
    const std::vector<double> p(share.begin(), share.end());
    const std::vector<double> meanP = means(p);
    std::vector<double> product(n);
    for (size_t c = 0; c < 3; ++c) {
        colour[c].resize(n);
        for (size_t i = 0; i < n; ++i) colour[c][i] = rgb.data[3 * i + c] / 255.;
        mean[c] = means(colour[c]);
        for (size_t i = 0; i < n; ++i) product[i] = colour[c][i] * p[i];
        covariance[c] = means(product);
        for (size_t i = 0; i < n; ++i) covariance[c][i] -= mean[c][i] * meanP[i];
    }
    for (size_t c = 0; c < 3; ++c)
        for (size_t d = c; d < 3; ++d) {
            for (size_t i = 0; i < n; ++i) product[i] = colour[c][i] * colour[d][i];
            colours[c][d] = means(product);
            for (size_t i = 0; i < n; ++i) colours[c][d][i] -= mean[c][i] * mean[d][i];
        }
    // In each window share ≈ a · colour + b, by least squares.
    std::array<std::vector<double>, 3> a{std::vector<double>(n), std::vector<double>(n),
                                         std::vector<double>(n)};
    std::vector<double> b(n);
    for (size_t i = 0; i < n; ++i) {
        const double xx = colours[0][0][i] + epsilon, yy = colours[1][1][i] + epsilon,
                     zz = colours[2][2][i] + epsilon;
        const double xy = colours[0][1][i], xz = colours[0][2][i], yz = colours[1][2][i];
        const double cxx = yy * zz - yz * yz, cxy = xz * yz - xy * zz, cxz = xy * yz - xz * yy;
        const double cyy = xx * zz - xz * xz, cyz = xy * xz - xx * yz, czz = xx * yy - xy * xy;
        const double determinant = xx * cxx + xy * cxy + xz * cxz;
        const double r = covariance[0][i], g = covariance[1][i], k = covariance[2][i];
        a[0][i] = (cxx * r + cxy * g + cxz * k) / determinant;
        a[1][i] = (cxy * r + cyy * g + cyz * k) / determinant;
        a[2][i] = (cxz * r + cyz * g + czz * k) / determinant;
        b[i] = meanP[i] - a[0][i] * mean[0][i] - a[1][i] * mean[1][i] - a[2][i] * mean[2][i];
    }
    const std::vector<double> meanB = means(b);
    std::vector<float> result(n);
    for (size_t c = 0; c < 3; ++c) a[c] = means(a[c]);
    for (size_t i = 0; i < n; ++i) {
        result[i] = float(a[0][i] * colour[0][i] + a[1][i] * colour[1][i] + a[2][i] * colour[2][i] +
                          meanB[i]);
    }
    return result;
}

namespace {

// Where the person may be, and a margin about it; empty: nowhere.
Rect rectOf(const std::vector<float>& share, int width, int height, int margin) {
    Rect rect{width, height, 0, 0};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            if (share[size_t(y) * size_t(width) + size_t(x)] < .02f) continue;
            rect.left = std::min(rect.left, x), rect.right = std::max(rect.right, x + 1);
            rect.top = std::min(rect.top, y), rect.bottom = std::max(rect.bottom, y + 1);
        }
    if (rect.empty()) return {};
    return {std::max(rect.left - margin, 0), std::max(rect.top - margin, 0),
            std::min(rect.right + margin, width), std::min(rect.bottom + margin, height)};
}

Image partOf(const Image& rgb, const Rect& rect) {
    Image part(rect.width(), rect.height(), 3);
    for (int y = 0; y < part.height; ++y)
        std::copy_n(rgb.pixel(rect.left, rect.top + y), part.rowBytes(), part.row(y));
    return part;
}

std::vector<float> partOf(const std::vector<float>& share, int width, const Rect& rect) {
    std::vector<float> part;
    for (int y = rect.top; y < rect.bottom; ++y) {
        const auto row = share.begin() + std::ptrdiff_t(y) * width;
        part.insert(part.end(), row + rect.left, row + rect.right);
    }
    return part;
}

// Pixels that are as much as not the person's, over the person's.
double doubtIn(const std::vector<float>& share) {
    double inside = 0, doubtful = 0;
    for (float p : share) inside += p >= .5f, doubtful += p > .2f && p < .8f;
    return doubtful / std::max(inside, 1.);
}

// The mask of a picture from the share in a rectangle.
std::vector<uint8_t> maskOf(const Image& part, const std::vector<float>& share, const Image& rgb,
                            const Rect& rect) {
    std::vector<uint8_t> whole(share.size());
    for (size_t i = 0; i < share.size(); ++i) whole[i] = share[i] >= .5f ? 255 : 0;
    dropIslands(whole, part.width, part.height);
    std::vector<uint8_t> mask(size_t(rgb.width) * size_t(rgb.height));
    for (int y = 0; y < part.height; ++y)
        std::copy_n(&whole[size_t(y) * size_t(part.width)], part.width,
                    &mask[size_t(rect.top + y) * size_t(rgb.width) + size_t(rect.left)]);
    return mask;
}

bool isUnsure(double prior) { return prior > kLeastUnsure && prior < 1 - kLeastUnsure; }

int radiusOf(double side, double share) { return std::max(1, int(std::lround(side * share))); }

}  // namespace

CutOut cutOutAsGiven(const ClipView& view) {
    const auto& [rgb, share, part, side] = view;
    return {maskOf(rgb, share, rgb, {0, 0, rgb.width, rgb.height}), doubtIn(share)};
}

CutOut cutOutAlongEdges(const ClipView& view) {
    const auto& [rgb, share, parts, side] = view;
    const Rect rect = rectOf(share, rgb.width, rgb.height, radiusOf(side, kReachShare));
    if (rect.empty()) return {std::vector<uint8_t>(share.size()), 0};
    const Image part = partOf(rgb, rect);
    const std::vector<float> led =
        guidedFilter(part, partOf(share, rgb.width, rect), radiusOf(side, kLedShare), kEpsilon);
    return {maskOf(part, led, rgb, rect), doubtIn(led)};
}

// ---- by a whole clip's colours ------------------------------------------------------------------

void ClipMasks::learn(const ClipView& view) {
    colours_.add(view);
    background_.add(view.rgb, view.share);
}

void ClipMasks::finish(bool asksBehind) {
    colours_.finish();
    still_ = asksBehind && background_.still();
}

CutOut ClipMasks::cutOut(const ClipView& view, const Behind& behind) const {
    const auto& [rgb, share, parts, side] = view;
    CHECK(parts.size() == share.size(), "of each pixel it is known which part is near");
    const int blur = radiusOf(side, kBlurShare), led = radiusOf(side, kLedShare);
    const Rect rect = rectOf(share, rgb.width, rgb.height, radiusOf(side, kReachShare));
    if (rect.empty()) return {std::vector<uint8_t>(share.size()), 0};
    const Image part = partOf(rgb, rect);
    std::vector<float> given = partOf(share, rgb.width, rect);
    std::vector<double> prior(given.begin(), given.end());
    for (int pass = 0; pass < 2; ++pass) prior = windowMeans(prior, part.width, part.height, blur);
    std::vector<float> still;
    if (still_) still = background_.favour(rgb, share, rect);
    if (behind) {
        std::vector<uint8_t> unsure(prior.size());
        for (size_t i = 0; i < prior.size(); ++i) unsure[i] = isUnsure(prior[i]);
        still = behind(rect, unsure);
        // Where the network is contradicted, what contradicts it tells whose a colour is.
        for (size_t i = 0; i < given.size(); ++i)
            if (std::abs(still[i]) > kContradicts && (given[i] < .5f) == (still[i] > 0))
                given[i] = 1 / (1 + std::exp(-still[i]));
    }
    const PlaceColours places(rgb, rect, given, radiusOf(side, kCellShare));
    std::vector<float> posterior(given.size());
    for (size_t i = 0; i < given.size(); ++i) {
        const double p = std::clamp(prior[i], kLeastPrior, 1 - kLeastPrior);
        double favour = 0;
        // Far inside and far outside the network is right.
        if (isUnsure(prior[i])) {
            const int x = rect.left + int(i % size_t(part.width)),
                      y = rect.top + int(i / size_t(part.width));
            favour = double(places.favour(x, y, rgb.pixel(x, y), colours_,
                                          parts[size_t(y) * size_t(rgb.width) + size_t(x)]));
        }
        favour = std::clamp(favour, -kMostFavour, kMostFavour);
        if (!still.empty()) favour += double(still[i]);
        posterior[i] = float(1 / (1 + std::exp(-std::log(p / (1 - p)) - favour)));
    }
    // Neighbours of one colour belong together.
    posterior = guidedFilter(part, posterior, led, kEpsilon);
    return {maskOf(part, guidedFilter(part, posterior, led, kEpsilon), rgb, rect),
            doubtIn(posterior)};
}

}  // namespace doppel
