#include "trainer/import/masks/chroma_key.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <queue>

#include "engine/error.h"
#include "trainer/person/masks/mask_tools.h"

namespace doppel {

namespace {

constexpr int kCell = 40;  // pixels: the screen's colour varies slowly
// Pixels this much darker than the screen around them have no chromaticity worth the name: such
// deep shadows do not fall on a screen.
constexpr double kDark = .10, kDarkEnd = .18;
// Distances from the screen's chromaticity, in its own spread there, at which the key begins and is
// complete.
constexpr double kKeyBegin = 4, kKeyEnd = 8;
constexpr double kLeastSpread = .008;
// Colours of person and objects: 16 steps per channel.
constexpr int kSteps = 16;
constexpr int kSurroundings = 4;  // pixels to each side that tell whose colours these are

struct Chroma {
    double red, green, brightness;
};

Chroma chromaOf(const uint8_t* rgb) {
    const auto& linear = linearTable();
    const double r = double(linear[rgb[0]]), g = double(linear[rgb[1]]), b = double(linear[rgb[2]]);
    const double sum = r + g + b + 1e-4;
    return {r / sum, g / sum, (r + g + b) / 3};
}

double medianOf(std::vector<double>& values) {
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// The commonest chromaticity along the pictures' borders.
struct Mode {
    double red = 0, green = 0, share = 0;
};

Mode borderMode(std::span<const std::vector<uint8_t>> borders) {
    constexpr int kBins = 64;
    std::vector<double> bins(kBins * kBins, 0.);
    std::vector<Chroma> ring;
    for (const std::vector<uint8_t>& border : borders) {
        for (size_t at = 0; at < border.size(); at += 3) {
            ring.push_back(chromaOf(&border[at]));
            const Chroma& c = ring.back();
            if (c.brightness < .01) continue;
            bins[size_t(c.red * kBins * .999) * kBins + size_t(c.green * kBins * .999)] += 1;
        }
    }
    const auto peak = size_t(std::max_element(bins.begin(), bins.end()) - bins.begin());
    Mode mode{(double(peak / kBins) + .5) / kBins, (double(peak % kBins) + .5) / kBins, 0};
    for (int round = 0; round < 8; ++round) {
        double red = 0, green = 0, count = 0;
        for (const Chroma& c : ring) {
            if (c.brightness < .01 || std::hypot(c.red - mode.red, c.green - mode.green) > .06) {
                continue;
            }
            red += c.red, green += c.green, count += 1;
        }
        if (count == 0) break;
        mode = {red / count, green / count, count / double(ring.size())};
    }
    return mode;
}

size_t binOf(const uint8_t* rgb) {
    constexpr int kWidth = 256 / kSteps;
    return size_t((rgb[0] / kWidth * kSteps + rgb[1] / kWidth) * kSteps + rgb[2] / kWidth);
}

// [1 2 1] along each of the three axes, so that near colours count as well.
void smoothHistogram(std::vector<double>& bins) {
    for (const size_t stride : {size_t(1), size_t(kSteps), size_t(kSteps * kSteps)}) {
        const std::vector<double> from = bins;
        for (size_t i = 0; i < bins.size(); ++i) {
            const size_t at = i / stride % kSteps;
            bins[i] = .5 * from[i] + .25 * (at > 0 ? from[i - stride] : 0) +
                      .25 * (at + 1 < kSteps ? from[i + stride] : 0);
        }
    }
}

// Lengths that go with the body's size in the picture, pixels.
struct Scale {
    double band;   // how far the person may reach beyond the body
    double inner;  // how deep inside it the person is sure
};

Scale scaleOf(std::span<const uint8_t> body) {
    const auto area = std::count_if(body.begin(), body.end(), [](uint8_t v) { return v > 0; });
    const double side = std::sqrt(double(area));
    return {std::max(2., .15 * side), std::max(1., .025 * side)};
}

// Pixels that the screen does not explain; a 3×3 mean takes the noise of single ones away.
std::vector<uint8_t> solidOf(std::span<const float> key, int width, int height) {
    const auto sums = squareSums(key, width, height, 1);
    std::vector<uint8_t> solid(key.size());
    std::transform(sums.begin(), sums.end(), solid.begin(),
                   [](float sum) { return uint8_t(sum < 4.5f ? 0 : 255); });
    return solid;
}

// Those so far from the screen that nothing of it is mixed into their colours.
std::vector<uint8_t> coreOf(std::span<const uint8_t> solid, int width, int height) {
    const auto depth = distanceTo(invertedMask(solid), width, height);
    std::vector<uint8_t> core(solid.size());
    std::transform(depth.begin(), depth.end(), core.begin(),
                   [](float d) { return uint8_t(d > 3 ? 255 : 0); });
    return core;
}

// How far each solid pixel is from the seeds on a way through solid pixels, infinite where there is
// none. A step costs more over an edge of the picture, and where favour · sign > 0.
std::vector<float> growth(const Picture& picture, std::span<const uint8_t> solid,
                          std::span<const uint8_t> seeds, std::span<const float> favour,
                          float sign) {
    constexpr float kEdgeCost = .4f;    // per step of 8-bit brightness and channel
    constexpr float kFavourCost = 2.f;  // per unit of favour
    std::vector<float> distance(solid.size(), std::numeric_limits<float>::infinity());
    using Entry = std::pair<float, size_t>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    for (size_t p = 0; p < solid.size(); ++p) {
        if (seeds[p] > 0) distance[p] = 0, open.emplace(0.f, p);
    }
    const auto w = size_t(picture.width), h = size_t(picture.height);
    while (!open.empty()) {
        const auto [at, p] = open.top();
        open.pop();
        if (at > distance[p]) continue;
        const auto visit = [&](size_t q) {
            if (solid[q] == 0) return;
            float cost = 1 + kFavourCost * std::max(0.f, sign * favour[q]);
            for (size_t c = 0; c < 3; ++c) {
                cost += kEdgeCost / 3 *
                        float(std::abs(picture.rgb[3 * p + c] - picture.rgb[3 * q + c]));
            }
            if (at + cost < distance[q]) distance[q] = at + cost, open.emplace(at + cost, q);
        };
        if (p % w > 0) visit(p - 1);
        if (p % w + 1 < w) visit(p + 1);
        if (p / w > 0) visit(p - w);
        if (p / w + 1 < h) visit(p + w);
    }
    return distance;
}

}  // namespace

// ---- the screen ---------------------------------------------------------------------------------

std::vector<uint8_t> borderOf(const Picture& picture) {
    const int w = picture.width, h = picture.height, depth = std::max(2, std::min(w, h) / 12);
    std::vector<uint8_t> border;
    for (int y = 0; y < h; y += 2) {
        for (int x = 0; x < w; x += 2) {
            if (std::min({x, y, w - 1 - x, h - 1 - y}) >= depth) continue;
            const uint8_t* pixel = &picture.rgb[3 * (size_t(y) * size_t(w) + size_t(x))];
            border.insert(border.end(), pixel, pixel + 3);
        }
    }
    return border;
}

std::string screenOf(std::span<const std::vector<uint8_t>> borders) {
    constexpr double kLeastShare = .5, kLeastLead = .08;
    const Mode mode = borderMode(borders);
    if (mode.share < kLeastShare) return {};
    const double blue = 1 - mode.red - mode.green;
    if (mode.green - std::max(mode.red, blue) > kLeastLead) return "green";
    if (blue - std::max(mode.red, mode.green) > kLeastLead) return "blue";
    return {};
}

ScreenKey::ScreenKey(std::span<const std::shared_ptr<const Picture>> pictures,
                     std::string_view where) {
    CHECK(!pictures.empty(), "a key is learnt from one picture or more");
    width_ = pictures[0]->width;
    height_ = pictures[0]->height;
    std::vector<std::vector<uint8_t>> borders;
    for (const auto& picture : pictures) borders.push_back(borderOf(*picture));
    const Mode mode = borderMode(borders);
    const double saturation = std::hypot(mode.red - 1. / 3, mode.green - 1. / 3);
    if (mode.share < .3 || saturation < .08) {
        throwInput(
            "{}: expected pictures before a green (or other saturated) screen that reaches "
            "the border, found {}; give masks instead of --key",
            where,
            mode.share < .3 ? "no colour that covers a third of the border"
                            : "a border that is nearly grey");
    }

    columns_ = std::max(1, (width_ + kCell - 1) / kCell);
    rows_ = std::max(1, (height_ + kCell - 1) / kCell);
    cells_.resize(size_t(columns_) * size_t(rows_));
    std::vector<std::vector<Chroma>> samples(cells_.size());
    for (const auto& picture : pictures) {
        CHECK(picture->width == width_ && picture->height == height_, "pictures are of one size");
        for (int y = 1; y < height_; y += 3) {
            for (int x = 1; x < width_; x += 3) {
                const Chroma c =
                    chromaOf(&picture->rgb[3 * (size_t(y) * size_t(width_) + size_t(x))]);
                if (c.brightness < .01) continue;
                samples[size_t(y / kCell * columns_ + x / kCell)].push_back(c);
            }
        }
    }
    // From the cells that show the border's colour the screen spreads to their neighbours, whose
    // colour may be a little different, and so on.
    std::vector<double> red, green, brightness, distance;
    for (int round = 0; round < std::max(columns_, rows_) + 2; ++round) {
        const std::vector<Cell> before = cells_;
        for (int y = 0; y < rows_; ++y) {
            for (int x = 0; x < columns_; ++x) {
                double r = 0, g = 0;
                int known = 0;
                for (int dy = -1; dy <= 1; ++dy) {
                    for (int dx = -1; dx <= 1; ++dx) {
                        const int u = x + dx, v = y + dy;
                        if (u < 0 || v < 0 || u >= columns_ || v >= rows_) continue;
                        const Cell& near = before[size_t(v * columns_ + u)];
                        if (near.known) r += near.red, g += near.green, ++known;
                    }
                }
                const bool own = before[size_t(y * columns_ + x)].known;
                r = known > 0 ? r / known : mode.red;
                g = known > 0 ? g / known : mode.green;
                const auto& here = samples[size_t(y * columns_ + x)];
                red.clear(), green.clear(), brightness.clear(), distance.clear();
                for (const Chroma& c : here) {
                    if (std::hypot(c.red - r, c.green - g) > .05) continue;
                    red.push_back(c.red), green.push_back(c.green);
                    brightness.push_back(c.brightness);
                }
                Cell& cell = cells_[size_t(y * columns_ + x)];
                if (double(red.size()) < .08 * double(here.size()) || red.size() < 8) {
                    if (!own) cell = {};
                    continue;
                }
                cell.known = true;
                cell.red = medianOf(red), cell.green = medianOf(green);
                cell.brightness = medianOf(brightness);
                for (size_t i = 0; i < red.size(); ++i) {
                    // The lists have been reordered by the medians; each alone gives its part.
                    distance.push_back(std::abs(red[i] - cell.red));
                    distance.push_back(std::abs(green[i] - cell.green));
                }
                cell.spread = std::max(kLeastSpread, 1.5 * medianOf(distance));
            }
        }
    }
    // What is hidden in all pictures looks as its surroundings do.
    while (std::any_of(cells_.begin(), cells_.end(), [](const Cell& c) { return !c.known; })) {
        const std::vector<Cell> before = cells_;
        for (int y = 0; y < rows_; ++y) {
            for (int x = 0; x < columns_; ++x) {
                Cell& cell = cells_[size_t(y * columns_ + x)];
                if (cell.known) continue;
                Cell sum;
                int known = 0;
                for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
                    const int u = x + dx, v = y + dy;
                    if (u < 0 || v < 0 || u >= columns_ || v >= rows_) continue;
                    const Cell& near = before[size_t(v * columns_ + u)];
                    if (!near.known) continue;
                    sum.red += near.red, sum.green += near.green, sum.spread += near.spread;
                    sum.brightness += near.brightness, ++known;
                }
                if (known == 0) continue;
                cell = {sum.red / known, sum.green / known, sum.spread / known,
                        sum.brightness / known, true};
            }
        }
    }

    red.clear();
    for (const Cell& cell : cells_) red.push_back(cell.brightness);
    const double middle = medianOf(red);
    const std::array<double, 3> shares{mode.red, mode.green, 1 - mode.red - mode.green};
    for (size_t c = 0; c < 3; ++c) {
        const float linear = float(std::clamp(3 * middle * shares[c], 0., 1.));
        const auto& table = linearTable();
        colour_[c] = int(std::lower_bound(table.begin(), table.end() - 1, linear) - table.begin());
    }
}

ScreenKey::Cell ScreenKey::at(double x, double y) const {
    const double u = std::clamp(x / kCell - .5, 0., double(columns_ - 1));
    const double v = std::clamp(y / kCell - .5, 0., double(rows_ - 1));
    const int x0 = int(u), y0 = int(v);
    const int x1 = std::min(x0 + 1, columns_ - 1), y1 = std::min(y0 + 1, rows_ - 1);
    const double a = u - x0, b = v - y0;
    Cell result;
    for (const auto& [column, row, weight] : {std::tuple{x0, y0, (1 - a) * (1 - b)},
                                              {x1, y0, a * (1 - b)},
                                              {x0, y1, (1 - a) * b},
                                              {x1, y1, a * b}}) {
        const Cell& cell = cells_[size_t(row * columns_ + column)];
        result.red += weight * cell.red;
        result.green += weight * cell.green;
        result.spread += weight * cell.spread;
        result.brightness += weight * cell.brightness;
    }
    return result;
}

std::vector<float> ScreenKey::foreground(const Picture& picture) const {
    CHECK(picture.width == width_ && picture.height == height_, "pictures are of one size");
    std::vector<float> key(size_t(width_) * size_t(height_));
    for (int y = 0; y < height_; ++y) {
        for (int x = 0; x < width_; ++x) {
            const size_t p = size_t(y) * size_t(width_) + size_t(x);
            const Chroma c = chromaOf(&picture.rgb[3 * p]);
            const Cell screen = at(x + .5, y + .5);
            const double distance =
                std::hypot(c.red - screen.red, c.green - screen.green) / screen.spread;
            const double colour =
                std::clamp((distance - kKeyBegin) / (kKeyEnd - kKeyBegin), 0., 1.);
            const double relative = c.brightness / std::max(screen.brightness, 1e-3);
            const double dark = std::clamp((kDarkEnd - relative) / (kDarkEnd - kDark), 0., 1.);
            key[p] = float(std::max(colour, dark));
        }
    }
    return key;
}

// ---- the person ---------------------------------------------------------------------------------

PersonKey::PersonKey(std::span<const std::shared_ptr<const Picture>> pictures,
                     std::span<const std::vector<uint8_t>> bodies, std::string_view where)
    : screen_(pictures, where) {
    CHECK(pictures.size() == bodies.size(), "every picture has its body");
    constexpr size_t kBins = size_t(kSteps) * kSteps * kSteps;
    std::vector<double> person(kBins, 0.), objects(kBins, 0.);
    double personTotal = 0, objectsTotal = 0, area = 0;
    for (size_t i = 0; i < pictures.size(); ++i) {
        const Picture& picture = *pictures[i];
        const auto key = screen_.foreground(picture);
        const Scale scale = scaleOf(bodies[i]);
        const auto outside = distanceTo(bodies[i], picture.width, picture.height);
        const auto depth = distanceTo(invertedMask(bodies[i]), picture.width, picture.height);
        const auto core =
            coreOf(solidOf(key, picture.width, picture.height), picture.width, picture.height);
        for (size_t p = 0; p < key.size(); ++p) {
            if (core[p] == 0) continue;
            const size_t bin = binOf(&picture.rgb[3 * p]);
            if (double(depth[p]) > scale.inner) person[bin] += 1, personTotal += 1;
            // Nothing of a person is as far as that from the body, however badly it fits.
            if (double(outside[p]) > 2 * scale.band && double(outside[p]) < 1e8) {
                objects[bin] += 1, objectsTotal += 1;
            }
        }
        area += double(
            std::count_if(bodies[i].begin(), bodies[i].end(), [](uint8_t v) { return v > 0; }));
    }
    // A few stray pixels are no objects.
    if (objectsTotal < .02 * area || personTotal == 0) return;
    smoothHistogram(person);
    smoothHistogram(objects);
    favour_.resize(kBins);
    for (size_t i = 0; i < kBins; ++i) {
        const double ratio = (person[i] / personTotal + 1e-4) / (objects[i] / objectsTotal + 1e-4);
        favour_[i] = float(std::clamp(std::log(ratio), -3., 3.));
    }
}

std::vector<uint8_t> PersonKey::mask(const Picture& picture, std::span<const uint8_t> body) const {
    const int w = picture.width, h = picture.height;
    const auto key = screen_.foreground(picture);
    std::vector<uint8_t> mask(key.size(), 0);
    if (std::none_of(body.begin(), body.end(), [](uint8_t v) { return v > 0; })) return mask;
    const Scale scale = scaleOf(body);
    const auto outside = distanceTo(body, w, h);
    const auto depth = distanceTo(invertedMask(body), w, h);

    const std::vector<uint8_t> solid = solidOf(key, w, h);
    // What a pixel's surroundings look like: > 0 the person's colours, < 0 another object's.
    std::vector<float> favour(key.size(), 0.f);
    if (!favour_.empty()) {
        std::vector<float> weight(key.size(), 0.f);
        const auto core = coreOf(solid, w, h);
        for (size_t p = 0; p < key.size(); ++p) {
            if (core[p] == 0) continue;
            favour[p] = favour_[binOf(&picture.rgb[3 * p])];
            weight[p] = 1;
        }
        favour = squareSums(favour, w, h, kSurroundings);
        weight = squareSums(weight, w, h, kSurroundings);
        for (size_t p = 0; p < key.size(); ++p) favour[p] /= std::max(weight[p], 1.f);
    }
    // Person and objects grow from where each is sure, slowly through colours of the other and over
    // edges; a pixel belongs to whom it reaches first.
    std::vector<uint8_t> person(key.size(), 0), object(key.size(), 0);
    for (size_t p = 0; p < key.size(); ++p) {
        if (solid[p] == 0) continue;
        const double out = double(outside[p]);
        if (double(depth[p]) > scale.inner && favour[p] > -1) person[p] = 255;
        if (out > 2 * scale.band) object[p] = 255;
    }
    const auto toPerson = growth(picture, solid, person, favour, -1);
    const auto toObject = growth(picture, solid, object, favour, 1);
    for (size_t p = 0; p < key.size(); ++p) {
        if (solid[p] > 0 && toPerson[p] < toObject[p]) mask[p] = 255;
    }
    refineEdge(mask, picture.rgb, w, h);

    // Parts that do not reach well into the body are somebody else, and so are crumbs.
    const size_t area =
        size_t(std::count_if(body.begin(), body.end(), [](uint8_t v) { return v > 0; }));
    Parts parts = connectedParts(mask, true, w, h);
    std::vector<size_t> within(parts.sizes.size(), 0);
    for (size_t p = 0; p < mask.size(); ++p) {
        if (parts.part[p] >= 0 && body[p] > 0) ++within[size_t(parts.part[p])];
    }
    for (size_t p = 0; p < mask.size(); ++p) {
        if (parts.part[p] < 0) continue;
        const auto part = size_t(parts.part[p]);
        if (parts.sizes[part] < area / 500 || 3 * within[part] < parts.sizes[part]) mask[p] = 0;
    }
    // Holes: small ones are a belt's buckle or a print; large ones show the screen through, or are
    // the person's own where they look as some object does.
    parts = connectedParts(mask, false, w, h);
    std::vector<size_t> screened(parts.sizes.size(), 0);
    std::vector<bool> open(parts.sizes.size(), false);
    for (size_t p = 0; p < mask.size(); ++p) {
        if (parts.part[p] < 0) continue;
        const auto part = size_t(parts.part[p]), x = p % size_t(w), y = p / size_t(w);
        if (key[p] < .5f) ++screened[part];
        if (x == 0 || y == 0 || x + 1 == size_t(w) || y + 1 == size_t(h)) open[part] = true;
    }
    for (size_t p = 0; p < mask.size(); ++p) {
        if (parts.part[p] < 0) continue;
        const auto part = size_t(parts.part[p]);
        const size_t size = parts.sizes[part];
        if (!open[part] && (size < area / 500 || 4 * screened[part] < size)) mask[p] = 255;
    }
    return mask;
}

}  // namespace doppel
