// How many samples a pixel has while something moves.
#pragma once

#include <array>
#include <cstddef>

namespace doppel {

// Two of each pixel's rows and columns where the device has drawn so fast that four times as many
// samples fit into the budget, one elsewhere. A kind of picture that is drawn for the first time
// takes long, for its kernels are compiled: so the number grows between two movements alone, and
// the first picture of a movement does not count.
class MovingSamples {
public:
    // budget: milliseconds that a picture may take.
    explicit MovingSamples(double budget) : budget_(budget) {}

    // Per pixel and axis, of the next picture that moves.
    int now() const { return samples_; }
    // What that picture took, milliseconds.
    void drawn(double milliseconds);
    // Nothing moves any more.
    void rested();

private:
    static constexpr size_t kCounted = 4;  // pictures that have to agree

    double budget_;
    int samples_ = 1;
    double times_ = 4;  // as long as a picture of one sample, of two
    bool first_ = true;
    std::array<double, kCounted> took_{};  // the last ones
    size_t count_ = 0;
    double alone_ = 0;  // with one sample, of those that were the longest
};

}  // namespace doppel
