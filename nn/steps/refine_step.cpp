#include "nn/steps/refine_step.h"

#include <string>

#include "nn/ops/elementwise.h"
#include "nn/ops/fit.h"
#include "nn/ops/gan.h"
#include "nn/ops/loss.h"
#include "nn/ops/texture.h"
#include "nn/steps/light.h"

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

}  // namespace

TextureUnetConfig refineUnetConfig(const RefinePreset& preset, const TexturePreset& texture) {
    return {.size = texture.textureSize,
            .width = preset.width,
            .inputChannels = 4,
            .outputChannels = 3,
            .downs = preset.depth,
            .block = texture.block};
}

RefineNetworks::RefineNetworks(const RefinePreset& preset, const TexturePreset& texture,
                               uint32_t seed)
    : generator(refineUnetConfig(preset, texture), "refine", seed),
      image(sized(imageDiscriminator(preset.discriminatorWidth), preset.imageDiscriminator),
            "image_discriminator", seed),
      face(sized(faceDiscriminator(preset.discriminatorWidth), preset.faceDiscriminator),
           "face_discriminator", seed) {
    auto check = [](const PatchDiscriminator& net, const char* what, int64_t pixels) {
        if (pixels < net.smallestPicture())
            throwInput("{} discriminator: pictures must have {} pixels or more, found {}", what,
                       net.smallestPicture(), pixels);
    };
    if (preset.imageDiscriminator) check(image, "image", preset.size);
    if (preset.faceDiscriminator) check(face, "face", preset.faceSize);
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

RefineStep::RefineStep(Device& device, const BodyModel& body, const RefinePreset& preset,
                       const RefineNetworks& networks, const CoarseTexture& coarse,
                       const CompileOptions& options)
    : graph(device) {
    graph.join(options.ranks);
    const int64_t size = preset.size, texels = networks.generator.config().size,
                  batch = preset.batch / sizeOf(options.ranks);
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
    Tensor seen = batched(graph, maps);  // x_v = U(M)

    // The coarse textures x_p, as planes for G_RN and interleaved for the renders.
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

    Tensor refined =
        refineTextures(graph, networks.generator, coarsePlanes, seen,
                       {.training = true, .dropout = preset.dropout > 0}, preset.residual);
    std::vector<Tensor> textures = interleave(graph, refined);

    const CaptureLight light(graph, body, mesh, texels, coarse.light);
    std::vector<Tensor> renders, images, regions, masks;
    for (int64_t n = 0; n < batch; ++n) {
        const Sample& sample = samples[size_t(n)];
        VisibilityBuffer visible =
            visibilityBuffer(graph, mesh, sample.verts, sample.camera, size, size);
        auto drawn = [&](const Tensor& texture) {
            return texturedRender(graph, visible, atlas, light.lit(texture, sample.verts));
        };
        Tensor render = drawn(textures[size_t(n)]);
        Tensor region = regionOf(graph, preset.region, visible.mask, sample.mask);  // B
        // C
        Tensor apart = misalignedRegion(graph, visible.mask, sample.mask, faceCentres, n,
                                        preset.faceSize, preset.apart == Misalignment::Rendered);
        Tensor before = drawn(coarseTextures[size_t(n)]);
        // L_r = α1 ‖(I − Î^RN) ⊗ B‖₁/‖B‖₁ + α2 ‖(Î^TN − Î^RN) ⊗ C‖₁/‖C‖₁
        losses.term("reconstruction", preset.reconstruction,
                    maskedL1Loss(graph, render, sample.image, region));
        losses.term("misaligned", preset.misaligned, maskedL1Loss(graph, render, before, apart));
        renders.push_back(render);
        images.push_back(sample.image);
        regions.push_back(region);
        masks.push_back(sample.mask);
    }

    auto ganLoss = [&](const Tensor& logits, bool real) {
        return preset.loss == GanLoss::Squares ? leastSquaresGanLoss(graph, logits, real)
                                               : logGanLoss(graph, logits, real);
    };
    struct Opponent {
        const char* name;
        const PatchDiscriminator* net;
        Tensor fake, real;
    };
    std::vector<Opponent> opponents;
    if (preset.imageDiscriminator || preset.faceDiscriminator) {
        // The render is black where nothing is rendered: in its own silhouette as it is.
        const bool own = preset.masks == GanMasks::Own;
        Tensor fake = own ? planar(graph, renders) : planar(graph, renders, regions);
        Tensor real = planar(graph, images, own ? masks : regions);
        if (preset.imageDiscriminator) opponents.push_back({"image", &networks.image, fake, real});
        if (preset.faceDiscriminator)
            opponents.push_back({"face", &networks.face,
                                 cropWindow(graph, fake, faceCentres, preset.faceSize),
                                 cropWindow(graph, real, faceCentres, preset.faceSize)});
    }

    // The discriminators' turn: what the generator painted is given.
    Losses discriminatorLosses(graph);
    if (!opponents.empty()) {
        for (const Opponent& o : opponents) {
            PatchDiscriminator::Tensors weights = o.net->trained(graph);
            Tensor onFake = ganLoss(o.net->forward(graph, weights, detach(graph, o.fake)), false);
            Tensor onReal = ganLoss(o.net->forward(graph, weights, o.real), true);
            discriminatorLosses.term(std::string("discriminator_") + o.name, 1,
                                     weightedSum(graph, {{onReal, 1}, {onFake, 1}}));
        }
        graph.backward(discriminatorLosses.sum());
        AdamWOptions optimiser = adamwOptions(preset);
        optimiser.rateScale = static_cast<float>(preset.lrDiscriminator / preset.lr);
        for (const Opponent& o : opponents) adamwStep(graph, o.net->parameters(), optimiser);
    }

    // The generator's: L_G against the new discriminators, and L_r.
    for (const Opponent& o : opponents)
        losses.term(std::string("gan_") + o.name, preset.adversarial,
                    ganLoss(o.net->forward(graph, o.net->frozen(graph), o.fake), true));
    graph.backward(losses.sum());
    adamwStep(graph, networks.generator.parameters(), adamwOptions(preset));
    if (!opponents.empty()) losses.append(discriminatorLosses);
    graph.compile(options);
}

}  // namespace doppel
