#include "trainer/motion/hand_held.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <glm/gtc/quaternion.hpp>
#include <numeric>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "engine/io/image.h"
#include "engine/io/video.h"
#include "trainer/data/body_render.h"
#include "trainer/data/output_folder.h"
#include "trainer/data/progress.h"
#include "trainer/data/random.h"
#include "trainer/motion/room.h"

namespace doppel {

namespace {

using glm::dvec3;

constexpr double kPi = 3.14159265358979;
constexpr double kLooksDown = 5;  // degrees

// A sum of slow and quick swings with phases of its own, about 1 in size.
double sway(uint64_t seed, uint64_t number, double seconds) {
    constexpr std::array<std::array<double, 2>, 4> kSwings{
        {{.11, .6}, {.37, .5}, {.9, .25}, {2.3, .08}}};  // Hz, size
    double sum = 0;
    for (size_t k = 0; k < kSwings.size(); ++k) {
        const double phase = uniformOf(seed, 16 * number + k);
        sum += kSwings[k][1] * std::sin(2 * kPi * (kSwings[k][0] * seconds + phase));
    }
    return sum;
}

// From the room to the camera at a moment.
RigidMotion cameraAt(const HandHeldOptions& options, double seconds) {
    glm::dquat turn = glm::angleAxis(glm::radians(kLooksDown), dvec3(1, 0, 0));
    dvec3 place(0);
    if (!options.still) {
        const auto swing = [&](uint64_t number) { return sway(options.seed, number, seconds); };
        place = dvec3(.03, .02, .03) * dvec3(swing(0), swing(1), swing(2));
        const dvec3 tilt = glm::radians(dvec3(.8, .9, .6) * dvec3(swing(3), swing(4), swing(5)));
        turn = quaternionOf(tilt) * turn;
    }
    const glm::dmat3 rotation = glm::mat3_cast(turn);
    return {rotation, -(rotation * place)};
}

struct Drawn {
    Drawing drawing;
    double depth = 0;
};

// Factors of red, green and blue, encoded: exposure and white balance.
dvec3 gainAt(const HandHeldOptions& options, double seconds) {
    if (options.still) return dvec3(1);
    const double stops = .25 * sway(options.seed, 6, seconds);
    const double warm = .025 * sway(options.seed, 7, seconds);
    return std::pow(2., stops / 2.2) * dvec3(1 + warm, 1, 1 - warm);
}

// Two triangular distributions' worth of noise of one value, about 1 in size.
float noiseOf(uint64_t seed, uint64_t number) {
    return float(2.4 * (uniformOf(seed, 2 * number) + uniformOf(seed, 2 * number + 1) - 1));
}

struct Moment {
    RigidMotion toCamera;
    Camera camera;
    double seconds = 0;
    uint64_t number = 0;
    std::vector<Drawn> people;  // as the performers
    std::vector<dvec3> feet;    // in the room
};

struct Filmed {
    Image picture, mask;
};

// Rows [begin, end) of a moment's picture.
void filmRows(const Moment& moment, const Room& room, const HandHeldOptions& options, int begin,
              int end, Filmed& filmed) {
    constexpr float kNoise = 1.6f / 255;
    const Camera& camera = moment.camera;
    const glm::dmat3 back = glm::transpose(moment.toCamera.rotation);
    const dvec3 origin = -(back * moment.toCamera.translation);
    const dvec3 gain = gainAt(options, moment.seconds);
    std::vector<size_t> order(moment.people.size());  // the farthest first
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::sort(
        order, [&](size_t a, size_t b) { return moment.people[a].depth > moment.people[b].depth; });
    const auto side = size_t(options.samples);
    for (int y = begin; y < end; ++y) {
        for (int x = 0; x < camera.width; ++x) {
            std::array<float, 3> colour{};
            for (size_t s = 0; s < side * side; ++s) {
                const double u = x + (double(s % side) + .5) / double(side),
                             v = y + (double(s / side) + .5) / double(side);
                const dvec3 ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1);
                const auto seen =
                    options.plain ? options.screen : room.colour(origin, back * ray, moment.feet);
                for (size_t c = 0; c < 3; ++c) colour[c] += seen[c] / float(side * side);
            }
            const size_t pixel = size_t(y) * size_t(camera.width) + size_t(x);
            float first = 0;  // the share of the first performer
            for (size_t p : order) {
                const Drawing& drawing = moment.people[p].drawing;
                const float share = float(drawing.mask[pixel]) / 255;
                for (size_t c = 0; c < 3; ++c)
                    colour[c] = drawing.rgb[3 * pixel + c] + (1 - share) * colour[c];
                first = p == 0 ? share : (1 - share) * first;
            }
            for (size_t c = 0; c < 3; ++c) {
                const float noise = kNoise * noiseOf(options.seed + moment.number, 3 * pixel + c);
                const float value = colour[c] * float(gain[glm::length_t(c)]) + noise;
                filmed.picture.data[3 * pixel + c] =
                    uint8_t(std::lround(255 * std::clamp(value, 0.f, 1.f)));
            }
            filmed.mask.data[pixel] = first >= .5f ? 255 : 0;
        }
    }
}

}  // namespace

void filmHandHeld(Device& device, std::span<const Performer> performers,
                  const std::filesystem::path& clip, const std::filesystem::path& truth,
                  const HandHeldOptions& options) {
    CHECK(!performers.empty() && !performers[0].motion.empty(), "somebody is filmed");
    const size_t frames = performers[0].motion.size();
    const int w = options.width, h = options.height;
    const double focal =
        std::max(w, h) / (2 * std::tan(glm::radians(options.longerSideDegrees) / 2));
    const Camera camera{focal, focal, w / 2., h / 2., w, h};
    std::vector<std::unique_ptr<BodyPoser>> posers;
    std::vector<std::unique_ptr<MeshDrawer>> drawers;
    for (const Performer& performer : performers) {
        CHECK(performer.motion.size() == frames, "performers move for equally long");
        posers.push_back(std::make_unique<BodyPoser>(device, performer.actor->body));
        drawers.push_back(std::make_unique<MeshDrawer>(device, performer.actor->body));
    }
    OutputFolder folder(truth, "truth");
    createFolders(folder.folder() / "masks");
    VideoWriter video(clip, w, h, options.fps);
    const Room room(options.seed);
    std::vector<Theta> thetas;
    std::vector<Trans> transs;
    std::vector<float> joints;
    const auto keep = [&](const Moment& moment) {
        Filmed filmed{Image(w, h, 3), Image(w, h, 1)};
        auto lower = std::async(std::launch::async,
                                [&] { filmRows(moment, room, options, h / 2, h, filmed); });
        filmRows(moment, room, options, 0, h / 2, filmed);
        lower.get();
        video.add(filmed.picture);
        writeImage(folder.folder() / "masks" / fmt::format("{:06}.png", moment.number),
                   filmed.mask);
    };
    std::future<void> keeping;  // a frame is filmed while the device draws the next one's people
    Progress progress("film", int64_t(frames));
    for (size_t f = 0; f < frames; ++f) {
        if (interrupted()) throw Interrupted{};
        progress.update(int64_t(f) + 1);
        Moment moment{.camera = camera, .seconds = double(f) / options.fps, .number = f};
        moment.toCamera = cameraAt(options, moment.seconds);
        for (size_t p = 0; p < performers.size(); ++p) {
            Theta theta = performers[p].motion[f].theta;
            Trans trans = performers[p].motion[f].trans;
            // The lowest point stands on the floor.
            const PosedMesh stood = posers[p]->pose(theta, trans, {});
            float lowest = -1e9f;
            for (size_t i = 1; i < stood.verts.size(); i += 3)
                lowest = std::max(lowest, stood.verts[i]);
            const float down = float(Room::kFloor) - lowest;
            trans[1] += down;
            for (size_t foot : {joint::kLeftAnkle, joint::kRightAnkle}) {
                const auto& at = stood.joints[foot];
                moment.feet.push_back({at[0], Room::kFloor, at[2]});
            }
            movePose(moment.toCamera, theta, trans);
            const PosedMesh posed = posers[p]->pose(theta, trans, {});
            const Actor& actor = *performers[p].actor;
            moment.people.push_back({drawers[p]->draw(posed.verts, camera, actor.texture,
                                                      actor.textureSize, options.samples + 1),
                                     posed.joints[joint::kPelvis][2]});
            if (p > 0) continue;
            thetas.push_back(theta);
            transs.push_back(trans);
            for (const auto& joint : posed.joints)
                for (double v : joint) joints.push_back(float(v));
        }
        if (keeping.valid()) keeping.get();
        keeping = std::async(std::launch::async, [&keep, m = std::move(moment)] { keep(m); });
    }
    keeping.get();
    video.finish();
    Npz poses = posesArrays(thetas, transs, {});
    poses.set("joints", Array::f32({int64_t(frames), kJointCount, 3}, joints));
    writeNpz(folder.folder() / "poses.npz", poses, true);
    const std::vector<Camera> cameras(frames, camera);
    writeNpz(folder.folder() / "cameras.npz", camerasArrays(cameras), true);
    folder.commit();
}

}  // namespace doppel
