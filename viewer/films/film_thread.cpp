#include "viewer/films/film_thread.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "trainer/avatar/avatar_renderer.h"
#include "trainer/data/frame_cache.h"
#include "viewer/picture/backdrop.h"
#include "viewer/picture/floor.h"

namespace doppel {

namespace {

// Straight alpha of what was drawn over black and over white, whose difference is what is not
// covered: white - black = 255 (1 - alpha), black = alpha colour.
Image withAlpha(const std::vector<uint32_t>& black, const std::vector<uint32_t>& white, int width,
                int height) {
    Image image(width, height, 4);
    for (size_t i = 0; i < black.size(); ++i) {
        int uncovered = 0;
        std::array<int, 3> colour{};
        for (size_t c = 0; c < 3; ++c) {
            colour[c] = int(black[i] >> 8 * c & 255);
            uncovered += int(white[i] >> 8 * c & 255) - colour[c];
        }
        const int alpha = std::clamp(255 - (uncovered + 1) / 3, 0, 255);
        for (size_t c = 0; c < 3; ++c)
            image.data[4 * i + c] =
                alpha > 0 ? uint8_t(std::min(255, (colour[c] * 255 + alpha / 2) / alpha)) : 0;
        image.data[4 * i + 3] = uint8_t(alpha);
    }
    return image;
}

Image asImage(const std::vector<uint32_t>& pixels, int width, int height) {
    Image image(width, height, 3);
    for (size_t i = 0; i < pixels.size(); ++i)
        for (size_t c = 0; c < 3; ++c)
            image.data[3 * i + c] = static_cast<uint8_t>(pixels[i] >> 8 * c);
    return image;
}

Image previewOf(const Image& image) {
    constexpr int kGrey = 128;  // behind what is transparent
    Image opaque(image.width, image.height, 3);
    for (size_t i = 0; i < opaque.data.size() / 3; ++i)
        for (size_t c = 0; c < 3; ++c) {
            const auto n = static_cast<size_t>(image.channels);
            const int alpha = n == 4 ? image.data[n * i + 3] : 255;
            opaque.data[3 * i + c] =
                static_cast<uint8_t>((image.data[n * i + c] * alpha + kGrey * (255 - alpha)) / 255);
        }
    const double scale = std::min(
        1., static_cast<double>(FilmThread::kPreview) / std::max(image.width, image.height));
    return resize(opaque, std::max(1, static_cast<int>(image.width * scale)),
                  std::max(1, static_cast<int>(image.height * scale)));
}

}  // namespace

FilmThread::FilmThread(FilmPlan plan, std::function<void()> progressed)
    : plan_(std::move(plan)),
      isPicture_(!plan_.pictures),
      progressed_(std::move(progressed)),
      thread_([this] { work(); }) {}

FilmThread::~FilmThread() {
    stop_ = true;
    thread_.join();
}

float FilmThread::progress() const {
    return static_cast<float>(drawn_) /
           static_cast<float>(std::max<size_t>(plan_.frames.size(), 1));
}

void FilmThread::finish() {
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

std::optional<Image> FilmThread::latest() {
    std::lock_guard lock(mutex_);
    return std::exchange(latest_, std::nullopt);
}

void FilmThread::work() {
    try {
        draw();
    } catch (...) {
        failure_ = std::current_exception();
    }
    plan_.pictures.reset();  // what is not finished leaves no file
    ended_ = true;
    progressed_();
}

void FilmThread::draw() {
    const Avatar& avatar = plan_.avatar->avatar;
    const int width = plan_.width, height = plan_.height;
    Device device(plan_.device);
    Scene scene(device, avatar);
    std::vector<std::unique_ptr<Scene>> others;
    for (const FilmOther& other : plan_.others) {
        others.push_back(std::make_unique<Scene>(device, other.avatar->avatar));
        others.back()->setTexture(other.texels);
    }
    std::optional<AvatarRenderer> renderer;
    if (plan_.painted)
        renderer.emplace(device, avatar, false, plan_.texture);
    else
        scene.setTexture(plan_.texels);
    std::optional<FrameCache> captured;
    if (plan_.capture) captured.emplace(*plan_.capture);
    const Skeleton skeleton = skeletonOf(avatar.body, plan_.betas);
    const auto pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
    for (const FilmFrame& frame : plan_.frames) {
        if (stop_) return;
        const auto takePose = [&] {
            scene.setPose(thetaOf(frame.pose), transOf(frame.pose), plan_.betas);
        };
        takePose();
        for (size_t i = 0; i < others.size(); ++i) {
            Pose pose = frame.pose;
            pose.trans += frame.offsets[i];
            others[i]->setPose(thetaOf(pose), transOf(pose), plan_.others[i].betas);
        }
        const std::vector<float> verts = scene.vertices(plan_.mesh, frame.view);
        if (renderer) scene.setTexture(renderer->texture(verts));
        const auto drawn = [&](std::vector<uint32_t> behind) {
            std::vector<float> depths(others.empty() ? 0 : pixels, INFINITY);
            for (size_t i = 0; i < others.size(); ++i) {
                const FilmOther& other = plan_.others[i];
                ShadeOptions shade = plan_.shade;
                shade.inset = 0;
                behind = others[i]->draw(other.mesh, frame.camera, frame.view, shade, behind,
                                         plan_.samples, {}, &depths);
            }
            return scene.draw(plan_.mesh, frame.camera, frame.view, plan_.shade, behind,
                              plan_.samples, {}, others.empty() ? nullptr : &depths);
        };
        Image image;
        if (plan_.clear) {
            image = withAlpha(drawn(std::vector<uint32_t>(pixels, 0xff000000)),
                              drawn(std::vector<uint32_t>(pixels, 0xffffffff)), width, height);
        } else {
            std::shared_ptr<const Picture> own;
            if (captured && frame.captured) own = captured->load(*frame.captured);
            BackdropSource source{plan_.colour, plan_.backdrop.empty() ? nullptr : &plan_.backdrop,
                                  own.get()};
            std::vector<uint32_t> front;
            if (own && plan_.front.as > Backdrop::Capture)
                front = backdropPixels(width, height, source);
            source.marksPerson = plan_.front.as == Backdrop::Difference;
            std::vector<uint32_t> behind = backdropPixels(width, height, source);
            if (frame.floor) {
                std::vector<FloorBody> bodies{{verts, avatar.body.faces}};
                for (size_t i = 0; i < others.size(); ++i)
                    bodies.push_back({others[i]->vertices(plan_.others[i].mesh, frame.view),
                                      plan_.others[i].avatar->avatar.body.faces});
                drawFloor(behind, frame.camera, frame.view, *frame.floor,
                          forwardKinematics(skeleton, frame.pose).position[joint::kPelvis],
                          plan_.line, bodies);
            }
            drawGhosts(scene, frame.ghosts, plan_.betas, frame.camera, frame.view, behind);
            takePose();
            std::vector<uint32_t> picture = drawn(behind);
            if (!front.empty()) putInFront(picture, front, plan_.front);
            image = asImage(picture, width, height);
        }
        plan_.pictures ? plan_.pictures->add(image) : writeImage(plan_.out, image);
        ++drawn_;
        {
            std::lock_guard lock(mutex_);
            latest_ = previewOf(image);
        }
        progressed_();
    }
    if (plan_.pictures) plan_.pictures->finish();
}

}  // namespace doppel
