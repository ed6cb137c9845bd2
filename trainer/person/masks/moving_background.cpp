#include "trainer/person/masks/moving_background.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "engine/error.h"
#include "trainer/data/shared_work.h"
#include "trainer/person/masks/mask_tools.h"

namespace doppel {

namespace {

// Where the person is, as far as a place behind has to be free of it: a share, and of the square's
// side the margin about it. Few pixels that are the person's after all do not move a median.
constexpr float kCovers = .3f;
constexpr double kMargin = 1. / 256;

// Which pictures tell of one: as many as this, of some before and behind it, the sparser the
// farther they are, for the person has to have moved and the camera not too far.
constexpr size_t kOthers = 10, kSteps = 40;
size_t offsetOf(size_t step) { return step + step * step / 16; }
constexpr size_t kEnough = 3, kWished = 5;  // of them have to show a place, and should
constexpr int kCells = 128;  // along the longer side, in which it is noted where the person is
constexpr double kRing = 3. / 64;  // of the square's side, about the person: what is to be told

// The camera's motion is found in pictures that are smaller by kSmaller, by patches that are found
// again; then that of each place, by windows of the pictures themselves. Pixels, there and there.
constexpr int kSmaller = 4, kPatch = 8, kPatchReach = 16;
constexpr int kWindow = 16, kWindowStep = 16, kWindowReach = 3;
constexpr size_t kLeastPatches = 12;
constexpr double kLeastAgreement = .5;  // of what patches tell
constexpr int kNode = 48;               // pixels between places whose motion is found
constexpr double kAbout = 1. / 10;      // of the square's side: how far windows tell of a place
constexpr double kRoom = 1. / 6;  // of the square's side, about the rectangle: where windows are
constexpr double kStray = .5;     // pixels: windows that move so much otherwise count half

constexpr int kClipped = 250;  // values of 255 above which nothing is told of the exposure
constexpr double kNoise = 4;   // values of 255: what sensors, codecs and resampling add at least

struct Grey {
    int width = 0, height = 0;
    std::vector<uint8_t> values;
    const uint8_t* at(int x, int y) const { return &values[size_t(y) * size_t(width) + size_t(x)]; }
};

Grey greyOf(const Image& rgb) {
    Grey grey{rgb.width, rgb.height, {}};
    grey.values.resize(size_t(rgb.width) * size_t(rgb.height));
    for (size_t i = 0; i < grey.values.size(); ++i) {
        const uint8_t* p = &rgb.data[3 * i];
        grey.values[i] = uint8_t((p[0] + 2 * p[1] + p[2] + 2) / 4);
    }
    return grey;
}

Grey smaller(const Grey& grey) {
    Grey small{grey.width / kSmaller, grey.height / kSmaller, {}};
    for (int y = 0; y < small.height; ++y)
        for (int x = 0; x < small.width; ++x) {
            int sum = 0;
            for (int i = 0; i < kSmaller; ++i)
                for (int j = 0; j < kSmaller; ++j)
                    sum += *grey.at(kSmaller * x + j, kSmaller * y + i);
            small.values.push_back(uint8_t(sum / (kSmaller * kSmaller)));
        }
    return small;
}

// A picture as it is compared with others.
struct Prepared {
    Grey grey, small;
    std::vector<uint8_t> person;  // [H,W], > 0 where the person covers what is behind

    Prepared(const ClipView& view, int margin)
        : grey(greyOf(view.rgb)), small(smaller(grey)), person(view.share.size()) {
        std::vector<float> covers(view.share.size());
        for (size_t i = 0; i < covers.size(); ++i) covers[i] = view.share[i] >= kCovers;
        const std::vector<float> near = squareSums(covers, view.rgb.width, view.rgb.height, margin);
        for (size_t i = 0; i < near.size(); ++i) person[i] = near[i] > .5f;
    }
    // Whether none of the square's nine corners, middles of sides and centre is covered; the square
    // is in the picture.
    bool isFree(int left, int top, int side) const {
        for (int y : {top, top + side / 2, top + side - 1})
            for (int x : {left, left + side / 2, left + side - 1})
                if (person[size_t(y) * size_t(grey.width) + size_t(x)]) return false;
        return true;
    }
};

// Displacements, pixels, as linear functions of the place.
struct Motion {
    Eigen::Matrix<double, 6, 1> p = Eigen::Matrix<double, 6, 1>::Zero();
    Eigen::Vector2d operator()(const Eigen::Vector2d& place) const {
        return {p[0] + p[1] * place[0] + p[2] * place[1], p[3] + p[4] * place[0] + p[5] * place[1]};
    }
    // The same, of places that are counted from there.
    Motion from(const Eigen::Vector2d& origin) const {
        Motion moved = *this;
        const Eigen::Vector2d there = (*this)(origin);
        moved.p[0] = there[0], moved.p[3] = there[1];
        return moved;
    }
};

// A square that was found again. information: the mean of its gradients' products; what moved along
// an edge cannot be told.
struct Match {
    Eigen::Vector2d place, moved;
    Eigen::Matrix2d information;
};

// The square of `from` in `to`, displaced by `start` and up to `reach` along both axes more: where
// their squared differences, without their means, are least, to a fraction of a pixel by gradients
// (Lucas and Kanade, 1981). Nothing where that is at the border of what was looked at.
template <typename Allowed>
std::optional<Match> findAgain(const Grey& from, const Grey& to, int left, int top, int side,
                               const std::array<int, 2>& start, int reach, const Allowed& allowed) {
    const int64_t count = int64_t{side} * side;
    int64_t least = INT64_MAX, sumOfBest = 0;
    std::array<int, 2> best{};
    for (int v = start[1] - reach; v <= start[1] + reach; ++v)
        for (int u = start[0] - reach; u <= start[0] + reach; ++u) {
            const int l = left + u, t = top + v;
            if (l < 1 || t < 1 || l + side >= to.width || t + side >= to.height) continue;
            int32_t sum = 0, squares = 0;
            for (int y = 0; y < side; ++y) {
                const uint8_t *a = from.at(left, top + y), *b = to.at(l, t + y);
                for (int x = 0; x < side; ++x) {
                    const int d = b[x] - a[x];
                    sum += d;
                    squares += d * d;
                }
            }
            const int64_t cost = count * squares - int64_t{sum} * sum;
            if (cost < least && allowed(l, t)) least = cost, best = {u, v}, sumOfBest = sum;
        }
    if (least == INT64_MAX || std::abs(best[0] - start[0]) == reach ||
        std::abs(best[1] - start[1]) == reach)
        return {};
    Eigen::Matrix2d products = Eigen::Matrix2d::Zero();
    Eigen::Vector2d slope = Eigen::Vector2d::Zero();
    const double brighter = double(sumOfBest) / double(count);
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) {
            const int i = left + best[0] + x, j = top + best[1] + y;
            const Eigen::Vector2d gradient{(*to.at(i + 1, j) - *to.at(i - 1, j)) / 2.,
                                           (*to.at(i, j + 1) - *to.at(i, j - 1)) / 2.};
            products += gradient * gradient.transpose();
            slope += gradient * (*from.at(left + x, top + y) - *to.at(i, j) + brighter);
        }
    // Noise has gradients, too: where there is little else, whole pixels are all that is known.
    const Eigen::Matrix2d damped = products + Eigen::Matrix2d::Identity() * double(count);
    const Eigen::Vector2d more = damped.ldlt().solve(slope);
    if (more.cwiseAbs().maxCoeff() > 1) return {};
    return Match{{left + side / 2., top + side / 2.},
                 Eigen::Vector2d{best[0], best[1]} + more,
                 products / double(count)};
}

// How far a match is from the motion, pixels squared, in the directions that it knows.
double strayOf(const Match& match, const Motion& motion) {
    const double most = match.information.trace();
    if (most == 0) return 0;
    const Eigen::Vector2d apart = match.moved - motion(match.place);
    return apart.dot(match.information * apart) / most;
}

// The motion that matches tell, each with its weight, without those that move by themselves. trust:
// what `otherwise` counts, which is taken where nothing is seen.
Motion motionOf(const std::vector<Match>& matches, const std::vector<double>& weights,
                const Motion& otherwise, double trust) {
    Motion motion = otherwise;
    for (double stray : {8 * kStray, kStray, kStray}) {
        Eigen::Matrix<double, 6, 6> products = Eigen::Matrix<double, 6, 6>::Zero();
        Eigen::Matrix<double, 6, 1> sums = Eigen::Matrix<double, 6, 1>::Zero();
        for (size_t i = 0; i < matches.size(); ++i) {
            const Match& match = matches[i];
            const Eigen::Matrix2d weight =
                match.information * (weights[i] / (1 + strayOf(match, motion) / (stray * stray)));
            const Eigen::Vector3d place{1, match.place[0], match.place[1]};
            const Eigen::Matrix3d places = place * place.transpose();
            const Eigen::Vector2d moved = weight * match.moved;
            for (int r = 0; r < 2; ++r) {
                sums.segment<3>(3 * r) += moved[r] * place;
                for (int c = 0; c < 2; ++c)
                    products.block<3, 3>(3 * r, 3 * c) += weight(r, c) * places;
            }
        }
        for (int k = 0; k < 6; ++k) {
            const double tie = trust * (k % 3 == 0 ? 1 : 1e4);  // pixels at a hundred pixels
            products(k, k) += tie;
            sums[k] += tie * otherwise.p[k];
        }
        motion.p = products.ldlt().solve(sums);
    }
    return motion;
}

double medianOf(std::vector<double> values) {
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

// How the camera moved all that stands still; nothing where too little is found again.
std::optional<Motion> cameraMotion(const Prepared& here, const Prepared& there) {
    std::vector<Match> matches;
    constexpr int kSide = kSmaller * kPatch;
    const Grey &from = here.small, &to = there.small;
    for (int y = 1; y + kPatch < from.height; y += kPatch)
        for (int x = 1; x + kPatch < from.width; x += kPatch) {
            if (!here.isFree(kSmaller * x, kSmaller * y, kSide)) continue;
            auto match =
                findAgain(from, to, x, y, kPatch, {0, 0}, kPatchReach, [&](int left, int top) {
                    return there.isFree(kSmaller * left, kSmaller * top, kSide);
                });
            if (!match) continue;
            match->place *= kSmaller;
            match->moved *= kSmaller;
            matches.push_back(*match);
        }
    if (matches.size() < kLeastPatches) return {};
    std::vector<double> across, down;
    for (const Match& match : matches)
        across.push_back(match.moved[0]), down.push_back(match.moved[1]);
    Motion start;
    start.p[0] = medianOf(across), start.p[3] = medianOf(down);
    const Motion motion = motionOf(matches, std::vector<double>(matches.size(), 1), start, 1e-6);
    // Of pictures that show something else, each patch is found somewhere else.
    double all = 0, agreeing = 0;
    for (const Match& match : matches) {
        const double most = match.information.trace();
        all += most;
        if (strayOf(match, motion) < kSmaller * kSmaller) agreeing += most;
    }
    if (agreeing < kLeastAgreement * all) return {};
    return motion;
}

// Of the corners of squares of kNode pixels that have a wanted pixel: where they are in the other
// picture. The others stay where they are.
struct Nodes {
    int columns;
    std::vector<Eigen::Vector2d> moved;

    // x, y: pixels of the rectangle.
    Eigen::Vector2d at(int x, int y) const {
        const int c = x / kNode, r = y / kNode;
        const double a = double(x) / kNode - c, b = double(y) / kNode - r;
        const auto node = [&](int i, int j) -> const Eigen::Vector2d& {
            return moved[size_t(j) * size_t(columns) + size_t(i)];
        };
        return (1 - b) * ((1 - a) * node(c, r) + a * node(c + 1, r)) +
               b * ((1 - a) * node(c, r + 1) + a * node(c + 1, r + 1));
    }
};

// What stands still about the rectangle, window by window.
std::vector<Match> windowsOf(const Prepared& here, const Prepared& there, const Rect& rect,
                             double side, const Motion& camera) {
    const int room = int(kRoom * side);
    const Rect about{std::max(rect.left - room, 1), std::max(rect.top - room, 1),
                     std::min(rect.right + room, here.grey.width - 1),
                     std::min(rect.bottom + room, here.grey.height - 1)};
    std::vector<Match> matches;
    for (int top = about.top; top + kWindow < about.bottom; top += kWindowStep)
        for (int left = about.left; left + kWindow < about.right; left += kWindowStep) {
            if (!here.isFree(left, top, kWindow)) continue;
            const Eigen::Vector2d u = camera({left + kWindow / 2., top + kWindow / 2.});
            if (!(u.cwiseAbs().maxCoeff() < std::max(here.grey.width, here.grey.height))) continue;
            const std::array<int, 2> start{int(std::lround(u[0])), int(std::lround(u[1]))};
            if (const auto match =
                    findAgain(here.grey, there.grey, left, top, kWindow, start, kWindowReach,
                              [&](int l, int t) { return there.isFree(l, t, kWindow); }))
                matches.push_back(*match);
        }
    return matches;
}

// Factors that bring the other picture's exposure to this one's.
std::array<float, 3> gainsOf(const Image& here, const Image& there,
                             const std::vector<Match>& matches) {
    std::array<double, 3> ours{}, theirs{};
    for (const Match& match : matches) {
        const int left = int(match.place[0]) - kWindow / 2, top = int(match.place[1]) - kWindow / 2,
                  across = int(std::lround(match.moved[0])),
                  down = int(std::lround(match.moved[1]));
        for (int y = top; y < top + kWindow; y += 2)
            for (int x = left; x < left + kWindow; x += 2) {
                const int u = std::clamp(x + across, 0, there.width - 1),
                          v = std::clamp(y + down, 0, there.height - 1);
                const uint8_t *p = here.pixel(x, y), *q = there.pixel(u, v);
                for (size_t c = 0; c < 3; ++c) {
                    if (p[c] > kClipped || q[c] > kClipped) continue;
                    ours[c] += p[c];
                    theirs[c] += q[c];
                }
            }
    }
    std::array<float, 3> gains{1, 1, 1};
    for (size_t c = 0; c < 3; ++c)
        if (ours[c] > 0 && theirs[c] > 0) gains[c] = float(std::clamp(ours[c] / theirs[c], .5, 2.));
    return gains;
}

Nodes nodesOf(const std::vector<Match>& matches, const Rect& rect,
              const std::vector<uint8_t>& wanted, double side, const Motion& camera) {
    const int rows = (rect.height() + kNode - 1) / kNode + 1;
    Nodes nodes{(rect.width() + kNode - 1) / kNode + 1, {}};
    nodes.moved.assign(size_t(nodes.columns) * size_t(rows), Eigen::Vector2d::Zero());
    std::vector<bool> needed(nodes.moved.size());
    for (int y = 0; y < rect.height(); ++y)
        for (int x = 0; x < rect.width(); ++x) {
            if (!wanted[size_t(y) * size_t(rect.width()) + size_t(x)]) continue;
            const size_t first = size_t(y / kNode) * size_t(nodes.columns) + size_t(x / kNode);
            for (size_t i : {first, first + 1, first + size_t(nodes.columns),
                             first + size_t(nodes.columns) + 1})
                needed[i] = true;
        }
    const double radius = kAbout * side;
    for (size_t i = 0; i < needed.size(); ++i) {
        if (!needed[i]) continue;
        const Eigen::Vector2d place{rect.left + int(i % size_t(nodes.columns)) * kNode,
                                    rect.top + int(i / size_t(nodes.columns)) * kNode};
        std::vector<Match> near;
        std::vector<double> weights;
        for (const Match& match : matches) {
            const double away = (match.place - place).squaredNorm() / (2 * radius * radius);
            if (away > 3) continue;
            near.push_back(match);
            near.back().place -= place;
            weights.push_back(std::exp(-away));
        }
        nodes.moved[i] = motionOf(near, weights, camera.from(place), 1)(Eigen::Vector2d::Zero());
    }
    return nodes;
}

using Colour = std::array<float, 3>;

// What another picture shows at the wanted places of this one: their numbers in the rectangle.
struct Shown {
    std::vector<uint32_t> places;
    std::vector<Colour> colours;
};

Shown shownBy(const ClipView& other, const ClipView& view, const Prepared& here, const Rect& rect,
              const std::vector<uint8_t>& wanted, double side, int margin) {
    const Prepared there(other, margin);
    Shown shown;
    const auto camera = cameraMotion(here, there);
    if (!camera) return shown;
    const std::vector<Match> matches = windowsOf(here, there, rect, side, *camera);
    const Nodes nodes = nodesOf(matches, rect, wanted, side, *camera);
    const std::array<float, 3> gains = gainsOf(view.rgb, other.rgb, matches);
    const int width = other.rgb.width, height = other.rgb.height;
    for (int y = 0; y < rect.height(); ++y)
        for (int x = 0; x < rect.width(); ++x) {
            const size_t at = size_t(y) * size_t(rect.width()) + size_t(x);
            if (!wanted[at]) continue;
            const Eigen::Vector2d u = nodes.at(x, y);
            const double px = rect.left + x + u[0], py = rect.top + y + u[1];
            if (!(px >= 0 && py >= 0 && px < width - 1 && py < height - 1)) continue;
            const int ix = int(px), iy = int(py);
            const auto fx = float(px - ix), fy = float(py - iy);
            if (!there.isFree(ix, iy, 2)) continue;
            const uint8_t *p = other.rgb.pixel(ix, iy), *q = other.rgb.pixel(ix, iy + 1);
            Colour colour;
            for (size_t c = 0; c < 3; ++c)
                colour[c] = gains[c] * ((1 - fy) * ((1 - fx) * p[c] + fx * p[c + 3]) +
                                        fy * ((1 - fx) * q[c] + fx * q[c + 3]));
            shown.places.push_back(uint32_t(at));
            shown.colours.push_back(colour);
        }
    return shown;
}

// What several pictures show at a place.
struct Samples {
    std::array<Colour, kOthers> colours;
    size_t count = 0;

    Colour median() const {
        Colour middle;
        for (size_t c = 0; c < 3; ++c) {
            std::array<float, kOthers> values{};
            for (size_t j = 0; j < count; ++j) values[j] = colours[j][c];
            const auto at = values.begin() + std::ptrdiff_t(count / 2);
            std::nth_element(values.begin(), at, values.begin() + std::ptrdiff_t(count));
            middle[c] = *at;
        }
        return middle;
    }
    // Twice the median of their squared distances from `middle`, a channel's: about the variance.
    double variance(const Colour& middle) const {
        std::array<float, kOthers> apart{};
        for (size_t j = 0; j < count; ++j)
            for (size_t c = 0; c < 3; ++c)
                apart[j] += (colours[j][c] - middle[c]) * (colours[j][c] - middle[c]) / 3;
        const auto at = apart.begin() + std::ptrdiff_t(count / 2);
        std::nth_element(apart.begin(), at, apart.begin() + std::ptrdiff_t(count));
        return 2 * double(*at);
    }
};

}  // namespace

void MovingBackground::add(const std::vector<float>& share, int width, int height) {
    if (covered_.empty()) {
        width_ = width, height_ = height;
        cell_ = std::max(1, std::max(width, height) / kCells);
        columns_ = (width + cell_ - 1) / cell_, rows_ = (height + cell_ - 1) / cell_;
    }
    CHECK(width == width_ && height == height_ && share.size() == size_t(width) * size_t(height),
          "a clip's pictures are of one size");
    std::vector<bool> covered(size_t(columns_) * size_t(rows_));
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            if (share[size_t(y) * size_t(width) + size_t(x)] >= kCovers)
                covered[size_t(y / cell_) * size_t(columns_) + size_t(x / cell_)] = true;
    covered_.push_back(std::move(covered));
}

bool MovingBackground::tells() const { return covered_.size() > kEnough; }

// Those by which most about the person is seen often enough, one after the other. A hand that holds
// a camera moves it by less than the person moves.
std::vector<size_t> MovingBackground::othersOf(size_t picture, double side) const {
    std::vector<uint8_t> person;
    for (bool covered : covered_[picture]) person.push_back(covered);
    const auto away = distanceTo(person, columns_, rows_);
    std::vector<size_t> ring;
    for (size_t i = 0; i < away.size(); ++i)
        if (double(away[i]) * cell_ <= kRing * side) ring.push_back(i);
    std::vector<size_t> seen(away.size()), others;
    std::vector<size_t> candidates;
    for (size_t step = 1; step <= kSteps; ++step) {
        const size_t offset = offsetOf(step);
        if (offset <= picture) candidates.push_back(picture - offset);
        if (picture + offset < covered_.size()) candidates.push_back(picture + offset);
    }
    while (others.size() < kOthers) {
        size_t best = picture, most = 0;
        for (size_t other : candidates) {
            if (std::ranges::count(others, other) > 0) continue;
            size_t gain = 0;
            for (size_t i : ring)
                if (!covered_[other][i] && seen[i] < kWished) gain += kWished - seen[i];
            if (gain > most) most = gain, best = other;
        }
        if (best == picture) break;
        for (size_t i : ring) seen[i] += !covered_[best][i];
        others.push_back(best);
    }
    return others;
}

std::vector<float> MovingBackground::favour(size_t picture, const ClipView& view, const Rect& rect,
                                            const std::vector<uint8_t>& wanted,
                                            const Look& look) const {
    const double side = view.side;
    const size_t count = size_t(rect.width()) * size_t(rect.height());
    CHECK(picture < covered_.size() && wanted.size() == count && view.rgb.width == width_ &&
              view.rgb.height == height_,
          "a picture of the clip and a part of it");
    const int margin = std::max(1, int(std::lround(kMargin * side)));
    const Prepared here(view, margin);
    std::vector<uint32_t> number(count);  // of a wanted pixel among them
    uint32_t some = 0;
    for (size_t i = 0; i < count; ++i)
        if (wanted[i]) number[i] = some++;
    std::vector<Samples> samples(some);
    const std::vector<size_t> others = othersOf(picture, side);
    inParallel(
        others.size(),
        [&](size_t k) { return shownBy(*look(others[k]), view, here, rect, wanted, side, margin); },
        [&](size_t, const Shown& shown) {
            for (size_t i = 0; i < shown.places.size(); ++i) {
                Samples& place = samples[number[shown.places[i]]];
                place.colours[place.count++] = shown.colours[i];
            }
        });
    std::vector<Colour> behind(some);
    for (size_t i = 0; i < some; ++i)
        if (samples[i].count >= kEnough) behind[i] = samples[i].median();
    std::vector<float> result(count);
    for (int y = 0; y < rect.height(); ++y)
        for (int x = 0; x < rect.width(); ++x) {
            const size_t pixel = size_t(y) * size_t(rect.width()) + size_t(x);
            const size_t i = number[pixel];
            if (!wanted[pixel] || samples[i].count < kEnough) continue;
            const auto at = [&](int u, int v) -> const Colour& {
                const size_t n =
                    size_t(std::clamp(v, 0, rect.height() - 1)) * size_t(rect.width()) +
                    size_t(std::clamp(u, 0, rect.width() - 1));
                return behind[wanted[n] && samples[number[n]].count >= kEnough ? number[n] : i];
            };
            // At edges a third of a pixel's error, too.
            double edges = 0;
            for (size_t c = 0; c < 3; ++c) {
                const double across = double(at(x + 1, y)[c] - at(x - 1, y)[c]) / 2,
                             down = double(at(x, y + 1)[c] - at(x, y - 1)[c]) / 2;
                edges += (across * across + down * down) / 3;
            }
            const double variance = std::max(samples[i].variance(behind[i]), kNoise * kNoise);
            const uint8_t* p = view.rgb.pixel(rect.left + x, rect.top + y);
            const Colour& b = behind[i];
            const float favour =
                notBehind({double(p[0]), double(p[1]), double(p[2])},
                          {double(b[0]), double(b[1]), double(b[2])}, variance + edges / 9);
            // The less the others agree, the less it tells that they look like this one.
            const double doubt = 1.5 * std::log(variance / (kNoise * kNoise));
            result[pixel] = std::max(favour, std::min(0.f, float(doubt) - 4));
        }
    return result;
}

}  // namespace doppel
