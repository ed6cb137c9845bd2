// Exported avatars, read back by another reader and skinned by hand: the same bodies as lbs gives.
#include "trainer/avatar/avatar_renderer.h"
#include "trainer/avatar/export.h"

#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <glm/gtc/quaternion.hpp>
#include <map>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "tests/files.h"
#include "tests/op_test.h"
#include "trainer/avatar/checkpoint.h"
#include "trainer/avatar/networks.h"
#include "trainer/commands/export.h"
#include "trainer/motion/session.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;
using test::bytesOf;
using test::Folder;
using test::messageOf;

// The default body as somebody tall and broad, without networks.
Avatar plainAvatar() {
    Avatar avatar;
    avatar.bodyArrays = readBodyArrays("default");
    avatar.body = bodyFromNpz(avatar.bodyArrays);
    avatar.betas = {1.5f, -1, 0.5f, 0, 1};
    avatar.preset = presetByName("ci");
    avatar.textureSize = 64;
    avatar.texture.assign(64 * 64 * 3, 0.25f);
    return avatar;
}

// A few poses with every joint bent, in camera space.
Motion bends() {
    Motion motion;
    motion.name = "bends";
    motion.fps = 20;
    for (uint32_t f = 0; f < 3; ++f) {
        std::vector<double> bend = uniform({72}, -0.5, 0.5, f + 1).data;
        Theta theta;
        std::ranges::transform(bend, theta.begin(), [](double x) { return static_cast<float>(x); });
        auto root = uprightOrientation(0.7f * static_cast<float>(f), 0.2f);
        std::ranges::copy(root, theta.begin());
        motion.theta.push_back(theta);
        motion.trans.push_back({0.3f * static_cast<float>(f), 0.1f, 3 + static_cast<float>(f)});
    }
    return motion;
}

// The same motion in a world that is the camera's turned: v' = turn v about the world's origin.
// The pelvis at rest is j_0; theta turns about it, so trans has to make up for it.
Motion turnedMotion(Motion motion, const glm::dquat& turn, const glm::dvec3& pelvis) {
    for (size_t f = 0; f < motion.size(); ++f) {
        Theta& theta = motion.theta[f];
        glm::dvec3 axis(theta[0], theta[1], theta[2]);
        double angle = glm::length(axis);
        glm::dquat root = turn * glm::angleAxis(angle, axis / angle);
        if (root.w < 0) root = -root;  // glm::angle is wrong near -1
        glm::dvec3 vector = glm::axis(root) * glm::angle(root);
        Trans& t = motion.trans[f];
        glm::dvec3 moved = turn * (pelvis + glm::dvec3(t[0], t[1], t[2])) - pelvis;
        for (int c = 0; c < 3; ++c) {
            theta[static_cast<size_t>(c)] = static_cast<float>(vector[c]);
            t[static_cast<size_t>(c)] = static_cast<float>(moved[c]);
        }
    }
    return motion;
}

struct Reader {
    tinygltf::Model model;

    explicit Reader(const std::filesystem::path& path) {
        tinygltf::TinyGLTF gltf;
        std::string error, warning;
        EXPECT_TRUE(gltf.LoadBinaryFromFile(&model, &error, &warning, path.string())) << error;
        EXPECT_EQ(error + warning, "");
    }

    template <typename T>
    std::vector<T> values(int index) const {
        const auto& accessor = model.accessors.at(static_cast<size_t>(index));
        const auto& view = model.bufferViews.at(static_cast<size_t>(accessor.bufferView));
        auto type = static_cast<uint32_t>(accessor.type);
        auto component = static_cast<uint32_t>(accessor.componentType);
        EXPECT_EQ(tinygltf::GetComponentSizeInBytes(component), static_cast<int>(sizeof(T)));
        std::vector<T> result(accessor.count *
                              static_cast<size_t>(tinygltf::GetNumComponentsInType(type)));
        EXPECT_LE(result.size() * sizeof(T), view.byteLength);
        std::memcpy(result.data(), &model.buffers.at(0).data.at(view.byteOffset),
                    result.size() * sizeof(T));
        return result;
    }
    template <typename T>
    std::vector<T> attribute(const char* name) const {
        return values<T>(model.meshes.at(0).primitives.at(0).attributes.at(name));
    }
    std::vector<uint16_t> indices() const {
        return values<uint16_t>(model.meshes.at(0).primitives.at(0).indices);
    }

    // Vertices of key `key` as glTF defines them: weights, joint matrices, inverse bind matrices.
    // Without a key the skeleton as its nodes stand.
    std::vector<glm::dvec3> skinned(int key = -1) const {
        struct Place {
            glm::dvec3 translation{0};
            glm::dquat rotation{1, 0, 0, 0};
        };
        std::vector<Place> local(model.nodes.size());
        for (size_t n = 0; n < local.size(); ++n)
            for (size_t c = 0; c < model.nodes[n].translation.size(); ++c)
                local[n].translation[static_cast<int>(c)] = model.nodes[n].translation[c];
        if (key >= 0) {
            const tinygltf::Animation& animation = model.animations.at(0);
            for (const tinygltf::AnimationChannel& channel : animation.channels) {
                const auto& sampler = animation.samplers.at(static_cast<size_t>(channel.sampler));
                std::vector<float> out = values<float>(sampler.output);
                Place& place = local.at(static_cast<size_t>(channel.target_node));
                if (channel.target_path == "translation") {
                    const float* t = &out.at(3 * static_cast<size_t>(key));
                    place.translation = {t[0], t[1], t[2]};
                } else {
                    const float* q = &out.at(4 * static_cast<size_t>(key));
                    place.rotation = glm::dquat(q[3], q[0], q[1], q[2]);
                    EXPECT_NEAR(glm::length(place.rotation), 1, 1e-6);
                }
            }
        }
        std::vector<glm::dmat4> world(local.size(), glm::dmat4(1));
        std::vector<int> queue = model.scenes.at(0).nodes;
        for (size_t i = 0; i < queue.size(); ++i) {
            auto n = static_cast<size_t>(queue[i]);
            world[n] = world[n] * glm::translate(glm::dmat4(1), local[n].translation) *
                       glm::mat4_cast(local[n].rotation);
            for (int child : model.nodes[n].children) {
                world[static_cast<size_t>(child)] = world[n];
                queue.push_back(child);
            }
        }
        const tinygltf::Skin& skin = model.skins.at(0);
        std::vector<float> inverse = values<float>(skin.inverseBindMatrices);
        std::vector<glm::dmat4> bones;
        for (size_t j = 0; j < skin.joints.size(); ++j) {
            glm::dmat4 bind;
            for (int c = 0; c < 16; ++c)
                bind[c / 4][c % 4] = inverse.at(16 * j + static_cast<size_t>(c));
            bones.push_back(world[static_cast<size_t>(skin.joints[j])] * bind);
        }
        std::vector<float> positions = attribute<float>("POSITION");
        std::vector<float> weights = attribute<float>("WEIGHTS_0");
        std::vector<uint16_t> joints = attribute<uint16_t>("JOINTS_0");
        std::vector<glm::dvec3> verts;
        for (size_t v = 0; v < positions.size() / 3; ++v) {
            glm::dvec4 rest(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2], 1);
            glm::dvec4 sum(0);
            for (size_t k = 0; k < 4; ++k)
                sum +=
                    static_cast<double>(weights[4 * v + k]) * (bones.at(joints[4 * v + k]) * rest);
            verts.emplace_back(sum);
        }
        return verts;
    }
};

double lowest(const std::vector<glm::dvec3>& verts) {
    double low = INFINITY;
    for (const glm::dvec3& v : verts) low = std::min(low, v.y);
    return low;
}

// The file's vertices in each key are half a turn about x and one translation away from lbs's.
void expectSameBodies(const Reader& file, const Avatar& avatar, const Motion& motion) {
    BodyPoser poser(testDevice(), avatar.body);
    std::vector<uint16_t> indices = file.indices();
    ASSERT_EQ(indices.size(), avatar.body.faces.size());
    glm::dvec3 offset;
    double worst = 0;
    for (size_t f = 0; f < motion.size(); ++f) {
        PosedMesh posed = poser.pose(motion.theta[f], motion.trans[f], avatar.betas);
        std::vector<glm::dvec3> verts = file.skinned(static_cast<int>(f));
        auto turned = [&](const auto* v) { return glm::dvec3(v[0], -v[1], -v[2]); };
        if (f == 0) {
            EXPECT_NEAR(lowest(verts), 0, 1e-4) << "it stands on the ground";
            offset = verts.at(indices[0]) -
                     turned(&posed.verts[3 * static_cast<size_t>(avatar.body.faces[0])]);
            glm::dvec3 pelvis = turned(posed.joints[0].data()) + offset;
            EXPECT_NEAR(std::hypot(pelvis.x, pelvis.z), 0, 1e-4) << "above the origin";
        }
        // Corner by corner: the faces keep their order where vertices are split.
        for (size_t i = 0; i < indices.size(); ++i) {
            glm::dvec3 expected =
                turned(&posed.verts[3 * static_cast<size_t>(avatar.body.faces[i])]) + offset;
            worst = std::max(worst, glm::distance(verts.at(indices[i]), expected));
        }
    }
    EXPECT_LT(worst, 1e-4) << "metres";
}

TEST(Export, MovesAsLbsDoes) {
    Folder folder;
    Avatar avatar = plainAvatar();
    Motion motion = bends();
    motion.cameras.resize(motion.size());
    exportAvatar(testDevice(), avatar, folder / "a.glb", &motion);
    EXPECT_EQ(folder.names(), std::vector<std::string>{"a.glb"});
    Reader file(folder / "a.glb");
    expectSameBodies(file, avatar, motion);

    const tinygltf::Animation& animation = file.model.animations.at(0);
    EXPECT_EQ(animation.name, "bends");
    std::vector<float> times = file.values<float>(animation.samplers.at(0).input);
    ASSERT_EQ(times.size(), 3u);
    EXPECT_FLOAT_EQ(times[2], 0.1f);
    EXPECT_EQ(file.model.nodes.at(static_cast<size_t>(file.model.skins.at(0).joints.at(15))).name,
              "head");
}

TEST(Export, FacesForwardOnTheGround) {
    // Upright before the camera and facing it: in the file it stands as in the bind pose.
    Folder folder;
    Avatar avatar = plainAvatar();
    Motion motion;
    motion.theta.resize(1);
    auto root = uprightOrientation(0);
    std::ranges::copy(root, motion.theta[0].begin());
    motion.trans = {{0.5f, 0.2f, 4}};
    exportAvatar(testDevice(), avatar, folder / "a.glb", &motion);
    Reader file(folder / "a.glb");
    std::vector<glm::dvec3> bind = file.skinned(), posed = file.skinned(0);
    EXPECT_NEAR(lowest(bind), 0, 1e-5);
    std::vector<double> joints =
        restJoints(avatar.body, std::vector<double>(avatar.betas.begin(), avatar.betas.end()));
    for (size_t v = 0; v < bind.size(); ++v)
        ASSERT_LT(glm::distance(bind[v] - glm::dvec3(joints[0], 0, joints[2]), posed[v]), 1e-4);
}

TEST(Export, BindPoseIsTheShapedBody) {
    Folder folder;
    Avatar avatar = plainAvatar();
    exportAvatar(testDevice(), avatar, folder / "a.glb", nullptr);
    Reader file(folder / "a.glb");
    EXPECT_TRUE(file.model.animations.empty());
    EXPECT_TRUE(file.model.materials.at(0).doubleSided);
    EXPECT_TRUE(file.model.materials[0].extensions.contains("KHR_materials_unlit"));
    std::vector<double> shaped =
        shapedVertices(avatar.body, std::vector<double>(avatar.betas.begin(), avatar.betas.end()));
    double ground = INFINITY;
    for (size_t i = 1; i < shaped.size(); i += 3) ground = std::min(ground, shaped[i]);

    std::vector<glm::dvec3> verts = file.skinned();
    std::vector<float> uvs = file.attribute<float>("TEXCOORD_0");
    std::vector<float> normals = file.attribute<float>("NORMAL");
    std::vector<float> weights = file.attribute<float>("WEIGHTS_0");
    std::vector<uint16_t> indices = file.indices();
    EXPECT_GE(verts.size(), static_cast<size_t>(avatar.body.vertexCount));
    size_t outward = 0;
    for (size_t i = 0; i < indices.size(); ++i) {
        size_t v = indices[i], source = 3 * static_cast<size_t>(avatar.body.faces[i]);
        ASSERT_LT(v, verts.size());
        ASSERT_LT(glm::distance(verts[v], glm::dvec3(shaped[source], shaped[source + 1] - ground,
                                                     shaped[source + 2])),
                  1e-5);
        const float* uv = &avatar.body.uvs[2 * static_cast<size_t>(avatar.body.uvFaces[i])];
        ASSERT_EQ(uvs[2 * v], uv[0]);
        ASSERT_EQ(uvs[2 * v + 1], uv[1]);
        if (i % 3) continue;
        glm::dvec3 face =
            glm::cross(verts[indices[i + 1]] - verts[v], verts[indices[i + 2]] - verts[v]);
        if (glm::dot(face, {normals[3 * v], normals[3 * v + 1], normals[3 * v + 2]}) > 0) ++outward;
    }
    EXPECT_GT(static_cast<double>(outward), 0.99 * static_cast<double>(avatar.body.faceCount));
    for (size_t v = 0; v < verts.size(); ++v) {
        const float* n = &normals[3 * v];
        const float* w = &weights[4 * v];
        ASSERT_NEAR(std::hypot(n[0], n[1], n[2]), 1, 1e-5);
        ASSERT_NEAR(w[0] + w[1] + w[2] + w[3], 1, 1e-6);
        ASSERT_GE(*std::min_element(w, w + 4), 0);
    }
}

TEST(Export, StandsUprightWhicheverAxisIsUp) {
    Avatar avatar = plainAvatar();
    std::vector<double> rest =
        restJoints(avatar.body, std::vector<double>(avatar.betas.begin(), avatar.betas.end()));
    glm::dvec3 pelvis(rest[0], rest[1], rest[2]);
    Motion motion = bends();
    glm::dquat half(0, 1, 0, 0);
    glm::dquat quarter = glm::angleAxis(std::acos(0.0), glm::dvec3(1, 0, 0));
    std::map<std::string, Motion> motions{
        {"y down", motion},
        {"y up", turnedMotion(motion, half, pelvis)},
        {"z up", turnedMotion(motion, quarter * half, pelvis)},
    };
    for (const auto& [name, made] : motions) {
        SCOPED_TRACE(name);
        Folder folder;
        exportAvatar(testDevice(), avatar, folder / "a.glb", &made);
        expectSameBodies(Reader(folder / "a.glb"), avatar, motion);
    }
}

// Mean distance between the file's vertices and the avatar's, their centres brought together.
double distanceToNetwork(const Reader& file, Device& device, const Avatar& avatar,
                         const Motion& motion) {
    AvatarRenderer renderer(device, avatar);
    std::vector<uint16_t> indices = file.indices();
    double sum = 0, count = 0;
    for (size_t f = 0; f < motion.size(); ++f) {
        std::vector<float> posed = renderer.vertices(motion.theta[f], motion.trans[f]);
        std::vector<glm::dvec3> verts = file.skinned(static_cast<int>(f));
        std::vector<glm::dvec3> difference;
        glm::dvec3 mean(0);
        for (size_t i = 0; i < indices.size(); ++i) {
            const float* v = &posed[3 * static_cast<size_t>(avatar.body.faces[i])];
            difference.push_back(verts.at(indices[i]) - glm::dvec3(v[0], -v[1], -v[2]));
            mean += difference.back() / static_cast<double>(indices.size());
        }
        for (const glm::dvec3& d : difference) sum += glm::length(d - mean);
        count += static_cast<double>(difference.size());
    }
    return sum / count;
}

TEST(Export, StaysCloseToTheMeshNetwork) {
    Folder folder;
    Avatar avatar = plainAvatar();
    Parameters net;
    declareMeshNet(net, avatar, 1);
    net.allocate(testDevice());
    avatar.meshNet = readWeights(net);
    // As if trained: offsets of up to some centimetres that turn with the normals.
    uint32_t seed = 1;
    for (auto& [name, array] : avatar.meshNet) {
        if (name.find("offset.weight") == std::string::npos) continue;
        std::vector<double> drawn =
            random({static_cast<int64_t>(array.values.size())}, seed++).data;
        std::ranges::transform(drawn, array.values.begin(),
                               [](double x) { return static_cast<float>(0.005 * x); });
    }
    Motion motion = bends();
    exportAvatar(testDevice(), avatar, folder / "a.glb", &motion);
    std::vector<float> tPose = AvatarRenderer(testDevice(), avatar).vertices(Theta{}, Trans{});
    writeGlb(folder / "t.glb", avatarScene(avatar, tPose, &motion));
    Avatar plain = avatar;
    plain.meshNet.clear();
    exportAvatar(testDevice(), plain, folder / "plain.glb", &motion);
    auto distance = [&](const char* name) {
        return distanceToNetwork(Reader(folder / name), testDevice(), avatar, motion);
    };
    double ours = distance("a.glb"), refinedInTPose = distance("t.glb"),
           unrefined = distance("plain.glb");
    EXPECT_GT(unrefined, 0.002) << "metres: the network does something";
    EXPECT_LT(ours, 0.75 * refinedInTPose);
    EXPECT_LT(ours, 0.75 * unrefined);
}

TEST(Export, FillsTheTextureBetweenCharts) {
    // Charts in the left two fifths, drawn green; red between and beside them.
    Avatar avatar = plainAvatar();
    for (size_t i = 0; i < avatar.body.uvs.size(); i += 2) avatar.body.uvs[i] *= 0.4f;
    for (size_t i = 0; i < avatar.texture.size(); i += 3) {
        bool left = i / 3 % 64 < 30;
        avatar.texture[i] = left ? 0.0f : 1.0f;
        avatar.texture[i + 1] = left ? 1.0f : 0.0f;
        avatar.texture[i + 2] = 0;
    }
    std::vector<float> bind(avatar.body.templateVertices);
    Image image = avatarScene(avatar, bind, nullptr).baseColor;
    ASSERT_EQ(image.width, 64);
    for (int y = 0; y < 64; ++y)
        for (int x = 0; x < 64; ++x) {
            ASSERT_EQ(image.pixel(x, y)[0], 0) << x << " " << y;
            ASSERT_EQ(image.pixel(x, y)[1], 255) << x << " " << y;
        }

    // Texels that a chart's pictures depend on stay as they are: all of them, where charts are
    // everywhere.
    avatar = plainAvatar();
    for (size_t i = 0; i < avatar.texture.size(); ++i)
        avatar.texture[i] = static_cast<float>(i * 7 % 256) / 255.0f;
    avatar.body.uvs = {-0.1f, -0.1f, 2.5f, -0.1f, -0.1f, 2.5f};
    avatar.body.uvCount = 3;
    for (size_t i = 0; i < avatar.body.uvFaces.size(); ++i)
        avatar.body.uvFaces[i] = static_cast<int32_t>(i % 3);
    image = avatarScene(avatar, bind, nullptr).baseColor;
    for (size_t i = 0; i < image.data.size(); ++i) ASSERT_EQ(image.data[i], i * 7 % 256);
}

TEST(Export, Refusals) {
    Folder folder;
    Avatar avatar = plainAvatar();
    avatar.texture.clear();
    std::vector<float> bind(avatar.body.templateVertices);
    EXPECT_NE(messageOf<InputError>([&] { avatarScene(avatar, bind, nullptr); }).find("no texture"),
              std::string::npos);

    writeAvatar(folder / "bare", avatar);
    ExportOptions options;
    options.avatar = folder / "bare";
    options.out = folder / "a.glb";
    EXPECT_NE(messageOf<InputError>([&] { runExport(options); }).find("train stage texture first"),
              std::string::npos);
    avatar = plainAvatar();
    writeAvatar(folder / "whole", avatar);
    options.avatar = folder / "whole";
    options.frames = "0:2";
    EXPECT_NE(messageOf<InputError>([&] { runExport(options); }).find("without --motion"),
              std::string::npos);
    options.frames = "";
    options.motions = {folder / "nothing"};
    EXPECT_THROW(runExport(options), InputError);
    options.motions.clear();
    options.out = folder / "no" / "a.glb";
    EXPECT_THROW(runExport(options), InputError);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"bare", "whole"}));

    // What can be exported, is: by name, read from disk.
    options.out = folder / "a.glb";
    runExport(options);
    EXPECT_GT(Reader(folder / "a.glb").skinned().size(), 0u);
}

// Neither the avatar nor the motion is written over, nor anything put between their files.
TEST(Export, LiesApartFromItsInputs) {
    Folder folder;
    writeAvatar(folder / "av", plainAvatar());
    fs::create_directories(folder / "cap");
    const Motion motion = bends();
    writeNpz(folder / "cap/poses.npz", posesArrays(motion.theta, motion.trans, {}), true);
    folder.link("av/body.npz", "link.npz");
    folder.link("av/body.npz", "beside.png");
    const std::string body = bytesOf(folder / "av/body.npz"),
                      poses = bytesOf(folder / "cap/poses.npz");
    for (const char* out :
         {"av/body.npz", "av/new.json", "cap/poses.npz", "cap/me.obj", "link.npz", "beside.usda"}) {
        ExportOptions options;
        options.avatar = folder / "av";
        options.motions = {folder / "cap"};
        options.frames = "0:1";
        options.out = folder / out;
        const std::string found = messageOf<InputError>([&] { runExport(options); });
        EXPECT_NE(found.find("expected a place apart from the input"), std::string::npos) << found;
    }
    EXPECT_EQ(bytesOf(folder / "av/body.npz"), body);
    EXPECT_EQ(bytesOf(folder / "cap/poses.npz"), poses);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"av", "beside.png", "cap", "link.npz"}));
}

}  // namespace
}  // namespace doppel
