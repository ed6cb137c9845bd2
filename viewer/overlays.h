// Sizes of what is drawn over the picture, which the mouse meets.
#pragma once

namespace doppel {

constexpr double kRingRadius = 74;  // window units (Window::unit)
constexpr int kRingPoints = 64;

}  // namespace doppel
