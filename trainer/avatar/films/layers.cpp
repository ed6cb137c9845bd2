#include "trainer/avatar/films/layers.h"

#include <algorithm>

#include "engine/error.h"
#include "trainer/avatar/background.h"

namespace doppel {

namespace {

uint8_t toByte(float value) {
    return static_cast<uint8_t>(std::clamp(value, 0.0f, 1.0f) * 255 + .5f);
}

}  // namespace

void addShadow(Drawing& drawing, const std::vector<float>& shadow) {
    CHECK(shadow.size() == drawing.mask.size(), "a shadow has the size of its picture");
    for (size_t i = 0; i < shadow.size(); ++i) {
        const float seen = 1 - static_cast<float>(drawing.mask[i]) / 255.0f;
        drawing.mask[i] = toByte(1 - seen * (1 - shadow[i]));
    }
}

void occlude(Drawing& drawing, const std::vector<float>& hidden) {
    CHECK(hidden.size() == drawing.mask.size(), "what is in front has the size of its picture");
    for (size_t i = 0; i < hidden.size(); ++i) {
        const float left = 1 - std::clamp(hidden[i], 0.0f, 1.0f);
        drawing.mask[i] = toByte(static_cast<float>(drawing.mask[i]) / 255.0f * left);
        for (size_t c = 0; c < 3; ++c) drawing.rgb[3 * i + c] *= left;
    }
}

Image straightAlpha(const Drawing& drawing, bool bleed) {
    std::vector<float> colours(drawing.rgb.size());
    std::vector<uint8_t> covered(drawing.mask.size());
    for (size_t i = 0; i < covered.size(); ++i) {
        covered[i] = drawing.mask[i] > 0;
        if (!covered[i]) continue;
        const float alpha = static_cast<float>(drawing.mask[i]) / 255.0f;
        for (size_t c = 0; c < 3; ++c) colours[3 * i + c] = drawing.rgb[3 * i + c] / alpha;
    }
    if (bleed && std::ranges::count(covered, 1) > 0)
        fillHoles(colours, covered, static_cast<size_t>(drawing.width),
                  static_cast<size_t>(drawing.height));
    Image image(drawing.width, drawing.height, 4);
    for (size_t i = 0; i < covered.size(); ++i) {
        for (size_t c = 0; c < 3; ++c) image.data[4 * i + c] = toByte(colours[3 * i + c]);
        image.data[4 * i + 3] = drawing.mask[i];
    }
    return image;
}

}  // namespace doppel
