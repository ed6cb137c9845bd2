#include "viewer/picture/scene.h"

#include <algorithm>
#include <cstring>
#include <glm/gtc/quaternion.hpp>

#include "engine/files/numbers.h"
#include "nn/ops/body.h"
#include "nn/steps/light.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/data/body_render.h"
#include "trainer/data/pose.h"
#include "viewer/picture/bounds.h"

namespace doppel {

namespace {

constexpr size_t kDrawingsKept = 12;  // of some 30 MB each at most for a window of usual size

std::array<float, 3> axisAngle(const glm::dmat3& rotation) {
    glm::dvec3 v = axisAngleOf(glm::normalize(glm::quat_cast(rotation)));
    return {float(v.x), float(v.y), float(v.z)};
}

// Where a row of a box begins in a picture [H,width].
size_t placeOf(const PixelBox& box, int row, int width) {
    return static_cast<size_t>(box.y + row) * static_cast<size_t>(width) +
           static_cast<size_t>(box.x);
}

}  // namespace

// Pose in (what the last one has moved is computed); vertices and normals in the world out, in
// memory that drawings read. Normals have a graph of their own: a texture without a light needs
// none.
struct Scene::Posing {
    Graph graph, shape;
    Parameters net;
    std::optional<MovedRows> moved;  // where a part of the mesh can be computed
    Tensor theta, trans, beta;
    Buffer verts, normals;
    uint64_t version = 0, shapeVersion = 0;
    std::optional<Betas> prepared;
    std::vector<float> hostVerts;  // as verts

    Posing(Device& device, const Avatar& avatar, MeshKind kind) : graph(device), shape(device) {
        const BodyModel& body = avatar.body;
        theta = graph.input({kThetaSize});
        trans = graph.input({3});
        beta = graph.input({10});
        Tensor rest = graph.constant(body.restVertices(), {body.vertexCount, 3});
        LbsModel skin = lbsModel(graph, body);
        Tensor posed;
        if (kind == MeshKind::Refined) {
            declareMeshNet(net, avatar, 0);
            net.allocate(device);
            loadWeights(net, avatar.meshNet, "mesh_net.safetensors");
            MeshNetwork network = meshNetwork(graph, avatar, net);
            ShapedBody shaped = shapeBody(graph, skin, rest, beta);
            graph.endPreparation();
            if (network.net.takesRows()) moved.emplace(graph, body, network.net.reach());
            posed = network.refine(skin, shaped, theta, trans, moved ? &*moved : nullptr);
        } else {
            ShapedBody shaped = shapeBody(graph, skin, rest, beta);
            graph.endPreparation();
            posed = poseBody(graph, skin, shaped, theta, trans).verts;
        }
        uint64_t bytes = 12 * static_cast<uint64_t>(body.vertexCount);
        verts = device.allocate(bytes, Memory::Device);
        normals = device.allocate(bytes, Memory::Device);
        graph.beginOp("keep_mesh");
        graph.copy(posed, graph.attach({&verts, 0, bytes}, posed.shape));
        graph.compile();

        MeshTopology topology = meshTopology(body.faces, body.vertexCount, body.file);
        Tensor units = vertexNormals(shape, shape.attach({&verts, 0, bytes}, posed.shape),
                                     meshTensors(shape, topology));
        shape.beginOp("keep_normals");
        shape.copy(units, shape.attach({&normals, 0, bytes}, posed.shape));
        shape.compile();
    }

    void pose(const Theta& newTheta, const Trans& newTrans, const Betas& betas) {
        if (prepared != betas) {
            graph.write(beta, std::span<const float>(betas));
            graph.prepare();
            prepared = betas;
            if (moved) moved->forget();
        }
        graph.write(theta, std::span<const float>(newTheta));
        graph.write(trans, std::span<const float>(newTrans));
        if (moved) moved->write(newTheta, newTrans);
        graph.run();
    }

    void findNormals() {
        if (shapeVersion == version) return;
        shape.run();
        shapeVersion = version;
    }
};

// One size and kind of picture.
struct Scene::Drawing {
    Graph graph;
    Tensor rotation, translation, camera, state, background, picture, count;
    Tensor behindDepths, depths;  // where there are others
    int taken = 0;                // refinements that are in the mean
    std::vector<int32_t> behind;  // as written to background
    Pixels behindOf;              // of which it is this box, where pixels do not change
    PixelBox behindBox;
    std::vector<uint32_t> drawn;           // as read from picture
    std::shared_ptr<const Buffer> result;  // the picture, where it stays

    Drawing(Device& device, const Avatar& avatar, const Posing& posing, const Buffer& texture,
            const DrawingKey& key)
        : graph(device) {
        const BodyModel& body = avatar.body;
        const int64_t size = avatar.textureSize;
        const Shape meshShape{body.vertexCount, 3};
        Tensor world = graph.attach({&posing.verts, 0, posing.verts.bytes()}, meshShape);
        Tensor normals = graph.attach({&posing.normals, 0, posing.normals.bytes()}, meshShape);
        Tensor tex = graph.attach({&texture, 0, texture.bytes()}, {size, size}, ElementType::I32);
        rotation = graph.input({3});
        translation = graph.input({3});
        camera = graph.input(kCameraShape);
        state = graph.input({sizeof(ShadeState) / 4});
        background = graph.input({key.height, key.width}, ElementType::I32);
        Tensor origin = graph.constant(std::vector<float>(3), {3});
        Tensor verts = rigidTransform(graph, world, rotation, origin, translation);
        RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
        NearestFaces seen = nearestFaces(graph, mesh, verts, camera, key.height * key.samples,
                                         key.width * key.samples);
        Tensor map = graph.none();
        if (key.paint == kPaintVisibility) {
            Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
            map = visibilityMap(graph, mesh, verts, rasterAtlas(graph, uvs, body.uvFaces), size);
        }
        const Shape pixels{key.height, key.width};
        const auto bytes = 4 * static_cast<uint64_t>(elementCount(pixels));
        const bool stays = key.pane != kNoPlace, accumulates = key.place != kNoPlace;
        if (stays) result = std::make_shared<const Buffer>(device.allocate(bytes, Memory::Device));
        const auto whatIsShown = [&] {
            return stays ? graph.attach({result.get(), 0, bytes}, pixels, ElementType::I32)
                         : graph.temporary(pixels, ElementType::I32);
        };
        picture = accumulates ? graph.temporary(pixels, ElementType::I32) : whatIsShown();
        Tensor marks = marksOf(avatar), corners = cornerUvs(body);
        ShadeParams params{u32(key.width), u32(key.height), u32(size), u32(key.inset),
                           divisorOf(u32(key.width))};
        Specialisation spec{{"paint", key.paint},
                            {"light", key.light},
                            {"wireframe", key.wireframe ? 1u : 0u},
                            {"samples", u32(key.samples)},
                            {"keys", seen.keys ? 1u : 0u}};
        graph.beginOp("shade");
        Tensor spans = seenSpans(graph, seen, key.height, key.width, key.samples);
        graph.copy(background, picture);
        graph.dispatchGroups("view/shade.forward",
                             {{"index", seen.index},
                              {"screen", seen.screen},
                              {"normals", normals},
                              {"marks", marks},
                              {"faces", mesh.faceVertices},
                              {"cornerUvs", corners},
                              {"tex", tex},
                              {"visibility", map},
                              {"state", state},
                              {"background", background},
                              {"picture", picture},
                              {"spans", spans}},
                             params, spanGroups(device, picture.elements()), spec);
        if (key.layered) {
            behindDepths = graph.input({key.height, key.width});
            depths = graph.temporary(behindDepths.shape);
            LayerParams layer{params.width, params.height, params.byWidth};
            graph.beginOp("layer");
            graph.dispatch("view/layer.forward",
                           {{"index", seen.index},
                            {"screen", seen.screen},
                            {"faces", mesh.faceVertices},
                            {"behind", behindDepths},
                            {"background", background},
                            {"picture", picture},
                            {"nearest", depths}},
                           layer, u32(picture.elements()),
                           {{"samples", u32(key.samples)}, {"keys", seen.keys ? 1u : 0u}});
            graph.output(depths);
        }
        if (key.inset > 0)
            graph.dispatch("view/shade.inset",
                           {{"tex", tex}, {"visibility", map}, {"picture", picture}}, params,
                           uint64_t{u32(key.inset)} * u32(key.inset), spec);
        if (accumulates) {
            count = graph.input({1});
            Tensor sums = graph.temporary({3, key.height, key.width});
            graph.keep(sums);
            Tensor mean = whatIsShown();
            AccumulateParams all{u32(picture.elements())};
            graph.beginOp("accumulate");
            graph.dispatch("view/accumulate.forward",
                           {{"taken", count}, {"picture", picture}, {"sums", sums}, {"mean", mean}},
                           all, all.pixels);
            picture = mean;
        }
        if (!stays) graph.output(picture);
        graph.compile();
    }

    // The box of a picture [H,width] is behind what is drawn next.
    void putBehind(std::span<const uint32_t> pixels, const PixelBox& box, int width) {
        const auto wide = static_cast<size_t>(box.width);
        bool changed = behind.size() != static_cast<size_t>(box.area());
        behind.resize(static_cast<size_t>(box.area()));
        for (int y = 0; y < box.height; ++y) {
            int32_t* known = &behind[static_cast<size_t>(y) * wide];
            const uint32_t* now = &pixels[placeOf(box, y, width)];
            if (std::memcmp(known, now, 4 * wide) == 0) continue;
            std::memcpy(known, now, 4 * wide);
            changed = true;
        }
        if (changed) graph.write(background, behind);
    }

    // [F,2,4] so that a face's UVs are two loads.
    Tensor cornerUvs(const BodyModel& body) {
        std::vector<float> values;
        for (size_t f = 0; f < static_cast<size_t>(body.faceCount); ++f) {
            for (size_t corner = 0; corner < 3; ++corner) {
                auto t = static_cast<size_t>(body.uvFaces[3 * f + corner]);
                values.insert(values.end(), {body.uvs[2 * t], body.uvs[2 * t + 1]});
            }
            values.insert(values.end(), {0, 0});
        }
        return graph.constant(std::span<const float>(values), {body.faceCount, 8});
    }

    // [V,2] body part, and the clamp bound as part of the largest.
    Tensor marksOf(const Avatar& avatar) {
        std::vector<float> bounds = clampBounds(avatar.body, avatar.preset.mesh.clamps);
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

ShadeOptions Scene::shown(ShadeOptions options) const {
    const bool lights = !avatar_.light.empty() && options.paint == kPaintTexture;
    if (options.light == kLightCapture && !lights) options.light = kLightFlat;
    return options;
}

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
    std::vector<uint32_t> packed(size * size);
    for (size_t i = 0; i < packed.size(); ++i) {
        uint32_t word = 0xff000000u;
        for (size_t c = 0; c < 3; ++c)
            word |= static_cast<uint32_t>(255 * std::clamp(texture[3 * i + c], 0.0f, 1.0f) + 0.5f)
                    << 8 * c;
        packed[i] = word;
    }
    device_.upload({&texture_, 0, packed.size() * 4}, std::as_bytes(std::span(packed)));
    ++textureVersion_;
}

Scene::Posing& Scene::posed(MeshKind mesh) {
    if (!hasRefinedMesh()) mesh = MeshKind::Body;
    auto& posing = posings_[mesh];
    if (!posing) posing = std::make_unique<Posing>(device_, avatar_, mesh);
    if (posing->version != poseVersion_) {
        posing->pose(theta_, trans_, betas_);
        posing->version = poseVersion_;
        posing->hostVerts.resize(3 * static_cast<size_t>(avatar_.body.vertexCount));
        device_.download({&posing->verts, 0, posing->hostVerts.size() * 4},
                         std::as_writable_bytes(std::span(posing->hostVerts)));
    }
    return *posing;
}

Scene::Drawing& Scene::drawing(const DrawingKey& key, const Posing& posing) {
    auto found =
        std::ranges::find(drawings_, key, &std::pair<DrawingKey, std::unique_ptr<Drawing>>::first);
    if (found != drawings_.end()) {
        drawings_.splice(drawings_.begin(), drawings_, found);
    } else {
        if (drawings_.size() >= kDrawingsKept) drawings_.pop_back();
        drawings_.emplace_front(key,
                                std::make_unique<Drawing>(device_, avatar_, posing, texture_, key));
    }
    return *drawings_.front().second;
}

glm::dvec2 refinementShift(int refinement) {
    static_assert(kRefinements == 16);
    // Points k and 15 - k of the set mirror each other; the sixteenths are renumbered so that the
    // first two are in the middle.
    int k = refinement / 2;
    if (refinement % 2 == 1) k = 15 - k;
    int reversed = (k & 1) << 3 | (k & 2) << 1 | (k & 4) >> 1 | (k & 8) >> 3;
    auto place = [](int sixteenth) { return ((sixteenth ^ 8) + 0.5) / 16 - 0.5; };
    return {place(reversed), place(k)};
}

namespace {

int insetOf(const ShadeOptions& options, const Camera& camera) {
    return std::clamp(options.inset, 0, std::min(camera.width, camera.height));
}

bool needsNormals(const ShadeOptions& options) {
    return options.light != kLightFlat || options.paint == kPaintClay ||
           options.paint == kPaintNormals || options.paint == kPaintParts ||
           options.paint == kPaintClamps;
}

// Where something is drawn: around the avatar, or everywhere for an atlas in the corner.
PixelBox boxOf(std::span<const float> verts, const Camera& camera, const ViewTransform& view,
               const ShadeOptions& options) {
    if (insetOf(options, camera) > 0) return {0, 0, camera.width, camera.height};
    return around(boundsOf(verts, camera, view), camera);
}

}  // namespace

struct Scene::Drawn {
    MeshKind mesh;
    Camera camera;
    ViewTransform view;
    ShadeOptions options;
    int samples;
    uint64_t textureVersion;
    std::vector<uint32_t> background;
    std::vector<float> verts;
    const uint32_t* pixels = nullptr;  // of the picture that was returned
};

std::vector<uint32_t> Scene::draw(MeshKind mesh, const Camera& camera, const ViewTransform& view,
                                  const ShadeOptions& asked, std::span<const uint32_t> background,
                                  int samples, std::vector<uint32_t> reused,
                                  std::vector<float>* depths) {
    const ShadeOptions options = shown(asked);
    if (!hasRefinedMesh()) mesh = MeshKind::Body;
    const std::vector<float>& verts = posed(mesh).hostVerts;
    std::vector<uint32_t> picture = std::move(reused);
    PixelBox whole = boxOf(verts, camera, view, options), box = whole;
    // What a pixel of the visibility map shows depends on faces elsewhere.
    bool onLast = !depths && drawn_ && drawn_->pixels == picture.data() && drawn_->mesh == mesh &&
                  drawn_->camera == camera && drawn_->view == view && drawn_->options == options &&
                  drawn_->samples == samples && drawn_->textureVersion == textureVersion_ &&
                  insetOf(options, camera) == 0 && options.paint != kPaintVisibility &&
                  std::ranges::equal(drawn_->background, background);
    if (onLast) {
        box = around(boundsOfMoved(drawn_->verts, verts, avatar_.body.faces,
                                   needsNormals(options) ? 2 : 1, camera, view),
                     camera);
        // Where nearly all has moved, the size that there is already.
        if (4 * box.area() > 3 * whole.area()) {
            box = whole;
            onLast = false;
        }
    }
    if (onLast) {
        for (int y = 0; y < box.height; ++y) {
            const size_t at = placeOf(box, y, camera.width);
            std::copy_n(&background[at], box.width, &picture[at]);
        }
    } else {
        picture.assign(background.begin(), background.end());
    }
    drawBox(box, mesh, camera, view, options, samples, picture, depths);
    if (depths) {
        drawn_.reset();  // others may be in front of what has moved
        return picture;
    }
    if (!drawn_) drawn_ = std::make_unique<Drawn>();
    if (!onLast) drawn_->background.assign(background.begin(), background.end());
    drawn_->mesh = mesh;
    drawn_->camera = camera;
    drawn_->view = view;
    drawn_->options = options;
    drawn_->samples = samples;
    drawn_->textureVersion = textureVersion_;
    drawn_->verts = verts;
    drawn_->pixels = picture.data();
    return picture;
}

std::vector<uint32_t> Scene::refine(MeshKind mesh, const Camera& camera, const ViewTransform& view,
                                    const ShadeOptions& asked, std::span<const uint32_t> background,
                                    int place, int refinement, std::vector<uint32_t> reused,
                                    std::vector<float>* depths) {
    const ShadeOptions options = shown(asked);
    if (!hasRefinedMesh()) mesh = MeshKind::Body;
    std::vector<uint32_t> picture = std::move(reused);
    picture.assign(background.begin(), background.end());
    // Of the camera that is not shifted, so that all are of one size; it has a pixel to spare.
    PixelBox box = boxOf(posed(mesh).hostVerts, camera, view, options);
    drawBox(box, mesh, camera, view, options, 1, picture, depths, place, refinement);
    drawn_.reset();  // a part of a mean cannot be drawn again
    return picture;
}

Scene::Drawing& Scene::aimed(const PixelBox& box, MeshKind mesh, const Camera& camera,
                             const ViewTransform& view, const ShadeOptions& options, int samples,
                             bool layered, int place, int refinement, int pane) {
    Posing& posing = posed(mesh);
    if (needsNormals(options)) posing.findNormals();
    Drawing& d = drawing({place, mesh, box.width, box.height, samples, options.paint, options.light,
                          options.wireframe, insetOf(options, camera), layered, pane},
                         posing);
    auto f = [](double value) { return static_cast<float>(value); };
    glm::dvec3 lamp = glm::normalize(options.lamp);
    const glm::dmat3& r = view.rotation;  // columns first
    std::array<float, sizeof(ShadeState) / 4> state{
        f(options.ambient), f(lamp.x),  f(lamp.y),  f(lamp.z),  f(r[0][0]), f(r[1][0]), f(r[2][0]),
        f(r[0][1]),         f(r[1][1]), f(r[2][1]), f(r[0][2]), f(r[1][2]), f(r[2][2])};
    static_assert(sizeof(ShadeState::captureLight) == 4 * kLightNumbers);
    std::ranges::copy(avatar_.light, state.end() - kLightNumbers);
    d.graph.write(d.state, std::span<const float>(state));
    std::array<float, 3> turn = axisAngle(view.rotation);
    std::array<float, 3> shift{f(view.translation.x), f(view.translation.y), f(view.translation.z)};
    d.graph.write(d.rotation, std::span<const float>(turn));
    d.graph.write(d.translation, std::span<const float>(shift));
    glm::dvec2 centre(camera.cx - box.x, camera.cy - box.y);
    if (place != kNoPlace) {
        CHECK(refinement == 0 || d.taken == refinement, "refinement {} follows {}", refinement,
              d.taken);
        d.taken = refinement + 1;
        centre += refinementShift(refinement);
        d.graph.write(d.count, std::vector<float>{static_cast<float>(d.taken)});
    }
    RasterCamera raster = rasterCamera(camera);
    raster.fx *= f(samples), raster.fy *= f(samples);
    raster.cx = f(samples * centre.x), raster.cy = f(samples * centre.y);
    d.graph.write(d.camera, cameraValues(raster));

    return d;
}

void Scene::drawBox(const PixelBox& box, MeshKind mesh, const Camera& camera,
                    const ViewTransform& view, const ShadeOptions& options, int samples,
                    std::vector<uint32_t>& picture, std::vector<float>* depths, int place,
                    int refinement) {
    if (box.area() == 0) return;
    Drawing& d = aimed(box, mesh, camera, view, options, samples, depths != nullptr, place,
                       refinement, kNoPlace);
    d.putBehind(picture, box, camera.width);
    const auto pixels = static_cast<size_t>(box.area()), wide = static_cast<size_t>(box.width);
    std::vector<float> near;
    if (depths) {
        CHECK(depths->size() == picture.size(), "a depth for each pixel");
        near.resize(pixels);
        for (int y = 0; y < box.height; ++y)
            std::copy_n(depths->data() + placeOf(box, y, camera.width), wide,
                        &near[static_cast<size_t>(y) * wide]);
        d.graph.write(d.behindDepths, std::span<const float>(near));
    }
    d.graph.run();
    d.drawn.resize(pixels);
    d.graph.read(d.picture, std::span(d.drawn));
    if (depths) {
        d.graph.read(d.depths, std::span(near));
        for (int y = 0; y < box.height; ++y)
            std::copy_n(&near[static_cast<size_t>(y) * wide], wide,
                        depths->data() + placeOf(box, y, camera.width));
    }
    for (int y = 0; y < box.height; ++y)
        std::copy_n(&d.drawn[static_cast<size_t>(y) * wide], wide,
                    &picture[placeOf(box, y, camera.width)]);
}

PictureOnDevice Scene::drawOnDevice(MeshKind mesh, const Camera& camera, const ViewTransform& view,
                                    const ShadeOptions& asked, const Pixels& background, int pane,
                                    int samples, std::optional<int> refinement) {
    const ShadeOptions options = shown(asked);
    if (!hasRefinedMesh()) mesh = MeshKind::Body;
    drawn_.reset();
    const PixelBox box = boxOf(posed(mesh).hostVerts, camera, view, options);
    if (box.area() == 0) return {background, box, nullptr};
    Drawing& d = aimed(box, mesh, camera, view, options, refinement ? 1 : samples, false,
                       refinement ? pane : kNoPlace, refinement.value_or(0), pane);
    if (d.behindOf != background || d.behindBox != box) {
        d.putBehind(*background, box, camera.width);
        d.behindOf = background;
        d.behindBox = box;
    }
    d.graph.run();  // whose time says how many samples the next picture has
    return {background, box, d.result};
}

std::vector<uint32_t> onHost(Device& device, const PictureOnDevice& picture, int width) {
    std::vector<uint32_t> pixels = *picture.background;
    if (!picture.drawn) return pixels;
    const PixelBox& box = picture.box;
    std::vector<uint32_t> drawn(static_cast<size_t>(box.area()));
    device.download({picture.drawn.get(), 0, picture.drawn->bytes()},
                    std::as_writable_bytes(std::span(drawn)));
    for (int y = 0; y < box.height; ++y)
        std::copy_n(&drawn[static_cast<size_t>(y) * static_cast<size_t>(box.width)], box.width,
                    &pixels[placeOf(box, y, width)]);
    return pixels;
}

std::vector<float> Scene::vertices(MeshKind mesh) { return posed(mesh).hostVerts; }

std::vector<float> Scene::vertices(MeshKind mesh, const ViewTransform& view) {
    std::vector<float> verts = vertices(mesh);
    for (size_t i = 0; i + 2 < verts.size(); i += 3) {
        glm::dvec3 p = view({verts[i], verts[i + 1], verts[i + 2]});
        for (int k = 0; k < 3; ++k) verts[i + static_cast<size_t>(k)] = static_cast<float>(p[k]);
    }
    return verts;
}

}  // namespace doppel
