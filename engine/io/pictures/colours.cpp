#include "engine/io/pictures/colours.h"

#include <lcms2.h>

#include <algorithm>
#include <cstdlib>
#include <memory>

#include "engine/io/image.h"

namespace doppel {

namespace {

struct Free {
    void operator()(void* profile) const { cmsCloseProfile(profile); }
};
using Profile = std::unique_ptr<void, Free>;

struct FreeTransform {
    void operator()(void* transform) const { cmsDeleteTransform(transform); }
};

// Whether colours all over the cube stay where they are, or a step of 255 beside it: programs write
// sRGB in many ways.
bool changesNothing(cmsHTRANSFORM transform) {
    std::vector<uint8_t> from;
    constexpr int kSteps = 6;
    for (int i = 0; i < kSteps * kSteps * kSteps; ++i)
        for (const int c : {i % kSteps, i / kSteps % kSteps, i / kSteps / kSteps})
            from.push_back(static_cast<uint8_t>(255 * c / (kSteps - 1)));
    std::vector<uint8_t> to(from.size());
    cmsDoTransform(transform, from.data(), to.data(),
                   static_cast<cmsUInt32Number>(from.size() / 3));
    return std::ranges::equal(from, to, [](int a, int b) { return std::abs(a - b) <= 1; });
}

}  // namespace

std::vector<uint8_t> profileOf(const Primaries& primaries) {
    const auto colour = [](const std::array<double, 2>& xy) { return cmsCIExyY{xy[0], xy[1], 1}; };
    const cmsCIExyY white = colour(primaries.white);
    const cmsCIExyYTRIPLE colours{colour(primaries.red), colour(primaries.green),
                                  colour(primaries.blue)};
    constexpr double kSrgb[] = {2.4, 1 / 1.055, .055 / 1.055, 1 / 12.92, .04045};
    cmsToneCurve* curve = cmsBuildParametricToneCurve(nullptr, 4, kSrgb);
    cmsToneCurve* const curves[] = {curve, curve, curve};
    const Profile profile(cmsCreateRGBProfile(&white, &colours, curves));
    cmsFreeToneCurve(curve);
    std::vector<uint8_t> bytes;
    cmsUInt32Number size = 0;
    if (profile && cmsSaveProfileToMem(profile.get(), nullptr, &size)) {
        bytes.resize(size);
        if (!cmsSaveProfileToMem(profile.get(), bytes.data(), &size)) bytes.clear();
    }
    return bytes;
}

void convertToSrgb(Image& image, std::span<const uint8_t> profile) {
    if (profile.empty() || image.channels < 3) return;
    const Profile from(
        cmsOpenProfileFromMem(profile.data(), static_cast<cmsUInt32Number>(profile.size())));
    if (!from || cmsGetColorSpace(from.get()) != cmsSigRgbData) return;
    const Profile to(cmsCreate_sRGBProfile());
    using Transform = std::unique_ptr<void, FreeTransform>;
    const auto transform = [&](cmsUInt32Number format) {
        return Transform(cmsCreateTransform(from.get(), format, to.get(), format,
                                            INTENT_RELATIVE_COLORIMETRIC, cmsFLAGS_COPY_ALPHA));
    };
    if (const Transform plain = transform(TYPE_RGB_8); !plain || changesNothing(plain.get()))
        return;
    const Transform whole = transform(image.channels == 3 ? TYPE_RGB_8 : TYPE_RGBA_8);
    if (!whole) return;
    for (int y = 0; y < image.height; ++y)
        cmsDoTransform(whole.get(), image.row(y), image.row(y),
                       static_cast<cmsUInt32Number>(image.width));
}

}  // namespace doppel
