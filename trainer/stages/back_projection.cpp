#include "trainer/stages/back_projection.h"

#include <algorithm>
#include <cmath>

#include "nn/ops/raster.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/bake.h"
#include "trainer/data/body_render.h"
#include "trainer/data/progress.h"

namespace doppel {

namespace {

// What lies behind what is seen by more than this, m, is hidden.
constexpr double kHidden = 0.012;
// Evenly taken: more would hardly change a mean.
constexpr size_t kMostFrames = 120;
// Samples of the depth per pixel and axis, in pictures of up to so many pixels.
constexpr int kSamples = 2;
constexpr int64_t kSampledPixels = int64_t{1} << 20;

// Depths of a mesh in one size of picture, several samples to a pixel.
class DepthMap {
public:
    DepthMap(Device& device, const BodyModel& body, const Camera& camera)
        : graph_(device), width_(camera.width), height_(camera.height) {
        samples_ = int64_t{width_} * height_ <= kSampledPixels ? kSamples : 1;
        verts_ = graph_.input({body.vertexCount, 3});
        camera_ = graph_.input(kCameraShape);
        RasterMesh mesh = rasterMesh(graph_, body.faces, body.vertexCount);
        seen_ =
            visibilityBuffer(graph_, mesh, verts_, camera_, height_ * samples_, width_ * samples_);
        graph_.output(seen_.surface);
        graph_.compile();
    }
    bool fits(const Camera& camera) const {
        return camera.width == width_ && camera.height == height_;
    }
    void draw(std::span<const float> verts, Camera camera) {
        camera.fx *= samples_, camera.fy *= samples_, camera.cx *= samples_, camera.cy *= samples_;
        graph_.write(verts_, verts);
        graph_.write(camera_, cameraValues(rasterCamera(camera)));
        graph_.run();
        surface_ = graph_.read<float>(seen_.surface);
    }
    // At a place in the picture, pixels; 0 where nothing is seen.
    double at(double u, double v) const {
        const auto x = static_cast<int64_t>(u * samples_), y = static_cast<int64_t>(v * samples_);
        if (u < 0 || v < 0 || x >= width_ * samples_ || y >= height_ * samples_) return 0;
        return static_cast<double>(
            surface_[static_cast<size_t>(4 * (y * width_ * samples_ + x)) + 3]);
    }

private:
    Graph graph_;
    int width_, height_, samples_ = 1;
    Tensor verts_, camera_;
    VisibilityBuffer seen_;
    std::vector<float> surface_;
};

// How much a mask's pixels count: full two pixels from its rim, little on it, nothing outside.
std::vector<float> maskWeights(const Picture& picture) {
    std::vector<uint8_t> outside(picture.mask.size());
    std::ranges::transform(picture.mask, outside.begin(),
                           [](uint8_t m) { return static_cast<uint8_t>(m > 127 ? 0 : 255); });
    const std::vector<uint8_t> near = dilateMask(outside, picture.width, picture.height, 1);
    const std::vector<uint8_t> nearly = dilateMask(outside, picture.width, picture.height, 2);
    std::vector<float> weights(outside.size());
    for (size_t i = 0; i < weights.size(); ++i)
        weights[i] = outside[i] ? 0 : near[i] ? 1e-4f : nearly[i] ? 1e-2f : 1;
    return weights;
}

}  // namespace

std::vector<float> backProject(Device& device, const BodyModel& body, const Capture& capture,
                               FrameCache& frames, int size) {
    capture.requireMasks();
    BodyPoser poser(device, body);
    std::unique_ptr<DepthMap> depths;
    const std::vector<TexelPlace> places = texelPlaces(body, size);
    std::vector<double> sums(3 * places.size()), totals(places.size());
    const size_t count = std::min(capture.size(), kMostFrames);
    Progress progress("first texels", static_cast<int64_t>(count));
    for (size_t k = 0; k < count; ++k) {
        if (interrupted()) throw Interrupted{};
        const size_t f = k * capture.size() / count;
        const Camera& camera = capture.frames[f].camera;
        const auto picture = frames.load(f);
        const PosedMesh posed = poser.pose(capture.theta[f], capture.trans[f], capture.betas);
        if (!depths || !depths->fits(camera))
            depths = std::make_unique<DepthMap>(device, body, camera);
        depths->draw(posed.verts, camera);
        const std::vector<float> facing = viewWeights(body, places, posed.verts);
        const std::vector<float> counts = maskWeights(*picture);
        const int w = picture->width, h = picture->height;
        for (size_t i = 0; i < places.size(); ++i) {
            if (places[i].face < 0 || !(facing[i] > 0)) continue;
            double x[3] = {0, 0, 0};
            for (size_t corner = 0; corner < 3; ++corner) {
                const auto v = static_cast<size_t>(
                    body.faces[3 * static_cast<size_t>(places[i].face) + corner]);
                for (size_t c = 0; c < 3; ++c)
                    x[c] += double{places[i].corners[corner]} * double{posed.verts[3 * v + c]};
            }
            if (!(x[2] > 0)) continue;
            const double u = camera.fx * x[0] / x[2] + camera.cx;
            const double v = camera.fy * x[1] / x[2] + camera.cy;
            const double seen = depths->at(u, v);
            if (seen == 0 || x[2] > seen + kHidden) continue;
            const int column = static_cast<int>(u), row = static_cast<int>(v);
            const double weight =
                double{facing[i]} * double{counts[static_cast<size_t>(row * w + column)]};
            if (!(weight > 0)) continue;
            // Bilinear, clamped at the border.
            const double s = std::clamp(u - .5, 0.0, w - 1.0), t = std::clamp(v - .5, 0.0, h - 1.0);
            const int x0 = static_cast<int>(s), y0 = static_cast<int>(t);
            const int x1 = std::min(x0 + 1, w - 1), y1 = std::min(y0 + 1, h - 1);
            auto pixel = [&](int px, int py, size_t c) {
                return picture->rgb[static_cast<size_t>(py * w + px) * 3 + c] / 255.0;
            };
            for (size_t c = 0; c < 3; ++c) {
                const double above = std::lerp(pixel(x0, y0, c), pixel(x1, y0, c), s - x0);
                const double below = std::lerp(pixel(x0, y1, c), pixel(x1, y1, c), s - x0);
                sums[3 * i + c] += weight * std::lerp(above, below, t - y0);
            }
            totals[i] += weight;
        }
        progress.update(static_cast<int64_t>(k) + 1);
    }
    std::vector<float> texture(sums.size());
    std::vector<uint8_t> known(totals.size());
    for (size_t i = 0; i < totals.size(); ++i) {
        if (!(totals[i] > 1e-12)) continue;
        known[i] = 1;
        for (size_t c = 0; c < 3; ++c)
            texture[3 * i + c] = static_cast<float>(sums[3 * i + c] / totals[i]);
    }
    fillHoles(texture, known, static_cast<size_t>(size), static_cast<size_t>(size));
    return texture;
}

}  // namespace doppel
