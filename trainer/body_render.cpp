#include "trainer/body_render.h"

#include <cmath>

#include "nn/lbs.h"

namespace doppel {

BodyPoser::BodyPoser(Device& device, const BodyModel& body) : graph_(device) {
    theta_ = graph_.input({72});
    trans_ = graph_.input({3});
    beta_ = graph_.input({10});
    LbsModel model = lbsModel(graph_, body);
    Tensor rest =
        graph_.constant(std::span<const float>(body.templateVertices), {body.vertexCount, 3});
    PosedBody posed = lbs(graph_, model, rest, theta_, beta_, trans_);
    verts_ = posed.verts;
    joints_ = posed.joints;
    graph_.output(verts_);
    graph_.output(joints_);
    graph_.compile();
}

PosedMesh BodyPoser::pose(const Theta& theta, const Trans& trans, const Betas& betas) {
    graph_.write(theta_, std::span<const float>(theta));
    graph_.write(trans_, std::span<const float>(trans));
    graph_.write(beta_, std::span<const float>(betas));
    graph_.run();
    PosedMesh posed{graph_.read<float>(verts_), {}};
    std::vector<float> joints = graph_.read<float>(joints_);
    for (size_t j = 0; j + 2 < joints.size(); j += 3)
        posed.joints.push_back({joints[j], joints[j + 1], joints[j + 2]});
    return posed;
}

RasterCamera rasterCamera(const Camera& camera, double sigma, double blurRadius) {
    auto f = [](double value) { return static_cast<float>(value); };
    return {f(camera.fx), f(camera.fy), f(camera.cx), f(camera.cy), f(sigma), f(blurRadius), 0, 0};
}

// One size of picture; without a texture it gives the visibility buffer alone.
struct MeshDrawer::Recording {
    Graph graph;
    Tensor verts, camera, texture, image;
    VisibilityBuffer visibility;

    Recording(Device& device, const BodyModel& body, int width, int height, int textureSize)
        : graph(device) {
        verts = graph.input({body.vertexCount, 3});
        camera = graph.input(kCameraShape);
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        visibility = visibilityBuffer(graph, mesh, verts, camera, height, width);
        graph.output(visibility.mask);
        if (textureSize > 0) {
            Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
            RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);
            texture = graph.input({textureSize, textureSize, 3});
            image = texturedRender(graph, visibility, atlas, texture);
            graph.output(image);
        } else {
            graph.output(visibility.faceIndex);
        }
        graph.compile();
    }
};

MeshDrawer::MeshDrawer(Device& device, const BodyModel& body) : device_(device), body_(body) {}
MeshDrawer::~MeshDrawer() = default;

MeshDrawer::Recording& MeshDrawer::recording(int width, int height, int textureSize) {
    auto& slot = recordings_[{width, height, textureSize}];
    if (!slot) slot = std::make_unique<Recording>(device_, body_, width, height, textureSize);
    return *slot;
}

std::vector<uint8_t> MeshDrawer::mask(std::span<const float> verts, const Camera& camera) {
    Recording& r = recording(camera.width, camera.height, 0);
    r.graph.write(r.verts, verts);
    r.graph.write(r.camera, cameraValues(rasterCamera(camera)));
    r.graph.run();
    std::vector<uint8_t> mask;
    for (float value : r.graph.read<float>(r.visibility.mask))
        mask.push_back(value > 0.5f ? 255 : 0);
    return mask;
}

Drawing MeshDrawer::draw(std::span<const float> verts, const Camera& camera,
                         std::span<const float> texture, int textureSize, int samples) {
    Camera fine = camera;
    fine.fx *= samples, fine.fy *= samples, fine.cx *= samples, fine.cy *= samples;
    fine.width *= samples, fine.height *= samples;
    Recording& r = recording(fine.width, fine.height, textureSize);
    r.graph.write(r.verts, verts);
    r.graph.write(r.camera, cameraValues(rasterCamera(fine)));
    r.graph.write(r.texture, texture);
    r.graph.run();
    std::vector<float> image = r.graph.read<float>(r.image);
    std::vector<float> mask = r.graph.read<float>(r.visibility.mask);

    size_t width = static_cast<size_t>(camera.width), height = static_cast<size_t>(camera.height);
    auto n = static_cast<size_t>(samples);
    Drawing drawing{camera.width, camera.height, std::vector<float>(width * height * 3),
                    std::vector<uint8_t>(width * height)};
    float share = 1.0f / static_cast<float>(n * n);
    for (size_t y = 0; y < height; ++y)
        for (size_t x = 0; x < width; ++x) {
            float covered = 0;
            float* rgb = &drawing.rgb[3 * (y * width + x)];
            for (size_t sy = 0; sy < n; ++sy)
                for (size_t sx = 0; sx < n; ++sx) {
                    size_t sample = (y * n + sy) * width * n + x * n + sx;
                    covered += mask[sample] * share;
                    for (size_t c = 0; c < 3; ++c) rgb[c] += image[3 * sample + c] * share;
                }
            drawing.mask[y * width + x] = static_cast<uint8_t>(std::lround(255 * covered));
        }
    return drawing;
}

Drawing MeshDrawer::drawShaded(std::span<const float> verts, const Camera& camera) {
    Recording& r = recording(camera.width, camera.height, 0);
    r.graph.write(r.verts, verts);
    r.graph.write(r.camera, cameraValues(rasterCamera(camera)));
    r.graph.run();
    std::vector<int32_t> faceIndex = r.graph.read<int32_t>(r.visibility.faceIndex);
    Drawing drawing{camera.width, camera.height, {}, {}};
    for (int32_t face : faceIndex) {
        drawing.mask.push_back(face >= 0 ? 255 : 0);
        float shade = 0;
        if (face >= 0) {
            std::array<std::array<float, 3>, 3> v;
            for (size_t corner = 0; corner < 3; ++corner)
                for (size_t k = 0; k < 3; ++k) {
                    auto vertex =
                        static_cast<size_t>(body_.faces[static_cast<size_t>(face) * 3 + corner]);
                    v[corner][k] = verts[3 * vertex + k];
                }
            auto edge = [&](size_t corner, size_t k) { return v[corner][k] - v[0][k]; };
            float nx = edge(1, 1) * edge(2, 2) - edge(1, 2) * edge(2, 1);
            float ny = edge(1, 2) * edge(2, 0) - edge(1, 0) * edge(2, 2);
            float nz = edge(1, 0) * edge(2, 1) - edge(1, 1) * edge(2, 0);
            float length = std::sqrt(nx * nx + ny * ny + nz * nz);
            shade = length > 0 ? 0.2f + 0.75f * std::abs(nz) / length : 0.2f;
        }
        drawing.rgb.insert(drawing.rgb.end(), 3, shade);
    }
    return drawing;
}

}  // namespace doppel
