// Files of other programs that estimate poses, of the person of tests/estimate_scene.h.
#pragma once

#include "engine/files/npz.h"
#include "tests/estimate_scene.h"

namespace doppel::test {

// What PHALP keeps of the pictures from `first` on, which it counts from 0; their names from 1.
inline py::Value phalp(const Truth& truth, size_t first) {
    const double focal = 5000. / 256 * kWidth;
    std::vector<std::pair<py::Value, py::Value>> frames;
    for (size_t f = first; f < kFrames; ++f) {
        const Theta seen = truth.seenOnAxis(f);
        const auto [u, v, pixels] = truth.sight(f);
        const double depth = focal / pixels;
        const std::vector<double> camera{(u - kWidth / 2.) / pixels - kPelvis.x,
                                         (v - kHeight / 2.) / pixels - kPelvis.y,
                                         depth - kPelvis.z};
        const auto smpl =
            py::dict({{py::text("global_orient"), py::joblibArray({1, 3, 3}, matrices(seen, 0, 1))},
                      {py::text("body_pose"), py::joblibArray({23, 3, 3}, matrices(seen, 1, 23))},
                      {py::text("betas"), py::joblibArray({10}, std::vector<double>(10))}});
        // The second track was last seen in picture 1, and is repeated with what it was there.
        const bool lost = f > 1;
        frames.push_back(
            {py::text(fmt::format("outputs/_DEMO/clip/img/{:06}.jpg", f + 1)),
             py::dict({{py::text("time"), py::integer(int64_t(f - first))},
                       {py::text("shot"), py::integer(0)},
                       {py::text("tracked_ids"), py::list({py::integer(3)})},
                       {py::text("tid"), py::list({py::integer(3), py::integer(4)})},
                       {py::text("tracked_time"),
                        py::list({py::integer(0), py::integer(lost ? int64_t(f) - 1 : 0)})},
                       {py::text("size"), py::list({py::integer(kHeight), py::integer(kWidth)})},
                       {py::text("smpl"), py::list({smpl, smpl})},
                       {py::text("camera"), py::list({py::joblibArray({3}, camera),
                                                      py::joblibArray({3}, {4, 0, depth})})}})});
    }
    return py::dict(frames);
}

// GVHMR's results, with body poses of `width` numbers. What it follows in the world is the same
// here as in the camera.
inline void writeGvhmr(const std::filesystem::path& file, const Truth& truth, int64_t width = 63,
                       const char* storage = "FloatStorage") {
    std::vector<double> orient, body, transl, zeros(10 * kFrames), k;
    const Camera& c = truth.camera;
    for (size_t f = 0; f < kFrames; ++f) {
        const auto& theta = truth.theta[f];
        add(orient, std::span(theta).subspan(0, 3));
        add(body, std::span(theta).subspan(3, size_t(width)));
        // SMPL-X's pelvis rests 13 cm lower.
        const glm::dvec3 t = truth.pelvis(f) - glm::dvec3(.0031, -.3514, .0120);
        add(transl, std::vector<double>{t.x, t.y, t.z});
        add(k, std::vector<double>{c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1});
    }
    py::Torch torch;
    const auto params = [&] {
        return py::dict({{py::text("body_pose"), torch.tensor({6, width}, body)},
                         {py::text("betas"), torch.tensor({6, 10}, zeros)},
                         {py::text("global_orient"), torch.tensor({6, 3}, orient, storage)},
                         {py::text("transl"), torch.tensor({6, 3}, transl)}});
    };
    torch.save(file,
               py::dict({{py::text("smpl_params_global"), params()},
                         {py::text("smpl_params_incam"), params()},
                         {py::text("K_fullimg"), torch.tensor({6, 3, 3}, k)},
                         {py::text("net_outputs"),
                          py::dict({{py::text("model_output"),
                                     py::dict({{py::text("pred_x"),
                                                torch.tensor({1, 6}, {1, 2, 3, 4, 5, 6})}})}})}}));
}

// ROMP's results of two people in all pictures but the third one, of bodies that stand about
// `rest`.
inline void writeRomp(const std::filesystem::path& file, const Truth& truth,
                      const glm::dvec3& rest) {
    std::vector<std::pair<py::Value, py::Value>> pictures;
    for (size_t f = 0; f < kFrames; ++f) {
        const auto [u, v, pixels] = truth.sight(f);
        const double s = pixels / (kWidth / 2.);
        std::vector<double> thetas = numbers(truth.seenOnAxis(f)),
                            cam{s, (u - kWidth / 2.) / (kWidth / 2.) - s * rest.x,
                                (v - kHeight / 2.) / (kWidth / 2.) - s * rest.y};
        add(thetas, thetas);
        add(cam, std::vector<double>{s, .9, .9});
        pictures.push_back(
            {py::text(fmt::format("{:08}.jpg", f)),
             f == 3 ? py::dict({})
                    : py::dict({{py::text("cam"), py::array({2, 3}, cam)},
                                {py::text("smpl_thetas"), py::array({2, 72}, thetas)},
                                {py::text("track_ids"), py::array({2}, {5, 2})},
                                {py::text("cam_trans"), py::array({2, 3}, {0, 0, 9, 0, 0, 9})}})});
    }
    py::savezObject(file, "results", py::dict(pictures));
}

inline void writeSpin(const std::filesystem::path& file, const Truth& truth) {
    std::vector<float> pose, betas(10 * kFrames), camera;
    for (size_t f = 0; f < kFrames; ++f) {
        const Theta seen = truth.seenOnAxis(f);
        pose.insert(pose.end(), seen.begin(), seen.end());
        camera.insert(camera.end(), {.9f, 0, .1f});
    }
    Npz npz;
    npz.set("pose", Array::f32({6, 72}, pose));
    npz.set("betas", Array::f32({6, 10}, betas));
    npz.set("camera", Array::f32({6, 3}, camera));
    writeNpz(file, npz, false);
}

}  // namespace doppel::test
