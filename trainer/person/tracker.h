// One person followed through the pictures of a clip.
#pragma once

#include <optional>
#include <vector>

#include "trainer/person/blazepose.h"
#include "trainer/person/one_euro.h"

namespace doppel {

// Where the next square is: about the landmarks 33 and 34 of this picture, smoothed.
class RoiFilter {
public:
    // seconds since the picture before (of the first it does not matter).
    Roi operator()(const PersonLandmarks& person, double seconds);

private:
    std::vector<OneEuro> filters_;  // x, y of both landmarks
};

class PersonTracker {
public:
    // person: of those in the first picture from left to right, from 1; 0: the largest.
    PersonTracker(BlazePose& pose, int person) : pose_(pose), person_(person) {}

    // The person in the next picture, shown at `time` (seconds, ascending); nothing where there is
    // none. The detector runs only where the person was not followed from the picture before.
    // InputError where the first picture with people has fewer than `person`.
    std::optional<PersonLandmarks> next(const Image& rgb, double time);

    // The next picture has nothing to do with those before (a cut).
    void forget();

    int detections() const { return detections_; }  // so far

private:
    std::optional<Roi> find(const Image& rgb);

    BlazePose& pose_;
    int person_, detections_ = 0;
    std::optional<Roi> roi_;   // where to look
    std::optional<Roi> last_;  // where the person was seen
    RoiFilter filter_;
    double time_ = 0;
};

// Landmarks of one person in pictures at `times`, smoothed by one-euro filters as the official
// solution does it: landmarks in the picture, in space, and visibilities. Where there is nobody
// filters begin anew, and so they do at the pictures that begin something new (after a cut).
using Track = std::vector<std::optional<PersonLandmarks>>;
void smoothForward(Track& track, const std::vector<double>& times,
                   const std::vector<size_t>& beginnings = {});

// The same without the lag that filters have: the mean of what they give from either end.
void smoothBothWays(Track& track, const std::vector<double>& times,
                    const std::vector<size_t>& beginnings = {});

// Exchanges left and right in pictures where that alone continues the motion before; returns how
// many there were.
size_t mendSwaps(Track& track, const std::vector<size_t>& beginnings = {});

}  // namespace doppel
