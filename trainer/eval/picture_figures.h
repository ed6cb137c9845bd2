// Figures of one frame that tell blur, misalignment and outlines apart, where one number over the
// body cannot.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

namespace doppel {

// In pixels; from x0, y0 up to and without x1, y1.
struct PixelRect {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

// A part of the picture that is looked at by itself.
struct PictureRegion {
    std::string name;             // "head": its figures are psnr_head, …
    std::vector<uint8_t> pixels;  // [H,W] 1 inside; none: its figures are left out
};
PictureRegion regionOf(std::string name, const PixelRect& rect, int width, int height);

struct PictureFigures {
    int width = 0, height = 0;
    std::span<const float> rendered, frame;   // [H,W,3] in [0,1]; the render over the background
    std::span<const float> person;            // [H,W,3] the render alone, times its coverage
    std::span<const uint8_t> coverage, mask;  // [H,W] of the render, and of the frame: > 127 inside
    std::vector<PictureRegion> regions = {};
};

using Figures = std::vector<std::pair<std::string, double>>;

// In this order:
//   outline_bias         pixels of the mask alone minus of the render alone, over the outline's
//                        length: > 0 where the render is too thin, pixels
//   outline_95           95th percentile of the distances between the two outlines, both ways,
//   pixels psnr_union           over the pixels of the mask or the render, dB psnr_interior over
//   the mask without its three outermost pixels, dB sharpness_interior   mean gradient of the
//   render over that of the frame, there psnr_white           of the whole picture, both people cut
//   out on white, at 540 rows at most, dB
// and for each region:
//   psnr_head, ssim_head over the mask or the render within it
//   sharpness_head       as of the interior, in the mask's part of it
//   similarity_head      of gradient magnitudes (Xue and others, GMSD, IEEE TIP 2014, equation 4)
//   correlation_head     the best of grey values over shifts of 3 pixels: a low sharpness at a high
//                        correlation is blur, a low one at a high sharpness misalignment
Figures pictureFigures(const PictureFigures& picture);

}  // namespace doppel
