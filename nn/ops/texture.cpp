#include "nn/ops/texture.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "engine/files/numbers.h"
#include "nn/core/op.h"
#include "nn/ops/raster.h"
#include "texture/params.h"

namespace doppel {

std::vector<Tensor> interleave(Graph& graph, const Tensor& x) {
    CHECK(x.shape.size() == 4, "an image batch is [N,C,H,W], not {}", toString(x.shape));
    InterleaveParams params{u32(x.dim(1)), u32(x.dim(2) * x.dim(3))};
    std::vector<Tensor> textures;
    graph.beginOp("interleave");
    for (int64_t n = 0; n < x.dim(0); ++n) {
        textures.push_back(graph.temporary({x.dim(2), x.dim(3), x.dim(1)}));
        graph.dispatch("texture/interleave.forward", {{"x", x.slice(n, 1)}, {"y", textures.back()}},
                       params, params.pixels);
    }
    graph.differentiate({x}, textures, [=, &graph] {
        Tensor dx = graph.gradientTarget(x);
        for (size_t n = 0; n < textures.size(); ++n)
            graph.dispatch(
                "texture/interleave.backward",
                {{"x", graph.gradient(textures[n])}, {"y", dx.slice(static_cast<int64_t>(n), 1)}},
                params, params.pixels);
    });
    return textures;
}

namespace {

// Both ways: `coarse` is the shape with the blocks among its channels.
Tensor moveBlocks(Graph& graph, const char* name, const Tensor& x, const Shape& coarse,
                  const Shape& result, int64_t block) {
    const PixelShuffleParams params{u32(x.elements()), u32(coarse[2]), u32(coarse[3]), u32(block)};
    const bool shuffles = x.shape == coarse;
    auto move = [=, &graph](bool shuffle, const Tensor& from, const Tensor& to) {
        graph.dispatch(
            shuffle ? "texture/pixel_shuffle.shuffle" : "texture/pixel_shuffle.unshuffle",
            {{"x", from}, {"y", to}}, params, params.n);
    };
    Tensor y = graph.temporary(result);
    graph.beginOp(name);
    move(shuffles, x, y);
    graph.differentiate(
        {x}, {y}, [=, &graph] { move(!shuffles, graph.gradient(y), graph.gradientTarget(x)); });
    return y;
}

// attr_block, which has to divide the extent, or its square has to.
int64_t blockOf(OpCall& c, int64_t extent, bool squared) {
    const int64_t block = c.u("block");
    if (block < 1 || block > extent || extent % (squared ? block * block : block) != 0)
        throwInput("attr_block: expected the side of blocks that divide {}{}, found {}", extent,
                   squared ? " channels" : " pixels", block);
    return block;
}

}  // namespace

Tensor pixelShuffle(Graph& graph, const Tensor& x, int64_t block) {
    CHECK(x.shape.size() == 4 && block > 0 && x.dim(1) % (block * block) == 0,
          "blocks of {} are among the channels of [N,C,H,W], not of {}", block, toString(x.shape));
    return moveBlocks(graph, "pixel_shuffle", x, x.shape,
                      {x.dim(0), x.dim(1) / block / block, x.dim(2) * block, x.dim(3) * block},
                      block);
}

Tensor pixelUnshuffle(Graph& graph, const Tensor& x, int64_t block) {
    CHECK(x.shape.size() == 4 && block > 0 && x.dim(2) % block == 0 && x.dim(3) % block == 0,
          "blocks of {} fill the planes of [N,C,H,W], not {}", block, toString(x.shape));
    const Shape coarse{x.dim(0), x.dim(1) * block * block, x.dim(2) / block, x.dim(3) / block};
    return moveBlocks(graph, "pixel_unshuffle", x, coarse, coarse, block);
}

Tensor binomialMean(Graph& graph, const Tensor& x) {
    CHECK(x.shape.size() == 3, "a texture is [H,W,C], not {}", toString(x.shape));
    const int64_t line = x.dim(1) * x.dim(2);
    const BinomialMeanParams params{u32(line * ((x.dim(0) + kBinomialRows - 1) / kBinomialRows)),
                                    u32(line), u32(x.dim(0)), u32(x.dim(2))};
    Tensor y = graph.temporary(x.shape);
    graph.beginOp("binomial_mean");
    graph.dispatch("texture/binomial_mean.forward", {{"x", x}, {"y", y}}, params, params.columns);
    graph.differentiate({x}, {y}, [=, &graph] {
        graph.dispatch("texture/binomial_mean.forward",
                       {{"x", graph.gradient(y)}, {"y", graph.gradientTarget(x)}}, params,
                       params.columns);
    });
    return y;
}

std::vector<float> binomialMean(const std::vector<float>& x, int64_t height, int64_t width,
                                int64_t channels) {
    std::vector<float> y(x.size());
    for (int64_t row = 0; row < height; ++row)
        for (int64_t column = 0; column < width; ++column)
            for (int64_t c = 0; c < channels; ++c) {
                float sum = 0;
                for (int64_t v = std::max<int64_t>(row - 1, 0); v <= std::min(row + 1, height - 1);
                     ++v)
                    for (int64_t u = std::max<int64_t>(column - 1, 0);
                         u <= std::min(column + 1, width - 1); ++u)
                        sum += static_cast<float>((2 - std::abs(u - column)) *
                                                  (2 - std::abs(v - row))) *
                               x[static_cast<size_t>((v * width + u) * channels + c)];
                y[static_cast<size_t>((row * width + column) * channels + c)] = sum / 16;
            }
    return y;
}

TexelTensors texelTensors(Graph& graph, std::span<const TexelPlace> places) {
    const auto side = static_cast<int64_t>(std::lround(std::sqrt(places.size())));
    std::vector<int32_t> faces;
    std::vector<float> corners;
    for (const TexelPlace& place : places) {
        faces.push_back(place.face);
        corners.insert(corners.end(), {place.corners[1], place.corners[2]});
    }
    return {graph.constant(std::span<const int32_t>(faces), {side, side}),
            graph.constant(std::span<const float>(corners), {side, side, 2})};
}

Tensor litTexture(Graph& graph, const Tensor& texture, const Tensor& light, const Tensor& normals,
                  const Tensor& faceVertices, const TexelTensors& texels) {
    CHECK(texture.shape.size() == 3 && texture.dim(2) == 3, "a texture is [T,T,3], not {}",
          toString(texture.shape));
    CHECK(light.shape == (Shape{9, 3}), "a light is [9,3], not {}", toString(light.shape));
    CHECK(3 * texels.faces.elements() == texture.elements(), "a texel has a place");
    constexpr uint32_t kMostPartials = 4096;
    const uint32_t count = u32(texels.faces.elements());
    const LitTextureParams params{count, std::min(count, kMostPartials)};
    Tensor lit = graph.temporary(texture.shape), factors = graph.temporary(texture.shape);
    graph.beginOp("lit_texture");
    graph.dispatch("texture/lit_texture.forward",
                   {{"tex", texture},
                    {"light", light},
                    {"normals", normals},
                    {"faces", faceVertices},
                    {"texelFaces", texels.faces},
                    {"texelCorners", texels.corners},
                    {"factors", factors},
                    {"lit", lit}},
                   params, count);
    graph.differentiate({texture, light}, {lit}, [=, &graph] {
        const Tensor dLit = graph.gradient(lit);
        if (graph.wantsGradient(texture))
            graph.dispatch(
                "texture/lit_texture.backward_texture",
                {{"factors", factors}, {"dLit", dLit}, {"lit", graph.gradientTarget(texture)}},
                params, count);
        if (!graph.wantsGradient(light)) return;
        Tensor partial = graph.temporary({9, params.partials, 3});
        graph.dispatch("texture/lit_texture.backward_partial",
                       {{"tex", texture},
                        {"normals", normals},
                        {"faces", faceVertices},
                        {"texelFaces", texels.faces},
                        {"texelCorners", texels.corners},
                        {"dLit", dLit},
                        {"partial", partial}},
                       params, params.partials);
        graph.dispatchGroups("texture/lit_texture.backward_light",
                             {{"partial", partial}, {"dLight", graph.gradientTarget(light)}},
                             params, {9, 1, 1});
    });
    return lit;
}

static const Op kInterleave{{
    .name = "interleave",
    .inputs = "x[C,H,W]",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            Tensor x = c["x"];
            Tensor batch = x.reshaped({1, x.dim(0), x.dim(1), x.dim(2)});
            c.result("y", interleave(c.graph, batch).at(0));
        },
}};

static const Op kPixelShuffle{{
    .name = "pixel_shuffle",
    .inputs = "x[N,C,H,W]",
    .attributes = "block=2",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            c.result("y", pixelShuffle(c.graph, c["x"], blockOf(c, c["x"].dim(1), true)));
        },
}};

static const Op kPixelUnshuffle{{
    .name = "pixel_unshuffle",
    .inputs = "x[N,C,H,W]",
    .attributes = "block=2",
    .outputs = "y",
    .differentiable = "x",
    .build =
        [](OpCall& c) {
            const int64_t block = blockOf(c, c["x"].dim(2), false);
            blockOf(c, c["x"].dim(3), false);
            c.result("y", pixelUnshuffle(c.graph, c["x"], block));
        },
}};

static const Op kBinomialMean{{
    .name = "binomial_mean",
    .inputs = "x[H,W,C]",
    .outputs = "y",
    .differentiable = "x",
    .build = [](OpCall& c) { c.result("y", binomialMean(c.graph, c["x"])); },
}};

static const Op kLitTexture{{
    .name = "lit_texture",
    .inputs = "texture[T,T,3] light[9,3] normals[V,3] faces:i32[F,3] texel_faces:i32[T,T] "
              "texel_corners[T,T,2]",
    .outputs = "lit",
    .differentiable = "texture light",
    .build =
        [](OpCall& c) {
            const RasterMesh mesh = rasterMesh(c.graph, c.ints("faces"), c["normals"].dim(0));
            for (int32_t face : c.ints("texel_faces"))
                if (face < -1 || face >= mesh.faces)
                    throwInput("texel_faces: expected numbers from -1 to {}, found {}",
                               mesh.faces - 1, face);
            c.result("lit", litTexture(c.graph, c["texture"], c["light"], c["normals"],
                                       mesh.faceVertices, {c["texel_faces"], c["texel_corners"]}));
        },
}};

}  // namespace doppel
