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

// What somebody looks like: colours of the upper and of the lower half of the square, where the
// network sees the person.
class Appearance {
public:
    Appearance() = default;
    Appearance(const Image& rgb, const PersonLandmarks& person);

    bool empty() const { return shares_.empty(); }
    // From 0, nothing in common, to 1: the mean over both halves of the Bhattacharyya coefficient.
    double likeness(const Appearance& other) const;
    // Becomes a little like the other.
    void learn(const Appearance& other, double rate);

private:
    std::vector<float> shares_;  // [2][8³], each half's sum is 1
};

class PersonTracker {
public:
    // person: of those in the first picture from left to right, from 1; 0: the largest.
    PersonTracker(BlazePose& pose, int person) : pose_(pose), person_(person) {}

    // The person in the next picture, shown at `time` (seconds, ascending); nothing where there is
    // none. The detector runs where the person was not followed from the picture before, and twice
    // a second, to see whether there are others. Once there are, the person is who looks like it:
    // where people cross, the follower may have gone with the wrong one, and nobody is found while
    // the person is hidden. InputError where the first picture with people has fewer than `person`.
    std::optional<PersonLandmarks> next(const Image& rgb, double time);

    // The next picture has nothing to do with those before (a cut).
    void forget();

    int detections() const { return detections_; }  // so far
    // Those in the first picture with people, from left to right; and which of them is followed.
    const std::vector<Roi>& people() const { return people_; }
    size_t followed() const { return followed_; }
    // Pictures in which somebody was found, but not the person.
    int mistaken() const { return mistaken_; }

private:
    PersonLandmarks look(const Image& rgb, const Roi& roi);
    std::optional<Roi> find(const Image& rgb);
    std::vector<Roi> detect(const Image& rgb, double time);
    // The person among all that the picture shows, by looks; nothing where nobody is like it.
    std::optional<PersonLandmarks> recognise(const Image& rgb, double time,
                                             std::optional<PersonLandmarks> followed);

    BlazePose& pose_;
    int person_, detections_ = 0, mistaken_ = 0;
    std::vector<Roi> people_;
    size_t followed_ = 0;
    std::optional<Roi> roi_;   // where to look
    std::optional<Roi> last_;  // where the person was seen
    RoiFilter filter_;
    double time_ = 0, detected_ = -1e9, seen_ = 0;
    bool others_ = false;  // somebody else was seen since the last cut
    Appearance looks_;
    double usual_ = 0;  // likeness from picture to picture
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
