// How sharp a picture is.
#pragma once

namespace doppel {

// Mean square of the Laplacian over the variance, so that light does not matter. grey(x, y): the
// picture, of 0 to 255; counts(x, y): whether a pixel is looked at. 0 where none is.
template <typename Grey, typename Counts>
double sharpness(int width, int height, const Grey& grey, const Counts& counts) {
    double edges = 0, sum = 0, squares = 0, count = 0;
    for (int y = 1; y + 1 < height; ++y)
        for (int x = 1; x + 1 < width; ++x) {
            if (!counts(x, y)) continue;
            const double here = grey(x, y);
            const double l =
                4 * here - grey(x - 1, y) - grey(x + 1, y) - grey(x, y - 1) - grey(x, y + 1);
            edges += l * l;
            sum += here;
            squares += here * here;
            count += 1;
        }
    if (count == 0) return 0;
    const double variance = squares / count - sum / count * (sum / count);
    return edges / count / (variance + 1);
}

}  // namespace doppel
