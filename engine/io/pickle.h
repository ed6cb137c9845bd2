// Python pickles read as data. Nothing in a pickle is ever run: a small machine follows the opcodes
// of protocols 0 to 5 and knows what a few names mean (NumPy's arrays, scalars and types, SciPy's
// sparse matrices, chumpy's arrays as in the official SMPL files, joblib's arrays, plain
// containers; in a PyTorch file, see weights.h, its tensors). Any other name in the file is an
// InputError: "refers to code (os.system)".
//
//     const PickleValue frame = readPickle("0001_body.pkl");
//     std::vector<float> pose = frame.at("pose").asArray().requireShape({72}).toF32();
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/files/npz.h"

namespace doppel {

struct PickleGraph;  // everything in one file; values keep it alive

// A PyTorch tensor: a view of a storage, whose bytes lie outside the pickle. Unchecked numbers.
struct TorchTensor {
    std::string storage;      // its key
    std::string type;         // of the storage: "FloatStorage"
    int64_t storageSize = 0;  // elements
    int64_t offset = 0;       // elements
    std::vector<int64_t> shape, strides;
};

// A value in the file, cheap to copy. Accessors that do not fit the value are InputErrors which say
// file, path, what was expected and what stands there.
class PickleValue {
public:
    enum class Kind : uint8_t {
        none,
        boolean,
        integer,
        real,
        text,
        bytes,  // Python 2's str as well
        list,
        tuple,
        set,
        dict,
        array,   // a NumPy array or scalar
        object,  // a sparse matrix, a chumpy array, a PyTorch tensor, or a type
    };

    PickleValue(std::shared_ptr<const PickleGraph> graph, uint32_t node, std::string where);

    Kind kind() const;
    const std::string& where() const { return where_; }  // "0001_body.pkl: pose"

    // Dicts. Keys are compared as text: Python 2's and 3's strings alike, numbers by their digits.
    PickleValue at(std::string_view key) const;  // the error lists the keys that are there
    std::optional<PickleValue> find(std::string_view key) const;
    bool has(std::string_view key) const { return find(key).has_value(); }
    std::vector<std::string> keys() const;  // in the file's order
    // All pairs in that order; at() for each key would look through all of them again.
    void eachPair(
        const std::function<void(const std::string& key, const PickleValue& value)>& call) const;

    // Lists, tuples, sets.
    size_t size() const;  // of a dict: how many pairs
    PickleValue item(size_t index) const;

    // Numbers become 0-d arrays, nested lists of numbers arrays, sparse matrices dense ones;
    // chumpy's arrays give the numbers in them. Text becomes a text array.
    Array asArray() const;
    double asNumber() const;    // one number of any kind, arrays of one element included
    int64_t asInteger() const;  // a whole one
    std::string asText() const;

    // Nothing where the value is something else.
    std::optional<TorchTensor> asTorchTensor() const;

private:
    std::shared_ptr<const PickleGraph> graph_;
    uint32_t node_;
    std::string where_;
};

// Also behind zlib, as joblib.dump(…, compress=…) writes it. A pickle that is cut short, malformed,
// too large (2 GiB, 4 million values) or that names code is an InputError.
PickleValue readPickle(const std::filesystem::path& path);
PickleValue pickleFromBytes(std::span<const uint8_t> bytes, const std::string& name);
// A pickle inside a PyTorch file, where tensors may stand. consumed: its bytes, others may follow.
PickleValue torchPickleFromBytes(std::span<const uint8_t> bytes, const std::string& name,
                                 size_t& consumed);

}  // namespace doppel
