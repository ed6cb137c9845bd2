// Sizes and colours of what is drawn over the picture, which the mouse meets.
#pragma once

#include <imgui.h>

namespace doppel {

constexpr double kRingRadius = 74;  // window units (Window::unit)
constexpr int kRingPoints = 64;

// Handles are light and have a dark rim, for nobody knows what picture they lie on: three times as
// bright as the rim over white, in WCAG's measure.
constexpr ImU32 kRim = IM_COL32(0, 0, 0, 190);
constexpr ImU32 kRingColours[3] = {  // x, y, z
    IM_COL32(255, 100, 100, 255), IM_COL32(100, 210, 100, 255), IM_COL32(90, 140, 255, 255)};
constexpr ImU32 kJointColour = IM_COL32(120, 190, 255, 255);
constexpr ImU32 kHoveredColour = IM_COL32(255, 230, 150, 255);
constexpr ImU32 kSelectedColour = IM_COL32(255, 180, 60, 255);
constexpr ImU32 kPinColour = IM_COL32(255, 100, 100, 255);

}  // namespace doppel
