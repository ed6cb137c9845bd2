// An avatar on the device: posed when its pose changes, drawn when the view does.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "engine/device.h"
#include "trainer/avatar/avatar.h"
#include "trainer/data/camera.h"
#include "view/params.h"
#include "viewer/picture/view_transform.h"
#include "viewer/window/canvas.h"

namespace doppel {

// Which mesh is drawn: the body as skinning leaves it, or as the mesh network refines it.
enum class MeshKind { Body, Refined };

struct ShadeOptions {
    uint32_t paint = kPaintTexture;  // of kPaint…
    uint32_t light = kLightCapture;  // of kLight…
    bool wireframe = false;
    glm::dvec3 lamp{-0.4, -0.6, -0.7};  // towards it, camera space
    double ambient = 0.35;
    int inset = 0;  // side of the atlas in the lower right corner, pixels; 0: none
    bool operator==(const ShadeOptions&) const = default;
};

// A resting scene is seen through this many cameras, each shifted by parts of a pixel.
constexpr int kRefinements = 16;
// The shift of one of them, pixels, each in (-1/2, 1/2). They are the Hammersley set of 16 points:
// every sixteenth of a pixel holds one, across as well as down, and each of its four by four
// squares. A point and its mirror follow one another, so that what has been added up is centred and
// the picture does not wander while it becomes finer; the first is the centre but for 1/32.
glm::dvec2 refinementShift(int refinement);

// Pixels [H,W] of R, G, B, A that nobody changes: the same pointer stands for the same pixels.
using Pixels = std::shared_ptr<const std::vector<uint32_t>>;

// A picture that has stayed where it was computed.
struct PictureOnDevice {
    Pixels background;  // [H,W], seen around the box
    PixelBox box;
    std::shared_ptr<const Buffer>
        drawn;  // [box.height,box.width] as pixels; null: the box is empty
};
// It here.
std::vector<uint32_t> onHost(Device& device, const PictureOnDevice& picture, int width);

class Scene {
public:
    // The avatar outlives the scene.
    Scene(Device& device, const Avatar& avatar);
    ~Scene();

    bool hasRefinedMesh() const;

    // What the next pictures show. The meshes are computed when a picture asks for them.
    void setPose(const Theta& theta, const Trans& trans, const Betas& betas);
    // [size,size,3] sRGB-encoded in [0,1], of the avatar's texture size.
    void setTexture(std::span<const float> texture);

    // Computes the mesh now, if its pose has changed, and not when it is drawn.
    void prepare(MeshKind mesh) { posed(mesh); }

    // Pixels [H,W] of R, G, B, A. background: the same; samples: per pixel and axis, averaged. Only
    // the rectangle around the avatar is computed, the rest is the background. reused: the last
    // picture as it was returned, or other memory; of the last picture only the rectangle around
    // the faces that have moved is computed again, where nothing else has changed. depths [H,W]:
    // how far away what is in the background is, metres, INFINITY for nothing; what of the avatar
    // is farther is hidden by it, and the rest of it is there afterwards. null: all is behind.
    std::vector<uint32_t> draw(MeshKind mesh, const Camera& camera, const ViewTransform& view,
                               const ShadeOptions& options, std::span<const uint32_t> background,
                               int samples = 1, std::vector<uint32_t> reused = {},
                               std::vector<float>* depths = nullptr);

    // The mean of what the cameras of refinements 0 to `refinement` see, with one sample per pixel
    // each. They are asked for in their order, with everything else the same; 0 begins anew. place:
    // a number per picture that is refined at one time. reused: what the one before returned, for
    // the memory. depths: as draw() takes them.
    std::vector<uint32_t> refine(MeshKind mesh, const Camera& camera, const ViewTransform& view,
                                 const ShadeOptions& options, std::span<const uint32_t> background,
                                 int place, int refinement, std::vector<uint32_t> reused = {},
                                 std::vector<float>* depths = nullptr);

    // What draw() returns, or with a refinement what refine() does, of the same bytes, and on the
    // device. pane: a number per picture that is shown at one time, whose picture before this one
    // is lost.
    PictureOnDevice drawOnDevice(MeshKind mesh, const Camera& camera, const ViewTransform& view,
                                 const ShadeOptions& options, const Pixels& background, int pane,
                                 int samples, std::optional<int> refinement = {});

    // [V,3] as it is posed now: world, and camera space.
    std::vector<float> vertices(MeshKind mesh);
    std::vector<float> vertices(MeshKind mesh, const ViewTransform& view);

private:
    struct Posing;
    struct Drawing;
    Posing& posed(MeshKind mesh);

    Device& device_;
    const Avatar& avatar_;
    Buffer texture_;
    std::map<MeshKind, std::unique_ptr<Posing>> posings_;
    struct DrawingKey {
        int place;  // of refine(), or kNoPlace: of draw()
        MeshKind mesh;
        int width, height, samples;
        uint32_t paint, light;
        bool wireframe;
        int inset;
        bool layered;  // over others, with depths
        int pane;      // whose picture stays on the device, or kNoPlace: the host reads it
        bool operator==(const DrawingKey&) const = default;
    };
    static constexpr int kNoPlace = -1;
    Drawing& drawing(const DrawingKey& key, const Posing& posing);
    // The options with the light that this avatar shows.
    ShadeOptions shown(ShadeOptions options) const;
    // The drawing of a box of the picture, with all that it shows but what is behind.
    Drawing& aimed(const PixelBox& box, MeshKind mesh, const Camera& camera,
                   const ViewTransform& view, const ShadeOptions& options, int samples,
                   bool layered, int place, int refinement, int pane);
    // Draws this part of the picture, where the background is.
    void drawBox(const PixelBox& box, MeshKind mesh, const Camera& camera,
                 const ViewTransform& view, const ShadeOptions& options, int samples,
                 std::vector<uint32_t>& picture, std::vector<float>* depths = nullptr,
                 int place = kNoPlace, int refinement = 0);
    // The ones used last, the latest first.
    std::list<std::pair<DrawingKey, std::unique_ptr<Drawing>>> drawings_;
    // What the last picture was made of.
    struct Drawn;
    std::unique_ptr<Drawn> drawn_;
    uint64_t textureVersion_ = 0;
    Theta theta_{};
    Trans trans_{};
    Betas betas_;
    uint64_t poseVersion_ = 1;
};

}  // namespace doppel
