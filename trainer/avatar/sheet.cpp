#include "trainer/avatar/sheet.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"

namespace doppel {

Image contactSheet(const std::vector<std::vector<Image>>& rows) {
    CHECK(!rows.empty() && !rows[0].empty(), "a sheet has pictures");
    constexpr int kGap = 2;
    int width = rows[0][0].width, height = rows[0][0].height;
    size_t columns = 0;
    for (const auto& row : rows) columns = std::max(columns, row.size());
    Image sheet(static_cast<int>(columns) * (width + kGap) - kGap,
                static_cast<int>(rows.size()) * (height + kGap) - kGap, 3, 255);
    for (size_t r = 0; r < rows.size(); ++r)
        for (size_t c = 0; c < rows[r].size(); ++c) {
            const Image& picture = rows[r][c];
            CHECK(picture.width == width && picture.height == height && picture.channels == 3,
                  "a sheet's pictures are alike");
            for (int y = 0; y < height; ++y)
                std::copy(picture.row(y), picture.row(y) + picture.rowBytes(),
                          sheet.pixel(static_cast<int>(c) * (width + kGap),
                                      static_cast<int>(r) * (height + kGap) + y));
        }
    return sheet;
}

Image compareMasks(const std::vector<uint8_t>& mask, const std::vector<uint8_t>& silhouette,
                   int width, int height) {
    Image image(width, height, 3);
    for (size_t i = 0; i < mask.size(); ++i) {
        bool a = mask[i] > 127, b = silhouette[i] > 127;
        uint8_t* rgb = &image.data[3 * i];
        rgb[0] = a ? (b ? 255 : 230) : (b ? 40 : 0);
        rgb[1] = a ? (b ? 255 : 50) : (b ? 90 : 0);
        rgb[2] = a ? (b ? 255 : 50) : (b ? 235 : 0);
    }
    return image;
}

Image toImage(const std::vector<float>& rgb, int width, int height) {
    Image image(width, height, 3);
    std::ranges::transform(rgb, image.data.begin(), [](float value) {
        return static_cast<uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
    });
    return image;
}

Image differenceImage(const std::vector<float>& a, const std::vector<float>& b, int width,
                      int height, float gain) {
    std::vector<float> difference(a.size());
    for (size_t i = 0; i < a.size(); ++i) difference[i] = gain * std::abs(a[i] - b[i]);
    return toImage(difference, width, height);
}

}  // namespace doppel
