#include "engine/io/gltf_nodes.h"

// Only the declarations: the library is linked.
#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <exception>
#include <limits>
#include <set>
#include <string_view>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/json_depth.h"
#include "engine/files/printable.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMostBytes = uint64_t{1} << 30;
constexpr size_t kMostNodes = 65536, kMostNumbers = size_t{1} << 27;

// Where links and ".." lead.
bool liesBelow(const fs::path& file, const fs::path& folder) {
    std::error_code error;
    const fs::path place = fs::weakly_canonical(file, error);
    if (error) return false;
    const fs::path above = fs::weakly_canonical(folder, error);
    return !error && std::ranges::mismatch(place, above).in2 == above.end();
}

// Files beside a .gltf or below: nothing else is read, wherever the library looks, which tries the
// working directory too.
tinygltf::FsCallbacks filesBelow(const fs::path& folder) {
    tinygltf::FsCallbacks files{};
    files.user_data = const_cast<fs::path*>(&folder);
    files.FileExists = [](const std::string& file, void* below) {
        std::error_code error;
        return liesBelow(file, *static_cast<const fs::path*>(below)) &&
               fs::is_regular_file(file, error);
    };
    files.ExpandFilePath = [](const std::string& file, void*) { return file; };
    files.ReadWholeFile = [](std::vector<unsigned char>* out, std::string* error,
                             const std::string& file, void*) {
        try {
            *out = readWholeFile(file, kMostBytes);
            return true;
        } catch (const InputError& failure) {
            *error += failure.what();
            return false;
        }
    };
    files.WriteWholeFile = [](std::string*, const std::string&, const std::vector<unsigned char>&,
                              void*) { return false; };
    return files;
}

class Reader {
public:
    explicit Reader(const fs::path& path) : file_(path.string()) {
        const std::vector<uint8_t> bytes = readWholeFile(path, kMostBytes);
        tinygltf::TinyGLTF gltf;
        const fs::path folder = fs::absolute(path).parent_path();
        gltf.SetFsCallbacks(filesBelow(folder));
        // Pictures are not looked at.
        gltf.SetImageLoader([](tinygltf::Image*, const int, std::string*, std::string*, int, int,
                               const unsigned char*, int, void*) { return true; },
                            nullptr);
        std::string error, warning;
        bool good = false;
        const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
        const bool binary = text.starts_with("glTF");
        // Of a .glb behind the headers of the file and of its first chunk, which says its length.
        uint32_t json = 0;
        if (binary && bytes.size() >= 20) std::memcpy(&json, &bytes[12], 4);
        requireShallowJson(!binary             ? text
                           : bytes.size() < 20 ? std::string_view()
                                               : text.substr(20, json),
                           file_);
        try {
            const auto length = static_cast<unsigned int>(bytes.size());
            good = binary ? gltf.LoadBinaryFromMemory(&model_, &error, &warning, bytes.data(),
                                                      length, folder.string())
                          : gltf.LoadASCIIFromString(&model_, &error, &warning, text.data(), length,
                                                     folder.string());
        } catch (const std::exception& failure) {
            error = failure.what();
        }
        if (!good) {
            std::replace(error.begin(), error.end(), '\n', ' ');
            throwInput("{}: expected a glTF 2.0 file, found a damaged one: {}", file_,
                       printable(error, 200));
        }
    }

    GltfNodes read() {
        GltfNodes result;
        readNodes(result);
        requireWithinBudget();
        for (const tinygltf::Animation& animation : model_.animations) readClip(animation, result);
        readHumanoid(result);
        readSkin(result);
        return result;
    }

private:
    template <typename... Args>
    [[noreturn]] void fail(fmt::format_string<Args...> format, Args&&... args) const {
        throwInput("{}: {}", file_, fmt::format(format, std::forward<Args>(args)...));
    }

    double finite(double value, const char* what) const {
        if (!std::isfinite(value) || std::abs(value) > 1e12)
            fail("{}: expected finite numbers, found {}", what, value);
        return value;
    }

    void readNodes(GltfNodes& result) {
        const auto count = model_.nodes.size();
        if (count == 0 || count > kMostNodes)
            fail("nodes: expected 1 to {}, found {}", kMostNodes, count);
        std::vector<int> parent(count, -1);
        for (size_t n = 0; n < count; ++n)
            for (const int child : model_.nodes[n].children) {
                const auto c = static_cast<size_t>(child);
                if (child < 0 || c >= count || parent[c] >= 0)
                    fail("nodes: expected each node below one other, found node {} elsewhere",
                         child);
                parent[c] = static_cast<int>(n);
            }
        // Parents first.
        place_.assign(count, -1);
        std::vector<size_t> order;
        for (size_t n = 0; n < count; ++n)
            if (parent[n] < 0) order.push_back(n);
        for (size_t i = 0; i < order.size(); ++i) {
            place_[order[i]] = static_cast<int>(i);
            for (const int child : model_.nodes[order[i]].children)
                order.push_back(static_cast<size_t>(child));
        }
        if (order.size() != count) fail("nodes: expected a tree, found nodes in a circle");
        for (const size_t n : order) {
            const tinygltf::Node& node = model_.nodes[n];
            GltfNode added;
            added.name = node.name;
            added.parent = parent[n] < 0 ? -1 : place_[static_cast<size_t>(parent[n])];
            if (node.matrix.size() == 16) {
                decompose(node.matrix, added);
            } else {
                if (node.translation.size() == 3)
                    for (size_t c = 0; c < 3; ++c)
                        added.translation[c] = finite(node.translation[c], "translation");
                if (node.scale.size() == 3)
                    for (size_t c = 0; c < 3; ++c) added.scale[c] = finite(node.scale[c], "scale");
                if (node.rotation.size() == 4) {
                    double length = 0;
                    for (const double x : node.rotation) length += finite(x, "rotation") * x;
                    if (!(length > 1e-12))
                        fail("rotation: expected a unit quaternion, found zeros");
                    for (size_t c = 0; c < 4; ++c)
                        added.rotation[c] = node.rotation[c] / std::sqrt(length);
                }
            }
            result.nodes.push_back(std::move(added));
        }
    }

    // Channels may share their numbers in the file, and each has its own in memory.
    void requireWithinBudget() const {
        uint64_t count = 0;
        const auto add = [&](int index, uint64_t width) {
            if (index < 0 || static_cast<size_t>(index) >= model_.accessors.size()) return;
            const uint64_t more = model_.accessors[static_cast<size_t>(index)].count;
            count += std::min<uint64_t>(more, kMostNumbers) * width;
            if (count > kMostNumbers)
                fail("animations: expected at most {} numbers, found more", kMostNumbers);
        };
        for (const tinygltf::Animation& animation : model_.animations)
            for (const tinygltf::AnimationChannel& channel : animation.channels) {
                if (channel.sampler < 0 ||
                    static_cast<size_t>(channel.sampler) >= animation.samplers.size())
                    continue;
                const auto& sampler = animation.samplers[static_cast<size_t>(channel.sampler)];
                add(sampler.input, 1);
                add(sampler.output, 4);
            }
    }

    // A matrix of translation, rotation and scale, by columns.
    void decompose(const std::vector<double>& m, GltfNode& node) const {
        double r[3][3];  // columns
        for (size_t c = 0; c < 3; ++c) {
            double length = 0;
            for (size_t k = 0; k < 3; ++k) {
                r[c][k] = finite(m[4 * c + k], "matrix");
                length += r[c][k] * r[c][k];
            }
            node.scale[c] = std::sqrt(length);
            if (!(length > 1e-24)) fail("matrix: expected one that can be inverted, found zeros");
            for (size_t k = 0; k < 3; ++k) r[c][k] /= node.scale[c];
            node.translation[c] = finite(m[12 + c], "matrix");
        }
        // Of the four ways to the quaternion the one that divides by most.
        const double x = r[0][0], y = r[1][1], z = r[2][2];
        const double squares[4] = {1 + x - y - z, 1 - x + y - z, 1 - x - y + z, 1 + x + y + z};
        const auto largest = static_cast<size_t>(std::max_element(squares, squares + 4) - squares);
        const double twice = std::sqrt(std::max(squares[largest], 1e-12));
        const double sums[4][4] = {
            {squares[0], r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] - r[2][1]},
            {r[0][1] + r[1][0], squares[1], r[1][2] + r[2][1], r[2][0] - r[0][2]},
            {r[0][2] + r[2][0], r[1][2] + r[2][1], squares[2], r[0][1] - r[1][0]},
            {r[1][2] - r[2][1], r[2][0] - r[0][2], r[0][1] - r[1][0], squares[3]}};
        double length = 0;
        for (size_t c = 0; c < 4; ++c) {
            node.rotation[c] = sums[largest][c] / twice / 2;
            length += node.rotation[c] * node.rotation[c];
        }
        for (double& c : node.rotation) c /= std::sqrt(length);
    }

    // All numbers of an accessor; integers that stand for −1 to 1 or 0 to 1 are converted.
    std::vector<double> numbers(int index, int width, const char* what) const {
        if (index < 0 || static_cast<size_t>(index) >= model_.accessors.size())
            fail("{}: expected an accessor of the file, found number {}", what, index);
        const tinygltf::Accessor& accessor = model_.accessors[static_cast<size_t>(index)];
        if (accessor.sparse.isSparse) fail("{}: expected dense numbers, found sparse ones", what);
        if (accessor.bufferView < 0 ||
            static_cast<size_t>(accessor.bufferView) >= model_.bufferViews.size())
            fail("{}: expected a view of the file, found number {}", what, accessor.bufferView);
        const auto& view = model_.bufferViews[static_cast<size_t>(accessor.bufferView)];
        if (view.buffer < 0 || static_cast<size_t>(view.buffer) >= model_.buffers.size())
            fail("{}: expected a buffer of the file, found number {}", what, view.buffer);
        const auto& data = model_.buffers[static_cast<size_t>(view.buffer)].data;
        const int found = tinygltf::GetNumComponentsInType(static_cast<uint32_t>(accessor.type));
        if (found != width)
            fail("{}: expected {} numbers in each element, found {}", what, width, found);
        const int size =
            tinygltf::GetComponentSizeInBytes(static_cast<uint32_t>(accessor.componentType));
        const int stride = accessor.ByteStride(view);
        const auto wide = static_cast<size_t>(width);
        if (size <= 0 || stride < size * width || accessor.count == 0 ||
            accessor.count > kMostNumbers / wide)
            fail("{}: expected numbers, found elements of {} bytes", what, stride);
        const size_t step = static_cast<size_t>(stride);
        const size_t row = static_cast<size_t>(size) * wide;
        if (view.byteOffset > data.size() || view.byteLength > data.size() - view.byteOffset ||
            accessor.byteOffset > view.byteLength ||
            (accessor.count - 1) > (view.byteLength - accessor.byteOffset) / step ||
            (accessor.count - 1) * step + row > view.byteLength - accessor.byteOffset)
            fail("{}: expected {} elements, found fewer bytes", what, accessor.count);
        std::vector<double> values;
        values.reserve(accessor.count * wide);
        const auto read = [&]<typename T>(T, double most) {
            for (size_t i = 0; i < accessor.count; ++i)
                for (size_t c = 0; c < wide; ++c) {
                    T value;
                    std::memcpy(
                        &value,
                        &data[view.byteOffset + accessor.byteOffset + i * step + c * sizeof(T)],
                        sizeof(T));
                    double number = static_cast<double>(value);
                    if (most > 0) number = std::max(number / most, -1.);
                    values.push_back(finite(number, what));
                }
        };
        switch (accessor.componentType) {
            case TINYGLTF_COMPONENT_TYPE_FLOAT:
                read(float{}, 0);
                break;
            case TINYGLTF_COMPONENT_TYPE_BYTE:
                read(int8_t{}, 127);
                break;
            case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
                read(uint8_t{}, 255);
                break;
            case TINYGLTF_COMPONENT_TYPE_SHORT:
                read(int16_t{}, 32767);
                break;
            case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
                read(uint16_t{}, 65535);
                break;
            default:
                fail("{}: expected floats or short integers, found type {}", what,
                     accessor.componentType);
        }
        return values;
    }

    void readClip(const tinygltf::Animation& animation, GltfNodes& result) const {
        GltfNodes::Clip clip{animation.name, {}};
        std::set<std::pair<size_t, GltfChannel::Path>> moved;
        for (const tinygltf::AnimationChannel& channel : animation.channels) {
            using Path = GltfChannel::Path;
            // Weights of morph targets, and extensions' own.
            if (channel.target_node < 0) continue;
            const bool rotates = channel.target_path == "rotation",
                       moves = channel.target_path == "translation";
            if (!rotates && !moves && channel.target_path != "scale") continue;
            if (static_cast<size_t>(channel.target_node) >= place_.size() || channel.sampler < 0 ||
                static_cast<size_t>(channel.sampler) >= animation.samplers.size())
                fail("animations: expected nodes and samplers of the file, found {} and {}",
                     channel.target_node, channel.sampler);
            const auto& sampler = animation.samplers[static_cast<size_t>(channel.sampler)];
            GltfChannel added;
            added.node = static_cast<size_t>(place_[static_cast<size_t>(channel.target_node)]);
            added.path = rotates ? Path::Rotation : moves ? Path::Translation : Path::Scale;
            if (!moved.emplace(added.node, added.path).second)
                fail("animations: expected one channel for the {} of node {}, found two",
                     channel.target_path, channel.target_node);
            added.between = sampler.interpolation == "STEP"          ? GltfChannel::Between::Step
                            : sampler.interpolation == "CUBICSPLINE" ? GltfChannel::Between::Cubic
                                                                     : GltfChannel::Between::Linear;
            added.times = numbers(sampler.input, 1, "animation times");
            added.values = numbers(sampler.output, rotates ? 4 : 3, "animation values");
            const size_t each =
                (rotates ? 4u : 3u) * (added.between == GltfChannel::Between::Cubic ? 3u : 1u);
            if (added.values.size() != added.times.size() * each)
                fail("animation values: expected {} for {} keys, found {}",
                     added.times.size() * each, added.times.size(), added.values.size());
            for (size_t k = 1; k < added.times.size(); ++k)
                if (!(added.times[k] > added.times[k - 1]))
                    fail("animation times: expected rising ones, found {} after {}", added.times[k],
                         added.times[k - 1]);
            clip.channels.push_back(std::move(added));
        }
        if (!clip.channels.empty()) result.clips.push_back(std::move(clip));
    }

    void readHumanoid(GltfNodes& result) const {
        const auto add = [&](const std::string& bone, const tinygltf::Value& value) {
            if (!value.IsInt()) return;
            const int node = value.Get<int>();
            if (node < 0 || static_cast<size_t>(node) >= place_.size())
                fail("humanBones: {}: expected a node of the file, found {}", printable(bone),
                     node);
            result.humanoid[bone] = static_cast<size_t>(place_[static_cast<size_t>(node)]);
        };
        const auto bonesOf = [&](const char* extension) -> const tinygltf::Value* {
            const auto found = model_.extensions.find(extension);
            if (found == model_.extensions.end() || !found->second.IsObject() ||
                !found->second.Has("humanoid"))
                return nullptr;
            const tinygltf::Value& humanoid = found->second.Get("humanoid");
            if (!humanoid.IsObject() || !humanoid.Has("humanBones")) return nullptr;
            return &humanoid.Get("humanBones");
        };
        for (const char* extension : {"VRMC_vrm", "VRMC_vrm_animation"}) {
            const tinygltf::Value* bones = bonesOf(extension);
            if (bones == nullptr || !bones->IsObject()) continue;
            for (const std::string& bone : bones->Keys())
                if (bones->Get(bone).IsObject() && bones->Get(bone).Has("node"))
                    add(bone, bones->Get(bone).Get("node"));
        }
        const tinygltf::Value* old = bonesOf("VRM");
        for (size_t i = 0; old != nullptr && old->IsArray() && i < old->ArrayLen(); ++i) {
            const tinygltf::Value& entry = old->Get(static_cast<int>(i));
            if (entry.IsObject() && entry.Has("bone") && entry.Has("node") &&
                entry.Get("bone").IsString())
                add(entry.Get("bone").Get<std::string>(), entry.Get("node"));
        }
    }

    void readSkin(GltfNodes& result) const {
        if (model_.skins.empty() || model_.skins[0].inverseBindMatrices < 0) return;
        const tinygltf::Skin& skin = model_.skins[0];
        const auto matrices = numbers(skin.inverseBindMatrices, 16, "inverseBindMatrices");
        if (matrices.size() < 16 * skin.joints.size())
            fail("inverseBindMatrices: expected {}, found {}", skin.joints.size(),
                 matrices.size() / 16);
        for (size_t j = 0; j < skin.joints.size(); ++j) {
            if (skin.joints[j] < 0 || static_cast<size_t>(skin.joints[j]) >= place_.size())
                fail("skins: expected joints of the file, found node {}", skin.joints[j]);
            result.joints.push_back(
                static_cast<size_t>(place_[static_cast<size_t>(skin.joints[j])]));
            result.inverseBind.emplace_back();
            std::copy_n(&matrices[16 * j], 16, result.inverseBind.back().begin());
        }
    }

    std::string file_;
    tinygltf::Model model_;
    std::vector<int> place_;  // of the file's nodes among ours
};

}  // namespace

std::array<double, 4> GltfChannel::at(double time) const {
    const size_t width = path == Path::Rotation ? 4 : 3, keys = times.size();
    const size_t each = between == Between::Cubic ? 3 * width : width;
    const size_t value = between == Between::Cubic ? width : 0;  // behind the first tangent
    // Times of frames are rounded: one that is on a step is behind it.
    const double reached = between == Between::Step ? time + 1e-4 : time;
    const auto after =
        static_cast<size_t>(std::upper_bound(times.begin(), times.end(), reached) - times.begin());
    std::array<double, 4> result{};
    const auto take = [&](size_t key) {
        for (size_t c = 0; c < width; ++c) result[c] = values[key * each + value + c];
    };
    if (after == 0) {
        take(0);
    } else if (after == keys || between == Between::Step) {
        take(after - 1);
    } else {
        const double span = times[after] - times[after - 1], t = (time - times[after - 1]) / span;
        const double* a = &values[(after - 1) * each];
        const double* b = &values[after * each];
        if (between == Between::Cubic) {
            const double t2 = t * t, t3 = t2 * t;
            for (size_t c = 0; c < width; ++c)
                result[c] = (2 * t3 - 3 * t2 + 1) * a[width + c] +
                            span * (t3 - 2 * t2 + t) * a[2 * width + c] +
                            (3 * t2 - 2 * t3) * b[width + c] + span * (t3 - t2) * b[c];
        } else {
            double dot = 0;
            for (size_t c = 0; c < width; ++c) dot += a[c] * b[c];
            // The short way between rotations. Keys lie close together: along the chord, made a
            // rotation again below, is along the arc within a thousandth of the angle.
            const double side = width == 4 && dot < 0 ? -1 : 1;
            double from = 1 - t, to = t;
            if (width == 4 && std::abs(dot) < .9995) {
                const double angle = std::acos(std::abs(dot));
                from = std::sin((1 - t) * angle) / std::sin(angle);
                to = std::sin(t * angle) / std::sin(angle);
            }
            for (size_t c = 0; c < width; ++c) result[c] = from * a[c] + side * to * b[c];
        }
    }
    if (width == 4) {
        double length = 0;
        for (const double x : result) length += x * x;
        if (!(length > 1e-12)) return {0, 0, 0, 1};
        for (double& x : result) x /= std::sqrt(length);
    }
    return result;
}

GltfNodes readGltfNodes(const fs::path& path) { return Reader(path).read(); }

}  // namespace doppel
