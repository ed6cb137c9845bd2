#include "viewer/scene.h"

#include <algorithm>
#include <glm/gtc/quaternion.hpp>

#include "nn/lbs.h"
#include "trainer/checkpoint.h"
#include "trainer/networks.h"

namespace doppel {

namespace {

std::array<float, 3> axisAngle(const glm::dmat3& rotation) {
    glm::dquat q = glm::normalize(glm::quat_cast(rotation));
    if (q.w < 0) q = -q;
    glm::dvec3 axis(q.x, q.y, q.z);
    double sine = glm::length(axis);
    if (sine > 0) axis *= 2 * std::atan2(sine, q.w) / sine;
    return {float(axis.x), float(axis.y), float(axis.z)};
}

}  // namespace

// Pose in; vertices and normals in the world out, in memory that drawings read.
struct Scene::Posing {
    Graph graph;
    Parameters net;
    Tensor theta, trans, beta;
    Buffer verts, normals;
    uint64_t version = 0;

    Posing(Device& device, const Avatar& avatar, MeshKind kind) : graph(device) {
        const BodyModel& body = avatar.body;
        theta = graph.input({72});
        trans = graph.input({3});
        beta = graph.input({10});
        Tensor rest =
            graph.constant(std::span<const float>(body.templateVertices), {body.vertexCount, 3});
        LbsModel skin = lbsModel(graph, body);
        Tensor posed;
        if (kind == MeshKind::Refined) {
            declareMeshNet(net, avatar, 0);
            net.allocate(device);
            loadWeights(net, avatar.meshNet, "mesh_net.safetensors");
            posed = meshNetwork(graph, avatar, net).refine(skin, rest, beta, theta, trans);
        } else {
            posed = lbs(graph, skin, rest, theta, beta, trans).verts;
        }
        MeshTopology topology = meshTopology(body.faces, body.vertexCount, body.file);
        Tensor sums = vertexNormals(graph, posed, meshTensors(graph, topology));
        uint64_t bytes = 12 * static_cast<uint64_t>(body.vertexCount);
        verts = device.allocate(bytes, Memory::Device);
        normals = device.allocate(bytes, Memory::Device);
        graph.beginOp("keep_mesh");
        graph.copy(posed, graph.attach({&verts, 0, bytes}, posed.shape));
        graph.copy(sums, graph.attach({&normals, 0, bytes}, posed.shape));
        graph.compile();
    }
};

// One size of picture of one mesh.
struct Scene::Drawing {
    Graph graph;
    Tensor rotation, translation, camera, state, background, picture;
    std::vector<uint32_t> backgroundNow;

    Drawing(Device& device, const Avatar& avatar, const Posing& posing, const Buffer& texture,
            int width, int height, int samples, bool visibility)
        : graph(device) {
        const BodyModel& body = avatar.body;
        const int64_t size = avatar.textureSize;
        const Shape meshShape{body.vertexCount, 3};
        Tensor world = graph.attach({&posing.verts, 0, posing.verts.bytes()}, meshShape);
        Tensor normals = graph.attach({&posing.normals, 0, posing.normals.bytes()}, meshShape);
        Tensor tex = graph.attach({&texture, 0, texture.bytes()}, {size, size, 3});
        rotation = graph.input({3});
        translation = graph.input({3});
        camera = graph.input(kCameraShape);
        state = graph.input({sizeof(ShadeState) / 4});
        background = graph.input({height, width}, ElementType::I32);
        Tensor origin = graph.constant(std::vector<float>(3), {3});
        Tensor verts = rigidTransform(graph, world, rotation, origin, translation);
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        VisibilityBuffer seen =
            visibilityBuffer(graph, mesh, verts, camera, height * samples, width * samples);
        Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
        RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);
        Tensor map = visibility ? visibilityMap(graph, mesh, verts, atlas, size) : graph.none();
        picture = graph.temporary({height, width}, ElementType::I32);
        graph.beginOp("shade");
        ShadeParams params{static_cast<uint32_t>(width), static_cast<uint32_t>(height),
                           static_cast<uint32_t>(samples), static_cast<uint32_t>(size)};
        graph.dispatch("view/shade.forward",
                       {{"index", seen.faceIndex},
                        {"surface", seen.surface},
                        {"verts", verts},
                        {"normals", normals},
                        {"marks", marks(avatar)},
                        {"faces", mesh.faceVertices},
                        {"facesUv", atlas.faceCorners},
                        {"uvs", atlas.uvs},
                        {"tex", tex},
                        {"visibility", map},
                        {"camera", camera},
                        {"state", state},
                        {"background", background},
                        {"picture", picture}},
                       params, static_cast<uint64_t>(width) * static_cast<uint64_t>(height));
        graph.output(picture);
        graph.compile();
    }

    // [V,2] body part, and the clamp bound as part of the largest.
    Tensor marks(const Avatar& avatar) {
        std::vector<float> bounds = clampBounds(avatar.body, clampsOf(avatar.preset.mesh));
        float most = *std::ranges::max_element(bounds);
        std::vector<float> values;
        for (size_t v = 0; v < bounds.size(); ++v) {
            values.push_back(avatar.body.part[v]);
            values.push_back(most > 0 ? bounds[v] / most : 0);
        }
        return graph.constant(std::span<const float>(values), {avatar.body.vertexCount, 2});
    }
};

Scene::Scene(Device& device, const Avatar& avatar)
    : device_(device), avatar_(avatar), betas_(avatar.betas) {
    CHECK(avatar.textureSize > 0, "the avatar has a texture");
    texture_ = device.allocate(
        12 * static_cast<uint64_t>(avatar.textureSize) * static_cast<uint64_t>(avatar.textureSize),
        Memory::Device);
    setTexture(avatar.texture);
}

Scene::~Scene() = default;

bool Scene::hasRefinedMesh() const { return !avatar_.meshNet.empty(); }

void Scene::setPose(const Theta& theta, const Trans& trans, const Betas& betas) {
    if (theta == theta_ && trans == trans_ && betas == betas_) return;
    theta_ = theta;
    trans_ = trans;
    betas_ = betas;
    ++poseVersion_;
}

void Scene::setTexture(std::span<const float> texture) {
    auto size = static_cast<size_t>(avatar_.textureSize);
    CHECK(texture.size() == 3 * size * size, "the texture has {} numbers", texture.size());
    device_.upload({&texture_, 0, texture.size_bytes()}, std::as_bytes(texture));
}

Scene::Posing& Scene::posed(MeshKind mesh) {
    if (!hasRefinedMesh()) mesh = MeshKind::Body;
    auto& posing = posings_[mesh];
    if (!posing) posing = std::make_unique<Posing>(device_, avatar_, mesh);
    if (posing->version != poseVersion_) {
        posing->graph.write(posing->theta, std::span<const float>(theta_));
        posing->graph.write(posing->trans, std::span<const float>(trans_));
        posing->graph.write(posing->beta, std::span<const float>(betas_));
        posing->graph.run();
        posing->version = poseVersion_;
    }
    return *posing;
}

const std::vector<uint32_t>& Scene::draw(MeshKind mesh, const Camera& camera,
                                         const ViewTransform& view, const ShadeOptions& options,
                                         std::span<const uint32_t> background, int samples) {
    if (!hasRefinedMesh()) mesh = MeshKind::Body;
    Posing& posing = posed(mesh);
    if (size_ != std::array{camera.width, camera.height}) drawings_.clear();
    size_ = {camera.width, camera.height};
    bool visibility = options.paint == kPaintVisibility;
    auto& drawing = drawings_[{static_cast<int>(mesh), camera.width, camera.height, samples,
                               static_cast<int>(visibility)}];
    if (!drawing)
        drawing = std::make_unique<Drawing>(device_, avatar_, posing, texture_, camera.width,
                                            camera.height, samples, visibility);
    Drawing& d = *drawing;

    auto f = [](double value) { return static_cast<float>(value); };
    glm::dvec3 light = glm::normalize(options.light);
    const glm::dmat3& r = view.rotation;  // columns first
    ShadeState state{
        options.paint,
        options.lit ? 1u : 0u,
        options.wireframe ? 1u : 0u,
        static_cast<uint32_t>(std::clamp(options.inset, 0, std::min(camera.width, camera.height))),
        options.blueFirst ? 1u : 0u,
        f(options.ambient),
        f(light.x),
        f(light.y),
        f(light.z),
        f(r[0][0]),
        f(r[1][0]),
        f(r[2][0]),
        f(r[0][1]),
        f(r[1][1]),
        f(r[2][1]),
        f(r[0][2]),
        f(r[1][2]),
        f(r[2][2])};
    std::array<int32_t, sizeof(ShadeState) / 4> words;
    std::memcpy(words.data(), &state, sizeof(state));
    d.graph.write(d.state, std::span<const int32_t>(words));
    std::array<float, 3> turn = axisAngle(view.rotation);
    std::array<float, 3> shift{f(view.translation.x), f(view.translation.y), f(view.translation.z)};
    d.graph.write(d.rotation, std::span<const float>(turn));
    d.graph.write(d.translation, std::span<const float>(shift));
    RasterCamera raster = rasterCamera(camera);
    raster.fx *= f(samples), raster.fy *= f(samples);
    raster.cx *= f(samples), raster.cy *= f(samples);
    d.graph.write(d.camera, cameraValues(raster));
    if (!std::ranges::equal(d.backgroundNow, background)) {
        d.backgroundNow.assign(background.begin(), background.end());
        d.graph.write(d.background, std::span(reinterpret_cast<const int32_t*>(background.data()),
                                              background.size()));
    }
    d.graph.run();
    picture_ = d.graph.read<uint32_t>(d.picture);
    return picture_;
}

std::vector<float> Scene::vertices(MeshKind mesh) {
    Posing& posing = posed(mesh);
    std::vector<float> verts(3 * static_cast<size_t>(avatar_.body.vertexCount));
    device_.download({&posing.verts, 0, verts.size() * 4},
                     std::as_writable_bytes(std::span(verts)));
    return verts;
}

std::vector<float> Scene::vertices(MeshKind mesh, const ViewTransform& view) {
    std::vector<float> verts = vertices(mesh);
    for (size_t i = 0; i + 2 < verts.size(); i += 3) {
        glm::dvec3 p = view({verts[i], verts[i + 1], verts[i + 2]});
        for (int k = 0; k < 3; ++k) verts[i + static_cast<size_t>(k)] = static_cast<float>(p[k]);
    }
    return verts;
}

}  // namespace doppel
