#include "trainer/person/tracker.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kLeastPresence = .5;

// The person's size by which speeds are judged: the square's side without its margin.
double sizeOf(const PersonLandmarks& person) {
    const Point3 &c = person.points[landmark::kCentre].picture,
                 &p = person.points[landmark::kScalePoint].picture;
    return std::max(1., roiOfBody({c[0], c[1]}, {p[0], p[1]}).side / 1.25);
}

// Whether a part of the body is outside of the square in which it was looked for.
bool reachesOut(const PersonLandmarks& person) {
    return std::ranges::any_of(
        person.points.begin(), person.points.begin() + landmark::kCount,
        [&](const Landmark& point) {
            const Point2 at = person.roi.fromPicture({point.picture[0], point.picture[1]});
            return std::min(at[0], at[1]) < 0 || std::max(at[0], at[1]) > 1;
        });
}

// Of one person's landmarks, from one picture to the next.
class Smoother {
public:
    void operator()(PersonLandmarks& person, double seconds) {
        const double size = sizeOf(person);
        for (size_t i = 0; i < landmark::kCount; ++i) {
            Landmark& point = person.points[i];
            for (size_t k = 0; k < 3; ++k) {
                point.picture[k] = picture_[3 * i + k](point.picture[k], seconds, size);
                point.world[k] = world_[3 * i + k](point.world[k], seconds, 1);
            }
            double& seen = visibility_[i];
            seen = any_ ? seen + .1 * (point.visibility - seen) : point.visibility;
            point.visibility = seen;
        }
        any_ = true;
    }

private:
    std::vector<OneEuro> picture_ = {3 * landmark::kCount, OneEuro({.05, 80})};
    std::vector<OneEuro> world_ = {3 * landmark::kCount, OneEuro({.1, 40})};
    std::array<double, landmark::kCount> visibility_{};
    bool any_ = false;
};

}  // namespace

// ---- following ----------------------------------------------------------------------------------

Roi RoiFilter::operator()(const PersonLandmarks& person, double seconds) {
    if (filters_.empty()) filters_.assign(4, OneEuro({.01, 10}));
    const double size = sizeOf(person);
    std::array<Point2, 2> points;
    for (size_t p = 0; p < 2; ++p)
        for (size_t i = 0; i < 2; ++i)
            points[p][i] =
                filters_[2 * p + i](person.points[landmark::kCentre + p].picture[i], seconds, size);
    return roiOfBody(points[0], points[1]);
}

namespace {

constexpr size_t kSteps = 8, kBins = kSteps * kSteps * kSteps;  // of colours
constexpr double kLookAround = .5;                              // seconds
constexpr double kGivesUp = 2;                                  // seconds
constexpr double kLearns = .1;                                  // of a likely picture
constexpr double kLikely = .85, kUnlike = .7;                   // of the usual likeness
constexpr double kSomebodyElse = .35;  // of the square's side: farther is another person

double apart(const Roi& a, const Roi& b) {
    return std::hypot(a.centre[0] - b.centre[0], a.centre[1] - b.centre[1]);
}

}  // namespace

Appearance::Appearance(const Image& rgb, const PersonLandmarks& person) {
    shares_.assign(2 * kBins, 0);
    std::array<double, 2> totals{};
    for (int v = 1; v < kRoiMaskSide; v += 2)
        for (int u = 1; u < kRoiMaskSide; u += 2) {
            if (person.mask[size_t(v * kRoiMaskSide + u)] < 1) continue;  // a logit
            const Point2 at =
                person.roi.toPicture({(u + .5) / kRoiMaskSide, (v + .5) / kRoiMaskSide});
            if (at[0] < 0 || at[1] < 0 || at[0] >= rgb.width || at[1] >= rgb.height) continue;
            const uint8_t* p = rgb.pixel(int(at[0]), int(at[1]));
            const size_t bin =
                (p[0] * kSteps / 256 * kSteps + p[1] * kSteps / 256) * kSteps + p[2] * kSteps / 256;
            const size_t half = v >= kRoiMaskSide / 2;
            shares_[half * kBins + bin] += 1;
            totals[half] += 1;
        }
    for (size_t half : {0u, 1u})
        for (size_t i = 0; i < kBins; ++i)
            shares_[half * kBins + i] /= float(std::max(totals[half], 1.));
}

double Appearance::likeness(const Appearance& other) const {
    if (empty() || other.empty()) return 0;
    double sum = 0;
    for (size_t i = 0; i < shares_.size(); ++i)
        sum += std::sqrt(double(shares_[i]) * double(other.shares_[i]));
    return sum / 2;
}

void Appearance::learn(const Appearance& other, double rate) {
    if (empty()) {
        *this = other;
        return;
    }
    for (size_t i = 0; i < shares_.size(); ++i)
        shares_[i] += float(rate) * (other.shares_[i] - shares_[i]);
}

void PersonTracker::forget() {
    roi_.reset();
    filter_ = {};
    others_ = false;
}

std::vector<Roi> PersonTracker::detect(const Image& rgb, double time) {
    ++detections_;
    detected_ = time;
    std::vector<Roi> people;
    for (const Detection& detection : pose_.detect(rgb)) people.push_back(detection.roi());
    others_ = others_ || people.size() > 1;
    return people;
}

std::optional<Roi> PersonTracker::find(const Image& rgb) {
    std::vector<Roi> people = detect(rgb, time_);
    if (people.empty()) return {};
    if (last_ && person_ > 0)
        return *std::ranges::min_element(people, {},
                                         [&](const Roi& roi) { return apart(roi, *last_); });
    if (person_ > int(people.size())) {
        throwInput("--person: expected 1 to {}, as many as the first picture shows, found {}",
                   people.size(), person_);
    }
    std::ranges::sort(people, {}, [](const Roi& roi) { return roi.centre[0]; });
    const auto chosen =
        person_ > 0 ? people.begin() + (person_ - 1)
                    : std::ranges::max_element(people, {}, [](const Roi& r) { return r.side; });
    if (people_.empty()) {
        people_ = people;
        followed_ = size_t(chosen - people.begin());
    }
    return *chosen;
}

std::optional<PersonLandmarks> PersonTracker::recognise(const Image& rgb, double time,
                                                        std::optional<PersonLandmarks> followed) {
    std::vector<PersonLandmarks> candidates;
    for (const Roi& roi : detect(rgb, time)) {
        if (followed && apart(roi, followed->roi) < kSomebodyElse * roi.side) continue;
        PersonLandmarks other = look(rgb, roi);
        if (other.presence > kLeastPresence) candidates.push_back(std::move(other));
    }
    if (followed) candidates.push_back(std::move(*followed));
    const PersonLandmarks* best = nullptr;
    // Who has changed so much, a coat taken off, is the person after all.
    double likeness = time - seen_ > kGivesUp ? 0 : kUnlike * usual_;
    for (const PersonLandmarks& candidate : candidates) {
        const double like = looks_.likeness(Appearance(rgb, candidate));
        if (like < likeness) continue;
        likeness = like, best = &candidate;
    }
    if (best) return *best;
    mistaken_ += !candidates.empty();
    return {};
}

PersonLandmarks PersonTracker::look(const Image& rgb, const Roi& roi) {
    // Who takes the largest network wants it exact.
    return pose_.net() == PoseNet::Heavy ? pose_.landmarksBothWays(rgb, roi)
                                         : pose_.landmarks(rgb, roi);
}

std::optional<PersonLandmarks> PersonTracker::next(const Image& rgb, double time) {
    const double seconds = std::max(time - time_, 1e-3);
    time_ = time;
    std::optional<PersonLandmarks> person;
    // What was followed may be lost, and found by the detector in the same picture.
    if (roi_) {
        person = look(rgb, *roi_);
        if (!(person->presence > kLeastPresence)) person.reset();
    }
    if (!person && !(others_ && usual_ > 0)) {
        const bool others = others_;
        forget();
        others_ = others;
        roi_ = find(rgb);
        if (!roi_) return {};
        person = look(rgb, *roi_);
        // The detector knows the trunk and guesses the size: feet that are outside of its square
        // would have no mask.
        if (person->presence > kLeastPresence && reachesOut(*person))
            person = look(rgb, RoiFilter()(*person, seconds));
        if (!(person->presence > kLeastPresence)) {
            roi_.reset();
            return {};
        }
    } else if (person && time - detected_ >= kLookAround) {
        detect(rgb, time);
    }
    double like = person ? looks_.likeness(Appearance(rgb, *person)) : 0;
    if (others_ && usual_ > 0 && like < kLikely * usual_) {
        const std::optional<Roi> before = roi_;
        person = recognise(rgb, time, std::move(person));
        if (!person) {
            roi_.reset();
            filter_ = {};
            return {};
        }
        like = looks_.likeness(Appearance(rgb, *person));
        if (!before || apart(person->roi, *before) > 0) filter_ = {};
    }
    const Appearance now(rgb, *person);
    usual_ = usual_ > 0 ? usual_ + kLearns * (like - usual_) : looks_.empty() ? 0 : like;
    looks_.learn(now, !others_ || like >= kLikely * usual_ ? kLearns : kLearns / 4);
    last_ = person->roi;
    seen_ = time;
    roi_ = filter_(*person, seconds);
    return person;
}

// ---- smoothing ----------------------------------------------------------------------------------

namespace {

// Calls visit(picture, whether it begins something new, the one before) in order, or backward.
template <typename Visit>
void each(const Track& track, const std::vector<size_t>& beginnings, bool backward, Visit visit) {
    const size_t count = track.size();
    bool begins = true;
    size_t before = 0;
    for (size_t k = 0; k < count; ++k) {
        const size_t f = backward ? count - 1 - k : k;
        const size_t border = backward ? f + 1 : f;
        begins = begins || std::ranges::count(beginnings, border) > 0;
        if (!track[f]) {
            begins = true;
            continue;
        }
        visit(f, begins, before);
        begins = false;
        before = f;
    }
}

void smooth(Track& track, const std::vector<double>& times, const std::vector<size_t>& beginnings,
            bool backward) {
    CHECK(times.size() == track.size(), "each picture has a time");
    Smoother smoother;
    each(track, beginnings, backward, [&](size_t f, bool begins, size_t before) {
        if (begins) smoother = {};
        smoother(*track[f], std::max(std::abs(times[f] - times[before]), 1e-3));
    });
}

}  // namespace

void smoothForward(Track& track, const std::vector<double>& times,
                   const std::vector<size_t>& beginnings) {
    smooth(track, times, beginnings, false);
}

void smoothBothWays(Track& track, const std::vector<double>& times,
                    const std::vector<size_t>& beginnings) {
    Track backward = track;
    smooth(track, times, beginnings, false);
    smooth(backward, times, beginnings, true);
    for (size_t f = 0; f < track.size(); ++f) {
        if (!track[f]) continue;
        for (size_t i = 0; i < landmark::kCount; ++i) {
            Landmark& a = track[f]->points[i];
            const Landmark& b = backward[f]->points[i];
            for (size_t k = 0; k < 3; ++k) {
                a.picture[k] = (a.picture[k] + b.picture[k]) / 2;
                a.world[k] = (a.world[k] + b.world[k]) / 2;
            }
            a.visibility = (a.visibility + b.visibility) / 2;
        }
    }
}

size_t mendSwaps(Track& track, const std::vector<size_t>& beginnings) {
    size_t swaps = 0;
    each(track, beginnings, false, [&](size_t f, bool begins, size_t before) {
        if (begins) return;
        auto& points = track[f]->points;
        const auto& last = track[before]->points;
        double kept = 0, swapped = 0;
        for (size_t i = landmark::kLeftShoulder; i < landmark::kCount; ++i) {
            const Landmark &a = points[i], &b = points[oppositeLandmark(i)];
            for (size_t k = 0; k < 2; ++k) {
                kept += std::abs(a.picture[k] - last[i].picture[k]);
                swapped += std::abs(b.picture[k] - last[i].picture[k]);
            }
            for (size_t k = 0; k < 3; ++k) {
                const double scale = sizeOf(*track[f]) / 2;  // metres to pixels, roughly
                kept += scale * std::abs(a.world[k] - last[i].world[k]);
                swapped += scale * std::abs(b.world[k] - last[i].world[k]);
            }
        }
        // Of a person seen from the side both are alike, and nothing is gained.
        if (swapped > kept / 3) return;
        for (size_t i = 1; i < landmark::kCount; ++i)
            if (oppositeLandmark(i) > i) std::swap(points[i], points[oppositeLandmark(i)]);
        ++swaps;
    });
    return swaps;
}

}  // namespace doppel
