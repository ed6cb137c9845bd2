// An avatar's mesh, texture and picture for a pose and a camera.
#pragma once

#include <memory>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "trainer/data/body_render.h"

namespace doppel {

// Poses an avatar and draws it: pose in, mesh, texture, picture out.
class AvatarRenderer {
public:
    // refined: false leaves the mesh network out. Pictures are lit by avatar.light, as if the
    // person turned before the camera that recorded her; texture() is free of it.
    AvatarRenderer(Device& device, const Avatar& avatar, bool refined = true,
                   TextureKind texture = TextureKind::Best);
    ~AvatarRenderer();

    // [V,3] in camera space, metres.
    std::vector<float> vertices(const Theta& theta, const Trans& trans);
    // The texture for this view: one for all views, or the networks' for what faces the camera.
    const std::vector<float>& texture(std::span<const float> verts);
    Drawing draw(const Theta& theta, const Trans& trans, const Camera& camera, int samples = 1);
    // draw() in two halves, so that the device draws one picture while the host has another in
    // hand: take() is the oldest submitted. Two at most are under way, and nothing else is asked
    // for meanwhile.
    void submit(const Theta& theta, const Trans& trans, const Camera& camera, int samples = 1);
    Drawing take() { return drawer_.take(); }
    std::vector<uint8_t> mask(const Theta& theta, const Trans& trans, const Camera& camera);

private:
    struct MeshRecording;
    struct TextureRecording;
    Device& device_;
    const Avatar& avatar_;
    const std::vector<float>* fixedTexture_;  // where the view does not matter
    MeshDrawer drawer_;
    std::unique_ptr<MeshRecording> mesh_;
    std::unique_ptr<TextureRecording> textureRecording_;
    std::vector<float> texture_;
};

}  // namespace doppel
