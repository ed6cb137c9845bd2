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

void PersonTracker::forget() {
    roi_.reset();
    filter_ = {};
}

std::optional<Roi> PersonTracker::find(const Image& rgb) {
    ++detections_;
    std::vector<Roi> people;
    for (const Detection& detection : pose_.detect(rgb)) people.push_back(detection.roi());
    if (people.empty()) return {};
    const auto nearest = [&](const Roi& a, const Roi& b) {
        const auto away = [&](const Roi& roi) {
            return std::hypot(roi.centre[0] - last_->centre[0], roi.centre[1] - last_->centre[1]);
        };
        return away(a) < away(b);
    };
    if (last_ && person_ > 0) return *std::ranges::min_element(people, nearest);
    if (person_ > int(people.size())) {
        throwInput("--person: expected 1 to {}, as many as the first picture shows, found {}",
                   people.size(), person_);
    }
    if (person_ > 0) {
        std::ranges::sort(people, {}, [](const Roi& roi) { return roi.centre[0]; });
        return people[size_t(person_ - 1)];
    }
    return *std::ranges::max_element(people, {}, [](const Roi& roi) { return roi.side; });
}

std::optional<PersonLandmarks> PersonTracker::next(const Image& rgb, double time) {
    const double seconds = std::max(time - time_, 1e-3);
    time_ = time;
    // What was followed may be lost, and found by the detector in the same picture.
    for (int attempt = roi_ ? 0 : 1; attempt < 2; ++attempt) {
        if (attempt == 1) {
            forget();
            roi_ = find(rgb);
            if (!roi_) return {};
        }
        // Who takes the largest network wants it exact.
        PersonLandmarks person = pose_.net() == PoseNet::Heavy ? pose_.landmarksBothWays(rgb, *roi_)
                                                               : pose_.landmarks(rgb, *roi_);
        if (!(person.presence > kLeastPresence)) continue;
        last_ = roi_;
        roi_ = filter_(person, seconds);
        return person;
    }
    forget();
    return {};
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
