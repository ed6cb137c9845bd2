// Every op at the sizes that the paper's stages give it, through the same declarations that
// op_runner uses.
#include <algorithm>
#include <map>
#include <numeric>
#include <optional>

#include "nn/body/fingers.h"
#include "nn/body/joint.h"
#include "nn/body/mesh_topology.h"
#include "nn/body/seams.h"
#include "nn/body/texel_places.h"
#include "nn/core/op.h"
#include "nn/ops/optim.h"
#include "nn/tools/bench.h"

namespace doppel::bench {

namespace {

struct Input {
    std::string name;
    Shape shape;
    // Both empty: uniform random numbers in [-1, 1].
    std::function<std::vector<float>()> values = {};
    std::function<std::vector<int32_t>()> integers = {};
};

struct Case {
    std::string op, variant;
    std::vector<Input> inputs;
    std::map<std::string, double> attributes = {};
    bool backwardReadsInputs = true;
    // Of a case that touches less than all of its inputs.
    std::optional<double> forwardBytes = {};
};

uint64_t bytesOf(const std::vector<Tensor>& tensors) {
    return std::accumulate(tensors.begin(), tensors.end(), uint64_t{0},
                           [](uint64_t sum, const Tensor& t) { return sum + t.bytes(); });
}

std::vector<int32_t> texelFaces(int size) {
    std::vector<int32_t> faces;
    for (const TexelPlace& place : texelPlaces(defaultBody(), size)) faces.push_back(place.face);
    return faces;
}
std::vector<float> texelCorners(int size) {
    std::vector<float> corners;
    for (const TexelPlace& place : texelPlaces(defaultBody(), size))
        corners.insert(corners.end(), {place.corners[1], place.corners[2]});
    return corners;
}

// Forward: inputs read, outputs written. Backward: inputs, where they are needed, and the output's
// gradient read, the inputs' gradients written.
Recording record(const Case& c, bool backward) {
    const Op* op = Op::find(c.op);
    CHECK(op, "there is an op {}", c.op);
    auto graph = std::make_shared<Graph>(device());
    OpCall call{*graph, {}, {}, {}, {}, {}};
    std::vector<Tensor> inputs, watched;
    uint32_t seed = 1;
    for (const Input& input : c.inputs) {
        auto declared = std::ranges::find(op->inputs(), input.name, &Op::Input::name);
        CHECK(declared != op->inputs().end(), "{} has an input {}", c.op, input.name);
        Tensor tensor;
        if (declared->integer) {
            call.integers[input.name] = input.integers();
            tensor =
                graph->constant(std::span<const int32_t>(call.integers[input.name]), input.shape);
        } else {
            std::vector<float> values =
                input.values ? input.values() : randomValues(elementCount(input.shape), seed++);
            tensor = graph->constant(std::span<const float>(values), input.shape);
            if (backward && declared->differentiable) {
                graph->watch(tensor);
                watched.push_back(tensor);
            }
        }
        call.tensors[input.name] = tensor;
        call.shapes[input.name] = input.shape;
        inputs.push_back(tensor);
    }
    for (const Op::Attribute& attribute : op->attributes()) {
        auto given = c.attributes.find(attribute.name);
        CHECK(given != c.attributes.end() || attribute.fallback, "{} is given {}", c.op,
              attribute.name);
        call.attributes[attribute.name] =
            given != c.attributes.end() ? given->second : *attribute.fallback;
    }
    op->declaration().build(call);
    std::vector<Tensor> outputs;
    for (const auto& [name, tensor] : call.results) outputs.push_back(tensor);
    double bytes = c.forwardBytes.value_or(static_cast<double>(bytesOf(inputs) + bytesOf(outputs)));
    if (backward) {
        // The first output's gradient; others are by-products.
        std::vector<float> ones = randomValues(outputs[0].elements(), 77);
        graph->backward(
            {{outputs[0], graph->constant(std::span<const float>(ones), outputs[0].shape)}});
        bytes = static_cast<double>((c.backwardReadsInputs ? bytesOf(inputs) : 0) +
                                    outputs[0].bytes() + bytesOf(watched));
    }
    graph->compile({.timestamps = true});
    return {graph, graph.get(), backward ? Recording::Part::Backward : Recording::Part::Whole,
            bytes};
}

void addCase(const Case& c) {
    const Op* op = Op::find(c.op);
    CHECK(op, "there is an op {}", c.op);
    std::string name = "op/" + c.op + "/" + c.variant;
    add(name + "/forward", [c] { return record(c, false); });
    if (!op->declaration().differentiable.empty())
        add(name + "/backward", [c] { return record(c, true); });
}

// AdamW as training runs it: on flat arrays, in place.
Recording adamwInPlace(int64_t count) {
    struct Owner {
        Parameters parameters;
        std::unique_ptr<Graph> graph;
    };
    auto owner = std::make_shared<Owner>();
    owner->parameters.add("all", {count}, std::vector<float>(static_cast<size_t>(count), .1f));
    owner->parameters.allocate(device());
    owner->graph = std::make_unique<Graph>(device());
    adamwStep(*owner->graph, owner->parameters);
    owner->graph->compile({.timestamps = true});
    owner->graph->setStep(adamwStepParams(1, 1e-4f));
    // Values and moments read and written, gradients read.
    return {owner, owner->graph.get(), Recording::Part::Whole, 28.0 * static_cast<double>(count)};
}

}  // namespace

void addOps() {
    // ---- products ---------------------------------------------------------------------------
    auto conv = [](std::string variant, int64_t c, int64_t o, int64_t side, int64_t kernel,
                   int stride, int padding, int64_t n = 1) {
        addCase({"conv2d",
                 std::move(variant),
                 {{"x", {n, c, side, side}}, {"weight", {o, c, kernel, kernel}}},
                 {{"stride", stride}, {"padding", padding}}});
    };
    auto transposed = [](std::string variant, int64_t c, int64_t o, int64_t side) {
        addCase({"conv_transpose2d",
                 std::move(variant),
                 {{"x", {1, c, side, side}}, {"weight", {c, o, 4, 4}}},
                 {{"stride", 2}, {"padding", 1}}});
    };
    // The U-Nets', of 512x512 and width 64.
    conv("unet_down1", 1, 64, 512, 4, 2, 1);
    conv("unet_down2", 64, 128, 256, 4, 2, 1);
    conv("unet_down3", 128, 256, 128, 4, 2, 1);
    conv("unet_down4", 256, 512, 64, 4, 2, 1);
    conv("unet_down5", 512, 512, 32, 4, 2, 1);
    conv("unet_down6", 512, 512, 16, 4, 2, 1);
    conv("unet_down7", 512, 512, 8, 4, 2, 1);
    conv("unet_down8", 512, 512, 4, 4, 2, 1);
    conv("unet_down9", 512, 512, 2, 4, 2, 1);
    transposed("unet_up1", 512, 512, 1);
    transposed("unet_up2", 1024, 512, 2);
    transposed("unet_up3", 1024, 512, 4);
    transposed("unet_up4", 1024, 512, 8);
    transposed("unet_up5", 1024, 512, 16);
    transposed("unet_up6", 1024, 256, 32);
    transposed("unet_up7", 512, 128, 64);
    transposed("unet_up8", 256, 64, 128);
    transposed("unet_up9", 128, 3, 256);
    // The discriminators', on 512x512 pictures and 80x80 faces.
    conv("image_disc1", 3, 64, 512, 4, 2, 1);
    conv("image_disc2", 64, 128, 256, 4, 2, 1);
    conv("image_disc3", 128, 256, 128, 4, 2, 1);
    conv("image_disc4", 256, 512, 64, 4, 1, 1);
    conv("image_disc5", 512, 1024, 63, 4, 1, 1);
    conv("image_disc6", 1024, 1, 62, 4, 1, 1);
    conv("face_disc1", 3, 128, 80, 4, 2, 1);
    conv("face_disc2", 128, 256, 40, 4, 2, 1);
    conv("face_disc3", 256, 512, 20, 4, 1, 1);
    conv("face_disc4", 512, 1, 19, 4, 1, 1);
    conv("3x3_64", 64, 64, 256, 3, 1, 1);
    conv("1x1_64_128", 64, 128, 128, 1, 1, 0);
    int64_t V = defaultBody().vertexCount;
    addCase({"linear", "graph", {{"x", {V, 132}}, {"weight", {256, 132}}, {"bias", {256}}}});
    addCase({"linear", "offset", {{"x", {V, 132}}, {"weight", {3, 132}}, {"bias", {3}}}});
    addCase({"matmul", "1024", {{"a", {1, 1024, 1024}}, {"b", {1, 1024, 1024}}}});

    // ---- meshes -----------------------------------------------------------------------------
    int64_t F = defaultBody().faceCount, T = defaultBody().uvCount;
    MeshTopology topology = meshTopology(defaultBody().faces, V, "the embedded body");
    Input faces{"faces", {F, 3}, {}, [] { return defaultBody().faces; }};
    Input facesUv{"faces_uv", {F, 3}, {}, [] { return defaultBody().uvFaces; }};
    Input uvs{"uvs", {T, 2}, [] { return defaultBody().uvs; }};
    Input verts{"verts", {V, 3}, [] { return standingVerts(defaultBody()); }};
    Input edges{"edges", {int64_t(topology.edges.size()) / 2, 2}, {}, [topology] {
                    return topology.edges;
                }};
    addCase({"graph_conv",
             "hidden",
             {{"x", {V, 128}},
              edges,
              {"weight0", {128, 128}},
              {"bias0", {128}},
              {"weight1", {128, 128}},
              {"bias1", {128}}}});
    addCase({"graph_conv_layer",
             "hidden",
             {{"x", {V, 132}},
              edges,
              {"weight0", {128, 131}},
              {"bias0", {128}},
              {"weight1", {128, 131}},
              {"bias1", {128}},
              {"tail", {V, 3}}}});
    addCase({"with_tail", "block", {{"x", {V, 132}}, {"tail", {V, 3}}}, {{"columns", 128}}, false});
    addCase({"vertex_normals", "body", {verts, faces}});
    addCase({"laplacian_loss", "body", {verts, faces}});
    addCase({"normal_consistency_loss", "body", {verts, faces}});
    addCase({"offset_penalty", "body", {verts, {"stiffness", {V}}, faces}});
    addCase({"fold_penalty",
             "body",
             {verts, {"reference", {V, 3}}, {"weight", {topology.faceCount}}, faces}});
    addCase({"smooth_solve", "body", {verts, faces}});
    addCase({"offset_clamp", "body", {verts, {"offset", {V, 3}}, {"limit", {V}, [V] {
                                                                      return std::vector<float>(
                                                                          size_t(V), .04f);
                                                                  }}}});

    // ---- body -------------------------------------------------------------------------------
    const BodyModel& body = defaultBody();
    addCase({"lbs",
             "body",
             {{"template", {V, 3}, [] { return defaultBody().templateVertices; }},
              {"shapedirs", {V, 3, 10}, [] { return defaultBody().shapeDirections; }},
              {"weights", {V, kJointCount}, [] { return defaultBody().weights; }},
              {"joint_regressor", {kJointCount, V}, [] { return defaultBody().jointRegressor; }},
              {"parents", {kJointCount}, {}, [] { return defaultBody().parents; }},
              {"theta", {kThetaSize}, standingTheta},
              {"beta", {10}},
              {"trans", {3}, standingTrans}}});
    addCase(
        {"rigid_transform", "body", {verts, {"rotation", {3}}, {"pivot", {3}}, {"trans", {3}}}});
    static const FingerRig fingers = fingerRig(body);
    const auto bent = static_cast<int64_t>(fingers.amounts.size()) / FingerRig::kTurns;
    const auto moved = static_cast<int64_t>(fingers.fingers.size());
    addCase({"bend_fingers",
             "body",
             {verts,
              {"amounts", {4}},
              {"turns", {bent, FingerRig::kTurns, 7}, [] { return fingers.turns; }},
              {"turn_amounts", {bent, FingerRig::kTurns}, {}, [] { return fingers.amounts; }},
              {"begin", {V + 1}, {}, [] { return fingers.begin; }},
              {"fingers", {moved}, {}, [] { return fingers.fingers; }},
              {"entries", {moved, FingerRig::kEntryNumbers}, [] { return fingers.entries; }}}});
    CHECK(body.vertexCount == V, "one body");
    auto sparse = [&](const char* size, const SparseMatrix& a) {
        const auto count = static_cast<int64_t>(a.value.size());
        addCase({"sparse_product",
                 size,
                 {{"begin", {a.rows() + 1}, {}, [&a] { return a.begin; }},
                  {"column", {count}, {}, [&a] { return a.column; }},
                  {"value", {count}, [&a] { return a.value; }},
                  {"x", {a.columns, 3}}}});
    };
    static const SparseMatrix facePoints = matrixOf(body.facePoints, V),
                              seams = seamDifferences(body, 512);
    sparse("face", facePoints);
    sparse("seams", seams);

    // ---- rasterizers ------------------------------------------------------------------------
    auto camera = [](double size) {
        return std::map<std::string, double>{{"fx", 1.55 * size}, {"fy", 1.55 * size},
                                             {"cx", size / 2},    {"cy", size / 2},
                                             {"width", size},     {"height", size}};
    };
    auto with = [](std::map<std::string, double> a, std::map<std::string, double> more) {
        a.merge(more);
        return a;
    };
    addCase({"soft_silhouette",
             "256",
             {verts, faces},
             with(camera(256), {{"sigma", 1e-5}, {"blur_radius", 9.21024e-5}})});
    addCase({"textured_render",
             "512",
             {verts, faces, uvs, facesUv, {"texture", {512, 512, 3}}},
             camera(512)});
    addCase({"sampled_render",
             "512",
             {verts, faces, uvs, facesUv, {"texture", {512, 512, 3}}},
             with(camera(512), {{"samples", 2}})});
    addCase(
        {"surface_render",
         "256",
         {verts, faces, uvs, facesUv, {"texture", {512, 512, 3}}, {"background", {256, 256, 3}}},
         with(camera(256), {{"samples", 2}})});
    addCase({"lit_texture",
             "512",
             {{"texture", {512, 512, 3}},
              {"light", {9, 3}},
              {"normals", {V, 3}},
              faces,
              {"texel_faces", {512, 512}, {}, [] { return texelFaces(512); }},
              {"texel_corners", {512, 512, 2}, [] { return texelCorners(512); }}}});
    addCase({"visibility_map", "512", {verts, faces, uvs, facesUv}, {{"size", 512}}});

    // ---- pictures' losses -------------------------------------------------------------------
    auto unit = [](std::string name, Shape shape, uint32_t seed) {
        int64_t count = elementCount(shape);
        return Input{std::move(name), std::move(shape),
                     [count, seed] { return randomValues(count, seed, 0, 1); }};
    };
    addCase({"silhouette_iou_loss",
             "256",
             {unit("predicted", {256, 256}, 1), unit("target", {256, 256}, 2)}});
    addCase({"masked_l1_loss",
             "512",
             {unit("predicted", {512, 512, 3}, 1), unit("target", {512, 512, 3}, 2),
              unit("mask", {512, 512}, 3)}});
    addCase({"pyramid_loss",
             "256",
             {unit("a", {256, 256, 3}, 1), unit("b", {256, 256, 3}, 2),
              unit("counts", {256, 256}, 3), unit("scale", {1}, 4)},
             {{"weight2", .5}, {"weight4", .5}, {"epsilon", .02}}});
    addCase({"ssim", "512", {unit("a", {512, 512, 3}, 1), unit("b", {512, 512, 3}, 2)}});
    addCase({"dilate3", "256", {unit("x", {1, 256, 256}, 1)}});
    addCase({"keypoint_loss",
             "25",
             {{"joints", {25, 3}, [] { return randomValues(75, 1, 2, 3); }},
              unit("targets", {25, 3}, 2)},
             {{"fx", 400}, {"fy", 400}, {"cx", 128}, {"cy", 128}, {"scale", 10}}});

    // ---- adversarial training: logits of the image discriminator, faces, pictures as planes ---
    for (const char* loss : {"log_gan_loss", "least_squares_gan_loss"})
        addCase({loss, "image_disc", {{"x", {1, 1, 61, 61}}}, {{"real", 1}}});
    Input centres{"centres", {1, 2}, [] { return std::vector<float>{256, 80}; }};
    addCase({"crop_window", "face", {{"x", {1, 3, 512, 512}}, centres}, {{"size", 80}}, false});
    addCase({"misaligned_region",
             "512",
             {unit("rendered", {512, 512}, 1), unit("real", {512, 512}, 2), centres},
             {{"face_size", 80}}});
    addCase({"planar", "512", {{"image", {512, 512, 3}}, unit("mask", {512, 512}, 2)}, {}, false});

    // ---- what measures pictures and films: AlexNet's and I3D's layers -------------------------
    addCase({"max_pool2d", "alexnet", {{"x", {1, 64, 127, 127}}}, {{"kernel", 3}, {"stride", 2}}});
    addCase({"max_pool3d",
             "i3d",
             {{"x", {8, 64, 56, 56}}},
             {{"kernel_t", 1}, {"kernel", 3}, {"stride_t", 1}, {"stride", 2}}});
    addCase({"conv3d",
             "i3d",
             {{"x", {8, 64, 28, 28}}, {"weight", {192, 64, 3, 3, 3}}},
             {{"stride_t", 1}, {"stride", 1}}});
    addCase({"feature_distance",
             "alexnet",
             {{"a", {1, 192, 31, 31}}, {"b", {1, 192, 31, 31}}, unit("weight", {192}, 3)}});

    // ---- normalisation and what is done element by element ------------------------------------
    auto norm = [&](std::string variant, int64_t c, int64_t side) {
        std::vector<Input> inputs{{"x", {1, c, side, side}}, unit("weight", {c}, 2), {"bias", {c}}};
        std::map<std::string, double> attributes{{"eps", 1e-5}, {"slope", .2}};
        addCase({"batch_norm2d", variant, inputs, attributes});
        inputs.push_back({"running_mean", {c}});
        inputs.push_back(unit("running_variance", {c}, 4));
        addCase({"batch_norm2d_evaluation", variant, inputs, attributes});
    };
    norm("unet_up8", 64, 256);
    norm("unet_down2", 128, 128);
    norm("unet_down5", 512, 16);
    Input picture{"x", {1, 64, 256, 256}};
    Input a{"a", {1, 64, 256, 256}}, b{"b", {1, 64, 256, 256}};
    addCase({"leaky_relu", "4M", {picture}, {{"slope", .2}}});
    addCase({"relu", "4M", {picture}});
    addCase({"tanh", "4M", {picture}});
    addCase({"sigmoid", "4M", {picture}});
    addCase({"clamp", "4M", {picture}, {{"low", -.5}, {"high", .5}}});
    addCase({"scale_shift", "4M", {picture}, {{"scale", .5}, {"shift", .5}}, false});
    addCase({"dropout", "4M", {picture}, {{"rate", .5}}, false});
    addCase({"add", "4M", {a, b}, {}, false});
    addCase({"multiply", "4M", {a, b}});
    addCase({"concat", "4M", {a, b}, {}, false});
    addCase({"concat_relu", "4M", {a, b}});
    addCase({"binomial_mean", "512", {{"x", {512, 512, 3}}}});
    addCase({"interleave", "512", {{"x", {3, 512, 512}}}, {}, false});
    addCase({"pixel_shuffle", "512", {{"x", {1, 12, 256, 256}}}});
    addCase({"pixel_unshuffle", "512", {{"x", {1, 4, 512, 512}}}});

    // ---- optimisers, poses ------------------------------------------------------------------
    add("op/adamw/unet/forward", [] { return adamwInPlace(67'000'000); });
    add("op/adamw/mesh_net/forward", [] { return adamwInPlace(576'676); });
    addCase({"adamw_row",
             "poses",
             {{"table", {7200, 75}},
              {"grad", {75}},
              {"moment1", {7200, 75}},
              unit("moment2", {7200, 75}, 4)},
             {{"row", 3}, {"updates", 5}, {"lr", 1e-3}},
             false,
             7.0 * 75 * 4});
    addCase({"uniform_adam", "body", {{"param", {V, 3}}, {"grad", {1, V, 3}}}, {{"lr", .01}}});
    addCase({"clip_norm", "mesh_net", {{"grad", {576676}}}, {{"max_norm", 2}}});
    addCase({"select_row",
             "poses",
             {{"table", {7200, 75}}, {"index", {1}, {}, [] { return std::vector<int32_t>{7}; }}},
             {},
             false,
             2.0 * 75 * 4});
    addCase(
        {"pose_correction", "pose", {{"start", {75}}, {"correction", {75}}}, {{"trans_scale", 1}}});
    addCase({"pose_prior",
             "pose",
             {{"correction", {75}},
              {"before", {75}},
              {"after", {75}},
              {"start_bend", {75}},
              {"joint_weight", {kJointCount}},
              {"beta", {10}}},
             {{"pose", 1}, {"trans", 1}, {"smooth", 1}, {"shape", 1}}});
    addCase({"pose_likelihood",
             "pose",
             {{"theta", {kThetaSize}}, {"angles", {kThetaSize, 4}}},
             {{"likely", 1}, {"limits", 1}}});
    addCase({"balance_loss",
             "pose",
             {{"joints", {kJointCount, 3}}, {"shares", {kJointCount}}, {"up", {2}}},
             {{"deviation", .1}, {"level", .1}}});
    addCase({"weighted_sum", "four", {{"a", {}}, {"b", {}}, {"c", {}}, {"d", {}}}});
}

}  // namespace doppel::bench
