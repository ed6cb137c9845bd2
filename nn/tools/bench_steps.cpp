// Training steps and inference at the preset paper's sizes, on a synthetic person: every stage's
// whole graph, as training replays it.
#include <optional>

#include "nn/steps/inference.h"
#include "nn/steps/refine_step.h"
#include "nn/tools/bench.h"

namespace doppel::bench {

namespace {

// What a frame's mask and picture are stand-ins for: an upright ellipse, and noise.
std::vector<float> ellipse(int size) {
    std::vector<float> mask;
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            double u = (x + .5) / size - .5, v = (y + .5) / size - .5;
            mask.push_back(u * u / .016 + v * v / .16 < 1 ? 1.0f : 0.0f);
        }
    return mask;
}

std::array<float, 10> noBetas() { return {}; }

}  // namespace

Recording meshStep(const BodyModel& body, int batch) {
    struct Owner {
        Parameters net;
        std::unique_ptr<MeshStep> step;
    };
    auto owner = std::make_shared<Owner>();
    MeshPreset config;
    config.batch = batch;
    addMeshNetParameters(owner->net, meshNetConfig(config), 1);
    owner->net.allocate(device());
    owner->step = std::make_unique<MeshStep>(device(), body, noBetas(), owner->net, config,
                                             CompileOptions{.timestamps = true});
    Graph& graph = owner->step->graph;
    for (const MeshStep::Sample& sample : owner->step->samples) {
        graph.write(sample.camera, standingCamera(config.size));
        graph.write(sample.target, ellipse(config.size));
        graph.write(sample.theta, standingTheta());
        graph.write(sample.trans, standingTrans());
    }
    graph.setStep(adamwStepParams(1, 1e-4f));
    return {owner, &graph};
}

Recording textureStep(const BodyModel& body, int batch) {
    struct Owner {
        TextureUnet net{{}, "texture", 1};
        std::unique_ptr<TextureStep> step;
    };
    auto owner = std::make_shared<Owner>();
    TexturePreset config;
    config.batch = batch;
    owner->net.allocate(device());
    owner->step = std::make_unique<TextureStep>(device(), body, owner->net, config,
                                                CompileOptions{.timestamps = true});
    Graph& graph = owner->step->graph;
    for (const TextureStep::Sample& sample : owner->step->samples) {
        graph.write(sample.camera, standingCamera(config.size));
        graph.write(sample.verts, standingVerts(body));
        graph.write(sample.image, randomValues(sample.image.elements(), 5, 0, 1));
        graph.write(sample.mask, ellipse(config.size));
    }
    graph.setStep(adamwStepParams(1, 2e-3f));
    return {owner, &graph};
}

Recording ganStep(const BodyModel& body, int batch) {
    struct Owner {
        RefinePreset config;
        TextureUnet coarse{{}, "texture", 1};
        std::unique_ptr<RefineNetworks> networks;
        std::unique_ptr<RefineStep> step;
    };
    auto owner = std::make_shared<Owner>();
    owner->config.batch = batch;
    owner->coarse.allocate(device());
    owner->networks = std::make_unique<RefineNetworks>(owner->config, TexturePreset{}, 1);
    owner->networks->allocate(device());
    owner->step = std::make_unique<RefineStep>(device(), body, owner->config, *owner->networks,
                                               CoarseTexture{.net = &owner->coarse},
                                               CompileOptions{.timestamps = true});
    Graph& graph = owner->step->graph;
    int size = owner->config.size;
    std::vector<float> centres;
    for (const RefineStep::Sample& sample : owner->step->samples) {
        graph.write(sample.camera, standingCamera(size));
        graph.write(sample.verts, standingVerts(body));
        graph.write(sample.image, randomValues(sample.image.elements(), 5, 0, 1));
        graph.write(sample.mask, ellipse(size));
        centres.insert(centres.end(), {.5f * float(size), .15f * float(size)});
    }
    graph.write(owner->step->faceCentres, centres);
    graph.setStep(adamwStepParams(1, 2e-4f));
    return {owner, &graph};
}

// refined: with the network of stage 3.
Recording inference(const BodyModel& body, bool refined) {
    struct Owner {
        Parameters meshNet;
        TextureUnet textureNet{{}, "texture", 1};
        std::optional<TextureUnet> refineNet;
        std::unique_ptr<Inference> inference;
    };
    auto owner = std::make_shared<Owner>();
    InferenceConfig config;
    addMeshNetParameters(owner->meshNet, config.net, 1);
    owner->meshNet.allocate(device());
    owner->textureNet.allocate(device());
    if (refined) {
        owner->refineNet.emplace(refineUnetConfig({}, {}), "refine", 1);
        owner->refineNet->allocate(device());
    }
    owner->inference = std::make_unique<Inference>(
        device(), body, noBetas(), owner->meshNet, owner->textureNet, config,
        CompileOptions{.timestamps = true}, refined ? &*owner->refineNet : nullptr);
    Graph& graph = owner->inference->graph;
    graph.write(owner->inference->theta, standingTheta());
    graph.write(owner->inference->trans, standingTrans());
    graph.write(owner->inference->camera, standingCamera(config.width));
    return {owner, &graph};
}

void addSteps() {
    add("mesh_step", [] { return meshStep(defaultBody(), 1); });
    add("texture_step", [] { return textureStep(defaultBody(), 1); });
    add("gan_step", [] { return ganStep(defaultBody(), 1); });
    add("inference", [] { return inference(defaultBody(), false); });
    add("inference_refined", [] { return inference(defaultBody(), true); });
}

}  // namespace doppel::bench
