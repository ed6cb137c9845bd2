#include "engine/io/pickle.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/deflate.h"
#include "engine/files/printable.h"
#include "engine/io/pickles/pickle_graph.h"
#include "engine/io/pickles/pickle_machine.h"

namespace doppel {

using Kind = PickleValue::Kind;
using pickle::kindName, pickle::kMaxDepth, pickle::Name, pickle::Node, pickle::Role;

namespace {

constexpr uint64_t kMaxFile = uint64_t{2} << 30;
constexpr uint64_t kMaxElements = uint64_t{1} << 25;  // of lists and sparse matrices made arrays

std::vector<uint8_t> unpacked(std::span<const uint8_t> packed, const std::string& name) {
    std::vector<uint8_t> bytes;
    inflate(packed, Packing::zlib, name, [&](std::span<const uint8_t> more) {
        bytes.insert(bytes.end(), more.begin(), more.end());
        // Poses hardly shrink to a hundredth.
        if (bytes.size() > 100 * packed.size() + (size_t{1} << 26) || bytes.size() > kMaxFile) {
            throwInput("{}: unpacks from {} to more than {} bytes: refused as a zip bomb", name,
                       packed.size(), bytes.size());
        }
    });
    return bytes;
}

[[noreturn]] void unexpected(const std::string& where, const char* expected, const Node& node) {
    throwInput("{}: expected {}, found {}", where, expected,
               node.text.empty() || node.kind != Kind::object ? kindName(node) : node.text);
}

// A dict's key, as text to compare with.
std::string keyText(const Node& node) {
    switch (node.kind) {
        case Kind::text:
        case Kind::bytes:
            return node.text;
        case Kind::integer:
            return std::to_string(node.integer);
        case Kind::boolean:
            return node.integer ? "True" : "False";
        case Kind::array:
            if (node.array->count() == 1 && node.array->isInteger()) {
                return std::to_string(node.array->integer());
            }
            return "an array";
        default:
            return kindName(node);
    }
}

const Node* findIn(const PickleGraph& graph, const Node& dict, std::string_view key) {
    // From the end: a later pair replaces an earlier one.
    for (size_t i = dict.items.size(); i >= 2; i -= 2) {
        if (keyText(graph.nodes[dict.items[i - 2]]) == key) return &graph.nodes[dict.items[i - 1]];
    }
    return nullptr;
}

// A list, or a list of lists …, of numbers as one array.
struct ListReader {
    const PickleGraph& graph;
    const std::string& where;
    std::vector<int64_t> shape;
    std::vector<double> values;
    std::vector<int64_t> integers;
    bool allIntegers = true;

    void read(const Node& node) {
        findShape(node);
        uint64_t count = 1;
        for (const int64_t size : shape) {
            if (__builtin_mul_overflow(count, static_cast<uint64_t>(size), &count) ||
                count > kMaxElements) {
                throwInput("{}: a list of more than {} numbers", where, kMaxElements);
            }
        }
        values.reserve(count);
        integers.reserve(count);
        fill(node, 0);
    }

private:
    // Along the first elements; fill() finds where others differ.
    void findShape(const Node& first) {
        const Node* node = &first;
        while (node->kind == Kind::list || node->kind == Kind::tuple) {
            if (shape.size() == kMaxDepth) {
                throwInput("{}: lists nested more than {} deep", where, kMaxDepth);
            }
            shape.push_back(static_cast<int64_t>(node->items.size()));
            if (node->items.empty()) return;
            node = &graph.nodes[node->items[0]];
        }
        if (node->kind == Kind::array) {
            shape.insert(shape.end(), node->array->shape.begin(), node->array->shape.end());
        }
    }

    void fill(const Node& node, size_t depth) {
        if (node.kind == Kind::list || node.kind == Kind::tuple) {
            if (depth >= shape.size() || static_cast<int64_t>(node.items.size()) != shape[depth]) {
                throwInput("{}: a list whose rows differ in length", where);
            }
            for (const uint32_t item : node.items) fill(graph.nodes[item], depth + 1);
        } else if (node.kind == Kind::array) {
            if (!std::equal(node.array->shape.begin(), node.array->shape.end(),
                            shape.begin() + static_cast<ptrdiff_t>(std::min(depth, shape.size())),
                            shape.end())) {
                throwInput("{}: a list of arrays whose shapes differ", where);
            }
            const std::vector<double> numbers = node.array->toF64(where);
            values.insert(values.end(), numbers.begin(), numbers.end());
            if (node.array->isFloat() || node.array->dtype == DType::u64) {
                allIntegers = false;
            } else if (allIntegers) {
                const std::vector<int64_t> whole = node.array->toI64(where);
                integers.insert(integers.end(), whole.begin(), whole.end());
            }
        } else {
            if (depth != shape.size()) throwInput("{}: a list whose rows differ in length", where);
            if (node.kind == Kind::integer || node.kind == Kind::boolean) {
                values.push_back(static_cast<double>(node.integer));
                integers.push_back(node.integer);
            } else if (node.kind == Kind::real) {
                values.push_back(node.real);
                allIntegers = false;
            } else {
                unexpected(where, "numbers in the list", node);
            }
        }
    }
};

Array toArray(const PickleGraph& graph, const Node& node, const std::string& where, int depth);

// The attribute of an object, as an array.
Array attributeArray(const PickleGraph& graph, const Node& node, const char* name,
                     const std::string& where, int depth) {
    const Node* value =
        node.items.empty() ? nullptr : findIn(graph, graph.nodes[node.items[0]], name);
    if (value == nullptr) {
        throwInput("{}: expected an attribute '{}' in the object, found none", where, name);
    }
    return toArray(graph, *value, fmt::format("{}.{}", where, name), depth);
}

Array sparseToDense(const PickleGraph& graph, const Node& node, const std::string& where,
                    int depth) {
    const Node& state = node.items.empty() ? node : graph.nodes[node.items[0]];
    const bool named = findIn(graph, state, "_shape") != nullptr;
    const std::vector<int64_t> shape =
        attributeArray(graph, node, named ? "_shape" : "shape", where, depth).toI64();
    if (shape.size() != 2 || shape[0] < 0 || shape[1] < 0 ||
        (shape[1] > 0 &&
         static_cast<uint64_t>(shape[0]) > kMaxElements / static_cast<uint64_t>(shape[1]))) {
        throwInput("{}: a sparse matrix of impossible shape", where);
    }
    const std::vector<double> data = attributeArray(graph, node, "data", where, depth).toF64();
    std::vector<double> dense(static_cast<size_t>(shape[0] * shape[1]));
    const auto put = [&](int64_t row, int64_t column, double value) {
        if (row < 0 || row >= shape[0] || column < 0 || column >= shape[1]) {
            throwInput("{}: a sparse matrix with an element at {}, {} outside its shape {} x {}",
                       where, row, column, shape[0], shape[1]);
        }
        dense[static_cast<size_t>(row * shape[1] + column)] += value;  // SciPy sums duplicates
    };
    if (node.name == Name::coo) {
        const std::vector<int64_t> rows = attributeArray(graph, node, "row", where, depth).toI64();
        const std::vector<int64_t> columns =
            attributeArray(graph, node, "col", where, depth).toI64();
        if (rows.size() != data.size() || columns.size() != data.size()) {
            throwInput("{}: a sparse matrix whose parts differ in length", where);
        }
        for (size_t i = 0; i < data.size(); ++i) put(rows[i], columns[i], data[i]);
    } else {
        const bool byColumn = node.name == Name::csc;
        const std::vector<int64_t> indices =
            attributeArray(graph, node, "indices", where, depth).toI64();
        const std::vector<int64_t> starts =
            attributeArray(graph, node, "indptr", where, depth).toI64();
        const int64_t lines = byColumn ? shape[1] : shape[0];
        const int64_t stored = static_cast<int64_t>(std::min(data.size(), indices.size()));
        if (starts.empty() || static_cast<int64_t>(starts.size() - 1) != lines) {
            throwInput("{}: a sparse matrix with {} starts for {} lines; expected one more", where,
                       starts.size(), lines);
        }
        for (int64_t line = 0; line < lines; ++line) {
            const int64_t begin = starts[static_cast<size_t>(line)];
            const int64_t end = starts[static_cast<size_t>(line) + 1];
            if (begin < 0 || end < begin || end > stored) {
                throwInput("{}: a sparse matrix with broken starts", where);
            }
            for (int64_t i = begin; i < end; ++i) {
                const int64_t index = indices[static_cast<size_t>(i)];
                put(byColumn ? index : line, byColumn ? line : index, data[static_cast<size_t>(i)]);
            }
        }
    }
    return Array::f64({shape[0], shape[1]}, dense);
}

// a.ravel()[idxs].reshape(preferred_shape)
Array selected(const PickleGraph& graph, const Node& node, const std::string& where, int depth) {
    const std::vector<double> source = attributeArray(graph, node, "a", where, depth).toF64();
    const Array indexArray = attributeArray(graph, node, "idxs", where, depth);
    const std::vector<int64_t> indices = indexArray.toI64();
    std::vector<double> values;
    values.reserve(indices.size());
    for (const int64_t index : indices) {
        if (index < 0 || index >= static_cast<int64_t>(source.size())) {
            throwInput("{}: selects element {} of {}", where, index, source.size());
        }
        values.push_back(source[static_cast<size_t>(index)]);
    }
    std::vector<int64_t> shape = {static_cast<int64_t>(values.size())};
    const Node& state = graph.nodes[node.items[0]];
    const Node* preferred = findIn(graph, state, "preferred_shape");
    if (preferred != nullptr && preferred->kind != Kind::none) {
        shape = toArray(graph, *preferred, where, depth).toI64();
    }
    uint64_t count = 1;
    for (const int64_t size : shape) {
        if (size < 0 || __builtin_mul_overflow(count, static_cast<uint64_t>(size), &count)) {
            throwInput("{}: an impossible shape", where);
        }
    }
    if (count != values.size()) {
        throwInput("{}: {} selected elements for {} places", where, values.size(), count);
    }
    return Array::f64(std::move(shape), values);
}

Array toArray(const PickleGraph& graph, const Node& node, const std::string& where, int depth) {
    if (depth > kMaxDepth) throwInput("{}: objects nested more than {} deep", where, kMaxDepth);
    Array array;
    switch (node.kind) {
        case Kind::array:
            array = *node.array;
            break;
        case Kind::boolean:
        case Kind::integer:
            array = Array::scalarI64(node.integer);
            break;
        case Kind::real:
            array = Array::scalarF64(node.real);
            break;
        case Kind::text:
        case Kind::bytes:
            array = Array::text(node.text);
            break;
        case Kind::list:
        case Kind::tuple: {
            ListReader reader{graph, where, {}, {}, {}};
            reader.read(node);
            array = reader.allIntegers && !reader.integers.empty()
                        ? Array::i64(std::move(reader.shape), reader.integers)
                        : Array::f64(std::move(reader.shape), reader.values);
            break;
        }
        case Kind::object:
            if (node.role != Role::instance) unexpected(where, "numbers", node);
            if (node.name == Name::chumpy) {
                array = attributeArray(graph, node, "x", where, depth + 1);
            } else if (node.name == Name::chumpySelect) {
                array = selected(graph, node, where, depth + 1);
            } else if (node.name == Name::joblibArray) {
                unexpected(where, "numbers", node);
            } else {
                array = sparseToDense(graph, node, where, depth + 1);
            }
            break;
        case Kind::none:
        case Kind::set:
        case Kind::dict:
            unexpected(where, "numbers", node);
    }
    array.where = where;
    return array;
}

}  // namespace

PickleValue::PickleValue(std::shared_ptr<const PickleGraph> graph, uint32_t node, std::string where)
    : graph_(std::move(graph)), node_(node), where_(std::move(where)) {}

Kind PickleValue::kind() const { return graph_->nodes[node_].kind; }

std::optional<PickleValue> PickleValue::find(std::string_view key) const {
    const Node& node = graph_->nodes[node_];
    if (node.kind != Kind::dict) unexpected(where_, "a dict", node);
    const Node* value = findIn(*graph_, node, key);
    if (value == nullptr) return std::nullopt;
    return PickleValue(graph_, static_cast<uint32_t>(value - graph_->nodes.data()),
                       fmt::format("{}: {}", where_, printable(key)));
}

PickleValue PickleValue::at(std::string_view key) const {
    if (std::optional<PickleValue> value = find(key)) return *value;
    std::string present;
    const std::vector<std::string> all = keys();
    for (size_t i = 0; i < all.size() && i < 20; ++i) {
        if (i > 0) present += ", ";
        present += printable(all[i], 40);
    }
    if (all.size() > 20) present += ", …";
    throwInput("{}: expected '{}' in the dict, found {}", where_, key,
               present.empty() ? "nothing" : present);
}

std::vector<std::string> PickleValue::keys() const {
    std::vector<std::string> keys;
    eachPair([&](const std::string& key, const PickleValue&) { keys.push_back(key); });
    return keys;
}

void PickleValue::eachPair(
    const std::function<void(const std::string& key, const PickleValue& value)>& call) const {
    const Node& node = graph_->nodes[node_];
    if (node.kind != Kind::dict) unexpected(where_, "a dict", node);
    // A later pair replaces the value of an earlier one, in its place.
    std::vector<std::pair<std::string, uint32_t>> pairs;
    std::unordered_map<std::string, size_t> places;
    for (size_t i = 0; i + 1 < node.items.size(); i += 2) {
        std::string key = keyText(graph_->nodes[node.items[i]]);
        const auto [place, fresh] = places.emplace(key, pairs.size());
        if (fresh)
            pairs.emplace_back(std::move(key), node.items[i + 1]);
        else
            pairs[place->second].second = node.items[i + 1];
    }
    for (const auto& [key, value] : pairs)
        call(key, PickleValue(graph_, value, fmt::format("{}: {}", where_, printable(key))));
}

size_t PickleValue::size() const {
    const Node& node = graph_->nodes[node_];
    switch (node.kind) {
        case Kind::list:
        case Kind::tuple:
        case Kind::set:
            return node.items.size();
        case Kind::dict:
            return keys().size();
        default:
            unexpected(where_, "a list", node);
    }
}

PickleValue PickleValue::item(size_t index) const {
    const Node& node = graph_->nodes[node_];
    if (node.kind != Kind::list && node.kind != Kind::tuple && node.kind != Kind::set) {
        unexpected(where_, "a list", node);
    }
    if (index >= node.items.size()) {
        throwInput("{}: expected an element {}, found {} elements", where_, index,
                   node.items.size());
    }
    return PickleValue(graph_, node.items[index], fmt::format("{}[{}]", where_, index));
}

Array PickleValue::asArray() const { return toArray(*graph_, graph_->nodes[node_], where_, 0); }

double PickleValue::asNumber() const { return asArray().scalar(); }

int64_t PickleValue::asInteger() const { return asArray().integer(); }

std::string PickleValue::asText() const {
    const Node& node = graph_->nodes[node_];
    if (node.kind == Kind::text || node.kind == Kind::bytes) return node.text;
    if (node.kind == Kind::array) return node.array->toText(where_);
    unexpected(where_, "text", node);
}

std::optional<TorchTensor> PickleValue::asTorchTensor() const {
    const Node& node = graph_->nodes[node_];
    if (node.role != Role::torchTensor) return std::nullopt;
    const Node& storage = graph_->nodes[node.items[0]];
    const auto integers = [&](uint32_t index, const char* what) {
        const Node& list = graph_->nodes[index];
        std::vector<int64_t> values;
        if (list.kind != Kind::tuple && list.kind != Kind::list) {
            throwInput("{}: a tensor whose {} is {}", where_, what, kindName(list));
        }
        for (const uint32_t item : list.items) {
            const Node& value = graph_->nodes[item];
            if (value.kind != Kind::integer) {
                throwInput("{}: a tensor whose {} holds {}", where_, what, kindName(value));
            }
            values.push_back(value.integer);
        }
        return values;
    };
    const Node& offset = graph_->nodes[node.items[1]];
    if (offset.kind != Kind::integer) {
        throwInput("{}: a tensor whose offset is {}", where_, kindName(offset));
    }
    return TorchTensor{.storage = graph_->nodes[storage.items[1]].text,
                       .type = graph_->nodes[storage.items[0]].text.substr(6),  // "torch."
                       .storageSize = graph_->nodes[storage.items[2]].integer,
                       .offset = offset.integer,
                       .shape = integers(node.items[2], "shape"),
                       .strides = integers(node.items[3], "strides")};
}

PickleValue torchPickleFromBytes(std::span<const uint8_t> bytes, const std::string& name,
                                 size_t& consumed) {
    const auto graph = std::make_shared<PickleGraph>();
    const uint32_t root = pickle::run(bytes, name, *graph, true, consumed);
    return PickleValue(graph, root, name);
}

PickleValue pickleFromBytes(std::span<const uint8_t> bytes, const std::string& name) {
    const auto graph = std::make_shared<PickleGraph>();
    std::vector<uint8_t> inflated;
    // A zlib stream: no pickle starts with an 'x' opcode.
    if (bytes.size() >= 2 && bytes[0] == 0x78 && (bytes[0] * 256 + bytes[1]) % 31 == 0) {
        inflated = unpacked(bytes, name);
        bytes = inflated;
    }
    size_t consumed = 0;
    const uint32_t root = pickle::run(bytes, name, *graph, false, consumed);
    return PickleValue(graph, root, name);
}

PickleValue readPickle(const std::filesystem::path& path) {
    return pickleFromBytes(readWholeFile(path, kMaxFile), path.string());
}

}  // namespace doppel
