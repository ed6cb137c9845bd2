#include "trainer/person/one_euro.h"

#include <cmath>
#include <numbers>

namespace doppel {

namespace {

constexpr double kSpeedCutoff = 1;  // Hz, of the speed itself

double share(double cutoff, double seconds) {
    return 1 / (1 + 1 / (seconds * 2 * std::numbers::pi * cutoff));
}

}  // namespace

double OneEuro::operator()(double value, double seconds, double size) {
    if (!any_) {
        any_ = true;
        before_ = smooth_ = value;
        return value;
    }
    const double speed = (value - before_) / seconds / size;
    speed_ += share(kSpeedCutoff, seconds) * (speed - speed_);
    smooth_ +=
        share(numbers_.cutoff + numbers_.speed * std::abs(speed_), seconds) * (value - smooth_);
    before_ = value;
    return smooth_;
}

}  // namespace doppel
