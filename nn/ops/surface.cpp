#include "nn/ops/surface.h"

#include "nn/core/op.h"

namespace doppel {

namespace {

// Workgroups that share the large faces.
constexpr Groups kLargeGroups{64, 1, 1};

}  // namespace

SurfaceRender surfaceRender(Graph& graph, const RasterMesh& mesh, const Tensor& verts,
                            const Tensor& camera, const SurfaceLook* look, int64_t height,
                            int64_t width, const SurfaceOptions& options) {
    CHECK(options.samples > 0, "a pixel has samples");
    const int64_t rows = height * options.samples, columns = width * options.samples;
    const VisibilityBuffer seen =
        visibilityBuffer(graph, mesh, verts, camera, rows, columns, options.raster);
    const bool coloured = look != nullptr;
    const Tensor none = graph.none();
    const Tensor colours =
        coloured ? texturedRender(graph, seen, look->atlas, look->texture) : none;
    const Tensor background = coloured ? look->background : none;
    const bool taught = coloured && look->teaches;
    if (coloured)
        CHECK(background.shape == (Shape{height, width, 3}), "the background is [{},{},3]", height,
              width);
    if (taught)
        CHECK(look->teaches.shape == (Shape{height, width}), "a pixel of [{},{}] teaches", height,
              width);
    const bool faced = coloured && look->facing;
    if (faced)
        CHECK(look->facing.shape == (Shape{verts.dim(0), 4}),
              "each of {} vertices has a normal and a power", verts.dim(0));
    SurfaceRender result{coloured ? graph.temporary({height, width, 3}) : Tensor(),
                         graph.temporary({height, width})};
    const Tensor image = coloured ? result.image : none, alpha = result.alpha;
    const SurfaceParams params{static_cast<uint32_t>(width),
                               static_cast<uint32_t>(height),
                               coloured ? static_cast<uint32_t>(look->texture.dim(1)) : 1u,
                               coloured ? static_cast<uint32_t>(look->texture.dim(0)) : 1u,
                               options.edgeJump,
                               divisorOf(static_cast<uint64_t>(columns))};
    const Specialisation spec{{"samples", static_cast<uint32_t>(options.samples)},
                              {"coloured", coloured ? 1u : 0u}};
    Specialisation blend = spec;
    blend["taught"] = taught;
    blend["faced"] = faced;
    const auto samples = static_cast<uint64_t>(rows * columns);
    graph.beginOp("surface_render");
    graph.dispatch("raster/surface_blend.forward",
                   {{"index", seen.faceIndex},
                    {"colours", colours},
                    {"background", background},
                    {"image", image},
                    {"alpha", alpha}},
                   params, static_cast<uint64_t>(height * width), blend);

    std::vector<Tensor> inputs{verts}, outputs{alpha};
    if (coloured) inputs.push_back(colours), outputs.push_back(image);
    const SurfaceLook look_ = coloured ? *look : SurfaceLook{{none, none}, none, none};
    graph.differentiate(inputs, outputs, [=, &graph] {
        const Tensor dImage = coloured ? graph.gradient(image) : none;
        if (coloured && graph.wantsGradient(colours))
            graph.dispatch("raster/surface_blend.backward",
                           {{"index", seen.faceIndex},
                            {"dImage", dImage},
                            {"teaches", taught ? look_.teaches : none},
                            {"surface", seen.surface},
                            {"faces", mesh.faceVertices},
                            {"verts", verts},
                            {"facing", faced ? look_.facing : none},
                            {"dColours", graph.gradientTarget(colours)}},
                           params, samples, blend);
        if (!graph.wantsGradient(verts)) return;
        Tensor screen = graph.temporary({mesh.vertices, 4});
        const ProjectParams projection{static_cast<uint32_t>(mesh.vertices),
                                       static_cast<float>(columns) / 2,
                                       static_cast<float>(rows) / 2};
        graph.dispatch("raster/project.forward",
                       {{"verts", verts}, {"camera", camera}, {"screen", screen}}, projection,
                       projection.vertices);
        Tensor force = graph.temporary({rows, columns, 2});
        graph.dispatch("raster/surface_force.backward",
                       {{"index", seen.faceIndex},
                        {"surface", seen.surface},
                        {"screen", screen},
                        {"faces", mesh.faceVertices},
                        {"uvs", look_.atlas.uvs},
                        {"facesUv", look_.atlas.faceCorners},
                        {"tex", look_.texture},
                        {"colours", colours},
                        {"background", background},
                        {"dImage", dImage},
                        {"dAlpha", graph.gradient(alpha)},
                        {"force", force}},
                       params, samples, spec);
        const SurfaceGradientParams gradient{
            static_cast<uint32_t>(mesh.faces), static_cast<uint32_t>(mesh.vertices),
            static_cast<uint32_t>(columns), static_cast<uint32_t>(rows), options.raster.largeBox};
        Tensor large = graph.temporary({1 + mesh.faces}, ElementType::I32);
        Tensor dCorners = graph.temporary({mesh.corners.dim(0), 3});
        graph.fill(large.slice(0, 1));
        auto overFaces = [&](const char* kernel, Groups groups, uint64_t invocations) {
            graph.dispatchGroups(kernel,
                                 {{"faces", mesh.faceVertices},
                                  {"screen", screen},
                                  {"camera", camera},
                                  {"index", seen.faceIndex},
                                  {"surface", seen.surface},
                                  {"force", force},
                                  {"large", large},
                                  {"dCorners", dCorners}},
                                 gradient, groups, {}, invocations);
        };
        overFaces("raster/surface_gradient.small", {0, 0, 0}, gradient.faces);
        overFaces("raster/surface_gradient.large", kLargeGroups, 0);
        graph.dispatch("raster/surface_gradient.gather",
                       {{"cornerStart", mesh.cornerStart},
                        {"corners", mesh.corners},
                        {"dCorners", dCorners},
                        {"dverts", graph.gradientTarget(verts)}},
                       gradient, gradient.vertices);
    });
    return result;
}

static const Op kSurfaceRender{{
    .name = "surface_render",
    .inputs = "verts[V,3] faces:i32[F,3] uvs[T,2]? faces_uv:i32[F,3]? texture[Ht,Wt,3]? "
              "background[H,W,3]? teaches[H,W]? facing[V,4]?",
    .attributes = "fx fy cx cy width height samples=1 edge_jump=0.03 large_box=1024",
    .outputs = "alpha image",
    .differentiable = "verts texture",
    .build =
        [](OpCall& c) {
            const int64_t samples = side(c, "samples", 16);
            Tensor camera = cameraOf(c, 1, 0, static_cast<float>(samples));
            RasterMesh mesh = rasterMesh(c.graph, c.ints("faces"), c["verts"].dim(0));
            const bool coloured = static_cast<bool>(c["texture"]);
            SurfaceLook look;
            if (coloured) {
                for (const char* name : {"uvs", "faces_uv", "background"})
                    if (!c[name]) throwInput("{}: expected beside a texture, found none", name);
                look = {rasterAtlas(c.graph, c["uvs"], c.ints("faces_uv")), c["texture"],
                        c["background"], c["teaches"], c["facing"]};
            }
            SurfaceRender drawn =
                surfaceRender(c.graph, mesh, c["verts"], camera, coloured ? &look : nullptr,
                              side(c, "height", 8192 / samples), side(c, "width", 8192 / samples),
                              {.samples = samples,
                               .edgeJump = c.f("edge_jump"),
                               .raster = {.largeBox = c.u("large_box")}});
            c.result("alpha", drawn.alpha);
            if (coloured) c.result("image", drawn.image);
        },
}};

}  // namespace doppel
