#include "nn/ops/gan.h"

#include "gan/params.h"
#include "nn/core/op.h"
#include "nn/ops/conv/windows.h"
#include "nn/ops/linalg.h"

namespace doppel {

namespace {

struct GanLossKernels {
    const char *name, *mean, *backward;
};
constexpr GanLossKernels kLog{"log_gan_loss", "gan/log_gan_loss.mean", "gan/log_gan_loss.backward"};
constexpr GanLossKernels kLeastSquares{"least_squares_gan_loss", "gan/least_squares_gan_loss.mean",
                                       "gan/least_squares_gan_loss.backward"};

Tensor ganLoss(Graph& graph, const GanLossKernels& kernels, const Tensor& x, bool real) {
    CHECK(x.elements() > 0, "there are logits");
    GanLossParams params{u32(x.elements()), real ? 1.0f : 0.0f};
    Tensor loss = graph.temporary({});
    graph.beginOp(kernels.name);
    graph.dispatchGroups(kernels.mean, {{"x", x}, {"loss", loss}}, params, Groups{1, 1, 1},
                         {{"local_size", 256}});
    graph.differentiate({x}, {loss}, [=, &graph] {
        graph.dispatch(kernels.backward,
                       {{"x", x}, {"dLoss", graph.gradient(loss)}, {"dx", graph.gradientTarget(x)}},
                       params, params.n);
    });
    return loss;
}

}  // namespace

Tensor logGanLoss(Graph& graph, const Tensor& x, bool real) {
    return ganLoss(graph, kLog, x, real);
}
Tensor leastSquaresGanLoss(Graph& graph, const Tensor& x, bool real) {
    return ganLoss(graph, kLeastSquares, x, real);
}

Tensor cropWindow(Graph& graph, const Tensor& x, const Tensor& centres, int64_t size) {
    CHECK(x.shape.size() == 4 && centres.shape == (Shape{x.dim(0), 2}),
          "pictures [N,C,H,W] have centres [N,2], not {} and {}", toString(x.shape),
          toString(centres.shape));
    CHECK(size > 0, "a window has pixels");
    CropWindowParams params{.width = u32(x.dim(3)),
                            .height = u32(x.dim(2)),
                            .size = u32(size),
                            .byChannels = divisorOf(uint64_t(x.dim(1)))};
    Tensor y = graph.temporary({x.dim(0), x.dim(1), size, size});
    graph.beginOp("crop_window");
    Specialisation spec;
    Groups groups = planes(size, size, x.dim(0) * x.dim(1), spec);
    graph.dispatchGroups("gan/crop_window.forward", {{"x", x}, {"centres", centres}, {"y", y}},
                         params, groups, spec);
    graph.differentiate({x}, {y}, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        graph.fill(dx);
        graph.dispatchGroups("gan/crop_window.backward",
                             {{"centres", centres}, {"dy", graph.gradient(y)}, {"dx", dx}}, params,
                             groups, spec);
    });
    return y;
}

Tensor misalignedRegion(Graph& graph, const Tensor& rendered, const Tensor& real,
                        const Tensor& centres, int64_t row, int64_t faceSize, bool oneSided) {
    CHECK(rendered.shape.size() == 2 && real.shape == rendered.shape,
          "silhouettes {} and {} are [H,W]", toString(rendered.shape), toString(real.shape));
    CHECK(centres.shape.size() == 2 && centres.dim(1) == 2 && row >= 0 && row < centres.dim(0) &&
              faceSize >= 0,
          "row {} is one of the centres {}", row, toString(centres.shape));
    MisalignedRegionParams params{u32(rendered.dim(1)), u32(row), u32(faceSize),
                                  oneSided ? 1u : 0u};
    Tensor region = graph.temporary(rendered.shape);
    graph.beginOp("misaligned_region");
    Specialisation spec;
    Groups groups = planes(rendered.dim(1), rendered.dim(0), 1, spec);
    graph.dispatchGroups(
        "gan/misaligned_region.forward",
        {{"rendered", rendered}, {"real", real}, {"centres", centres}, {"region", region}}, params,
        groups, spec);
    return region;
}

Tensor planar(Graph& graph, const std::vector<Tensor>& images, const std::vector<Tensor>& masks) {
    CHECK(!images.empty() && (masks.empty() || masks.size() == images.size()),
          "each of {} pictures has a mask, or none has; there are {}", images.size(), masks.size());
    const Shape& shape = images[0].shape;
    CHECK(shape.size() == 3, "a picture is [H,W,C], not {}", toString(shape));
    for (size_t n = 0; n < images.size(); ++n) {
        CHECK(images[n].shape == shape, "all pictures are {}", toString(shape));
        CHECK(masks.empty() || masks[n].shape == (Shape{shape[0], shape[1]}),
              "a mask has the pixels of its picture");
    }
    CHECK(images.size() == 1 || elementCount(shape) % 4 == 0,
          "pictures of a batch start at multiples of 16 bytes, not {}", toString(shape));
    PlanarParams params{u32(shape[2]), u32(shape[0] * shape[1])};
    Specialisation spec{{"kMasked", masks.empty() ? 0u : 1u}};
    Tensor y = graph.temporary({static_cast<int64_t>(images.size()), shape[2], shape[0], shape[1]});
    auto maskOf = [=, &graph](size_t n) { return masks.empty() ? graph.none() : masks[n]; };
    graph.beginOp("planar");
    for (size_t n = 0; n < images.size(); ++n)
        graph.dispatch(
            "gan/planar.forward",
            {{"image", images[n]}, {"mask", maskOf(n)}, {"y", y.slice(static_cast<int64_t>(n), 1)}},
            params, params.pixels, spec);
    graph.differentiate(images, {y}, [=, &graph] {
        Tensor dy = graph.gradient(y);
        for (size_t n = 0; n < images.size(); ++n)
            if (graph.wantsGradient(images[n]))
                graph.dispatch("gan/planar.backward",
                               {{"mask", maskOf(n)},
                                {"dy", dy.slice(static_cast<int64_t>(n), 1)},
                                {"dImage", graph.gradientTarget(images[n])}},
                               params, params.pixels, spec);
    });
    return y;
}

Tensor detach(Graph& graph, const Tensor& x) {
    Tensor y = graph.temporary(x.shape, x.type);
    graph.beginOp("detach");
    graph.copy(x, y);
    return y;
}

// ---- for op_runner ------------------------------------------------------------------------------

static const Op kLogGanLoss{{
    .name = "log_gan_loss",
    .inputs = "x",
    .attributes = "real",
    .outputs = "loss",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            if (c["x"].elements() == 0) throwInput("x: expected logits, found none");
            c.result("loss", logGanLoss(c.graph, c["x"], c.u("real") != 0));
        },
}};
static const Op kLeastSquaresGanLoss{{
    .name = "least_squares_gan_loss",
    .inputs = "x",
    .attributes = "real",
    .outputs = "loss",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            if (c["x"].elements() == 0) throwInput("x: expected logits, found none");
            c.result("loss", leastSquaresGanLoss(c.graph, c["x"], c.u("real") != 0));
        },
}};
static const Op kCropWindow{{
    .name = "crop_window",
    .inputs = "x[N,C,H,W] centres[N,2]",
    .attributes = "size",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            if (c.u("size") == 0 || c.u("size") > 16384)
                throwInput("attr_size: expected pixels from 1 to 16384, found {}", c.u("size"));
            c.result("y", cropWindow(c.graph, c["x"], c["centres"], c.u("size")));
        },
}};
static const Op kMisalignedRegion{{
    .name = "misaligned_region",
    .inputs = "rendered[H,W] real[H,W] centres[N,2]",
    .attributes = "row=0 face_size one_sided=0",
    .outputs = "region",
    .build =
        [](OpCall& c) {
            if (c.u("row") >= c["centres"].dim(0))
                throwInput("attr_row: there are {} centres, found {}", c["centres"].dim(0),
                           c.u("row"));
            if (c.u("face_size") > 16384)
                throwInput("attr_face_size: expected pixels from 0 to 16384, found {}",
                           c.u("face_size"));
            c.result("region",
                     misalignedRegion(c.graph, c["rendered"], c["real"], c["centres"], c.u("row"),
                                      c.u("face_size"), c.u("one_sided") != 0));
        },
}};
static const Op kPlanar{{
    .name = "planar",
    .inputs = "image[H,W,C] mask[H,W]?",
    .outputs = "y",
    .differentiable = "image",
    .build =
        [](OpCall& c) {
            std::vector<Tensor> masks;
            if (c["mask"]) masks.push_back(c["mask"]);
            c.result("y", planar(c.graph, {c["image"]}, masks));
        },
}};

}  // namespace doppel
