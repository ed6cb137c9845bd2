// What the colours of a false-colour surface mean.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "view/params.h"

namespace doppel {

using LegendColour = std::array<double, 3>;  // sRGB-encoded in [0,1], without light

// A colour with its name, or a bar of colours with what its ends mean.
struct LegendRow {
    std::string name;
    std::vector<LegendColour> colours;  // evenly along the bar; one: a patch
    std::string low, high;              // of a bar's ends
};

// Empty for surfaces whose colours mean nothing else. As shaders/view/shade.comp paints them.
std::vector<LegendRow> legendOf(uint32_t paint, const Avatar& avatar);

}  // namespace doppel
