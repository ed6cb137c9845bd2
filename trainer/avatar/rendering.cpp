#include "trainer/avatar/rendering.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <future>
#include <glm/gtc/quaternion.hpp>

#include "engine/io/image.h"
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/background.h"
#include "trainer/avatar/export.h"
#include "trainer/avatar/films/colour_match.h"
#include "trainer/avatar/films/picture_sequence.h"
#include "trainer/avatar/sheet.h"
#include "trainer/avatar/training_poses.h"
#include "trainer/data/pose.h"
#include "trainer/data/progress.h"
#include "trainer/motion/session.h"
#include "trainer/motion/smooth.h"
#include "trainer/motion/upright.h"

namespace doppel {

Retargeted performed(const Avatar& avatar, const std::filesystem::path& folder, Motion motion,
                     const RetargetSettings& settings, double smooth) {
    const std::vector<TrainedFrame> known = trainedFrames(folder, motion);
    if (settings.on) takeTrainingPoses(known, motion);
    Retargeted result = retargetTo({avatar.body, avatar.betas, !known.empty()},
                                   smoothed(std::move(motion), smooth), settings);
    result.found = settings.on ? known.size() : 0;
    if (result.found > 0)
        result.summary = fmt::format(
            "the poses that training found for {} of its {} frames are taken; "
            "--retarget off leaves them as the capture has them{}{}",
            known.size(), result.motion.size(), result.summary.empty() ? "" : "; ", result.summary);
    return result;
}

Shot restShot(Device& device, const Avatar& avatar, int size) {
    Shot shot{};
    std::array<float, 3> root = uprightOrientation(0);
    std::ranges::copy(root, shot.theta.begin());
    shot.theta[3 * 16 + 2] = -0.9f;  // both arms lowered
    shot.theta[3 * 17 + 2] = 0.9f;
    double focal = 1.45 * size;
    shot.camera = {focal, focal, size / 2.0, size / 2.0, size, size};
    // As far away as its height asks for, the middle of the body on the axis.
    BodyPoser poser(device, avatar.body);
    PosedMesh posed = poser.pose(shot.theta, {0, 0, 0}, avatar.betas);
    float top = INFINITY, bottom = -INFINITY;
    for (size_t i = 1; i < posed.verts.size(); i += 3) {
        top = std::min(top, posed.verts[i]);
        bottom = std::max(bottom, posed.verts[i]);
    }
    shot.trans = {0, -(top + bottom) / 2, (bottom - top) * 1.45f * 1.12f};
    return shot;
}

Shot turned(const Shot& shot, double turns) {
    // The camera going round one way is the body turning the other.
    Shot result = shot;
    setJointRotation(result.theta, 0,
                     glm::angleAxis(6.283185307179586 * turns, glm::dvec3(0, 1, 0)) *
                         jointRotation(shot.theta, 0));
    return result;
}

Motion inCameraSpace(Motion motion) {
    const glm::dquat turn = glm::dquat(0, 1, 0, 0) * uprightRotation(motion);
    if (std::abs(turn.w) > 1 - 1e-12) return motion;
    const glm::dvec3 pelvis(kRestPelvis[0], kRestPelvis[1], kRestPelvis[2]);
    for (size_t i = 0; i < motion.size(); ++i) {
        setJointRotation(motion.theta[i], 0, turn * jointRotation(motion.theta[i], 0));
        Trans& trans = motion.trans[i];
        const glm::dvec3 place =
            turn * (pelvis + glm::dvec3(trans[0], trans[1], trans[2])) - pelvis;
        for (int k = 0; k < 3; ++k) trans[static_cast<size_t>(k)] = static_cast<float>(place[k]);
    }
    return motion;
}

std::vector<Shot> throughOwnCameras(const Motion& motion) {
    if (motion.cameras.empty())
        throwInput("{}: it has poses but no cameras; use --camera turntable or a cameras.npz",
                   motion.source.string());
    std::vector<Shot> shots;
    for (size_t i = 0; i < motion.size(); ++i)
        shots.push_back({motion.theta[i], motion.trans[i], motion.cameras[i]});
    return shots;
}

std::vector<float> plainBackground(const std::string& colour, const Camera& camera) {
    if (colour.size() != 7 || colour[0] != '#' ||
        colour.find_first_not_of("0123456789abcdefABCDEF", 1) != std::string::npos)
        throwInput("--background: expected a colour as #rrggbb, found \"{}\"", colour);
    std::array<float, 3> rgb{};
    for (size_t c = 0; c < 3; ++c) {
        int value = 0;
        const char* begin = colour.data() + 1 + 2 * c;
        std::from_chars(begin, begin + 2, value, 16);
        rgb[c] = static_cast<float>(value) / 255.0f;
    }
    std::vector<float> picture;
    size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
    for (size_t i = 0; i < pixels; ++i) picture.insert(picture.end(), rgb.begin(), rgb.end());
    return picture;
}

double renderShots(Device& device, const Avatar& avatar, const std::vector<Shot>& shots,
                   const Layers& layers, const std::filesystem::path& out, double fps,
                   const std::string& what, TextureKind texture,
                   const std::optional<SoundSource>& sound) {
    CHECK(!shots.empty(), "there is something to render");
    const bool film = isFilm(out);
    for (const Shot& shot : shots)
        if (film && (shot.camera.width != shots[0].camera.width ||
                     shot.camera.height != shots[0].camera.height))
            throwInput("{}: a film needs frames of one size; give --size or a folder",
                       out.string());
    PictureSequence pictures(out, shots[0].camera.width, shots[0].camera.height, fps,
                             {.alpha = !layers.background, .sound = sound});

    // Bodies without the mesh network's changes are near enough for a shadow.
    std::optional<BodyPoser> poser;
    CHECK(layers.grounds.empty() || layers.grounds.size() == shots.size(),
          "each shot has a ground, or none");
    if (!layers.grounds.empty()) poser.emplace(device, avatar.body);

    AvatarRenderer renderer(device, avatar, true, texture);
    ColourMatch match;
    Image before;
    double difference = 0;
    size_t compared = 0;
    auto keep = [&](size_t i, Drawing drawing, const std::vector<float>& verts) {
        const Camera& camera = shots[i].camera;
        std::vector<float> behind;
        if (layers.background) behind = layers.background(i);
        if (layers.background && layers.matchColours) match.apply(drawing, behind);
        if (poser)
            addShadow(drawing, contactShadow(verts, avatar.body.faces, layers.grounds[i], camera));
        if (layers.occluder) occlude(drawing, layers.occluder(i));
        Image image = layers.background ? toImage(composite(drawing.rgb, drawing.mask, behind),
                                                  camera.width, camera.height)
                                        : straightAlpha(drawing, film);
        pictures.add(image);
        // Colours that nothing covers are not seen to change.
        if (!layers.background) image = toImage(drawing.rgb, camera.width, camera.height);
        if (i > 0 && image.data.size() == before.data.size() && image.width == before.width) {
            for (size_t k = 0; k < image.data.size(); ++k)
                difference += std::abs(int{image.data[k]} - int{before.data[k]});
            compared += image.data.size();
        }
        before = std::move(image);
    };
    std::optional<Progress> progress;
    if (!what.empty()) progress.emplace(what, static_cast<int64_t>(shots.size()));
    auto submit = [&](size_t i) {
        if (i < shots.size())
            renderer.submit(shots[i].theta, shots[i].trans, shots[i].camera, layers.samples);
    };
    std::future<void> keeping;  // a picture is encoded while the device draws the next one
    submit(0);
    for (size_t i = 0; i < shots.size(); ++i) {
        if (interrupted()) throw Interrupted{};
        submit(i + 1);
        Drawing drawing = renderer.take();
        if (keeping.valid()) keeping.get();
        std::vector<float> verts;
        if (poser) verts = poser->pose(shots[i].theta, shots[i].trans, avatar.betas).verts;
        keeping = std::async(std::launch::async, keep, i, std::move(drawing), std::move(verts));
        if (progress) progress->update(static_cast<int64_t>(i) + 1);
    }
    keeping.get();
    if (interrupted()) throw Interrupted{};
    pictures.finish();
    return compared > 0 ? difference / static_cast<double>(compared) : 0;
}

void writePreview(Device& device, const Avatar& avatar, const std::filesystem::path& path) {
    Shot rest = restShot(device, avatar, 384);
    AvatarRenderer renderer(device, avatar);
    Image preview(2 * 384, 384, 3, 255);
    for (int view = 0; view < 2; ++view) {
        Shot shot = turned(rest, view * 0.125);
        Drawing drawing = renderer.draw(shot.theta, shot.trans, shot.camera, 2);
        for (int y = 0; y < 384; ++y)
            for (int x = 0; x < 384; ++x) {
                size_t i = static_cast<size_t>(y * 384 + x);
                float rest1 = 1 - static_cast<float>(drawing.mask[i]) / 255.0f;
                for (size_t c = 0; c < 3; ++c)
                    preview.pixel(384 * view + x, y)[c] = static_cast<uint8_t>(
                        255 * std::clamp(drawing.rgb[3 * i + c] + rest1, 0.0f, 1.0f));
            }
    }
    writeImage(path, preview);
}

}  // namespace doppel
