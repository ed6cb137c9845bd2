// What torch.save writes since PyTorch 1.6, a zip archive of a pickle and of its tensors' storages,
// read as data (see pickle.h); nothing in it is ever run.
//
//     const std::vector<uint8_t> bytes = readWholeFile("hmr4d_results.pt");
//     TorchFile file(bytes, "hmr4d_results.pt");
//     const auto transl = file.tensor(file.root().at("smpl_params_incam").at("transl"));
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/io/pickle.h"
#include "engine/io/safetensors.h"

namespace doppel {

// The sizes of a storage's elements, and whether they are read.
struct TorchStorageType {
    const char* name;
    size_t size;        // bytes
    const char* dtype;  // as NumPy says it; bf16; null: integers, which are left out
};

// InputError for a type that is none; where: file and tensor.
const TorchStorageType& torchStorageType(const TorchTensor& tensor, const std::string& where);

// The storages of one file, each converted once.
class TorchStorages {
public:
    // The bytes of a storage, whose number the tensor knows.
    using Fetch = std::function<std::vector<uint8_t>(const std::string& key, uint64_t bytes,
                                                     const std::string& where)>;

    // fileSize: tensors may be a few times larger (halves that become floats), but not more.
    TorchStorages(Fetch fetch, uint64_t fileSize);

    // The tensor's elements in C order; of a type that has a dtype. InputError where it reaches
    // beyond its storage.
    Tensor32 view(const TorchTensor& tensor, const TorchStorageType& type,
                  const std::string& where);

private:
    struct Loaded {
        const TorchStorageType* type;
        std::vector<float> values;
    };
    const std::vector<float>& load(const TorchTensor& tensor, const TorchStorageType& type,
                                   const std::string& where);

    Fetch fetch_;
    uint64_t budget_;
    std::map<std::string, Loaded> loaded_;
};

class TorchFile {
public:
    // file: a zip archive, which outlives this. InputErrors name the file: no data.pkl in it,
    // TorchScript, which is code, another byte order.
    TorchFile(std::span<const uint8_t> file, const std::string& name);
    ~TorchFile();

    // What torch.save was given.
    const PickleValue& root() const { return *root_; }

    // A tensor in it, float32, float16, bfloat16 and float64 alike; nothing where the value is
    // something else or holds integers.
    std::optional<Tensor32> tensor(const PickleValue& value);

private:
    struct Archive;
    std::unique_ptr<Archive> archive_;
    std::optional<PickleValue> root_;
    std::optional<TorchStorages> storages_;
};

}  // namespace doppel
