#include "engine/io/fbx_nodes.h"

#include <assimp/config.h>
#include <assimp/scene.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <span>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/child.h"
#include "engine/files/printable.h"

namespace doppel {

namespace {

constexpr uint64_t kMostBytes = uint64_t{512} << 20;
constexpr size_t kMostNodes = 10'000, kMostChannels = 100'000;
constexpr const char* kExpected = "an FBX file, binary or text, of 7.1 or newer";

using Json = nlohmann::json;

// ---- in the child -------------------------------------------------------------------------------

void addNode(Json& nodes, std::map<std::string, size_t>& byName, const aiNode& node, int parent,
             const std::string& where) {
    if (nodes.size() >= kMostNodes)
        throwInput("{}: nodes: expected at most {}, found more", where, kMostNodes);
    aiVector3D scale, move;
    aiQuaternion turn;
    node.mTransformation.Decompose(scale, turn, move);
    const auto number = static_cast<int>(nodes.size());
    byName.emplace(node.mName.C_Str(), nodes.size());
    nodes.push_back({{"name", printable(node.mName.C_Str())},
                     {"parent", parent},
                     {"translation", {move.x, move.y, move.z}},
                     {"rotation", {turn.x, turn.y, turn.z, turn.w}},
                     {"scale", {scale.x, scale.y, scale.z}}});
    for (unsigned i = 0; i < node.mNumChildren; ++i)
        addNode(nodes, byName, *node.mChildren[i], number, where);
}

template <typename Key>
void addChannel(Json& channels, size_t node, GltfChannel::Path path, const Key* keys,
                unsigned count, double ticksPerSecond) {
    Json times = Json::array(), values = Json::array();
    for (unsigned k = 0; k < count; ++k) {
        const double time = keys[k].mTime / ticksPerSecond;
        if (!times.empty() && !(time > times.back().get<double>())) continue;
        times.push_back(time);
        if constexpr (std::is_same_v<Key, aiQuatKey>)
            for (double x : {double{keys[k].mValue.x}, double{keys[k].mValue.y},
                             double{keys[k].mValue.z}, double{keys[k].mValue.w}})
                values.push_back(x);
        else
            for (double x :
                 {double{keys[k].mValue.x}, double{keys[k].mValue.y}, double{keys[k].mValue.z}})
                values.push_back(x);
    }
    if (!times.empty())
        channels.push_back({{"node", node}, {"path", path}, {"times", times}, {"values", values}});
}

std::vector<uint8_t> readWithAssimp(const std::vector<uint8_t>& bytes, const std::string& where) {
    Assimp::Importer importer;
    // Pivots as nodes of their own would stand between the bones.
    importer.SetPropertyBool(AI_CONFIG_IMPORT_FBX_PRESERVE_PIVOTS, false);
    for (const char* unread :
         {AI_CONFIG_IMPORT_FBX_READ_TEXTURES, AI_CONFIG_IMPORT_FBX_READ_MATERIALS,
          AI_CONFIG_IMPORT_FBX_READ_CAMERAS, AI_CONFIG_IMPORT_FBX_READ_LIGHTS})
        importer.SetPropertyBool(unread, false);
    // From memory, so that it opens nothing beside it.
    const aiScene* scene = importer.ReadFileFromMemory(bytes.data(), bytes.size(), 0, "fbx");
    if (!scene || !scene->mRootNode)
        throwInput("{}: expected {}; assimp says: {}", where, kExpected,
                   printable(importer.GetErrorString()));
    Json nodes = Json::array(), clips = Json::array(), joints = Json::array(),
         binds = Json::array();
    std::map<std::string, size_t> byName;
    addNode(nodes, byName, *scene->mRootNode, -1, where);
    for (unsigned a = 0; a < scene->mNumAnimations; ++a) {
        const aiAnimation& animation = *scene->mAnimations[a];
        const double rate = animation.mTicksPerSecond > 0 ? animation.mTicksPerSecond : 25;
        Json channels = Json::array();
        for (unsigned c = 0; c < animation.mNumChannels; ++c) {
            const aiNodeAnim& channel = *animation.mChannels[c];
            const auto node = byName.find(channel.mNodeName.C_Str());
            if (node == byName.end()) continue;
            using Path = GltfChannel::Path;
            addChannel(channels, node->second, Path::Translation, channel.mPositionKeys,
                       channel.mNumPositionKeys, rate);
            addChannel(channels, node->second, Path::Rotation, channel.mRotationKeys,
                       channel.mNumRotationKeys, rate);
            addChannel(channels, node->second, Path::Scale, channel.mScalingKeys,
                       channel.mNumScalingKeys, rate);
        }
        if (!channels.empty())
            clips.push_back({{"name", printable(animation.mName.C_Str())}, {"channels", channels}});
    }
    // The first mesh that hangs on bones.
    for (unsigned m = 0; m < scene->mNumMeshes && joints.empty(); ++m)
        for (unsigned b = 0; b < scene->mMeshes[m]->mNumBones; ++b) {
            const aiBone& bone = *scene->mMeshes[m]->mBones[b];
            const auto node = byName.find(bone.mName.C_Str());
            if (node == byName.end()) continue;
            joints.push_back(node->second);
            aiMatrix4x4 byRows = bone.mOffsetMatrix;
            byRows.Transpose();
            binds.push_back(std::vector<double>(&byRows.a1, &byRows.a1 + 16));
        }
    return Json::to_cbor(
        {{"nodes", nodes}, {"clips", clips}, {"joints", joints}, {"binds", binds}});
}

// ---- in this process, which trusts the child no more than the file ------------------------------

void requireFinite(std::span<const double> values, const std::string& where) {
    for (double x : values)
        if (!std::isfinite(x)) throwInput("{}: expected finite numbers, found {}", where, x);
}

void normalise(double* turn, const std::string& where) {
    double length = 0;
    for (int c = 0; c < 4; ++c) length += turn[c] * turn[c];
    length = std::sqrt(length);
    if (!(length > 1e-6)) throwInput("{}: rotation: expected a quaternion, found zeros", where);
    for (int c = 0; c < 4; ++c) turn[c] /= length;
}

GltfNodes nodesOf(const Json& json, const std::string& where) {
    GltfNodes file;
    for (const Json& from : json.at("nodes")) {
        GltfNode node;
        node.name = from.at("name");
        node.parent = from.at("parent");
        node.translation = from.at("translation");
        node.rotation = from.at("rotation");
        node.scale = from.at("scale");
        if (node.parent < -1 || node.parent >= static_cast<int>(file.nodes.size()))
            throwInput("{}: nodes: expected parents first, found {}", where, node.parent);
        for (std::span<const double> values :
             {std::span<const double>(node.translation), std::span<const double>(node.rotation),
              std::span<const double>(node.scale)})
            requireFinite(values, where + ": nodes");
        normalise(node.rotation.data(), where);
        file.nodes.push_back(std::move(node));
    }
    size_t channels = 0;
    for (const Json& from : json.at("clips")) {
        GltfNodes::Clip clip;
        clip.name = from.at("name");
        for (const Json& given : from.at("channels")) {
            if (++channels > kMostChannels)
                throwInput("{}: animations: expected at most {} channels, found more", where,
                           kMostChannels);
            GltfChannel channel;
            channel.node = given.at("node");
            channel.path = given.at("path");
            channel.times = given.at("times").get<std::vector<double>>();
            channel.values = given.at("values").get<std::vector<double>>();
            const size_t width = channel.path == GltfChannel::Path::Rotation ? 4 : 3;
            if (channel.node >= file.nodes.size() || channel.times.empty() ||
                channel.path > GltfChannel::Path::Scale ||
                channel.values.size() != width * channel.times.size() ||
                !std::ranges::is_sorted(channel.times))
                throwInput("{}: animations: expected keys of nodes, rising in time", where);
            requireFinite(channel.times, where + ": animation times");
            requireFinite(channel.values, where + ": animations");
            for (size_t k = 0; width == 4 && k < channel.times.size(); ++k)
                normalise(&channel.values[4 * k], where + ": animations");
            clip.channels.push_back(std::move(channel));
        }
        if (!clip.channels.empty()) file.clips.push_back(std::move(clip));
    }
    for (const Json& joint : json.at("joints")) {
        file.joints.push_back(joint);
        if (file.joints.back() >= file.nodes.size())
            throwInput("{}: bones: expected nodes, found number {}", where, file.joints.back());
    }
    for (const Json& bind : json.at("binds")) {
        file.inverseBind.push_back(bind);
        requireFinite(file.inverseBind.back(), where + ": bones");
    }
    if (file.joints.size() != file.inverseBind.size())
        throwInput("{}: bones: expected a bind pose for each", where);
    return file;
}

}  // namespace

GltfNodes readFbxNodes(const std::filesystem::path& path) {
    const std::string where = path.string();
    const std::vector<uint8_t> bytes = readWholeFile(path, kMostBytes);
    const std::vector<uint8_t> answer =
        inChild(where, kExpected, [&] { return readWithAssimp(bytes, where); });
    try {
        return nodesOf(Json::from_cbor(answer), where);
    } catch (const Json::exception& error) {
        throwInput("{}: expected {}; {}", where, kExpected, error.what());
    }
}

}  // namespace doppel
