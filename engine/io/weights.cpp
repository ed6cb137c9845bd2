#include "engine/io/weights.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <optional>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/printable.h"
#include "engine/io/torch_file.h"

namespace doppel {

namespace {

constexpr uint64_t kMaxFile = uint64_t{8} << 30;

// The dict of tensors in what torch.save was given.
PickleValue stateDict(const PickleValue& root) {
    if (root.kind() != PickleValue::Kind::dict) {
        throwInput("{}: expected a state_dict (tensors by name), found something else",
                   root.where());
    }
    for (const char* name : {"state_dict", "model_state_dict", "model", "net"}) {
        const std::optional<PickleValue> inner = root.find(name);
        if (inner && inner->kind() == PickleValue::Kind::dict) return *inner;
    }
    return root;
}

// tensorOf: a tensor's numbers; nothing where it holds integers.
template <typename TensorOf>
Safetensors collect(const PickleValue& root, const std::string& file, TensorOf tensorOf) {
    Safetensors result;
    result.file = file;
    const PickleValue dict = stateDict(root);
    for (const std::string& key : dict.keys()) {
        const PickleValue value = dict.at(key);
        if (!value.asTorchTensor()) continue;
        if (auto tensor = tensorOf(value)) result.tensors.emplace(key, std::move(*tensor));
    }
    if (result.tensors.empty()) {
        throwInput("{}: expected a state_dict (tensors by name), found none", file);
    }
    return result;
}

Safetensors fromZip(std::span<const uint8_t> bytes, const std::string& name) {
    TorchFile file(bytes, name);
    return collect(file.root(), name, [&](const PickleValue& value) { return file.tensor(value); });
}

// Before PyTorch 1.6: pickles of a magic number, a version, facts about the machine, the object and
// the storages' keys; then per storage its number of elements (8 bytes) and its bytes.
Safetensors fromStream(std::span<const uint8_t> file, const std::string& name) {
    size_t at = 0;
    const auto next = [&] {
        size_t consumed = 0;
        PickleValue value = torchPickleFromBytes(file.subspan(at), name, consumed);
        at += consumed;
        return value;
    };
    next();  // the magic number has been looked at already
    next();
    const PickleValue facts = next();
    if (facts.kind() == PickleValue::Kind::dict) {
        const std::optional<PickleValue> little = facts.find("little_endian");
        if (little && little->kind() == PickleValue::Kind::boolean && little->asInteger() == 0) {
            throwInput("{}: expected numbers in the byte order \"little\", found another", name);
        }
    }
    const PickleValue root = next();
    const PickleValue keys = next();
    // Where each storage begins follows from the sizes of those before it, which tensors know.
    std::map<std::string, std::pair<uint64_t, int64_t>> sizes;  // bytes per element, elements
    const PickleValue dict = stateDict(root);
    for (const std::string& key : dict.keys()) {
        const std::optional<TorchTensor> tensor = dict.at(key).asTorchTensor();
        if (!tensor) continue;
        sizes[tensor->storage] = {torchStorageType(*tensor, name).size, tensor->storageSize};
    }
    std::map<std::string, std::span<const uint8_t>> data;
    for (size_t i = 0; i < keys.size(); ++i) {
        const std::string key = keys.item(i).asText();
        const auto size = sizes.find(key);
        if (size == sizes.end()) {
            throwInput("{}: holds a storage that no tensor of its state_dict uses", name);
        }
        int64_t count = 0;
        if (file.size() - at < 8) throwInput("{}: cut short at a storage", name);
        std::memcpy(&count, &file[at], 8);
        at += 8;
        if (count != size->second.second || count < 0 ||
            static_cast<uint64_t>(count) > (file.size() - at) / size->second.first) {
            throwInput("{}: cut short: a storage of {} elements, {} bytes left", name, count,
                       file.size() - at);
        }
        const uint64_t bytes = static_cast<uint64_t>(count) * size->second.first;
        data[key] = file.subspan(at, static_cast<size_t>(bytes));
        at += static_cast<size_t>(bytes);
    }
    TorchStorages storages(
        [&](const std::string& key, uint64_t bytes, const std::string& where) {
            const auto found = data.find(key);
            if (found == data.end() || found->second.size() != bytes) {
                throwInput("{}: its storage {} is missing in the file", where, printable(key));
            }
            return std::vector<uint8_t>(found->second.begin(), found->second.end());
        },
        file.size());
    return collect(root, name, [&](const PickleValue& value) -> std::optional<Tensor32> {
        const TorchStorageType& type = torchStorageType(*value.asTorchTensor(), value.where());
        if (type.dtype == nullptr) return {};
        return storages.view(*value.asTorchTensor(), type, value.where());
    });
}

}  // namespace

Safetensors weightsFromBytes(std::span<const uint8_t> file, const std::string& name) {
    constexpr uint8_t kZip[] = {'P', 'K', 3, 4};
    // PROTO 2, LONG1 of ten bytes: the magic number.
    constexpr uint8_t kStream[] = {0x80, 2,    0x8a, 10,   0x6c, 0xfc, 0x9c,
                                   0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19};
    const auto starts = [&](std::span<const uint8_t> magic) {
        return file.size() >= magic.size() && std::equal(magic.begin(), magic.end(), file.begin());
    };
    if (starts(kZip)) return fromZip(file, name);
    if (starts(kStream)) return fromStream(file, name);
    const bool header = file.size() >= 9 && file[8] == '{';
    if (!header) {
        throwInput("{}: expected a safetensors file or what torch.save writes, found other content",
                   name);
    }
    return safetensorsFromBytes(file, name, OtherTypes::skip);
}

Safetensors readWeights(const std::filesystem::path& path) {
    return weightsFromBytes(readWholeFile(path, kMaxFile), path.string());
}

}  // namespace doppel
