// What the window shows of the avatar: panes, cameras, backgrounds, pictures and textures.
#include <algorithm>
#include <cmath>

#include "viewer/picture/backdrop.h"
#include "viewer/picture/floor.h"
#include "viewer/viewer.h"

namespace doppel {

namespace {

constexpr double kFastPainter = 0.015;  // seconds; a slower one waits until the mouse rests

uint32_t packed(const std::array<uint8_t, 3>& rgb) {
    return uint32_t{rgb[0]} | uint32_t{rgb[1]} << 8 | uint32_t{rgb[2]} << 16 | 0xff000000u;
}

}  // namespace

std::vector<uint32_t> partOfView(std::span<const uint32_t> view, const Pane& pane) {
    std::vector<uint32_t> part;
    for (int y = 0; y < pane.height; ++y)
        std::ranges::copy(
            view.subspan(static_cast<size_t>(y * pane.viewWidth + pane.x - pane.viewX),
                         static_cast<size_t>(pane.width)),
            std::back_inserter(part));
    return part;
}

void place(const Pane& pane, const PanePicture& picture, std::vector<PlacedPicture>& placed) {
    const auto add = [&](const PixelBox& box) -> PlacedPicture& {
        return placed.emplace_back(
            PlacedPicture{pane.x + box.x, pane.y + box.y, box.width, box.height, {}, {}, {}});
    };
    const PixelBox whole{0, 0, pane.width, pane.height};
    if (!picture.onDevice) {
        add(whole).pixels = picture.inFront.empty() ? picture.pixels : picture.inFront;
        return;
    }
    const PictureOnDevice& there = *picture.onDevice;
    PlacedPicture& background = add(whole);
    background.pixels = *there.background;
    background.unchanging = there.background;
    if (there.drawn) add(there.box).onDevice = there.drawn;
}

int Viewer::panelWidth() const {
    if (!settings_.panel) return 0;
    // A narrow window is not all panel.
    return static_cast<int>(
        std::min(std::round(kPanelWidth * window_.unit()), .6 * window_.width() / window_.scale()));
}

int Viewer::timelineHeight() const {
    return static_cast<int>(std::round(kTimelineHeight * window_.unit()));
}

void Viewer::layOut() {
    double scale = window_.scale();
    int width = window_.width() - static_cast<int>(panelWidth() * scale);
    int height = window_.height() - static_cast<int>(timelineHeight() * scale);
    panes_.clear();
    if (width < 16 || height < 16) return;
    Pane whole{0, 0, width, height, 0, width, 0, settings_.mesh, settings_.texture};
    if (settings_.split >= Split::Avatars && others_.empty()) settings_.split = Split::None;
    if (settings_.split == Split::Source && !hasSource()) settings_.split = Split::None;
    if (settings_.split == Split::None || settings_.split == Split::Together) {
        panes_ = {whole};
        return;
    }
    if (settings_.split == Split::Avatars && others_.size() > 1) {
        const auto count = static_cast<int>(others_.size()) + 1;
        whole.width = whole.viewWidth = std::max(1, width / count);
        for (int i = 0; i < count; ++i) {
            panes_.push_back(whole);
            panes_.back().x = panes_.back().viewX = i * whole.width;
            panes_.back().other = i;
            if (i > 0) panes_.back().mesh = others_[static_cast<size_t>(i) - 1].mesh(whole.mesh);
        }
        return;
    }
    constexpr int kLeast = 16;  // pixels of each part
    Pane left = whole, right = whole;
    left.width =
        settings_.divided
            ? std::clamp(
                  static_cast<int>(std::lround(static_cast<double>(settings_.divider) * width)),
                  kLeast, std::max(kLeast, width - kLeast))
            : width / 2;
    right.x = left.width;
    right.width = std::max(1, width - left.width);
    if (!settings_.divided) {
        left.viewWidth = left.width;
        right.viewX = right.x;
        right.viewWidth = right.width;
    }
    if (settings_.split == Split::Meshes) {
        left.mesh = MeshKind::Body;
        right.mesh = MeshKind::Refined;
    } else if (settings_.split == Split::Textures) {
        left.texture = TextureKind::Coarse;
        right.texture = bestTexture();
    } else if (settings_.split == Split::Source) {
        left.other = Pane::kSource;
    } else {
        right.other = 1;
        right.mesh = others_[0].mesh(whole.mesh);
    }
    panes_ = {left, right};
}

ViewTransform Viewer::view() const {
    return settings_.captureCamera ? ViewTransform{} : orbit_.view();
}

// Of a part of a view: the view's, without the pixels beside the part.
Camera Viewer::cameraOf(const Pane& pane) const {
    Camera camera = viewCameraOf(pane, timeline_);
    camera.cx -= pane.x - pane.viewX;
    camera.width = pane.width;
    return camera;
}

Camera Viewer::viewCameraOf(const Pane& pane, double time) const {
    if (!settings_.captureCamera || !motion() || motion()->cameras.empty())
        return orbit_.camera(pane.viewWidth, pane.height);
    auto i =
        static_cast<size_t>(std::clamp<int64_t>(static_cast<int64_t>(time), 0, frameCount() - 1));
    // The whole frame, as large as the pane allows.
    const Camera& own = motion()->cameras[i];
    double scale = std::min(static_cast<double>(pane.viewWidth) / own.width,
                            static_cast<double>(pane.height) / own.height);
    return {own.fx * scale,
            own.fy * scale,
            own.cx * scale + (pane.viewWidth - own.width * scale) / 2,
            own.cy * scale + (pane.height - own.height * scale) / 2,
            pane.viewWidth,
            pane.height};
}

const Skeleton& Viewer::skeleton() const {
    if (skeletonBetas_ != editor_->betas()) {
        skeletonBetas_ = editor_->betas();
        skeleton_ = skeletonOf(avatar_->avatar.body, *skeletonBetas_);
    }
    return skeleton_;
}

PosedSkeleton Viewer::posed() const { return forwardKinematics(skeleton(), editor_->pose()); }

glm::dvec3 Viewer::jointOnScreen(size_t joint) const {
    if (panes_.empty()) return {};
    const Pane& pane = panes_.back().other ? panes_.front() : panes_.back();
    glm::dvec3 at = projected(posed().position[joint], view(), cameraOf(pane));
    double scale = window_.scale();
    return {(at.x + pane.x) / scale, (at.y + pane.y) / scale, at.z};
}

Pixels Viewer::backgroundOf(const Pane& pane) {
    const bool frames = showsFrames();
    bool picture = settings_.backdrop == Backdrop::Picture && !backdropPicture_.empty();
    std::array<uint8_t, 3> colour{};
    for (size_t c = 0; c < 3; ++c)
        colour[c] =
            static_cast<uint8_t>(std::lround(255 * std::clamp(settings_.colour[c], 0.0f, 1.0f)));
    int64_t frame = frames ? static_cast<int64_t>(frameNow()) : -1;
    BackgroundKey key{pane.viewWidth,
                      pane.height,
                      frame,
                      int64_t{packed(colour)},
                      picture ? static_cast<int64_t>(backdropVersion_) : -1,
                      static_cast<int64_t>(settings_.backdrop)};
    if (key != backgroundKey_) {
        backgroundKey_ = key;
        std::shared_ptr<const Picture> own;
        try {
            if (frames) own = capture()->frames->load(static_cast<size_t>(frame));
        } catch (const std::exception& error) {
            if (message() != error.what()) say(error.what(), true);
        }
        BackdropSource source{settings_.colour, picture ? &backdropPicture_ : nullptr, own.get()};
        const auto pixels = [&] { return backdropPixels(pane.viewWidth, pane.height, source); };
        frame_.clear();
        if (own) frame_ = pixels();
        source.marksPerson = settings_.backdrop == Backdrop::Difference;
        background_ = std::make_shared<const std::vector<uint32_t>>(
            own && !source.marksPerson ? frame_ : pixels());
    }
    if (pane.width == pane.viewWidth) return background_;
    BackgroundPart& part = backgroundParts_[pane.x];
    if (part.of != background_ || part.pane != pane)
        part = {background_, pane,
                std::make_shared<const std::vector<uint32_t>>(partOfView(*background_, pane))};
    return part.part;
}

void Viewer::showFrames() {
    if (capture() && settings_.backdrop < Backdrop::Capture) settings_.backdrop = Backdrop::Capture;
}

FrameInFront Viewer::frameInFront() const {
    return {settings_.backdrop, settings_.frameOpacity, settings_.differenceTimes};
}

bool Viewer::framesInFront() const {
    return settings_.backdrop > Backdrop::Capture && showsFrames() && !frame_.empty();
}

// Over the pane's picture, which stays as it was drawn for the next one to build on.
void Viewer::putFrameInFront(size_t i) {
    PanePicture& picture = panePictures_[i];
    picture.inFront.clear();
    if (!framesInFront()) return;
    picture.inFront = picture.pixels;
    putInFront(picture.inFront, partOfView(frame_, panes_[i]), frameInFront());
}

std::vector<uint32_t> Viewer::seen(size_t i) const {
    const PanePicture& picture = panePictures_[i];
    if (picture.onDevice) return onHost(*device_, *picture.onDevice, shown_->panes[i].width);
    return picture.inFront.empty() ? picture.pixels : picture.inFront;
}

// The background with the floor and ghosts. The scene has the pose that is shown.
Pixels Viewer::behind(const Pane& pane) {
    const Pixels background = backgroundOf(pane);
    Behind now{editor_->pose(), editor_->betas(), pane, cameraOf(pane),
               view(),          backgroundKey_,   {},   ghosts(timeline_)};
    if (settings_.floor) now.floor = worldToFloor();
    now.others = others_.version();
    if (settings_.split == Split::Together) now.apart = settings_.apart;
    if (!now.floor && now.ghosts.empty()) return background;
    auto& [drawn, known] = behind_[pane.x];
    if (known && drawn == now && known->size() == background->size()) return known;
    std::vector<uint32_t> pixels = *background;
    if (now.floor) {
        std::vector<FloorBody> bodies{
            {scene_->vertices(pane.mesh, now.view), avatar_->avatar.body.faces}};
        for (size_t i = 0; now.apart && i < others_.size(); ++i)
            bodies.push_back({others_[i].scene().vertices(others_[i].mesh(pane.mesh), now.view),
                              others_[i].avatar().body.faces});
        drawFloor(pixels, now.camera, now.view, *now.floor, posed().position[joint::kPelvis],
                  floorLine(), bodies);
    }
    if (!now.ghosts.empty()) {
        drawGhosts(*scene_, now.ghosts, now.betas, now.camera, now.view, pixels);
        scene_->setPose(thetaOf(now.pose), transOf(now.pose), now.betas);
    }
    drawn = std::move(now);
    known = std::make_shared<const std::vector<uint32_t>>(std::move(pixels));
    return known;
}

// With the others of a row as well, and how far away they are; no depths without.
Pixels Viewer::behind(const Pane& pane, std::optional<int> refinement, std::vector<float>& depths) {
    const Pixels background = behind(pane);
    if (settings_.split != Split::Together) return background;
    std::vector<uint32_t> row = *background;
    depths.assign(row.size(), INFINITY);
    drawOthers(pane, refinement, row, depths);
    return std::make_shared<const std::vector<uint32_t>>(std::move(row));
}

ShadeOptions Viewer::shadeOptions(const Pane& pane) const {
    ShadeOptions shade;
    shade.paint = settings_.paint;
    shade.light = settings_.light;
    shade.wireframe = settings_.wireframe;
    double level = std::cos(settings_.lampPitch);
    shade.lamp = {level * std::sin(settings_.lampYaw), -std::sin(settings_.lampPitch),
                  -level * std::cos(settings_.lampYaw)};
    shade.ambient = settings_.ambient;
    shade.inset = settings_.atlas ? std::min(pane.width, pane.height) / 3 : 0;
    return shade;
}

Viewer::Shown Viewer::wanted() const {
    ViewTransform from = view();
    return {editor_->pose(),
            editor_->betas(),
            settings_,
            from.rotation,
            from.translation,
            cameraOf(panes_[0]),
            panes_,
            textureVersion_,
            backdropVersion_,
            others_.version(),
            capture() ? frameNow() : 0};
}

void Viewer::setPoses(const Shown& now) {
    const Theta theta = thetaOf(now.pose);
    const Trans trans = transOf(now.pose);
    scene_->setPose(theta, trans, now.betas);
    others_.setPose(now.pose, now.betas, avatar_->avatar, row());
}

// Whether the picture becomes finer: the mouse rests, and there is something to be gained.
bool Viewer::refines() const {
    return shown_ && !panes_.empty() && !interacting() && refinements_ < kRefinements;
}

void Viewer::updatePictures() {
    if (panes_.empty()) {
        shown_.reset();
        return;
    }
    Shown now = wanted();
    bool sameView = shown_ && shown_->pose == now.pose && shown_->betas == now.betas &&
                    shown_->rotation == now.rotation && shown_->translation == now.translation &&
                    shown_->camera == now.camera && shown_->panes == now.panes;
    if (!sameView) ++viewVersion_;
    if (shown_ && *shown_ == now) {
        if (!refines()) return;
        movingSamples_.rested();
        // Ghosts may have left another.
        setPoses(now);
        drawPanes(refinements_);
        ++refinements_;
        framesToDraw_ = std::max(framesToDraw_, 1);
        return;
    }

    auto before = Clock::now();
    setPoses(now);
    panePictures_.resize(panes_.size());
    for (const Pane& pane : panes_) sceneOf(pane).prepare(pane.mesh);
    times_.pose = millisecondsSince(before);
    before = Clock::now();
    drawPanes({});
    times_.draw = millisecondsSince(before);
    movingSamples_.drawn(times_.draw);
    shown_ = std::move(now);
    refinements_ = 0;
    ++pictures_;
    framesToDraw_ = std::max(framesToDraw_, 1);
}

void Viewer::drawPanes(std::optional<int> refinement) {
    for (size_t i = 0; i < panes_.size(); ++i) {
        const Pane& pane = panes_[i];
        if (pane.other == Pane::kSource) {
            drawSource(i, refinement);
            continue;
        }
        if (!pane.other) useTexture(pane.texture);
        std::vector<float> depths;
        const Pixels background = behind(pane, refinement, depths);
        drawPane(i, sceneOf(pane), pane.mesh, shadeOptions(pane), background, refinement,
                 depths.empty() ? nullptr : &depths);
        if (!panePictures_[i].onDevice) putFrameInFront(i);
    }
}

// A picture that the host goes on with is drawn there: a row of avatars by their depths, and one
// with a frame in front.
void Viewer::drawPane(size_t i, Scene& scene, MeshKind mesh, const ShadeOptions& shade,
                      const Pixels& background, std::optional<int> refinement,
                      std::vector<float>* depths) {
    const Camera camera = cameraOf(panes_[i]);
    const int place = static_cast<int>(i), samples = movingSamples_.now();
    PanePicture& picture = panePictures_[i];
    if (window_.directly() && !depths && !framesInFront()) {
        picture = {{},
                   {},
                   scene.drawOnDevice(mesh, camera, view(), shade, background, place, samples,
                                      refinement)};
        return;
    }
    picture.onDevice.reset();
    picture.pixels = refinement ? scene.refine(mesh, camera, view(), shade, *background, place,
                                               *refinement, std::move(picture.pixels), depths)
                                : scene.draw(mesh, camera, view(), shade, *background, samples,
                                             std::move(picture.pixels), depths);
}

// Gives the scene this texture, unless it has it.
void Viewer::useTexture(TextureKind kind) {
    std::pair wanted{kind, textureVersion_};
    if (sceneTexture_ == wanted) return;
    scene_->setTexture(textures_.at(kind));
    sceneTexture_ = wanted;
}

// Takes what the painter has finished, and asks for what the view lacks.
void Viewer::updateTextures() {
    if (std::optional<Painter::Painting> done = painter_->take()) {
        textures_[done->kind] = std::move(done->texture);
        painted_[done->kind] = done->version;
        // The first one pays for the pipelines.
        paintSeconds_ = std::min(done->seconds, 2 * paintSeconds_);
        times_.paint = 1e3 * done->seconds;
        ++textureVersion_;
        framesToDraw_ = std::max(framesToDraw_, 1);
    }
    if (panes_.empty() || painter_->busy() || !shown_) return;
    if (interacting() && paintSeconds_ > kFastPainter) return;
    for (const Pane& pane : panes_) {
        if (pane.other || !paintsViews(pane.texture) || settings_.paint != kPaintTexture) continue;
        auto painted = painted_.find(pane.texture);
        if (painted != painted_.end() && painted->second == viewVersion_) continue;
        painter_->ask(pane.texture, scene_->vertices(pane.mesh, view()), viewVersion_);
        return;
    }
}

}  // namespace doppel
