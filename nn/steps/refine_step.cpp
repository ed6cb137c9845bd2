#include "nn/steps/refine_step.h"

#include <algorithm>

#include "nn/ops/elementwise.h"
#include "nn/ops/fit.h"
#include "nn/ops/gan.h"
#include "nn/ops/loss.h"
#include "nn/ops/raster.h"
#include "nn/ops/texture.h"

namespace doppel {

namespace {

// Networks that nothing uses are kept as small as they can be.
PatchDiscriminatorConfig sized(PatchDiscriminatorConfig config, bool used) {
    if (!used) config = {.width = 1, .strided = 1, .level = 0};
    return config;
}

Tensor batched(Graph& graph, const std::vector<Tensor>& parts) {
    Tensor all = parts.at(0);
    for (size_t i = 1; i < parts.size(); ++i) all = concat(graph, all, parts[i], 0);
    return all;
}

Tensor mean(Graph& graph, const std::vector<Tensor>& terms) {
    float share = 1.0f / static_cast<float>(terms.size());
    Tensor sum;
    for (size_t i = 0; i < terms.size(); i += 3) {
        std::vector<WeightedTerm> some;
        if (sum) some.push_back({sum, 1});
        for (size_t k = i; k < std::min(i + 3, terms.size()); ++k)
            some.push_back({terms[k], share});
        sum = weightedSum(graph, some);
    }
    return sum;
}

}  // namespace

TextureUnetConfig refineUnetConfig(const RefineConfig& config) {
    return {.size = config.textureSize,
            .width = config.width,
            .inputChannels = 4,
            .outputChannels = 3,
            .downs = config.depth};
}

RefineNetworks::RefineNetworks(const RefineConfig& config, uint32_t seed)
    : generator(refineUnetConfig(config), "refine", seed),
      image(sized(imageDiscriminator(config.discriminatorWidth), config.imageDiscriminator),
            "image_discriminator", seed),
      face(sized(faceDiscriminator(config.discriminatorWidth), config.faceDiscriminator),
           "face_discriminator", seed) {
    auto check = [](const PatchDiscriminator& net, const char* what, int64_t pixels) {
        if (pixels < net.smallestPicture())
            throwInput("{} discriminator: pictures must have {} pixels or more, found {}", what,
                       net.smallestPicture(), pixels);
    };
    if (config.imageDiscriminator) check(image, "image", config.size);
    if (config.faceDiscriminator) check(face, "face", config.faceSize);
}

void RefineNetworks::allocate(Device& device) {
    generator.allocate(device);
    image.allocate(device);
    face.allocate(device);
}

Tensor refineTextures(Graph& graph, const TextureUnet& generator, const Tensor& coarse,
                      const Tensor& maps, TextureUnet::Mode mode, Residual residual) {
    Tensor y = generator.forward(graph, concat(graph, coarse, maps, 1), mode);
    Tensor half = scaleShift(graph, y, 0.5f, 0);
    if (residual == Residual::Program)
        return add(graph, scaleShift(graph, coarse, 0.5f, 0.5f), half);
    return clamp(graph, add(graph, coarse, half), 0, 1);
}

RefineStep::RefineStep(Device& device, const BodyModel& body, const RefineConfig& config,
                       const RefineNetworks& networks, const CoarseTexture& coarse,
                       const CompileOptions& options)
    : graph(device) {
    const int64_t size = config.size, texels = config.textureSize, batch = config.batch;
    CHECK(batch > 0, "a batch has frames");
    RasterMesh mesh = rasterMesh(graph, body.faces, body.vertexCount);
    Tensor uvs = graph.constant(std::span<const float>(body.uvs), {body.uvCount, 2});
    RasterAtlas atlas = rasterAtlas(graph, uvs, body.uvFaces);
    faceCentres = graph.input({batch, 2});

    std::vector<Tensor> maps;
    for (int64_t n = 0; n < batch; ++n) {
        samples.push_back({graph.input(kCameraShape), graph.input({body.vertexCount, 3}),
                           graph.input({size, size, 3}), graph.input({size, size})});
        maps.push_back(visibilityMap(graph, mesh, samples.back().verts, atlas, texels)
                           .reshaped({1, 1, texels, texels}));
    }
    Tensor seen = batched(graph, maps);

    // The coarse textures, as planes for G_RN and interleaved for the renders.
    Tensor coarsePlanes;
    std::vector<Tensor> coarseTextures;
    if (coarse.net) {
        TextureUnet::Mode frozen{.training = false, .dropout = false, .frozen = true};
        coarsePlanes = scaleShift(graph, coarse.net->forward(graph, seen, frozen), 0.5f, 0.5f);
        coarseTextures = interleave(graph, coarsePlanes);
    } else {
        CHECK(coarse.texture.size() == static_cast<size_t>(texels * texels * 3),
              "a coarse texture has {}x{} texels", texels, texels);
        Tensor one = graph.constant(std::span<const float>(coarse.texture), {texels, texels, 3});
        coarseTextures.assign(static_cast<size_t>(batch), one);
        Tensor planes = planar(graph, {one});
        coarsePlanes = batched(graph, std::vector<Tensor>(static_cast<size_t>(batch), planes));
    }

    Tensor refined = refineTextures(graph, networks.generator, coarsePlanes, seen,
                                    {.training = true, .dropout = config.dropout}, config.residual);
    std::vector<Tensor> textures = interleave(graph, refined);

    std::vector<Tensor> renders, images, regions, masks, reconstructions, misalignments;
    for (int64_t n = 0; n < batch; ++n) {
        const Sample& sample = samples[size_t(n)];
        VisibilityBuffer visible =
            visibilityBuffer(graph, mesh, sample.verts, sample.camera, size, size);
        Tensor render = texturedRender(graph, visible, atlas, textures[size_t(n)]);
        Tensor both = multiply(graph, visible.mask, sample.mask);
        Tensor region = both;
        if (config.unionRegion)
            region =
                add(graph, add(graph, visible.mask, sample.mask), scaleShift(graph, both, -1, 0));
        Tensor apart = misalignedRegion(graph, visible.mask, sample.mask, faceCentres, n,
                                        config.faceSize, config.oneSided);
        Tensor before = texturedRender(graph, visible, atlas, coarseTextures[size_t(n)]);
        reconstructions.push_back(maskedL1Loss(graph, render, sample.image, region));
        misalignments.push_back(maskedL1Loss(graph, render, before, apart));
        renders.push_back(render);
        images.push_back(sample.image);
        regions.push_back(region);
        masks.push_back(sample.mask);
    }
    reconstruction = mean(graph, reconstructions);
    misaligned = mean(graph, misalignments);

    auto ganLoss = [&](const Tensor& logits, bool real) {
        return config.leastSquares ? leastSquaresGanLoss(graph, logits, real)
                                   : logGanLoss(graph, logits, real);
    };
    struct Opponent {
        const PatchDiscriminator* net;
        Tensor fake, real;
        Tensor* discriminatorLoss;
        Tensor* ganLoss;
    };
    std::vector<Opponent> opponents;
    if (config.imageDiscriminator || config.faceDiscriminator) {
        // The render is black where nothing is rendered: in its own silhouette as it is.
        Tensor fake = config.ownMasks ? planar(graph, renders) : planar(graph, renders, regions);
        Tensor real = planar(graph, images, config.ownMasks ? masks : regions);
        if (config.imageDiscriminator)
            opponents.push_back({&networks.image, fake, real, &discriminatorImage, &ganImage});
        if (config.faceDiscriminator)
            opponents.push_back({&networks.face,
                                 cropWindow(graph, fake, faceCentres, config.faceSize),
                                 cropWindow(graph, real, faceCentres, config.faceSize),
                                 &discriminatorFace, &ganFace});
    }

    // The discriminators' turn: what the generator painted is given.
    if (!opponents.empty()) {
        std::vector<WeightedTerm> terms;
        for (const Opponent& o : opponents) {
            PatchDiscriminator::Tensors weights = o.net->trained(graph);
            Tensor onFake = ganLoss(o.net->forward(graph, weights, detach(graph, o.fake)), false);
            Tensor onReal = ganLoss(o.net->forward(graph, weights, o.real), true);
            *o.discriminatorLoss = weightedSum(graph, {{onReal, 1}, {onFake, 1}});
            terms.push_back({*o.discriminatorLoss, 1});
        }
        graph.backward(weightedSum(graph, terms));
        for (const Opponent& o : opponents)
            adamwStep(graph, o.net->parameters(), config.discriminatorOptimiser);
    }

    // The generator's.
    std::vector<WeightedTerm> terms{{reconstruction, config.reconstruction},
                                    {misaligned, config.misaligned}};
    for (const Opponent& o : opponents) {
        *o.ganLoss = ganLoss(o.net->forward(graph, o.net->frozen(graph), o.fake), true);
        terms.push_back({*o.ganLoss, config.adversarial});
    }
    generatorLoss = weightedSum(graph, terms);
    graph.backward(generatorLoss);
    adamwStep(graph, networks.generator.parameters(), config.generatorOptimiser);

    for (const Tensor& loss : {generatorLoss, reconstruction, misaligned, ganImage, ganFace,
                               discriminatorImage, discriminatorFace})
        if (loss) graph.output(loss);
    graph.compile(options);
}

}  // namespace doppel
