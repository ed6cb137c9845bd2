#include "nn/ops/gan.h"

#include <cmath>

#include "nn/nets/discriminator.h"
#include "nn/ops/loss.h"
#include "nn/ops/raster.h"
#include "nn/steps/refine_step.h"
#include "tests/files.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

TexturePreset texture(int size) {
    TexturePreset preset;
    preset.textureSize = size;
    return preset;
}

Value scalar(double value) { return {{}, {value}}; }

// ---- losses -------------------------------------------------------------------------------------

double softplus(double x) { return std::max(x, 0.0) + std::log1p(std::exp(-std::abs(x))); }

Values logReference(const Values& v) {
    double sum = 0, sign = v.at("real").data[0] != 0 ? -1 : 1;
    for (double x : v.at("x").data) sum += softplus(sign * x);
    return {{"loss", scalar(sum / double(v.at("x").data.size()))}};
}

Values leastSquaresReference(const Values& v) {
    double sum = 0, label = v.at("real").data[0] != 0 ? 1 : 0;
    for (double x : v.at("x").data) sum += (x - label) * (x - label);
    return {{"loss", scalar(sum / double(v.at("x").data.size()))}};
}

TEST(GanLoss, AgainstPlainLoop) {
    std::vector<Shape> shapes{{13}, {2, 1, 5, 7}, {1, 1, 127, 63}};
    for (int64_t tile : {8, 256})  // lanes of a workgroup: a CPU's vector or more
        for (int64_t n : edgeSizes(tile)) shapes.push_back({n});
    for (const Shape& size : shapes)
        for (double real : {0.0, 1.0}) {
            OpCase test{.inputs = {{"x", random(size)}}, .attributes = {{"real", real}}};
            test.reference = logReference;
            checkOp("log_gan_loss", test);
            test.reference = leastSquaresReference;
            checkOp("least_squares_gan_loss", test);
        }
}

TEST(GanLoss, SureLogitsNeitherOverflowNorVanish) {
    auto run = [](double x, double real) {
        Npz arrays;
        arrays.set("x", Array::f32({1}, std::vector<float>{static_cast<float>(x)}));
        arrays.set("attr_real", Array::scalarF64(real));
        arrays.set("grad_loss", Array::scalarF32(1));
        Npz out = Op::find("log_gan_loss")->run(testDevice(), arrays, {.poison = true});
        return std::pair{out.at("loss").scalar(), out.at("grad_x").toF64().at(0)};
    };
    EXPECT_NEAR(run(-500, 1).first, 500, 1e-3);
    EXPECT_EQ(run(-500, 1).second, -1);
    EXPECT_NEAR(run(500, 0).first, 500, 1e-3);
    // softplus(-20) = 2.0611536e-9.
    EXPECT_NEAR(run(20, 1).first, 2.0611536e-9, 1e-14);
    EXPECT_NEAR(run(20, 1).second, -2.0611536e-9, 1e-14);
    EXPECT_EQ(run(300, 1).first, 0);
}

// ---- crops and regions --------------------------------------------------------------------------

int64_t firstPixel(double centre, int64_t size) {
    return int64_t(std::floor(centre - double(size) / 2 + 0.5));
}

Values cropReference(const Values& v) {
    const Value &x = v.at("x"), &centres = v.at("centres");
    auto size = int64_t(v.at("size").data[0]);
    int64_t N = x.shape[0], C = x.shape[1], H = x.shape[2], W = x.shape[3];
    Value y{{N, C, size, size}, {}};
    for (int64_t n = 0; n < N; ++n)
        for (int64_t c = 0; c < C; ++c)
            for (int64_t r = 0; r < size; ++r)
                for (int64_t k = 0; k < size; ++k) {
                    int64_t row = firstPixel(centres.data[size_t(2 * n + 1)], size) + r;
                    int64_t column = firstPixel(centres.data[size_t(2 * n)], size) + k;
                    bool inside = row >= 0 && row < H && column >= 0 && column < W;
                    y.data.push_back(inside ? x.data[size_t(((n * C + c) * H + row) * W + column)]
                                            : 0);
                }
    return {{"y", y}};
}

TEST(CropWindow, AgainstPlainLoop) {
    for (int64_t size : {1, 7, 8, 9, 13})
        for (const Shape& shape : {Shape{1, 1, 1, 1}, {2, 3, 13, 17}, {3, 2, 40, 127}}) {
            OpCase test{
                .inputs = {{"x", random(shape)}, {"centres", uniform({shape[0], 2}, -5, 45, 3)}},
                .attributes = {{"size", double(size)}},
                .reference = cropReference};
            checkOp("crop_window", test);
        }
}

TEST(CropWindow, WindowsAreCentred) {
    // A window of one pixel around a pixel's centre is that pixel; far outside there is nothing.
    std::vector<float> x(35);
    for (size_t i = 0; i < x.size(); ++i) x[i] = float(i + 1);
    auto run = [&](float column, float row, double size) {
        Npz arrays;
        arrays.set("x", Array::f32({1, 1, 5, 7}, x));
        arrays.set("centres", Array::f32({1, 2}, std::vector<float>{column, row}));
        arrays.set("attr_size", Array::scalarF64(size));
        return Op::find("crop_window")->run(testDevice(), arrays, {}).at("y").toF32();
    };
    EXPECT_EQ(run(2.5f, 3.5f, 1), std::vector<float>{24});
    EXPECT_EQ(run(1.0f, 1.0f, 2), (std::vector<float>{1, 2, 8, 9}));
    EXPECT_EQ(run(1e20f, -1e20f, 2), (std::vector<float>(4)));
}

Values regionReference(const Values& v) {
    const Value &a = v.at("rendered"), &b = v.at("real"), &centres = v.at("centres");
    auto row = size_t(v.at("row").data[0]);
    auto face = int64_t(v.at("face_size").data[0]);
    Value region = a;
    for (int64_t y = 0; y < a.shape[0]; ++y)
        for (int64_t x = 0; x < a.shape[1]; ++x) {
            auto i = size_t(y * a.shape[1] + x);
            int64_t dx = x - firstPixel(centres.data[2 * row], face);
            int64_t dy = y - firstPixel(centres.data[2 * row + 1], face);
            double p = a.data[i], q = b.data[i];
            region.data[i] = v.at("one_sided").data[0] != 0 ? p * (1 - q) : p + q - 2 * p * q;
            if (dx >= 0 && dy >= 0 && dx < face && dy < face) region.data[i] = 0;
        }
    return {{"region", region}};
}

TEST(MisalignedRegion, AgainstPlainLoop) {
    for (const Shape& shape : {Shape{1, 1}, {13, 31}, {40, 127}, {7, 9}, {8, 8}, {13, 5}})
        for (double face : {0., 7., 16.})
            for (double oneSided : {0., 1.})
                checkOp("misaligned_region",
                        {.inputs = {{"rendered", uniform(shape, 0, 1, 1)},
                                    {"real", uniform(shape, 0, 1, 2)},
                                    {"centres", uniform({3, 2}, 0, 30, 4)}},
                         .attributes = {{"row", 2}, {"face_size", face}, {"one_sided", oneSided}},
                         .reference = regionReference});
}

TEST(MisalignedRegion, WhereAllAgreesTheLossIsZero) {
    Graph graph(testDevice());
    Tensor mask = graph.input({8, 8}), centres = graph.input({1, 2});
    Tensor refined = graph.variable({8, 8, 3}), coarse = graph.input({8, 8, 3});
    Tensor region = misalignedRegion(graph, mask, mask, centres, 0, 2, false);
    Tensor loss = maskedL1Loss(graph, refined, coarse, region);
    graph.backward(loss);
    Tensor gradient = graph.gradient(refined);
    graph.output(loss);
    graph.output(gradient);
    graph.compile({.poison = true});
    graph.write(mask, std::vector<float>(64, 1.0f));
    graph.write(refined, std::vector<float>(192, 0.25f));
    graph.run();
    EXPECT_EQ(graph.readScalar(loss), 0);
    EXPECT_EQ(graph.read(gradient), std::vector<float>(192));
}

// ---- planes -------------------------------------------------------------------------------------

Values planarReference(const Values& v) {
    const Value& image = v.at("image");
    int64_t pixels = image.shape[0] * image.shape[1], C = image.shape[2];
    Value y{{1, C, image.shape[0], image.shape[1]}, std::vector<double>(image.data.size())};
    for (int64_t p = 0; p < pixels; ++p)
        for (int64_t c = 0; c < C; ++c)
            y.data[size_t(c * pixels + p)] =
                image.data[size_t(p * C + c)] *
                (v.contains("mask") ? v.at("mask").data[size_t(p)] : 1);
    return {{"y", y}};
}

TEST(Planar, AgainstPlainLoop) {
    std::vector<Shape> shapes{{1, 1, 3}, {13, 7, 3}, {31, 127, 2}};
    for (int64_t tile : {8, 512})  // pixels of an invocation in pairs, of a workgroup
        for (int64_t n : edgeSizes(tile)) shapes.push_back({1, n, 3});
    for (const Shape& shape : shapes) {
        OpCase test{.inputs = {{"image", random(shape)}}, .reference = planarReference};
        checkOp("planar", test);
        test.inputs["mask"] = uniform({shape[0], shape[1]}, 0, 1, 2);
        checkOp("planar", test);
    }
}

TEST(Planar, BatchesKeepTheirOrder) {
    Graph graph(testDevice());
    Tensor a = graph.variable({2, 2, 3}), b = graph.variable({2, 2, 3});
    Tensor maskA = graph.input({2, 2}), maskB = graph.input({2, 2}), dy = graph.input({2, 3, 2, 2});
    Tensor y = planar(graph, {a, b}, {maskA, maskB});
    graph.backward({{y, dy}});
    Tensor da = graph.gradient(a), db = graph.gradient(b);
    for (const Tensor& t : {y, da, db}) graph.output(t);
    graph.compile({.poison = true});
    std::vector<float> values(12), other(12), upstream(24);
    for (size_t i = 0; i < 24; ++i) upstream[i] = float(i);
    for (size_t i = 0; i < 12; ++i) values[i] = float(i), other[i] = float(100 + i);
    // Masked pixels may hold anything.
    other[3 * 3] = NAN;
    graph.write(a, values);
    graph.write(b, other);
    graph.write(dy, upstream);
    graph.write(maskA, std::vector<float>{1, 2, 0, 1});
    graph.write(maskB, std::vector<float>{1, 1, 1, 0});
    graph.run();
    EXPECT_EQ(graph.read(y),
              (std::vector<float>{0,   6,   0,   9, 1,   8,   0,   10, 2,   10,  0,   11,
                                  100, 103, 106, 0, 101, 104, 107, 0,  102, 105, 108, 0}));
    EXPECT_EQ(graph.read(da), (std::vector<float>{0, 4, 8, 2, 10, 18, 0, 0, 0, 3, 7, 11}));
    EXPECT_EQ(graph.read(db), (std::vector<float>{12, 16, 20, 13, 17, 21, 14, 18, 22, 0, 0, 0}));
}

// ---- discriminators -----------------------------------------------------------------------------

// tests/networks/*.npz: PyTorch's numbers (float64, rounded) for discriminators of width 4; the
// gradients are those of the least-squares loss on "real".
void checkAgainst(const std::string& file, const PatchDiscriminatorConfig& config) {
    Npz golden = readNpz(test::sourceFolder() / "tests/networks" / file);
    PatchDiscriminator net(config, "discriminator", 1);
    net.allocate(testDevice());
    size_t given = 0;
    for (const auto& [name, array] : golden) given += name.starts_with("param.");
    ASSERT_EQ(net.parameters().entries().size(), given);
    for (const Parameters::Entry& entry : net.parameters().entries()) {
        ASSERT_TRUE(golden.has("param." + entry.name)) << entry.name;
        ASSERT_EQ(golden.at("param." + entry.name).shape, entry.shape) << entry.name;
        net.parameters().write(entry, golden.at("param." + entry.name).toF32());
    }
    Graph graph(testDevice());
    Tensor x = graph.variable(golden.at("x").shape);
    Tensor y = net.forward(graph, net.trained(graph), x);
    Tensor real = leastSquaresGanLoss(graph, y, true), fake = leastSquaresGanLoss(graph, y, false);
    Tensor logReal = logGanLoss(graph, y, true), logFake = logGanLoss(graph, y, false);
    // Constants of the gradient give the same gradient to x.
    Tensor x2 = graph.variable(golden.at("x").shape);
    Tensor y2 = net.forward(graph, net.frozen(graph), x2);
    Tensor real2 = leastSquaresGanLoss(graph, y2, true);
    graph.backward(real);
    graph.backward(real2);
    Tensor dx = graph.gradient(x), dx2 = graph.gradient(x2);
    for (const Tensor& t : {y, y2, real, fake, logReal, logFake, dx, dx2}) graph.output(t);
    graph.compile({.poison = true});
    graph.write(x, golden.at("x").toF32());
    graph.write(x2, golden.at("x").toF32());
    graph.run();
    auto error = [&](const std::vector<float>& got, const std::string& name) {
        return relativeError({got.begin(), got.end()}, golden.at(name).toF64(), 1e-12);
    };
    EXPECT_LE(error(graph.read(y), "y"), 1e-5);
    EXPECT_LE(error(graph.read(real), "lsgan_real"), 1e-5);
    EXPECT_LE(error(graph.read(fake), "lsgan_fake"), 1e-5);
    EXPECT_LE(error(graph.read(logReal), "log_real"), 1e-5);
    EXPECT_LE(error(graph.read(logFake), "log_fake"), 1e-5);
    EXPECT_LE(error(graph.read(dx), "grad_x"), 1e-4);
    EXPECT_EQ(graph.read(dx), graph.read(dx2));
    EXPECT_EQ(graph.read(y), graph.read(y2));
    for (const Parameters::Entry& entry : net.parameters().entries())
        EXPECT_LE(error(net.parameters().read(entry, Parameters::kGradient), "grad." + entry.name),
                  1e-4)
            << entry.name;
}

TEST(Discriminator, ImageAgreesWithPytorch) {
    checkAgainst("image_discriminator.npz", imageDiscriminator(4));
}
TEST(Discriminator, FaceAgreesWithPytorch) {
    checkAgainst("face_discriminator.npz", faceDiscriminator(4));
}

TEST(Discriminator, ShapesOfThePaper) {
    PatchDiscriminator image(imageDiscriminator(64), "image", 1);
    auto features = [](const PatchDiscriminator& net) {
        std::vector<int64_t> outs;
        for (const Parameters::Entry& entry : net.parameters().entries())
            if (entry.shape.size() == 4) outs.push_back(entry.shape[0]);
        return outs;
    };
    EXPECT_EQ(features(image), (std::vector<int64_t>{64, 128, 256, 512, 1024, 1}));
    EXPECT_EQ(image.smallestPicture(), 32);
    PatchDiscriminator face(faceDiscriminator(64), "face", 1);
    EXPECT_EQ(features(face), (std::vector<int64_t>{128, 256, 512, 1}));
    EXPECT_EQ(face.smallestPicture(), 12);
}

TEST(Discriminator, RefusesPicturesThatAreTooSmall) {
    PatchDiscriminator net(imageDiscriminator(1), "image", 1);
    net.allocate(testDevice());
    Graph graph(testDevice());
    Tensor x = graph.input({1, 3, 31, 40});
    expectInputError([&] { net.forward(graph, net.frozen(graph), x); }, "32x32 pixels or more");
    RefinePreset preset;
    preset.size = 16;
    preset.width = preset.discriminatorWidth = 1;
    preset.depth = 4;
    expectInputError([&] { RefineNetworks(preset, texture(16), 1); }, "image discriminator");
    preset.size = 64;
    preset.faceSize = 8;
    expectInputError([&] { RefineNetworks(preset, texture(16), 1); }, "face discriminator");
    preset.faceDiscriminator = false;
    EXPECT_NO_THROW(RefineNetworks(preset, texture(16), 1));
}

// ---- a training step ----------------------------------------------------------------------------

// Two triangles before the camera, with an atlas of their own.
BodyModel square() {
    BodyModel body;
    body.vertexCount = body.uvCount = 4;
    body.faceCount = 2;
    body.faces = {0, 2, 1, 0, 3, 2};
    body.uvFaces = {0, 2, 1, 0, 3, 2};
    body.uvs = {0.05f, 0.05f, 0.95f, 0.05f, 0.95f, 0.95f, 0.05f, 0.95f};
    return body;
}

struct StepTest {
    RefinePreset preset;
    RefineNetworks networks;
    RefineStep step;

    static RefinePreset small() {
        RefinePreset preset;
        preset.size = 32;
        preset.width = 4;
        preset.depth = 5;
        preset.discriminatorWidth = 2;
        preset.faceSize = 12;
        preset.batch = 2;
        preset.dropout = 0;
        preset.lr = 2e-3;
        preset.lrDiscriminator = 2e-4;
        return preset;
    }
    static CoarseTexture dark() {
        CoarseTexture coarse;
        for (size_t i = 0; i < 32 * 32; ++i)
            for (size_t k : {i / 32, i % 32, i % 32})
                coarse.texture.push_back(0.25f + 0.01f * static_cast<float>(k));
        return coarse;
    }

    explicit StepTest(const RefinePreset& p, uint32_t seed = 1)
        : preset(p),
          networks(p, texture(32), seed),
          step((networks.allocate(testDevice()), testDevice()), square(), p, networks, dark(),
               {.poison = true}) {
        std::vector<float> verts{-.4f, -.4f, 1, .4f, -.4f, 1, .4f, .4f, 1, -.4f, .4f, 1};
        RasterCamera camera{32, 32, 16, 16, 1e-5f, 9e-5f, 0, 0};
        std::vector<float> mask(32 * 32), centres{16, 16, 16, 12};
        for (size_t i = 0; i < mask.size(); ++i)
            mask[i] = i % 32 >= 2 && i % 32 < 28 && i / 32 >= 2 && i / 32 < 30;
        for (size_t n = 0; n < 2; ++n) {
            std::vector<float> image;
            // Slopes in every colour, brighter than the coarse texture.
            for (size_t i = 0; i < 32 * 32; ++i)
                for (size_t k : {i % 32, i / 32, 31 - i % 32})
                    image.push_back(0.75f + 0.008f * static_cast<float>(k));
            step.graph.write(step.samples[n].verts, verts);
            step.graph.write(step.samples[n].camera, cameraValues(camera));
            step.graph.write(step.samples[n].image, image);
            step.graph.write(step.samples[n].mask, mask);
        }
        step.graph.write(step.faceCentres, centres);
    }
    void run(uint32_t i) {
        StepParams params = adamwStepParams(i, static_cast<float>(preset.lr), adamwOptions(preset));
        params.seed = 5;
        step.graph.setStep(params);
        step.graph.run();
    }
    float read(const char* loss) { return step.graph.readScalar(step.losses.find(loss)); }
    static std::vector<std::vector<float>> values(const Parameters& parameters) {
        std::vector<std::vector<float>> all;
        for (const Parameters::Entry& entry : parameters.entries())
            all.push_back(parameters.read(entry));
        return all;
    }
};

TEST(RefineStep, LearnsThePictureAndUpdatesAllThree) {
    for (bool leastSquares : {false, true}) {
        RefinePreset preset = StepTest::small();
        if (leastSquares) preset.loss = GanLoss::Squares;
        preset.misaligned = 1;
        StepTest test(preset);
        auto generator = StepTest::values(test.networks.generator.parameters());
        auto image = StepTest::values(test.networks.image.parameters());
        auto face = StepTest::values(test.networks.face.parameters());
        test.run(1);
        float first = test.read("reconstruction");
        EXPECT_GT(first, 0.5f);
        EXPECT_NE(StepTest::values(test.networks.generator.parameters()), generator);
        EXPECT_NE(StepTest::values(test.networks.image.parameters()), image);
        EXPECT_NE(StepTest::values(test.networks.face.parameters()), face);
        for (uint32_t i = 2; i <= 60; ++i) test.run(i);
        EXPECT_LT(test.read("reconstruction"), 0.8f * first);
        // The whole is the weighted sum of its parts.
        EXPECT_NEAR(test.read("loss"),
                    100 * test.read("reconstruction") + test.read("misaligned") +
                        test.read("gan_image") + test.read("gan_face"),
                    1e-3);
    }
}

TEST(RefineStep, DiscriminatorsLearnToTellAndTheGeneratorSeesTheUpdatedOnes) {
    RefinePreset preset = StepTest::small();
    preset.reconstruction = preset.misaligned = preset.adversarial = 0;
    preset.lr = 1e-9;  // leaves the generator where it is
    // With four times the rate the face's swings, and when it settles is up to the last bits.
    preset.lrDiscriminator = 4e-3;
    StepTest test(preset);
    test.run(1);
    float atFirst = test.read("discriminator_image"), faceAtFirst = test.read("discriminator_face");
    // Before any update the generator's loss would be that of the discriminators' first opinion;
    // after theirs, fakes convince less.
    float ganAtFirst = test.read("gan_image");
    for (uint32_t i = 2; i <= 40; ++i) test.run(i);
    EXPECT_LT(test.read("discriminator_image"), 0.5f * atFirst);
    EXPECT_LT(test.read("discriminator_face"), 0.5f * faceAtFirst);
    EXPECT_GT(test.read("gan_image"), ganAtFirst);
}

TEST(RefineStep, LeavesOutWhatIsSwitchedOff) {
    RefinePreset preset = StepTest::small();
    preset.imageDiscriminator = preset.faceDiscriminator = false;
    StepTest test(preset);
    test.run(1);
    using Names = std::vector<std::string>;
    EXPECT_EQ(test.step.losses.names(), (Names{"loss", "reconstruction", "misaligned"}));
    preset.imageDiscriminator = true;
    StepTest withImage(preset);
    withImage.run(1);
    EXPECT_EQ(withImage.step.losses.names(),
              (Names{"loss", "reconstruction", "misaligned", "gan_image", "discriminator_image"}));
}

TEST(RefineStep, TheGeneratorsGradientIsThatOfItsLoss) {
    // Finite differences of the recorded step's own loss, with all updates switched off: through
    // the discriminators, the crop, the masks, the renders and the residual.
    for (int term = 0; term < 4; ++term) {
        RefinePreset preset = StepTest::small();
        preset.reconstruction = term == 0 ? 3 : 0;
        preset.misaligned = term == 1 ? 3 : 0;
        preset.adversarial = term >= 2 ? 1 : 0;
        preset.imageDiscriminator = term == 2;
        preset.faceDiscriminator = term == 3;
        preset.lr = 1e-30;
        preset.lrDiscriminator = 0;
        StepTest test(preset);
        Parameters& net = test.networks.generator.parameters();
        // Discriminators with an opinion.
        for (Parameters* parameters :
             {&test.networks.image.parameters(), &test.networks.face.parameters()})
            for (const Parameters::Entry& entry : parameters->entries()) {
                std::vector<float> values = parameters->read(entry);
                for (float& v : values) v *= entry.shape.size() == 4 ? 8.0f : 1.0f;
                parameters->write(entry, values);
            }
        // A residual away from the kinks of the absolute values.
        net.write(*net.find("dec5.bias"), std::vector<float>(3, 0.3f));
        for (const char* name : {"dec5.bias", "dec5.weight", "dec4_bn.bias"}) {
            test.run(1);  // the gradient where the parameters are
            const Parameters::Entry& entry = *net.find(name);
            std::vector<float> values = net.read(entry),
                               gradient = net.read(entry, Parameters::kGradient);
            // Along the gradient itself, where rounding matters least.
            double norm = 0;
            for (float g : gradient) norm += double(g) * double(g);
            norm = std::sqrt(norm);
            ASSERT_GT(norm, 0) << name;
            double h = 5e-4 / std::max(norm, 0.2), difference = 0;
            for (double sign : {1., -1.}) {
                std::vector<float> moved = values;
                for (size_t i = 0; i < moved.size(); ++i)
                    moved[i] += float(sign * h * double(gradient[i]) / norm);
                net.write(entry, moved);
                test.run(1);
                difference += sign * double(test.read("loss"));
            }
            net.write(entry, values);
            EXPECT_NEAR(difference / (2 * h), norm, 0.05 * norm) << name << ", term " << term;
        }
    }
}

TEST(RefineStep, TheSameSeedGivesTheSameBits) {
    RefinePreset preset = StepTest::small();
    preset.dropout = 0.5;
    auto train = [&](uint32_t seed) {
        StepTest test(preset, seed);
        for (uint32_t i = 1; i <= 5; ++i) test.run(i);
        return StepTest::values(test.networks.generator.parameters());
    };
    auto first = train(3);
    EXPECT_EQ(train(3), first);
    EXPECT_NE(train(4), first);
}

TEST(RefineStep, AZeroResidualGivesTheCoarseTextureBack) {
    TextureUnet net({.size = 8, .width = 2, .inputChannels = 4}, "refine", 1);
    net.allocate(testDevice());
    for (const char* name : {"dec3.weight", "dec3.bias"}) {
        const Parameters::Entry& entry = *net.parameters().find(name);
        net.parameters().write(entry, std::vector<float>(size_t(elementCount(entry.shape))));
    }
    Graph graph(testDevice());
    Tensor coarse = graph.input({1, 3, 8, 8}), maps = graph.input({1, 1, 8, 8});
    Tensor clamped = refineTextures(graph, net, coarse, maps, {}, Residual::Clamped);
    Tensor program = refineTextures(graph, net, coarse, maps, {}, Residual::Program);
    graph.output(clamped);
    graph.output(program);
    graph.compile({.poison = true});
    Value value = uniform({1, 3, 8, 8}, 0, 1);
    std::vector<float> texture(value.data.begin(), value.data.end());
    graph.write(coarse, texture);
    graph.run();
    EXPECT_EQ(graph.read(clamped), texture);
    for (size_t i = 0; i < texture.size(); ++i)
        EXPECT_NEAR(graph.read(program)[i], (1 + texture[i]) / 2, 1e-6);
}

TEST(TextureUnet, FrozenParametersAreConstants) {
    TextureUnet net({.size = 8, .width = 2, .inputChannels = 1}, "texture", 1);
    net.allocate(testDevice());
    Graph graph(testDevice());
    Tensor x = graph.variable({1, 1, 8, 8});
    Tensor y = net.forward(graph, x, {.training = true, .frozen = true});
    Tensor dy = graph.input(y.shape);
    graph.backward({{y, dy}});
    Tensor dx = graph.gradient(x);
    graph.output(dx);
    graph.compile();
    graph.write(x, std::vector<float>(64, 0.5f));
    graph.write(dy, std::vector<float>(192, 1.0f));
    graph.run();
    for (const Parameters::Entry& entry : net.parameters().entries())
        for (float g : net.parameters().read(entry, Parameters::kGradient)) EXPECT_EQ(g, 0);
}

}  // namespace
}  // namespace doppel
