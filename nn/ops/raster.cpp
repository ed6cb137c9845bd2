#include "nn/ops/raster.h"

#include <algorithm>
#include <cstring>

#include "engine/files/numbers.h"
#include "nn/core/op.h"

namespace doppel {

namespace {

// Workgroups that share the large faces; without any they cost a fifth of a millisecond.
constexpr Groups kLargeGroups{64, 1, 1};

// Triples as [F,4], so that a kernel loads a face at once.
Tensor paddedTriples(Graph& graph, std::span<const int32_t> triples, int64_t limit,
                     std::string_view what, std::string_view of) {
    CHECK(triples.size() % 3 == 0, "{} has three entries per face", what);
    std::vector<int32_t> padded;
    padded.reserve(triples.size() / 3 * 4);
    for (size_t i = 0; i < triples.size(); ++i) {
        if (triples[i] < 0 || triples[i] >= limit)
            throwInput("{}: face {}: expected {} from 0 to {}, found {}", what, i / 3, of,
                       limit - 1, triples[i]);
        padded.push_back(triples[i]);
        if (i % 3 == 2) padded.push_back(0);
    }
    if (padded.empty()) padded.resize(4);  // a descriptor is never of nothing
    return graph.constant(std::span<const int32_t>(padded),
                          {static_cast<int64_t>(padded.size() / 4), 4});
}

// Vertices in the picture: [V,4].
Tensor project(Graph& graph, const RasterMesh& mesh, const Tensor& verts, const Tensor& camera,
               const ProjectParams& params) {
    Tensor screen = graph.temporary({mesh.vertices, 4});
    graph.dispatch("raster/project.forward",
                   {{"verts", verts}, {"camera", camera}, {"screen", screen}}, params,
                   params.vertices);
    return screen;
}

void checkRender(const RasterMesh& mesh, const Tensor& verts, const Tensor& camera, int64_t height,
                 int64_t width) {
    CHECK(verts.shape == (Shape{mesh.vertices, 3}), "verts is [{},3]", mesh.vertices);
    CHECK(camera.shape == kCameraShape, "a camera is {}", toString(kCameraShape));
    CHECK(height > 0 && width > 0 && height * width <= (int64_t{1} << 28),
          "a picture of {}x{} pixels is drawn", width, height);
}

// An empty list of large faces.
Tensor largeList(Graph& graph, const RasterMesh& mesh) {
    Tensor large = graph.temporary({1 + mesh.faces}, ElementType::I32);
    graph.fill(large.slice(0, 1));
    return large;
}

}  // namespace

RasterMesh rasterMesh(Graph& graph, std::span<const int32_t> faces, int64_t vertices,
                      std::string_view what) {
    RasterMesh mesh;
    mesh.vertices = vertices;
    mesh.faces = static_cast<int64_t>(faces.size() / 3);
    mesh.faceVertices = paddedTriples(graph, faces, vertices, what, "a vertex");
    std::vector<int32_t> start(static_cast<size_t>(vertices) + 1);
    std::vector<int32_t> corners(std::max<size_t>(faces.size(), 1));
    for (int32_t v : faces) ++start[static_cast<size_t>(v) + 1];
    for (size_t v = 0; v < static_cast<size_t>(vertices); ++v) start[v + 1] += start[v];
    std::vector<int32_t> next(start.begin(), start.end() - 1);
    for (size_t i = 0; i < faces.size(); ++i)
        corners[static_cast<size_t>(next[static_cast<size_t>(faces[i])]++)] =
            static_cast<int32_t>(i);
    mesh.cornerStart = graph.constant(std::span<const int32_t>(start), {vertices + 1});
    mesh.corners =
        graph.constant(std::span<const int32_t>(corners), {static_cast<int64_t>(corners.size())});
    return mesh;
}

RasterAtlas rasterAtlas(Graph& graph, const Tensor& uvs, std::span<const int32_t> facesUv,
                        std::string_view what) {
    CHECK(uvs.shape.size() == 2 && uvs.dim(1) == 2, "uvs is [T,2]");
    return {uvs, paddedTriples(graph, facesUv, uvs.dim(0), what, "a UV")};
}

// ---- soft silhouette ----------------------------------------------------------------------------

Tensor softSilhouette(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                      const Tensor& camera, int64_t height, int64_t width,
                      const RasterOptions& options) {
    checkRender(mesh, verts, camera, height, width);
    uint32_t faces = u32(mesh.faces), pixels = u32(height * width);
    SoftSilhouetteParams params{faces, u32(width), u32(height), options.largeBox};
    ProjectParams projection{u32(mesh.vertices), static_cast<float>(width) / 2,
                             static_cast<float>(height) / 2};
    Tensor silhouette = graph.temporary({height, width});
    Tensor transmittance = graph.temporary({height, width});
    Tensor sum = graph.temporary({2, height, width}, ElementType::I32);

    graph.beginOp("soft_silhouette");
    Tensor screen = project(graph, mesh, verts, camera, projection);
    Tensor large = largeList(graph, mesh);
    graph.fill(sum);
    graph.dispatch("raster/soft_silhouette.forward_small",
                   {{"faces", mesh.faceVertices},
                    {"screen", screen},
                    {"camera", camera},
                    {"sum", sum},
                    {"large", large}},
                   params, faces);
    graph.dispatchGroups("raster/soft_silhouette.forward_large",
                         {{"faces", mesh.faceVertices},
                          {"screen", screen},
                          {"camera", camera},
                          {"sum", sum},
                          {"large", large}},
                         params, kLargeGroups);
    graph.dispatch("raster/soft_silhouette.resolve",
                   {{"sum", sum}, {"silhouette", silhouette}, {"transmittance", transmittance}},
                   params, pixels);

    graph.differentiate({verts}, {silhouette}, [=, &graph] {
        Tensor weight = graph.temporary({height, width});
        Tensor dCorners = graph.temporary({mesh.corners.dim(0), 2});
        graph.dispatch("raster/soft_silhouette.weigh",
                       {{"dSilhouette", graph.gradient(silhouette)},
                        {"transmittance", transmittance},
                        {"weight", weight}},
                       params, pixels);
        Tensor largeAgain = largeList(graph, mesh);
        graph.dispatch("raster/soft_silhouette.backward_small",
                       {{"faces", mesh.faceVertices},
                        {"screen", screen},
                        {"camera", camera},
                        {"large", largeAgain},
                        {"weight", weight},
                        {"dCorners", dCorners}},
                       params, faces);
        graph.dispatchGroups("raster/soft_silhouette.backward_large",
                             {{"faces", mesh.faceVertices},
                              {"screen", screen},
                              {"camera", camera},
                              {"large", largeAgain},
                              {"weight", weight},
                              {"dCorners", dCorners}},
                             params, kLargeGroups);
        graph.dispatch("raster/project.backward",
                       {{"verts", verts},
                        {"camera", camera},
                        {"cornerStart", mesh.cornerStart},
                        {"corners", mesh.corners},
                        {"dCorners", dCorners},
                        {"dverts", graph.gradientTarget(verts)}},
                       projection, projection.vertices);
    });
    return silhouette;
}

// ---- visibility buffer --------------------------------------------------------------------------

NearestFaces nearestFaces(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                          const Tensor& camera, int64_t height, int64_t width,
                          const RasterOptions& options) {
    checkRender(mesh, verts, camera, height, width);
    const Device& device = graph.device();
    uint32_t faces = u32(mesh.faces);
    NearestFaces result;
    // Descriptors are for tests: two passes are tested there.
    result.keys = device.kernelPath().int64Atomics;
    graph.beginOp("nearest_faces");
    result.screen = project(
        graph, mesh, verts, camera,
        {u32(mesh.vertices), static_cast<float>(width) / 2, static_cast<float>(height) / 2});
    Tensor large = largeList(graph, mesh);
    VisibilityParams params{
        faces, u32(width), u32(height), options.largeBox, 0, divisorOf(uint64_t(width))};
    if (result.keys) {
        result.index = graph.temporary({height, width, 2}, ElementType::I32);
        graph.fill(result.index);
        graph.dispatch("raster/visibility.small@keys",
                       {{"faces", mesh.faceVertices},
                        {"screen", result.screen},
                        {"keys", result.index},
                        {"large", large}},
                       params, faces);
        graph.dispatchGroups("raster/visibility.large@keys",
                             {{"faces", mesh.faceVertices},
                              {"screen", result.screen},
                              {"keys", result.index},
                              {"large", large}},
                             params, kLargeGroups);
        return result;
    }
    result.index = graph.temporary({height, width}, ElementType::I32);
    Tensor nearness = graph.temporary({height, width}, ElementType::I32);
    graph.fill(nearness);
    graph.fill(result.index, 0xffffffffu);
    for (params.pass = 0; params.pass < 2; ++params.pass) {
        graph.dispatch("raster/visibility.small",
                       {{"faces", mesh.faceVertices},
                        {"screen", result.screen},
                        {"nearness", nearness},
                        {"index", result.index},
                        {"large", large}},
                       params, faces);
        graph.dispatchGroups("raster/visibility.large",
                             {{"faces", mesh.faceVertices},
                              {"screen", result.screen},
                              {"nearness", nearness},
                              {"index", result.index},
                              {"large", large}},
                             params, kLargeGroups);
    }
    return result;
}

VisibilityBuffer visibilityBuffer(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                                  const Tensor& camera, int64_t height, int64_t width,
                                  const RasterOptions& options) {
    NearestFaces nearest = nearestFaces(graph, mesh, verts, camera, height, width, options);
    VisibilityBuffer result{nearest.index, graph.temporary({height, width}),
                            graph.temporary({height, width, 4})};
    VisibilityParams params{u32(mesh.faces),  u32(width), u32(height),
                            options.largeBox, 0,          divisorOf(uint64_t(width))};
    auto pixels = static_cast<uint64_t>(height * width);
    graph.beginOp("visibility_buffer");
    if (nearest.keys) {
        result.faceIndex = graph.temporary({height, width}, ElementType::I32);
        graph.dispatch("raster/visibility.resolve@keys",
                       {{"faces", mesh.faceVertices},
                        {"screen", nearest.screen},
                        {"keys", nearest.index},
                        {"index", result.faceIndex},
                        {"mask", result.mask},
                        {"surface", result.surface}},
                       params, pixels);
        return result;
    }
    graph.dispatch("raster/visibility.resolve",
                   {{"faces", mesh.faceVertices},
                    {"screen", nearest.screen},
                    {"index", result.faceIndex},
                    {"mask", result.mask},
                    {"surface", result.surface}},
                   params, pixels);
    return result;
}

Tensor texturedRender(Graph& graph, const VisibilityBuffer& visibility, const RasterAtlas& atlas,
                      const Tensor& texture) {
    CHECK(texture.shape.size() == 3 && texture.dim(2) == 3, "a texture is [H,W,3]");
    const Shape& size = visibility.mask.shape;
    uint32_t pixels = u32(visibility.mask.elements());
    int64_t plane = static_cast<int64_t>(alignUp(static_cast<uint64_t>(texture.elements()), 4));
    TexturedRenderParams params{pixels, u32(texture.dim(1)), u32(texture.dim(0)), u32(plane)};
    Tensor image = graph.temporary({size[0], size[1], 3});
    graph.beginOp("textured_render");
    graph.dispatch("raster/textured_render.forward",
                   {{"index", visibility.faceIndex},
                    {"surface", visibility.surface},
                    {"uvs", atlas.uvs},
                    {"facesUv", atlas.faceCorners},
                    {"tex", texture},
                    {"image", image}},
                   params, pixels);
    graph.differentiate({texture}, {image}, [=, &graph] {
        Tensor dImage = graph.gradient(image);
        Tensor largest = graph.temporary({1}, ElementType::I32);
        Tensor sums = graph.temporary({2, plane}, ElementType::I32);
        graph.fill(largest);
        graph.fill(sums.slice(0, 1), 0x80000000u);
        graph.fill(sums.slice(1, 1));
        graph.dispatchGroups(
            "raster/textured_render.backward_range",
            {{"index", visibility.faceIndex}, {"dImage", dImage}, {"largest", largest}}, params,
            {32, 1, 1});
        graph.dispatch("raster/textured_render.backward_scatter",
                       {{"index", visibility.faceIndex},
                        {"surface", visibility.surface},
                        {"uvs", atlas.uvs},
                        {"facesUv", atlas.faceCorners},
                        {"dImage", dImage},
                        {"largest", largest},
                        {"sums", sums}},
                       params, pixels);
        Tensor dTexture = graph.gradientTarget(texture);
        graph.dispatch("raster/textured_render.backward_convert",
                       {{"largest", largest},
                        {"sums", sums},
                        {"sums4", sums},
                        {"dTexture", dTexture},
                        {"dTexture4", dTexture}},
                       params, static_cast<uint64_t>(texture.elements() / 4 + 3));
    });
    return image;
}

// ---- pictures of several samples per pixel ------------------------------------------------------

Tensor seenSpans(Graph& graph, const NearestFaces& nearest, int64_t height, int64_t width,
                 int64_t samples) {
    auto pixels = static_cast<uint64_t>(height * width), most = (pixels + kSpan - 1) / kSpan;
    Tensor spans = graph.temporary({static_cast<int64_t>(1 + most)}, ElementType::I32);
    graph.fill(spans.slice(0, 1));
    graph.dispatch(
        "raster/seen_spans.list", {{"index", nearest.index}, {"spans", spans}},
        SeenSpansParams{u32(width), u32(height), divisorOf(static_cast<uint64_t>(width))}, most,
        {{"samples", u32(samples)}, {"keys", nearest.keys ? 1u : 0u}});
    return spans;
}

Groups spanGroups(const Device& device, int64_t pixels) {
    // A CPU pays for each workgroup.
    return {device.kernelPath().onCpu ? 64 : u32(std::min<int64_t>((pixels + 63) / 64, 65535)), 1,
            1};
}

SampledRender sampledRender(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                            const Tensor& camera, const RasterAtlas& atlas, const Tensor& texture,
                            int64_t height, int64_t width, int64_t samples,
                            const RasterOptions& options) {
    CHECK(texture.shape.size() == 3 && texture.dim(2) == 3, "a texture is [H,W,3]");
    CHECK(samples > 0, "a pixel has samples");
    NearestFaces nearest =
        nearestFaces(graph, mesh, verts, camera, height * samples, width * samples, options);
    SampledRender result{graph.temporary({height, width, 3}), graph.temporary({height, width})};
    graph.beginOp("sampled_render");
    Tensor spans = seenSpans(graph, nearest, height, width, samples);
    graph.fill(result.image);
    graph.fill(result.coverage);
    SampledRenderParams params{u32(width), u32(height), u32(texture.dim(1)), u32(texture.dim(0)),
                               divisorOf(static_cast<uint64_t>(width))};
    graph.dispatchGroups("raster/sampled_render.forward",
                         {{"index", nearest.index},
                          {"screen", nearest.screen},
                          {"faces", mesh.faceVertices},
                          {"uvs", atlas.uvs},
                          {"facesUv", atlas.faceCorners},
                          {"tex", texture},
                          {"spans", spans},
                          {"image", result.image},
                          {"coverage", result.coverage}},
                         params, spanGroups(graph.device(), height * width),
                         {{"samples", u32(samples)}, {"keys", nearest.keys ? 1u : 0u}});
    return result;
}

// ---- visibility map -----------------------------------------------------------------------------

Tensor visibilityMap(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                     const RasterAtlas& atlas, int64_t size, const RasterOptions& options) {
    CHECK(verts.shape == (Shape{mesh.vertices, 3}), "verts is [{},3]", mesh.vertices);
    CHECK(atlas.faceCorners.shape == mesh.faceVertices.shape, "the atlas has the mesh's {} faces",
          mesh.faces);
    CHECK(size > 0 && size <= 16384, "a visibility map of size {} is drawn", size);
    VisibilityMapParams params{u32(mesh.faces), u32(size), options.largeBox};
    Tensor visibility = graph.temporary({size, size});
    graph.beginOp("visibility_map");
    Tensor large = largeList(graph, mesh);
    graph.fill(visibility);
    graph.dispatch("raster/visibility_map.small",
                   {{"faces", mesh.faceVertices},
                    {"verts", verts},
                    {"uvs", atlas.uvs},
                    {"facesUv", atlas.faceCorners},
                    {"visibility", visibility},
                    {"large", large}},
                   params, params.faces);
    graph.dispatchGroups("raster/visibility_map.large",
                         {{"uvs", atlas.uvs},
                          {"facesUv", atlas.faceCorners},
                          {"visibility", visibility},
                          {"large", large}},
                         params, kLargeGroups);
    return visibility;
}

// ---- declarations -------------------------------------------------------------------------------

namespace {

constexpr int64_t kMostPixels = 8192;

RasterOptions optionsOf(OpCall& c) { return {.largeBox = c.u("large_box")}; }

}  // namespace

// large_box: see RasterOptions; tests force both paths with it.
static const Op kSoftSilhouette{{
    .name = "soft_silhouette",
    .inputs = "verts[V,3] faces:i32[F,3]",
    .attributes = "fx fy cx cy width height sigma blur_radius large_box=1024",
    .outputs = "silhouette",
    .differentiable = "verts",
    .build =
        [](OpCall& c) {
            double blur = c.attribute("blur_radius");
            if (blur < 0) throwInput("attr_blur_radius: expected 0 or more, found {}", blur);
            Tensor camera = cameraOf(c, positive(c, "sigma"), c.f("blur_radius"));
            RasterMesh mesh = rasterMesh(c.graph, c.ints("faces"), c["verts"].dim(0));
            c.result("silhouette", softSilhouette(c.graph, mesh, c["verts"], camera,
                                                  side(c, "height", kMostPixels),
                                                  side(c, "width", kMostPixels), optionsOf(c)));
        },
}};

static const Op kTexturedRender{{
    .name = "textured_render",
    .inputs = "verts[V,3] faces:i32[F,3] uvs[T,2] faces_uv:i32[F,3] texture[Ht,Wt,3]",
    .attributes = "fx fy cx cy width height large_box=1024",
    .outputs = "image mask face_index",
    .differentiable = "texture",
    .build =
        [](OpCall& c) {
            RasterMesh mesh = rasterMesh(c.graph, c.ints("faces"), c["verts"].dim(0));
            RasterAtlas atlas = rasterAtlas(c.graph, c["uvs"], c.ints("faces_uv"));
            VisibilityBuffer visibility = visibilityBuffer(
                c.graph, mesh, c["verts"], cameraOf(c, 1, 0), side(c, "height", kMostPixels),
                side(c, "width", kMostPixels), optionsOf(c));
            c.result("image", texturedRender(c.graph, visibility, atlas, c["texture"]));
            c.result("mask", visibility.mask);
            c.result("face_index", visibility.faceIndex);
        },
}};

static const Op kSampledRender{{
    .name = "sampled_render",
    .inputs = "verts[V,3] faces:i32[F,3] uvs[T,2] faces_uv:i32[F,3] texture[Ht,Wt,3]",
    .attributes = "fx fy cx cy width height samples=2 large_box=1024",
    .outputs = "image coverage",
    .differentiable = "",
    .build =
        [](OpCall& c) {
            int64_t samples = side(c, "samples", 16);
            RasterMesh mesh = rasterMesh(c.graph, c.ints("faces"), c["verts"].dim(0));
            RasterAtlas atlas = rasterAtlas(c.graph, c["uvs"], c.ints("faces_uv"));
            SampledRender drawn = sampledRender(
                c.graph, mesh, c["verts"], cameraOf(c, 1, 0, static_cast<float>(samples)), atlas,
                c["texture"], side(c, "height", kMostPixels / samples),
                side(c, "width", kMostPixels / samples), samples, optionsOf(c));
            c.result("image", drawn.image);
            c.result("coverage", drawn.coverage);
        },
}};

static const Op kVisibilityMap{{
    .name = "visibility_map",
    .inputs = "verts[V,3] faces:i32[F,3] uvs[T,2] faces_uv:i32[F,3]",
    .attributes = "size large_box=1024",
    .outputs = "visibility",
    .differentiable = "",
    .build =
        [](OpCall& c) {
            RasterMesh mesh = rasterMesh(c.graph, c.ints("faces"), c["verts"].dim(0));
            RasterAtlas atlas = rasterAtlas(c.graph, c["uvs"], c.ints("faces_uv"));
            c.result("visibility", visibilityMap(c.graph, mesh, c["verts"], atlas,
                                                 side(c, "size", 16384), optionsOf(c)));
        },
}};

}  // namespace doppel
