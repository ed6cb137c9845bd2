#include "engine/io/weights.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <optional>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/numbers.h"
#include "engine/files/printable.h"
#include "engine/files/zip.h"
#include "engine/io/pickle.h"

namespace doppel {

namespace {

constexpr uint64_t kMaxFile = uint64_t{8} << 30;
constexpr ZipKind kTorchZip{"a", "PyTorch", "entries"};

// The sizes of elements, and whether they are read.
struct StorageType {
    const char* name;
    size_t size;
    const char* dtype;  // as NumPy says it; bf16; null: integers, left out
};

constexpr StorageType kStorageTypes[] = {
    {"FloatStorage", 4, "<f4"},     {"DoubleStorage", 8, "<f8"}, {"HalfStorage", 2, "<f2"},
    {"BFloat16Storage", 2, "bf16"}, {"LongStorage", 8, nullptr}, {"IntStorage", 4, nullptr},
    {"ShortStorage", 2, nullptr},   {"CharStorage", 1, nullptr}, {"ByteStorage", 1, nullptr},
    {"BoolStorage", 1, nullptr},
};

const StorageType& typeOf(const TorchTensor& tensor, const std::string& where) {
    for (const StorageType& type : kStorageTypes) {
        if (tensor.type == type.name) return type;
    }
    throwInput("{}: a tensor of type {}; expected float32, float16, bfloat16 or float64", where,
               tensor.type);
}

std::vector<float> toFloats(const StorageType& type, std::span<const uint8_t> bytes,
                            const std::string& where) {
    const size_t count = bytes.size() / type.size;
    if (std::strcmp(type.dtype, "bf16") == 0) {
        std::vector<float> values(count);
        for (size_t i = 0; i < count; ++i) {
            uint16_t half;
            std::memcpy(&half, &bytes[2 * i], 2);
            values[i] = bfloat16ToFloat(half);
        }
        return values;
    }
    return arrayFromRaw(type.dtype, {static_cast<int64_t>(count)}, false, bytes, where).toF32();
}

// The storages of one file, each converted once.
class Storages {
public:
    using Fetch = std::function<std::vector<uint8_t>(const std::string& key, uint64_t bytes,
                                                     const std::string& where)>;

    // fileSize: tensors may be a few times larger (halves that become floats), but not more.
    Storages(Fetch fetch, uint64_t fileSize)
        : fetch_(std::move(fetch)), budget_(4 * fileSize + (uint64_t{1} << 16)) {}

    Tensor32 view(const TorchTensor& tensor, const StorageType& type, const std::string& where) {
        if (tensor.shape.size() != tensor.strides.size() || tensor.shape.size() > 16) {
            throwInput("{}: {} sizes with {} strides", where, tensor.shape.size(),
                       tensor.strides.size());
        }
        int64_t count = 1, last = tensor.offset;
        bool impossible = tensor.offset < 0 || tensor.storageSize < 0;
        for (size_t d = 0; d < tensor.shape.size(); ++d) {
            const int64_t size = tensor.shape[d], stride = tensor.strides[d];
            int64_t reach = 0;
            impossible = impossible || size < 0 || stride < 0 ||
                         __builtin_mul_overflow(count, size, &count) ||
                         __builtin_mul_overflow(std::max<int64_t>(size - 1, 0), stride, &reach) ||
                         __builtin_add_overflow(last, reach, &last);
        }
        if (impossible) throwInput("{}: a tensor of impossible shape", where);
        if (count > 0 && last >= tensor.storageSize) {
            throwInput("{}: its elements reach to {} of a storage of {}", where, last,
                       tensor.storageSize);
        }
        const uint64_t bytes = static_cast<uint64_t>(count) * sizeof(float);
        if (static_cast<uint64_t>(count) > budget_ || bytes > budget_) {
            throwInput("{}: its tensors are far larger than the file", where);
        }
        budget_ -= bytes;
        Tensor32 result{tensor.shape, std::vector<float>(static_cast<size_t>(count))};
        if (count == 0) return result;
        const std::vector<float>& values = load(tensor, type, where);
        std::vector<int64_t> index(tensor.shape.size(), 0);
        int64_t from = tensor.offset;
        for (float& value : result.values) {
            value = values[static_cast<size_t>(from)];
            for (size_t d = index.size(); d-- > 0;) {
                from += tensor.strides[d];
                if (++index[d] < tensor.shape[d]) break;
                from -= tensor.strides[d] * tensor.shape[d];
                index[d] = 0;
            }
        }
        return result;
    }

private:
    const std::vector<float>& load(const TorchTensor& tensor, const StorageType& type,
                                   const std::string& where) {
        const auto found = loaded_.find(tensor.storage);
        if (found != loaded_.end()) {
            if (found->second.type != &type ||
                found->second.values.size() != static_cast<size_t>(tensor.storageSize)) {
                throwInput("{}: a storage that tensors disagree about", where);
            }
            return found->second.values;
        }
        if (static_cast<uint64_t>(tensor.storageSize) > kMaxFile / type.size) {
            throwInput("{}: a storage of {} elements", where, tensor.storageSize);
        }
        const std::vector<uint8_t> bytes =
            fetch_(tensor.storage, static_cast<uint64_t>(tensor.storageSize) * type.size, where);
        return loaded_.emplace(tensor.storage, Loaded{&type, toFloats(type, bytes, where)})
            .first->second.values;
    }

    struct Loaded {
        const StorageType* type;
        std::vector<float> values;
    };
    Fetch fetch_;
    uint64_t budget_;
    std::map<std::string, Loaded> loaded_;
};

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

Safetensors collect(const PickleValue& root, Storages& storages, const std::string& file) {
    Safetensors result;
    result.file = file;
    const PickleValue dict = stateDict(root);
    for (const std::string& key : dict.keys()) {
        const std::string where = fmt::format("{}: {}", file, printable(key));
        const std::optional<TorchTensor> tensor = dict.at(key).asTorchTensor();
        if (!tensor) continue;
        const StorageType& type = typeOf(*tensor, where);
        if (type.dtype == nullptr) continue;
        result.tensors.emplace(key, storages.view(*tensor, type, where));
    }
    if (result.tensors.empty()) {
        throwInput("{}: expected a state_dict (tensors by name), found none", file);
    }
    return result;
}

Safetensors fromZip(std::span<const uint8_t> file, const std::string& name) {
    std::map<std::string, ZipEntry> entries;
    std::string prefix;
    bool found = false;
    for (ZipEntry& entry : zipEntries(file, kTorchZip, name, {.maxEntries = 65536})) {
        if (entry.name == "data.pkl" || entry.name.ends_with("/data.pkl")) {
            prefix = entry.name.substr(0, entry.name.size() - 8);
            found = true;
        }
        entries.emplace(entry.name, entry);
    }
    if (!found) {
        throwInput("{}: expected a PyTorch file, found a zip archive without data.pkl", name);
    }
    if (entries.contains(prefix + "constants.pkl")) {
        throwInput(
            "{}: expected a state_dict, found TorchScript, which is code; save the model's "
            "state_dict() instead",
            name);
    }
    if (const auto order = entries.find(prefix + "byteorder"); order != entries.end()) {
        const std::vector<uint8_t> bytes = unpackZip(file, order->second, name);
        if (std::string(bytes.begin(), bytes.end()) != "little") {
            throwInput("{}: expected numbers in the byte order \"little\", found another", name);
        }
    }
    const std::vector<uint8_t> pickle =
        unpackZip(file, entries.at(prefix + "data.pkl"), name + ": data.pkl");
    size_t consumed = 0;
    const PickleValue root = torchPickleFromBytes(pickle, name, consumed);
    Storages storages(
        [&](const std::string& key, uint64_t bytes, const std::string& where) {
            const auto entry = entries.find(prefix + "data/" + key);
            if (entry == entries.end()) {
                throwInput("{}: its storage {} is missing in the file", where, printable(key));
            }
            if (entry->second.size != bytes) {
                throwInput("{}: expected {} bytes in its storage, found {}", where, bytes,
                           entry->second.size);
            }
            return unpackZip(file, entry->second, where);
        },
        file.size());
    return collect(root, storages, name);
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
        sizes[tensor->storage] = {typeOf(*tensor, name).size, tensor->storageSize};
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
    Storages storages(
        [&](const std::string& key, uint64_t bytes, const std::string& where) {
            const auto found = data.find(key);
            if (found == data.end() || found->second.size() != bytes) {
                throwInput("{}: its storage {} is missing in the file", where, printable(key));
            }
            return std::vector<uint8_t>(found->second.begin(), found->second.end());
        },
        file.size());
    return collect(root, storages, name);
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
