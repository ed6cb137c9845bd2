// What stands in a pickle, as the machine leaves it and values look at it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/io/pickle.h"

namespace doppel::pickle {

constexpr size_t kMaxNodes = 4'000'000;
constexpr int kMaxDepth = 32;  // NumPy's limit of dimensions

// The names that a pickle may use, and what they mean here.
enum class Name : uint8_t {
    reconstruct,
    scalar,
    fromBuffer,
    ndarray,
    dtype,
    encode,
    reconstructor,
    baseObject,
    orderedDict,
    defaultDict,
    setType,
    bytesType,
    plainType,  // list, dict, int, …: only named, as a defaultdict's factory
    chumpy,
    chumpySelect,
    csc,
    csr,
    coo,
    joblibArray,
    torchStorage,
    torchTensor,
    torchParameter,
};

// What a name ("numpy.ndarray") means; nothing where it stands for code. torch: in a PyTorch file,
// where tensors may be named as well.
std::optional<Name> knownName(std::string_view name, bool torch);

bool makesObjects(Name name);

// What an object-kind node is.
enum class Role : uint8_t { value, name, dtype, instance, emptyArray, torchStorage, torchTensor };

struct Node {
    PickleValue::Kind kind = PickleValue::Kind::none;
    Role role = Role::value;
    Name name{};  // role name and instance: which
    union {
        int64_t integer = 0;
        double real;
    };
    std::string text;  // text, bytes; dtype: NumPy's type string; an odd value's repr
    // list, tuple, set; dict: key, value, …; instance: its state; torchStorage: type, key, size;
    // torchTensor: storage, offset, shape, strides
    std::vector<uint32_t> items;
    std::unique_ptr<Array> array;
};

// For errors.
const char* kindName(const Node& node);

}  // namespace doppel::pickle

namespace doppel {

struct PickleGraph {
    std::vector<pickle::Node> nodes;
};

}  // namespace doppel
