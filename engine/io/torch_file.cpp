#include "engine/io/torch_file.h"

#include <algorithm>
#include <cstring>

#include "engine/error.h"
#include "engine/files/numbers.h"
#include "engine/files/printable.h"
#include "engine/files/zip.h"

namespace doppel {

namespace {

constexpr uint64_t kMostStorage = uint64_t{8} << 30;
constexpr ZipKind kTorchZip{"a", "PyTorch", "entries"};

constexpr TorchStorageType kStorageTypes[] = {
    {"FloatStorage", 4, "<f4"},     {"DoubleStorage", 8, "<f8"}, {"HalfStorage", 2, "<f2"},
    {"BFloat16Storage", 2, "bf16"}, {"LongStorage", 8, nullptr}, {"IntStorage", 4, nullptr},
    {"ShortStorage", 2, nullptr},   {"CharStorage", 1, nullptr}, {"ByteStorage", 1, nullptr},
    {"BoolStorage", 1, nullptr},
};

std::vector<float> toFloats(const TorchStorageType& type, std::span<const uint8_t> bytes,
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

}  // namespace

const TorchStorageType& torchStorageType(const TorchTensor& tensor, const std::string& where) {
    for (const TorchStorageType& type : kStorageTypes) {
        if (tensor.type == type.name) return type;
    }
    throwInput("{}: a tensor of type {}; expected float32, float16, bfloat16 or float64", where,
               tensor.type);
}

TorchStorages::TorchStorages(Fetch fetch, uint64_t fileSize)
    : fetch_(std::move(fetch)), budget_(4 * fileSize + (uint64_t{1} << 16)) {}

Tensor32 TorchStorages::view(const TorchTensor& tensor, const TorchStorageType& type,
                             const std::string& where) {
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

const std::vector<float>& TorchStorages::load(const TorchTensor& tensor,
                                              const TorchStorageType& type,
                                              const std::string& where) {
    const auto found = loaded_.find(tensor.storage);
    if (found != loaded_.end()) {
        if (found->second.type != &type ||
            found->second.values.size() != static_cast<size_t>(tensor.storageSize)) {
            throwInput("{}: a storage that tensors disagree about", where);
        }
        return found->second.values;
    }
    if (static_cast<uint64_t>(tensor.storageSize) > kMostStorage / type.size) {
        throwInput("{}: a storage of {} elements", where, tensor.storageSize);
    }
    const std::vector<uint8_t> bytes =
        fetch_(tensor.storage, static_cast<uint64_t>(tensor.storageSize) * type.size, where);
    return loaded_.emplace(tensor.storage, Loaded{&type, toFloats(type, bytes, where)})
        .first->second.values;
}

struct TorchFile::Archive {
    std::span<const uint8_t> file;
    std::string name;
    std::map<std::string, ZipEntry> entries;
    std::string prefix;  // of all entries: torch.save puts them into a folder
};

TorchFile::~TorchFile() = default;

TorchFile::TorchFile(std::span<const uint8_t> file, const std::string& name)
    : archive_(std::make_unique<Archive>()) {
    Archive& archive = *archive_;
    archive.file = file;
    archive.name = name;
    bool found = false;
    for (ZipEntry& entry : zipEntries(file, kTorchZip, name, {.maxEntries = 65536})) {
        if (entry.name == "data.pkl" || entry.name.ends_with("/data.pkl")) {
            archive.prefix = entry.name.substr(0, entry.name.size() - 8);
            found = true;
        }
        archive.entries.emplace(entry.name, entry);
    }
    if (!found) {
        throwInput("{}: expected a PyTorch file, found a zip archive without data.pkl", name);
    }
    if (archive.entries.contains(archive.prefix + "constants.pkl")) {
        throwInput(
            "{}: expected a state_dict, found TorchScript, which is code; save the model's "
            "state_dict() instead",
            name);
    }
    if (const auto order = archive.entries.find(archive.prefix + "byteorder");
        order != archive.entries.end()) {
        const std::vector<uint8_t> bytes = unpackZip(file, order->second, name);
        if (std::string(bytes.begin(), bytes.end()) != "little") {
            throwInput("{}: expected numbers in the byte order \"little\", found another", name);
        }
    }
    const std::vector<uint8_t> pickle =
        unpackZip(file, archive.entries.at(archive.prefix + "data.pkl"), name + ": data.pkl");
    size_t consumed = 0;
    root_ = torchPickleFromBytes(pickle, name, consumed);
    storages_.emplace(
        [this](const std::string& key, uint64_t bytes, const std::string& where) {
            const auto entry = archive_->entries.find(archive_->prefix + "data/" + key);
            if (entry == archive_->entries.end()) {
                throwInput("{}: its storage {} is missing in the file", where, printable(key));
            }
            if (entry->second.size != bytes) {
                throwInput("{}: expected {} bytes in its storage, found {}", where, bytes,
                           entry->second.size);
            }
            return unpackZip(archive_->file, entry->second, where);
        },
        file.size());
}

std::optional<Tensor32> TorchFile::tensor(const PickleValue& value) {
    const std::optional<TorchTensor> tensor = value.asTorchTensor();
    if (!tensor) return {};
    const TorchStorageType& type = torchStorageType(*tensor, value.where());
    if (type.dtype == nullptr) return {};
    return storages_->view(*tensor, type, value.where());
}

}  // namespace doppel
