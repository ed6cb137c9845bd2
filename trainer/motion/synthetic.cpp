#include "trainer/motion/synthetic.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <future>
#include <glm/gtc/quaternion.hpp>

#include "engine/files/npz.h"
#include "engine/files/share.h"
#include "engine/io/image.h"
#include "trainer/data/body_render.h"
#include "trainer/data/capture_writer.h"
#include "trainer/data/random.h"

namespace doppel {

namespace {

glm::dvec3 randomDirection(uint64_t seed, uint64_t number) {
    double z = 2 * uniformOf(seed, 2 * number) - 1,
           phi = 6.283185307 * uniformOf(seed, 2 * number + 1);
    double r = std::sqrt(1 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
}

// A pose as a tracker would see it: every joint turned by `degrees`, the body moved by `metres`.
void disturb(Theta& theta, Trans& trans, double degrees, double metres, uint64_t seed) {
    for (size_t joint = 0; joint < theta.size() / 3; ++joint) {
        glm::dvec3 v(theta[3 * joint], theta[3 * joint + 1], theta[3 * joint + 2]);
        double angle = glm::length(v);
        glm::dquat q = angle > 0 ? glm::angleAxis(angle, v / angle) : glm::dquat(1, 0, 0, 0);
        q = q * glm::angleAxis(glm::radians(degrees), randomDirection(seed, joint));
        if (q.w < 0) q = -q;  // glm::angle() loses the digits of angles near a full turn
        glm::dvec3 turned = glm::axis(q) * glm::angle(q);
        for (int k = 0; k < 3; ++k)
            theta[3 * joint + static_cast<size_t>(k)] = static_cast<float>(turned[k]);
    }
    glm::dvec3 shift = metres * randomDirection(seed, kJointCount);
    for (int k = 0; k < 3; ++k) trans[static_cast<size_t>(k)] += static_cast<float>(shift[k]);
}

// A grey-blue wall that darkens to the corners, over a floor.
std::array<float, 3> studioColour(double u, double v) {
    double dx = u - 0.5, dy = v - 0.45;
    double fade = 1 - 0.55 * (dx * dx + dy * dy);
    if (v > 0.93) return {float(.46 * fade), float(.44 * fade), float(.42 * fade)};
    return {float(.62 * fade), float(.66 * fade), float(.70 * fade)};
}

}  // namespace

std::filesystem::path assetFolder() {
    if (const char* set = std::getenv("DOPPEL_ASSETS")) return set;
    const std::filesystem::path source = sourceFolder();
    return source.empty() ? shareFolder() : source / "assets";
}

Camera syntheticCamera(int size) {
    // A person of 1.8 m with raised arms fills most of the picture at kActorDistance.
    double f = 1.45 * size;
    return {f, f, size / 2.0, size / 2.0, size, size};
}

std::vector<std::string> actorNames(const std::filesystem::path& folder) {
    std::vector<std::string> names;
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
        std::filesystem::path picture = entry.path();
        if (picture.extension() == ".npz" &&
            std::filesystem::exists(picture.replace_extension(".png"), ignored))
            names.push_back(picture.stem().string());
    }
    std::sort(names.begin(), names.end());
    return names;
}

Actor readActor(const std::filesystem::path& folder, const std::string& name) {
    std::filesystem::path file = folder / (name + ".npz"), picture = folder / (name + ".png");
    Npz arrays = readNpz(file);
    if (!arrays.has("shapedirs")) {  // an actor has one shape, its own
        int64_t vertices = arrays.at("v_template").requireShape({-1, 3}).shape[0];
        std::vector<float> zeros(static_cast<size_t>(vertices) * 30);
        arrays.set("shapedirs", Array::f32({vertices, 3, 10}, zeros));
    }
    Actor actor{bodyFromNpz(arrays), {}, 0};
    Image image = readImage(picture, 3);
    if (image.width != image.height)
        throwInput("{}: expected a square texture, found {}×{}", picture.string(), image.width,
                   image.height);
    actor.textureSize = image.width;
    for (uint8_t byte : image.data) actor.texture.push_back(static_cast<float>(byte) / 255.0f);
    return actor;
}

std::vector<float> studioLamp() {
    // max(0, d . n) is 1/4 (1 + 2 d . n + 1/4 sum_k Y_k(d) Y_k(n)) up to the second degree.
    const glm::dvec3 d = glm::normalize(glm::dvec3(-.7, -.5, -.5));  // camera space: y down
    const glm::dvec3 strength(.12, .11, .09);                        // red, green, blue
    const double k1 = 2 / std::sqrt(3), k2 = std::sqrt(15) / 4;
    const std::array rows{k1 * d.y,       k1 * d.z,
                          k1 * d.x,       k2 * d.x * d.y,
                          k2 * d.y * d.z, std::sqrt(5) / 8 * (3 * d.z * d.z - 1),
                          k2 * d.x * d.z, k2 / 2 * (d.x * d.x - d.y * d.y)};
    std::vector<float> light;
    for (double row : rows)
        for (int c = 0; c < 3; ++c) light.push_back(static_cast<float>(row * strength[c]));
    return light;
}

Capture renderActor(Device& device, const Actor& actor, const std::vector<MotionFrame>& motion,
                    const std::filesystem::path& out, const SyntheticOptions& options) {
    BodyPoser poser(device, actor.body);
    MeshDrawer drawer(device, actor.body, options.light);
    CaptureWriter writer(out);
    Capture capture;
    capture.name = "synthetic actor";
    capture.source["made_by"] = "doppel demo: a synthetic actor, rendered";
    Camera camera = syntheticCamera(options.size);
    std::vector<Theta> trueTheta;
    std::vector<Trans> trueTrans;
    const int size = options.size;
    auto nameOf = [&](size_t i) { return fmt::format("{:04}_{}", i, motion[i].motion); };
    auto keep = [&](size_t i, const Drawing& drawing) {
        std::vector<uint8_t> rgb, mask;
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) {
                size_t pixel =
                    static_cast<size_t>(y) * static_cast<size_t>(size) + static_cast<size_t>(x);
                float share = static_cast<float>(drawing.mask[pixel]) / 255.0f;
                auto wall = studioColour((x + 0.5) / size, (y + 0.5) / size);
                for (size_t c = 0; c < 3; ++c) {
                    float value = drawing.rgb[3 * pixel + c] + (1 - share) * wall[c];
                    rgb.push_back(
                        static_cast<uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f))));
                }
                mask.push_back(share >= 0.5f ? 255 : 0);
            }
        writer.addImage(nameOf(i), size, size, rgb);
        writer.addMask(nameOf(i), size, size, mask);
    };
    std::future<void> keeping;  // a frame is encoded while the device draws the next one
    for (size_t i = 0; i < motion.size(); ++i) {
        PosedMesh posed = poser.pose(motion[i].theta, motion[i].trans, {});
        // Drawn large and averaged: the samples that hit nothing are the background's share.
        Drawing drawing =
            drawer.draw(posed.verts, camera, actor.texture, actor.textureSize, options.samples);
        if (keeping.valid()) keeping.get();
        keeping = std::async(std::launch::async, keep, i, std::move(drawing));
        Theta theta = motion[i].theta;
        Trans trans = motion[i].trans;
        trueTheta.push_back(theta);
        trueTrans.push_back(trans);
        disturb(theta, trans, options.poseNoiseDegrees, options.transNoiseMetres,
                options.seed * 1000003 + i);
        Frame frame;
        frame.name = nameOf(i);
        frame.camera = camera;
        capture.frames.push_back(frame);
        capture.theta.push_back(theta);
        capture.trans.push_back(trans);
    }
    if (keeping.valid()) keeping.get();
    writeNpz(writer.folder() / "truth.npz", posesArrays(trueTheta, trueTrans, {}), true);
    return writer.commit(capture);
}

}  // namespace doppel
