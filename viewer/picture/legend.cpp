#include "viewer/picture/legend.h"

#include <algorithm>
#include <cmath>

#include "viewer/inspect/inspected.h"

namespace doppel {

namespace {

LegendColour partColour(int part) {
    LegendColour colour;
    for (size_t c = 0; c < 3; ++c) {
        constexpr std::array<double, 3> kShift{0, 2, 1};
        const double hue = part * 0.61803399 + kShift[c] / 3;
        colour[c] = .25 + .7 * std::clamp(std::abs((hue - std::floor(hue)) * 6 - 3) - 1, 0., 1.);
    }
    return colour;
}

}  // namespace

std::vector<LegendRow> legendOf(uint32_t paint, const Avatar& avatar) {
    switch (paint) {
        case kPaintNormals:
            return {{"normal, to the right", {{0, .5, .5}, {1, .5, .5}}, "-1", "1"},
                    {"normal, up", {{.5, 0, .5}, {.5, 1, .5}}, "-1", "1"},
                    {"normal, to the eye", {{.5, .5, 0}, {.5, .5, 1}}, "-1", "1"}};
        case kPaintVisibility:
            return {{"visibility map",
                     {{.25, .2, .3}, {.55, .85, .5}},
                     "0, not seen",
                     "1, seen from here"}};
        case kPaintChecker:
            return {
                {"u, squares of 1/32", {{.35, .35, .9}, {.9, .35, .625}}, "0, left", "1, right"},
                {"v", {{.35, .35, .9}, {.35, .9, .625}}, "0, top", "1, bottom"}};
        case kPaintParts: {
            std::vector<LegendRow> rows;
            for (int part = 1; part < kBodyPartEnd; ++part)
                rows.push_back({partName(static_cast<BodyPart>(part)), {partColour(part)}, {}, {}});
            return rows;
        }
        case kPaintClamps: {
            const std::vector<float> bounds = clampBounds(avatar.body, avatar.preset.mesh.clamps);
            return {{"clamp bound K(v)",
                     {{.15, .3, .75}, {.95, .95, .95}, {.8, .15, .12}},
                     "0 mm",
                     fmt::format("{:.0f} mm", 1e3 * double{*std::ranges::max_element(bounds)})}};
        }
        default:
            return {};
    }
}

}  // namespace doppel
