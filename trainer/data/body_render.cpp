#include "trainer/data/body_render.h"

#include <algorithm>
#include <cmath>

#include "nn/ops/body.h"
#include "nn/steps/light.h"

namespace doppel {

BodyPoser::BodyPoser(Device& device, const BodyModel& body) : graph_(device) {
    theta_ = graph_.input({kThetaSize});
    trans_ = graph_.input({3});
    beta_ = graph_.input({10});
    LbsModel model = lbsModel(graph_, body);
    Tensor rest = graph_.constant(body.restVertices(), {body.vertexCount, 3});
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

// What is seen in one size of picture.
struct MeshDrawer::Silhouette {
    Graph graph;
    Tensor verts, camera;
    VisibilityBuffer visibility;

    Silhouette(Device& device, const BodyModel& body, int width, int height) : graph(device) {
        verts = graph.input({body.vertexCount, 3});
        camera = graph.input(kCameraShape);
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        visibility = visibilityBuffer(graph, mesh, verts, camera, height, width);
        graph.output(visibility.mask);
        graph.output(visibility.faceIndex);
        graph.compile();
    }
};

// A textured picture of one size.
struct MeshDrawer::Picture {
    Graph graph;
    int width, height;
    Tensor camera;
    SampledRender drawn;

    Picture(MeshDrawer& drawer, int width_, int height_, int textureSize, int samples)
        : graph(drawer.device_), width(width_), height(height_) {
        const BodyModel& body = drawer.body_;
        camera = graph.input(kCameraShape);
        Tensor verts = graph.attach(drawer.verts(), {body.vertexCount, 3});
        Tensor texture = graph.attach(drawer.texture(textureSize), {textureSize, textureSize, 3});
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
        texture = CaptureLight(graph, body, mesh, textureSize, drawer.light_).lit(texture, verts);
        drawn = sampledRender(graph, mesh, verts, camera, rasterAtlas(graph, uvs, body.uvFaces),
                              texture, height, width, samples);
        graph.output(drawn.image);
        graph.output(drawn.coverage);
        graph.compile();
    }
};

MeshDrawer::MeshDrawer(Device& device, const BodyModel& body, std::vector<float> light)
    : device_(device), body_(body), light_(std::move(light)) {}
MeshDrawer::~MeshDrawer() = default;

MeshDrawer::Silhouette& MeshDrawer::silhouette(int width, int height) {
    auto& slot = silhouettes_[{width, height}];
    if (!slot) slot = std::make_unique<Silhouette>(device_, body_, width, height);
    return *slot;
}

std::vector<uint8_t> MeshDrawer::mask(std::span<const float> verts, const Camera& camera) {
    Silhouette& s = silhouette(camera.width, camera.height);
    s.graph.write(s.verts, verts);
    s.graph.write(s.camera, cameraValues(rasterCamera(camera)));
    s.graph.run();
    std::vector<uint8_t> mask;
    for (float value : s.graph.read<float>(s.visibility.mask))
        mask.push_back(value > 0.5f ? 255 : 0);
    return mask;
}

BufferView MeshDrawer::verts() {
    if (verts_.bytes() == 0)
        verts_ = device_.allocate(12 * static_cast<uint64_t>(body_.vertexCount), Memory::Device);
    return {&verts_, 0, 12 * static_cast<uint64_t>(body_.vertexCount)};
}

BufferView MeshDrawer::texture(int textureSize) {
    auto side = static_cast<uint64_t>(textureSize);
    Buffer& buffer = textures_[textureSize];
    if (buffer.bytes() == 0) buffer = device_.allocate(12 * side * side, Memory::Device);
    return {&buffer, 0, 12 * side * side};
}

void MeshDrawer::submit(const Camera& camera, int textureSize, int samples) {
    CHECK(underWay_.size() < 2, "two pictures at most are under way");
    auto& slot = pictures_[{camera.width, camera.height, textureSize, samples}];
    if (!slot)
        slot = std::make_unique<Picture>(*this, camera.width, camera.height, textureSize, samples);
    Camera fine = camera;
    fine.fx *= samples, fine.fy *= samples, fine.cx *= samples, fine.cy *= samples;
    slot->graph.write(slot->camera, cameraValues(rasterCamera(fine)));
    slot->graph.submit();
    underWay_.push_back(slot.get());
}

Drawing MeshDrawer::take() {
    CHECK(!underWay_.empty(), "a picture is under way");
    Picture* picture = underWay_.front();
    underWay_.pop_front();
    // The other one may be of another size.
    int back = static_cast<int>(std::ranges::count(underWay_, picture));
    Drawing drawing{picture->width,
                    picture->height,
                    picture->graph.read<float>(picture->drawn.image, back),
                    {}};
    for (float covered : picture->graph.read<float>(picture->drawn.coverage, back))
        drawing.mask.push_back(static_cast<uint8_t>(255 * covered + 0.5f));
    return drawing;
}

Drawing MeshDrawer::draw(std::span<const float> verts, const Camera& camera,
                         std::span<const float> texture, int textureSize, int samples) {
    CHECK(underWay_.empty(), "nothing under way reads the mesh that is replaced");
    device_.upload(this->verts(), std::as_bytes(verts));
    device_.upload(this->texture(textureSize), std::as_bytes(texture));
    submit(camera, textureSize, samples);
    return take();
}

Drawing MeshDrawer::drawShaded(std::span<const float> verts, const Camera& camera) {
    Silhouette& s = silhouette(camera.width, camera.height);
    s.graph.write(s.verts, verts);
    s.graph.write(s.camera, cameraValues(rasterCamera(camera)));
    s.graph.run();
    std::vector<int32_t> faceIndex = s.graph.read<int32_t>(s.visibility.faceIndex);
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
