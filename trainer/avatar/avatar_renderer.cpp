#include "trainer/avatar/avatar_renderer.h"

#include <optional>

#include "nn/ops/body.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"

namespace doppel {

struct AvatarRenderer::MeshRecording {
    Graph graph;
    Parameters net;
    Tensor theta, trans, verts;

    // Leaves the vertices in target as well.
    MeshRecording(Device& device, const Avatar& avatar, bool refined, const BufferView& target)
        : graph(device) {
        const BodyModel& body = avatar.body;
        theta = graph.input({kThetaSize});
        trans = graph.input({3});
        Tensor beta = graph.constant(std::span<const float>(avatar.betas), {10});
        Tensor rest = graph.constant(body.restVertices(), {body.vertexCount, 3});
        LbsModel skin = lbsModel(graph, body);
        if (refined && !avatar.meshNet.empty()) {
            declareMeshNet(net, avatar, 0);
            net.allocate(device);
            loadWeights(net, avatar.meshNet, "mesh_net.safetensors");
            MeshNetwork network = meshNetwork(graph, avatar, net);
            verts = network.refine(skin, rest, beta, theta, trans);
        } else {
            verts = lbs(graph, skin, rest, theta, beta, trans).verts;
        }
        graph.beginOp("keep_mesh");
        graph.copy(verts, graph.attach(target, verts.shape));
        graph.output(verts);
        graph.compile();
    }
};

// The texture networks painting what faces the camera.
struct AvatarRenderer::TextureRecording {
    TextureNet net;
    std::optional<RefineNet> refineNet;
    Graph graph;
    Tensor texture;

    // Of the vertices in source; leaves the texture in target as well.
    TextureRecording(Device& device, const Avatar& avatar, bool refined, const BufferView& source,
                     const BufferView& target)
        : net(device, avatar), graph(device) {
        const BodyModel& body = avatar.body;
        Tensor verts = graph.attach(source, {body.vertexCount, 3});
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
        RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);
        Tensor map = visibilityMap(graph, mesh, verts, atlas, avatar.textureSize);
        if (refined) {
            refineNet.emplace(device, avatar);
            // With a constant input, the coarse texture is the same for every view.
            std::vector<float> constant;
            if (avatar.preset.texture.constantInput) constant = paintedTexture(device, net);
            texture = refineNet->forward(graph, net, constant, map);
        } else {
            texture = net.forward(graph, {map}, false).at(0);
        }
        graph.beginOp("keep_texture");
        graph.copy(texture, graph.attach(target, texture.shape));
        graph.output(texture);
        graph.compile();
    }
};

AvatarRenderer::AvatarRenderer(Device& device, const Avatar& avatar, bool refined, TextureKind kind)
    : device_(device),
      avatar_(avatar),
      fixedTexture_(&avatar.texture),
      drawer_(device, avatar.body, avatar.light),
      mesh_(std::make_unique<MeshRecording>(device, avatar, refined, drawer_.verts())) {
    if (kind == TextureKind::Best)
        kind = avatar.refineNet.empty() ? TextureKind::Coarse : TextureKind::Refined;
    if (kind == TextureKind::Baked) {
        CHECK(!avatar.bakedTexture.empty(), "the avatar has a baked texture");
        fixedTexture_ = &avatar.bakedTexture;
    }
    bool refine = kind == TextureKind::Refined;
    CHECK(!refine || (!avatar.refineNet.empty() && !avatar.textureNet.empty()),
          "the avatar has networks for a refined texture");
    bool painted = !avatar.textureNet.empty() && !avatar.preset.texture.constantInput;
    if (avatar.textureSize == 0) return;
    if (refine || (painted && kind != TextureKind::Baked))
        textureRecording_ = std::make_unique<TextureRecording>(
            device, avatar, refine, drawer_.verts(), drawer_.texture(avatar.textureSize));
    else
        device.upload(drawer_.texture(avatar.textureSize),
                      std::as_bytes(std::span(*fixedTexture_)));
}

AvatarRenderer::~AvatarRenderer() = default;

std::vector<float> AvatarRenderer::vertices(const Theta& theta, const Trans& trans) {
    mesh_->graph.write(mesh_->theta, std::span<const float>(theta));
    mesh_->graph.write(mesh_->trans, std::span<const float>(trans));
    mesh_->graph.run();
    return mesh_->graph.read<float>(mesh_->verts);
}

const std::vector<float>& AvatarRenderer::texture(std::span<const float> verts) {
    if (!textureRecording_) return *fixedTexture_;
    device_.upload(drawer_.verts(), std::as_bytes(verts));
    textureRecording_->graph.run();
    texture_ = textureRecording_->graph.read<float>(textureRecording_->texture);
    return texture_;
}

void AvatarRenderer::submit(const Theta& theta, const Trans& trans, const Camera& camera,
                            int samples) {
    mesh_->graph.write(mesh_->theta, std::span<const float>(theta));
    mesh_->graph.write(mesh_->trans, std::span<const float>(trans));
    mesh_->graph.submit();
    if (textureRecording_) textureRecording_->graph.submit();
    drawer_.submit(camera, avatar_.textureSize, samples);
}

Drawing AvatarRenderer::draw(const Theta& theta, const Trans& trans, const Camera& camera,
                             int samples) {
    submit(theta, trans, camera, samples);
    return take();
}

std::vector<uint8_t> AvatarRenderer::mask(const Theta& theta, const Trans& trans,
                                          const Camera& camera) {
    return drawer_.mask(vertices(theta, trans), camera);
}

}  // namespace doppel
