#include "nn/ops/loss.h"

#include "common/pairs.h"
#include "engine/files/numbers.h"
#include "loss/params.h"
#include "nn/core/op.h"
#include "nn/ops/linalg.h"
#include "nn/ops/raster.h"

namespace doppel {

namespace {

// First sums of a reduction: enough to fill a device, few enough for one workgroup to add up.
constexpr uint32_t kPartials = 1024;
constexpr Groups kOneGroup{1, 1, 1};

}  // namespace

Tensor silhouetteIouLoss(Graph& graph, const Tensor& predicted, const Tensor& target) {
    CHECK(predicted.shape == target.shape, "target {} has the shape of predicted {}",
          toString(target.shape), toString(predicted.shape));
    SilhouetteIouLossParams params{u32(predicted.elements()), kPartials};
    Tensor partial = graph.temporary({kPartials, 2}), total = graph.temporary({2});
    Tensor loss = graph.temporary({});
    graph.beginOp("silhouette_iou_loss");
    graph.dispatch("loss/silhouette_iou_loss.sums",
                   {{"predicted", predicted}, {"target", target}, {"partial", partial}}, params,
                   kPartials);
    graph.dispatchGroups("loss/silhouette_iou_loss.finish",
                         {{"partial", partial}, {"total", total}, {"loss", loss}}, params,
                         kOneGroup);
    graph.differentiate({predicted}, {loss}, [=, &graph] {
        graph.dispatch("loss/silhouette_iou_loss.backward",
                       {{"target", target},
                        {"total", total},
                        {"dLoss", graph.gradient(loss)},
                        {"dPredicted", graph.gradientTarget(predicted)}},
                       params, pairInvocations(params.n));
    });
    return loss;
}

Tensor maskedL1Loss(Graph& graph, const Tensor& predicted, const Tensor& target,
                    const Tensor& mask) {
    CHECK(predicted.shape == target.shape, "target {} has the shape of predicted {}",
          toString(target.shape), toString(predicted.shape));
    Shape pixels = predicted.shape;
    CHECK(!pixels.empty(), "predicted has channels");
    pixels.pop_back();
    CHECK(mask.shape == pixels, "mask {} has the pixels of predicted {}", toString(mask.shape),
          toString(predicted.shape));
    MaskedL1LossParams params{u32(mask.elements()), u32(predicted.dim(-1)), kPartials};
    Tensor partial = graph.temporary({kPartials, 2}), maskSum = graph.temporary({});
    Tensor loss = graph.temporary({});
    graph.beginOp("masked_l1_loss");
    graph.dispatch(
        "loss/masked_l1_loss.sums",
        {{"predicted", predicted}, {"target", target}, {"mask", mask}, {"partial", partial}},
        params, kPartials);
    graph.dispatchGroups("loss/masked_l1_loss.finish",
                         {{"partial", partial}, {"maskSum", maskSum}, {"loss", loss}}, params,
                         kOneGroup);
    graph.differentiate({predicted}, {loss}, [=, &graph] {
        graph.dispatch("loss/masked_l1_loss.backward",
                       {{"predicted", predicted},
                        {"target", target},
                        {"mask", mask},
                        {"maskSum", maskSum},
                        {"dLoss", graph.gradient(loss)},
                        {"dPredicted", graph.gradientTarget(predicted)}},
                       params, params.n);
    });
    return loss;
}

Tensor ssim(Graph& graph, const Tensor& a, const Tensor& b) {
    CHECK(a.shape.size() == 3 && a.shape == b.shape, "two pictures [H,W,C] are compared, not {} {}",
          toString(a.shape), toString(b.shape));
    SsimParams params{u32(a.dim(1)), u32(a.dim(0)), u32(a.dim(2)), kPartials};
    auto n = static_cast<uint64_t>(a.elements());
    Shape four{a.elements(), 4};
    Tensor rows = graph.temporary(four), rowsAB = graph.temporary(a.shape);
    Tensor map = graph.temporary(four), partial = graph.temporary({kPartials, 2});
    Tensor result = graph.temporary({});
    graph.beginOp("ssim", 2.0 * 11 * 10 * static_cast<double>(n));
    graph.dispatch("loss/ssim.forward_rows",
                   {{"a", a}, {"b", b}, {"rows", rows}, {"rowsAB", rowsAB}}, params, n);
    graph.dispatch("loss/ssim.forward_columns", {{"rows", rows}, {"rowsAB", rowsAB}, {"map", map}},
                   params, n);
    graph.dispatch("loss/ssim.sums", {{"map", map}, {"partial", partial}}, params, kPartials);
    graph.dispatchGroups("loss/ssim.finish", {{"partial", partial}, {"ssim", result}}, params,
                         kOneGroup);
    graph.differentiate({a}, {result}, [=, &graph] {
        Tensor dRows = graph.temporary(four);
        graph.dispatch("loss/ssim.backward_rows", {{"map", map}, {"dRows", dRows}}, params, n);
        graph.dispatch("loss/ssim.backward_columns",
                       {{"a", a},
                        {"b", b},
                        {"dRows", dRows},
                        {"dSsim", graph.gradient(result)},
                        {"da", graph.gradientTarget(a)}},
                       params, n);
    });
    return result;
}

Tensor pyramidLoss(Graph& graph, const Tensor& a, const Tensor& b, const Tensor& counts,
                   const Tensor& scale, const PyramidWeights& weights, float epsilon) {
    CHECK((a.shape.size() == 2 || a.shape.size() == 3) && a.shape == b.shape,
          "two pictures [H,W,C] or [H,W] are compared, not {} {}", toString(a.shape),
          toString(b.shape));
    CHECK(scale.elements() == 1, "the scale is one number");
    CHECK(counts.shape == (Shape{a.dim(0), a.dim(1)}), "a pixel of {} has a weight",
          toString(a.shape));
    CHECK(epsilon >= 0, "epsilon {} is not negative", epsilon);
    const int64_t height = a.dim(0), width = a.dim(1), channels = a.elements() / (height * width);
    const int64_t across = (width + 7) / 8, blocks = across * ((height + 7) / 8);
    const PyramidLossParams params{u32(width),    u32(height),   u32(channels), u32(across),
                                   u32(blocks),   weights.cell1, weights.cell2, weights.cell4,
                                   weights.cell8, epsilon};
    const int64_t terms = blocks * channels;
    Tensor partial = graph.temporary({terms}), loss = graph.temporary({});
    graph.beginOp("pyramid_loss");
    graph.dispatch("loss/pyramid_loss.forward",
                   {{"a", a}, {"b", b}, {"counts", counts}, {"scale", scale}, {"partial", partial}},
                   params, static_cast<uint64_t>(terms));
    sumAxis(graph, partial, 1, terms, 1, loss);
    graph.differentiate({a}, {loss}, [=, &graph] {
        graph.dispatch("loss/pyramid_loss.backward",
                       {{"a", a},
                        {"b", b},
                        {"counts", counts},
                        {"scale", scale},
                        {"dLoss", graph.gradient(loss)},
                        {"da", graph.gradientTarget(a)}},
                       params, static_cast<uint64_t>(terms));
    });
    return loss;
}

Tensor keypointLoss(Graph& graph, const Tensor& joints, const Tensor& targets, const Tensor& camera,
                    float scale) {
    CHECK(joints.shape.size() == 2 && joints.dim(1) == 3 && targets.shape == joints.shape,
          "joints {} and targets {} are [J,3]", toString(joints.shape), toString(targets.shape));
    CHECK(camera.shape == kCameraShape, "a camera is {}", toString(kCameraShape));
    CHECK(scale > 0, "the scale {} is positive", scale);
    KeypointLossParams params{u32(joints.dim(0)), scale};
    Tensor weight = graph.temporary({}), loss = graph.temporary({});
    graph.beginOp("keypoint_loss");
    graph.dispatchGroups("loss/keypoint_loss.forward",
                         {{"joints", joints},
                          {"targets", targets},
                          {"camera", camera},
                          {"weight", weight},
                          {"loss", loss}},
                         params, kOneGroup);
    graph.differentiate({joints}, {loss}, [=, &graph] {
        graph.dispatch("loss/keypoint_loss.backward",
                       {{"joints", joints},
                        {"targets", targets},
                        {"camera", camera},
                        {"weight", weight},
                        {"dLoss", graph.gradient(loss)},
                        {"djoints", graph.gradientTarget(joints)}},
                       params, params.joints);
    });
    return loss;
}

Tensor dilate3(Graph& graph, const Tensor& x) {
    CHECK(x.shape.size() >= 2, "pictures [...,H,W] are dilated, not {}", toString(x.shape));
    Dilate3Params params{u32(x.elements()), u32(x.dim(-1)), u32(x.dim(-2))};
    Tensor y = graph.temporary(x.shape);
    graph.beginOp("dilate3");
    graph.dispatch("loss/dilate3.forward", {{"x", x}, {"y", y}}, params, params.n);
    return y;
}

// ---- declarations -------------------------------------------------------------------------------

static const Op kSilhouetteIouLoss{{
    .name = "silhouette_iou_loss",
    .inputs = "predicted[H,W] target[H,W]",
    .attributes = "",
    .outputs = "loss",
    .differentiable = "predicted",
    .build =
        [](OpCall& c) {
            c.result("loss", silhouetteIouLoss(c.graph, c["predicted"], c["target"]));
        },
}};

static const Op kMaskedL1Loss{{
    .name = "masked_l1_loss",
    .inputs = "predicted[H,W,3] target[H,W,3] mask[H,W]",
    .attributes = "",
    .outputs = "loss",
    .differentiable = "predicted",
    .build =
        [](OpCall& c) {
            c.result("loss", maskedL1Loss(c.graph, c["predicted"], c["target"], c["mask"]));
        },
}};

static const Op kSsim{{
    .name = "ssim",
    .inputs = "a[H,W,C] b[H,W,C]",
    .attributes = "",
    .outputs = "ssim",
    .differentiable = "a",
    .build = [](OpCall& c) { c.result("ssim", ssim(c.graph, c["a"], c["b"])); },
}};

static const Op kKeypointLoss{{
    .name = "keypoint_loss",
    .inputs = "joints[J,3] targets[J,3]",
    .attributes = "fx fy cx cy scale",
    .outputs = "loss",
    .differentiable = "joints",
    .build =
        [](OpCall& c) {
            if (c.attribute("scale") <= 0)
                throwInput("attr_scale: expected pixels above 0, found {}", c.attribute("scale"));
            RasterCamera camera{c.f("fx"), c.f("fy"), c.f("cx"), c.f("cy"), 1, 0, 0, 0};
            std::vector<float> values = cameraValues(camera);
            c.result("loss",
                     keypointLoss(c.graph, c["joints"], c["targets"],
                                  c.graph.constant(std::span<const float>(values), kCameraShape),
                                  c.f("scale")));
        },
}};

static const Op kDilate3{{
    .name = "dilate3",
    .inputs = "x[N,H,W]",
    .attributes = "",
    .outputs = "y",
    .differentiable = "",
    .build = [](OpCall& c) { c.result("y", dilate3(c.graph, c["x"])); },
}};

static const Op kPyramidLoss{{
    .name = "pyramid_loss",
    .inputs = "a b counts[H,W] scale[1]",
    .attributes = "weight1=1 weight2=0 weight4=0 weight8=0 epsilon=0",
    .outputs = "loss",
    .differentiable = "a",
    .build =
        [](OpCall& c) {
            if ((c["a"].shape.size() != 2 && c["a"].shape.size() != 3) ||
                c["a"].shape != c["b"].shape)
                throwInput("a, b: expected two pictures [H,W,C] or [H,W] of one shape, found {} {}",
                           toString(c["a"].shape), toString(c["b"].shape));
            if (c["counts"].dim(0) != c["a"].dim(0) || c["counts"].dim(1) != c["a"].dim(1))
                throwInput("counts: expected one number for each pixel of a, found {}",
                           toString(c["counts"].shape));
            if (c.attribute("epsilon") < 0)
                throwInput("attr_epsilon: expected 0 or more, found {}", c.attribute("epsilon"));
            c.result("loss",
                     pyramidLoss(c.graph, c["a"], c["b"], c["counts"], c["scale"],
                                 {c.f("weight1"), c.f("weight2"), c.f("weight4"), c.f("weight8")},
                                 c.f("epsilon")));
        },
}};

}  // namespace doppel
