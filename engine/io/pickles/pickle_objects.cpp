#include "engine/io/pickles/pickle_objects.h"

namespace doppel::pickle {

namespace {

std::span<const uint8_t> asBytes(std::string_view text) {
    return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}

}  // namespace

void Objects::pushName(std::string_view module, std::string_view name) {
    const std::string full = fmt::format("{}.{}", module, name);
    if (const std::optional<Name> known = knownName(full, torch_)) {
        const uint32_t node = add(Kind::object, Role::name);
        nodes_[node].name = *known;
        nodes_[node].text = full;
        push(node);
        return;
    }
    throwInput("{}: refers to code ({}); only numeric data is read", file_, printable(full));
}

std::string_view Objects::textOf(uint32_t node) const {
    const Node& value = nodes_[node];
    if (value.kind != Kind::text && value.kind != Kind::bytes) {
        bad("expected text, found {}", kindName(value));
    }
    return value.text;
}

Name Objects::nameOf(uint32_t node) const {
    if (nodes_[node].role != Role::name) bad("it calls what is not a name");
    return nodes_[node].name;
}

uint32_t Objects::makeInstance(Name name) {
    const uint32_t node = add(Kind::object, Role::instance);
    nodes_[node].name = name;
    return node;
}

std::vector<int64_t> Objects::shapeOf(uint32_t node) const {
    const Node& value = nodes_[node];
    std::vector<int64_t> shape;
    const auto append = [&](const Node& size) {
        if (size.kind != Kind::integer || size.integer < 0) bad("a shape is not made of sizes");
        shape.push_back(size.integer);
    };
    if (value.kind == Kind::integer) {
        append(value);
    } else if (value.kind == Kind::tuple || value.kind == Kind::list) {
        if (value.items.size() > kMaxDepth) bad("an array of too many dimensions");
        for (const uint32_t item : value.items) append(nodes_[item]);
    } else {
        bad("a shape is {}", kindName(value));
    }
    return shape;
}

bool Objects::truthOf(uint32_t node) const {
    const Node& value = nodes_[node];
    if (value.kind != Kind::boolean && value.kind != Kind::integer) {
        bad("expected true or false, found {}", kindName(value));
    }
    return value.integer != 0;
}

void Objects::fillArray(uint32_t node, uint32_t dtype, std::vector<int64_t> shape, bool fortran,
                        std::span<const uint8_t> data) {
    if (nodes_[dtype].role != Role::dtype) bad("an array without a type");
    spend(data.size());
    Array array = arrayFromRaw(nodes_[dtype].text, std::move(shape), fortran, data, file_);
    Node& target = nodes_[node];
    target.kind = Kind::array;
    target.role = Role::value;
    target.array = std::make_unique<Array>(std::move(array));
}

uint32_t Objects::call(Name function, const std::vector<uint32_t>& arguments) {
    const size_t count = arguments.size();
    const auto need = [&](size_t least) {
        if (count < least) bad("a call with {} arguments; expected {}", count, least);
    };
    switch (function) {
        case Name::reconstruct:
            need(1);
            if (nameOf(arguments[0]) != Name::ndarray) bad("it rebuilds what is no array");
            return add(Kind::object, Role::emptyArray);
        case Name::scalar: {
            need(2);
            const uint32_t node = add(Kind::array);
            fillArray(node, arguments[0], {}, false, asBytes(textOf(arguments[1])));
            return node;
        }
        case Name::fromBuffer: {
            need(4);
            const uint32_t node = add(Kind::array);
            fillArray(node, arguments[1], shapeOf(arguments[2]), textOf(arguments[3]) == "F",
                      asBytes(textOf(arguments[0])));
            return node;
        }
        case Name::dtype: {
            need(1);
            const std::string_view text = textOf(arguments[0]);
            spend(text.size());
            const uint32_t node = add(Kind::object, Role::dtype);
            nodes_[node].text = textOf(arguments[0]);
            return node;
        }
        case Name::encode: {
            need(2);
            const std::string_view encoding = textOf(arguments[1]);
            if (encoding != "latin1" && encoding != "latin-1") {
                bad("text encoded as {}; expected latin1", printable(encoding));
            }
            spend(textOf(arguments[0]).size());
            std::string encoded = latin1(textOf(arguments[0]));
            const uint32_t node = add(Kind::bytes);
            nodes_[node].text = std::move(encoded);
            return node;
        }
        case Name::reconstructor:
            need(1);
            if (!makesObjects(nameOf(arguments[0]))) bad("it rebuilds what is no object");
            return makeInstance(nameOf(arguments[0]));
        case Name::orderedDict: {
            std::vector<uint32_t> pairs;
            if (count > 0) {
                for (const uint32_t pair : nodes_[arguments[0]].items) {
                    const Node& node = nodes_[pair];
                    const bool sequence = node.kind == Kind::list || node.kind == Kind::tuple;
                    if (!sequence || node.items.size() != 2) bad("a dict is not made of pairs");
                    pairs.insert(pairs.end(), node.items.begin(), node.items.end());
                }
            }
            spend(pairs.size() * sizeof(uint32_t));
            const uint32_t node = add(Kind::dict);
            nodes_[node].items = std::move(pairs);
            return node;
        }
        case Name::defaultDict:
            return add(Kind::dict);
        case Name::setType: {
            std::vector<uint32_t> items;
            if (count > 0) {
                const Node& source = nodes_[arguments[0]];
                if (source.kind != Kind::list && source.kind != Kind::tuple) {
                    bad("a set is made of {}", kindName(source));
                }
                spend(source.items.size() * sizeof(uint32_t));
                items = source.items;
            }
            const uint32_t node = add(Kind::set);
            nodes_[node].items = std::move(items);
            return node;
        }
        case Name::bytesType: {
            std::string value;
            if (count > 0) {
                spend(textOf(arguments[0]).size());
                value = nodes_[arguments[0]].kind == Kind::text ? latin1(textOf(arguments[0]))
                                                                : nodes_[arguments[0]].text;
            }
            const uint32_t node = add(Kind::bytes);
            nodes_[node].text = std::move(value);
            return node;
        }
        case Name::chumpy:
        case Name::chumpySelect:
        case Name::csc:
        case Name::csr:
        case Name::coo:
        case Name::joblibArray:
            if (count > 0) bad("an object made from arguments");
            return makeInstance(function);
        case Name::torchTensor: {
            // (storage, offset, shape, strides, …)
            need(4);
            if (nodes_[arguments[0]].role != Role::torchStorage) bad("a tensor without storage");
            const uint32_t node = add(Kind::object, Role::torchTensor);
            nodes_[node].text = "a PyTorch tensor";
            nodes_[node].items.assign(arguments.begin(), arguments.begin() + 4);
            return node;
        }
        case Name::torchParameter:
            need(1);
            return arguments[0];
        case Name::ndarray:
        case Name::baseObject:
        case Name::plainType:
        case Name::torchStorage:
            break;
    }
    bad("it calls a type that holds no data");
}

std::vector<uint32_t> Objects::argumentsOf(uint32_t node) const {
    if (nodes_[node].kind != Kind::tuple) bad("arguments that are no tuple");
    return nodes_[node].items;
}

void Objects::build(uint32_t node, uint32_t state) {
    const Node& value = nodes_[state];
    switch (nodes_[node].role) {
        case Role::dtype: {
            // (version, byte order, subtype, names, fields, item size, …)
            if (value.kind != Kind::tuple || value.items.size() < 5) bad("a type without state");
            const std::string_view order = textOf(value.items[1]);
            if (nodes_[value.items[2]].kind != Kind::none ||
                nodes_[value.items[3]].kind != Kind::none) {
                nodes_[node].text = "structured";
                return;
            }
            if (order.size() != 1) bad("a byte order of more than a letter");
            std::string& text = nodes_[node].text;
            if (!text.empty() && std::strchr("<>|=", text[0]) != nullptr) text.erase(0, 1);
            text.insert(0, 1, order[0]);
            return;
        }
        case Role::emptyArray: {
            // (version, shape, type, Fortran order, bytes); the first releases had no version.
            if (value.kind != Kind::tuple || value.items.size() < 4 || value.items.size() > 5) {
                bad("an array without state");
            }
            const size_t first = value.items.size() - 4;
            const uint32_t dtype = value.items[first + 1], data = value.items[first + 3];
            std::vector<int64_t> shape = shapeOf(value.items[first]);
            const bool fortran = truthOf(value.items[first + 2]);
            if (nodes_[data].kind == Kind::list) {  // an array of Python objects
                spend(nodes_[data].items.size() * sizeof(uint32_t));
                nodes_[node].items = std::vector<uint32_t>(nodes_[data].items);
                nodes_[node].kind = Kind::list;
                nodes_[node].role = Role::value;
                return;
            }
            fillArray(node, dtype, std::move(shape), fortran, asBytes(textOf(data)));
            return;
        }
        case Role::instance: {
            uint32_t dict = state;
            if (value.kind == Kind::tuple && value.items.size() == 2) dict = value.items[0];
            if (nodes_[dict].kind != Kind::dict) bad("an object whose state is no dict");
            nodes_[node].items = {dict};
            if (nodes_[node].name == Name::joblibArray) readJoblibArray(node, dict);
            return;
        }
        case Role::value:
            // OrderedDict and the like may carry attributes of their own: they are no data.
            if (nodes_[node].kind == Kind::dict || nodes_[node].kind == Kind::set) return;
            break;
        case Role::torchTensor:
            return;  // attributes of its own: no data
        case Role::name:
        case Role::torchStorage:
            break;
    }
    bad("a state for what takes none");
}

uint32_t Objects::torchStorage(uint32_t id) {
    const std::vector<uint32_t> parts = argumentsOf(id);
    if (parts.size() < 5 || textOf(parts[0]) != "storage") bad("a reference to no storage");
    if (nodes_[parts[1]].role != Role::name || nodes_[parts[1]].name != Name::torchStorage) {
        bad("a storage of no type");
    }
    textOf(parts[2]);
    if (nodes_[parts[4]].kind != Kind::integer) bad("a storage of no size");
    if (parts.size() > 5 && nodes_[parts[5]].kind != Kind::none) bad("a view of a storage");
    const uint32_t node = add(Kind::object, Role::torchStorage);
    nodes_[node].text = "a PyTorch storage";
    nodes_[node].items = {parts[1], parts[2], parts[4]};
    return node;
}

const Node* Objects::attribute(uint32_t dict, std::string_view name) const {
    const std::vector<uint32_t>& items = nodes_[dict].items;
    for (size_t i = 0; i + 1 < items.size(); i += 2) {
        if (nodes_[items[i]].text == name) return &nodes_[items[i + 1]];
    }
    return nullptr;
}

void Objects::readJoblibArray(uint32_t node, uint32_t dict) {
    const Node* shape = attribute(dict, "shape");
    const Node* dtype = attribute(dict, "dtype");
    const Node* order = attribute(dict, "order");
    const Node* alignment = attribute(dict, "numpy_array_alignment_bytes");
    if (shape == nullptr || dtype == nullptr || dtype->role != Role::dtype) {
        bad("an array without shape or type");
    }
    if (alignment != nullptr && alignment->kind == Kind::integer) take(take(1)[0]);
    std::vector<int64_t> sizes = shapeOf(static_cast<uint32_t>(shape - nodes_.data()));
    // "<f8": the size of an element ends the type string.
    const std::string type = dtype->text;
    const size_t digits = type.find_first_of("0123456789");
    if (digits == std::string::npos || type.find_first_of("OSUV") != std::string::npos) {
        bad("an array of type {}", printable(type));
    }
    uint64_t bytes = number<uint32_t>(std::string_view(type).substr(digits));
    for (const int64_t size : sizes) {
        if (__builtin_mul_overflow(bytes, static_cast<uint64_t>(size), &bytes)) {
            bad("an array of impossible size");
        }
    }
    const bool fortran = order != nullptr && order->text == "F";
    fillArray(node, static_cast<uint32_t>(dtype - nodes_.data()), std::move(sizes), fortran,
              take(bytes));
}

}  // namespace doppel::pickle
