// Smoothing that is strong on what rests and quick on what moves: Casiez, Roussel and Vogel, 1 €
// Filter: A Simple Speed-based Low-pass Filter for Noisy Input in Interactive Systems (CHI 2012).
#pragma once

namespace doppel {

struct OneEuroNumbers {
    double cutoff = .05;  // Hz, of what rests
    double speed = 80;    // Hz more for each size of the object in a second
};

class OneEuro {
public:
    explicit OneEuro(const OneEuroNumbers& numbers) : numbers_(numbers) {}

    // The next value, `seconds` > 0 after the one before (of the first it does not matter), of an
    // object of this size, in the value's unit. The first value passes as it is.
    double operator()(double value, double seconds, double size);

private:
    OneEuroNumbers numbers_;
    bool any_ = false;
    double before_ = 0, speed_ = 0, smooth_ = 0;
};

}  // namespace doppel
