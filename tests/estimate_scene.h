// A person whose poses are known, before a clip's camera, and masks of it: what the tests of other
// estimators' poses have in common. Programs' files are written as we know their layouts.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "nn/body/body.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "tests/pickle_writer.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/body_render.h"
#include "trainer/data/capture_writer.h"
#include "trainer/import/given_poses.h"
#include "trainer/motion/session.h"
#include "trainer/person/body_start.h"

namespace doppel::test {

constexpr int kWidth = 240, kHeight = 180;  // of the clip
constexpr size_t kFrames = 6;
inline const glm::dvec3 kPelvis(kRestPelvis[0], kRestPelvis[1], kRestPelvis[2]);

inline std::string stem(size_t f) { return fmt::format("{:06}", f); }

// Somebody who walks across the picture, in the space of a camera.
struct Truth {
    Camera camera = cameraOfAngle(kWidth, kHeight, kGuessedAngle);
    std::vector<Theta> theta;
    std::vector<Trans> trans;
    Truth() {
        const auto session = actorSession(4, 8, 3.4f);
        for (size_t f = 0; f < kFrames; ++f) {
            const MotionFrame& frame = session[4 + f];
            theta.push_back(frame.theta);
            trans.push_back({-.5f + .2f * static_cast<float>(f), .25f, 3.6f});
        }
    }
    glm::dvec3 pelvis(size_t f) const {
        return kPelvis + glm::dvec3(trans[f][0], trans[f][1], trans[f][2]);
    }
    // As a program that sees the person on its optical axis has the first joint.
    Theta seenOnAxis(size_t f) const {
        Theta seen = theta[f];
        const glm::dvec3 ray = glm::normalize(pelvis(f)), axis(0, 0, 1);
        const glm::dvec3 about = glm::cross(axis, ray);
        const glm::dquat turn = glm::normalize(glm::dquat(1 + ray.z, about.x, about.y, about.z));
        setJointRotation(seen, 0, glm::conjugate(turn) * jointRotation(seen, 0));
        return seen;
    }
    // Where the pelvis is in the picture, and how many pixels a metre has there.
    std::array<double, 3> sight(size_t f) const {
        const glm::dvec3 p = pelvis(f);
        const auto [u, v] = camera.project({p.x, p.y, p.z});
        return {u, v, camera.fx / p.z};
    }
};

inline std::vector<double> numbers(const auto& values) { return {values.begin(), values.end()}; }
inline void add(std::vector<double>& to, const auto& values) {
    to.insert(to.end(), values.begin(), values.end());
}
inline std::vector<double> matrices(const Theta& theta, size_t first, size_t count) {
    std::vector<double> all;
    for (size_t j = first; j < first + count; ++j) {
        const glm::dmat3 m = glm::mat3_cast(jointRotation(theta, j));
        for (int row = 0; row < 3; ++row)
            for (int column = 0; column < 3; ++column) all.push_back(m[column][row]);
    }
    return all;
}

inline void write(const Folder& folder, const char* name, const py::Value& value) {
    folder.write(name, py::pickle(value));
}

// ---- a capture with masks of the truth ----------------------------------------------------------

class Scene {
public:
    explicit Scene(const std::filesystem::path& folder, const Truth& truth = {}, size_t every = 1)
        : body_(bodyFromNpz(readBodyArrays("default"))),
          poser_(testDevice(), body_),
          drawer_(testDevice(), body_) {
        CaptureWriter writer(folder);
        for (size_t f = 0; f < kFrames; f += every) {
            Frame frame;
            frame.name = stem(f);
            frame.camera = truth.camera;
            const auto mask = draw_(truth.camera, truth.theta[f], truth.trans[f], {}).mask;
            writer.addImage(frame.name, kWidth, kHeight,
                            std::vector<uint8_t>(size_t(3 * kWidth * kHeight), 90));
            writer.addMask(frame.name, kWidth, kHeight, mask);
            capture.frames.push_back(frame);
            Theta upright{};
            upright[0] = 3.14159f;
            capture.theta.push_back(upright);
            capture.trans.push_back({0, 0, 2});
        }
        capture.source["camera"] = "guessed";
        capture = writer.commit(capture);
    }
    GivenPoses take(const std::filesystem::path& poses,
                    const std::filesystem::path& source = "clip.mp4",
                    const std::filesystem::path& workspace = {}) {
        return takeGivenPoses(capture, {poses, source, workspace}, draw_);
    }
    double overlap(size_t frame) {
        FrameCache cache(capture);
        return intersection(cache.load(frame)->mask,
                            draw_(capture.frames[frame].camera, capture.theta[frame],
                                  capture.trans[frame], capture.betas)
                                .mask);
    }

    Capture capture;

private:
    static double intersection(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
        double both = 0, any = 0;
        for (size_t i = 0; i < a.size(); ++i) both += a[i] && b[i], any += a[i] || b[i];
        return both / any;
    }
    BodyModel body_;
    BodyPoser poser_;
    MeshDrawer drawer_;
    DrawBody draw_ = [this](const Camera& camera, const Theta& theta, const Trans& trans,
                            const Betas& betas) {
        return BodyPicture{drawer_.mask(poser_.pose(theta, trans, betas).verts, camera), {}};
    };
};

inline double degreesApart(const Theta& a, const Theta& b) {
    double worst = 0;
    for (size_t j = 0; j < 22; ++j)
        worst = std::max(worst, glm::length(axisAngleOf(jointRotation(a, j) *
                                                        glm::conjugate(jointRotation(b, j)))));
    return worst * 180 / 3.14159265358979;
}

// The poses of the frames are the truth's. metres: a tolerance, wider where our body is moved to
// fill the mask as high, which is measured in whole pixels.
inline void expectTruth(Scene& scene, const Truth& truth, double metres = .06, size_t every = 1) {
    ASSERT_EQ(scene.capture.size(), (kFrames + every - 1) / every);
    for (size_t i = 0; i < scene.capture.size(); ++i) {
        const size_t f = i * every;
        SCOPED_TRACE(f);
        EXPECT_LT(degreesApart(scene.capture.theta[i], truth.theta[f]), .1);
        for (size_t c = 0; c < 3; ++c)
            EXPECT_NEAR(scene.capture.trans[i][c], truth.trans[f][c], metres) << c;
        EXPECT_NEAR(scene.capture.frames[i].camera.fx, truth.camera.fx, 1e-6 * truth.camera.fx);
        EXPECT_GT(scene.overlap(i), .94);
    }
}

struct Person {
    std::vector<size_t> frames;
    double across = 0;  // pixels to the right of the truth
};
inline const Person kTruth{{0, 1, 2, 3, 4, 5}};

// One person of VIBE.
inline py::Value vibePerson(const Truth& truth, const Person& person) {
    std::vector<double> pose, cam, boxes, ids;
    for (const size_t f : person.frames) {
        const auto [u, v, pixels] = truth.sight(f);
        const double side = 130 + 3 * static_cast<double>(f), half = side / 2;
        const double x = u + person.across + 4, y = v - 6;  // of the box
        add(pose, truth.seenOnAxis(f));
        add(cam, std::vector<double>{pixels / half, (u + person.across - x) / pixels - kPelvis.x,
                                     (v - y) / pixels - kPelvis.y});
        add(boxes, std::vector<double>{x, y, side, side});
        ids.push_back(static_cast<double>(f));
    }
    const auto count = static_cast<int64_t>(person.frames.size());
    std::vector<py::Value> idList;
    for (const double id : ids) idList.push_back(py::integer(static_cast<int64_t>(id)));
    return py::dict({{py::text("pred_cam"), py::joblibArray({count, 3}, cam)},
                     {py::text("verts"),
                      py::joblibArray({count, 2, 3}, std::vector<double>(size_t(6 * count)))},
                     {py::text("pose"), py::joblibArray({count, 72}, pose)},
                     {py::text("betas"),
                      py::joblibArray({count, 10}, std::vector<double>(size_t(10 * count), .5))},
                     {py::text("joints2d"), py::none()},
                     {py::text("bboxes"), py::joblibArray({count, 4}, boxes)},
                     {py::text("frame_ids"), py::list(idList)}});
}

}  // namespace doppel::test
