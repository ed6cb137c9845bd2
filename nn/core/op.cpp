#include "nn/core/op.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

namespace doppel {

namespace {

std::vector<std::string> words(const std::string& text) {
    std::istringstream stream(text);
    std::vector<std::string> result;
    for (std::string word; stream >> word;) result.push_back(word);
    return result;
}

std::vector<const Op*>& registry() {
    static std::vector<const Op*> ops;
    return ops;
}

// Checks an array's shape against the declaration, binding letters to sizes.
void checkShape(const Op::Input& input, const Array& array,
                std::map<std::string, int64_t>& letters) {
    if (input.anyShape) return;
    bool fits = array.shape.size() == input.dims.size();
    std::string expected;
    for (size_t i = 0; i < input.dims.size(); ++i) {
        const std::string& dim = input.dims[i];
        int64_t size = 0;
        if (std::isdigit(static_cast<unsigned char>(dim[0])))
            std::from_chars(dim.data(), dim.data() + dim.size(), size);
        else if (auto bound = letters.find(dim); bound != letters.end())
            size = bound->second;
        else if (fits)
            size = letters[dim] = array.shape[i];
        else
            size = -1;
        expected += (i ? "," : "") + (size < 0 ? dim : std::to_string(size));
        if (fits && array.shape[i] != size) fits = false;
    }
    if (!fits)
        throwInput("{}: expected shape [{}], found {}", array.where, expected, array.shapeText());
}

}  // namespace

Tensor OpCall::operator[](std::string_view name) const {
    auto found = tensors.find(name);
    return found == tensors.end() ? Tensor{} : found->second;
}

const std::vector<int32_t>& OpCall::ints(std::string_view name) const {
    auto found = integers.find(name);
    CHECK(found != integers.end(), "{} is an integer input", name);
    return found->second;
}

double OpCall::attribute(std::string_view name) const {
    auto found = attributes.find(name);
    CHECK(found != attributes.end(), "{} is a declared attribute", name);
    return found->second;
}

uint32_t OpCall::u(std::string_view name) const {
    double value = attribute(name);
    if (value < 0 || value > 1e9 || value != std::floor(value))
        throwInput("attr_{}: expected a whole number from 0 on, found {}", name, value);
    return static_cast<uint32_t>(value);
}

Op::Op(OpDeclaration declaration) : declaration_(std::move(declaration)) {
    std::vector<std::string> differentiable = words(declaration_.differentiable);
    for (std::string word : words(declaration_.inputs)) {
        Input input;
        if (word.back() == '?') {
            input.optional = true;
            word.pop_back();
        }
        size_t bracket = word.find('[');
        input.anyShape = bracket == std::string::npos;
        if (!input.anyShape) {
            std::istringstream dims(word.substr(bracket + 1, word.size() - bracket - 2));
            for (std::string dim; std::getline(dims, dim, ',');) input.dims.push_back(dim);
            word.resize(bracket);
        }
        if (size_t colon = word.find(":i32"); colon != std::string::npos) {
            input.integer = true;
            word.resize(colon);
        }
        input.name = word;
        input.differentiable = std::ranges::count(differentiable, word) > 0;
        inputs_.push_back(std::move(input));
    }
    for (const std::string& word : words(declaration_.attributes)) {
        size_t equals = word.find('=');
        Attribute attribute{word.substr(0, equals), std::nullopt};
        if (equals != std::string::npos) attribute.fallback = std::stod(word.substr(equals + 1));
        attributes_.push_back(attribute);
    }
    outputs_ = words(declaration_.outputs);
    auto place = std::ranges::upper_bound(registry(), declaration_.name, {},
                                          [](const Op* op) { return op->name(); });
    registry().insert(place, this);
}

const std::vector<const Op*>& Op::all() { return registry(); }

const Op* Op::find(std::string_view name) {
    auto found = std::ranges::find(registry(), name, [](const Op* op) { return op->name(); });
    return found == registry().end() ? nullptr : *found;
}

Npz Op::run(Device& device, const Npz& arrays, const CompileOptions& options) const {
    Graph graph(device);
    OpCall call{graph, {}, {}, {}, {}, {}};
    bool backward = std::ranges::any_of(
        outputs_, [&](const std::string& name) { return arrays.has("grad_" + name); });

    std::map<std::string, int64_t> letters;
    std::vector<std::pair<std::string, std::vector<float>>> floats;
    for (const Input& input : inputs_) {
        const Array* array = arrays.find(input.name);
        if (!array && input.optional) continue;
        if (!array) throwInput("{}: input {} is missing", name(), input.name);
        checkShape(input, *array, letters);
        call.shapes[input.name] = array->shape;
        if (input.integer) {
            call.integers[input.name] = array->toI32();
            call.tensors[input.name] =
                graph.constant(std::span<const int32_t>(call.integers[input.name]), array->shape);
        } else {
            bool wanted = backward && input.differentiable;
            Tensor tensor = wanted ? graph.variable(array->shape) : graph.input(array->shape);
            call.tensors[input.name] = tensor;
            floats.emplace_back(input.name, array->toF32());
        }
    }
    for (const Attribute& attribute : attributes_) {
        const Array* array = arrays.find("attr_" + attribute.name);
        if (!array && !attribute.fallback)
            throwInput("{}: attribute attr_{} is missing", name(), attribute.name);
        double value = array ? array->scalar() : *attribute.fallback;
        if (!std::isfinite(value))
            throwInput("{}: attr_{} must be finite, found {}", name(), attribute.name, value);
        call.attributes[attribute.name] = value;
    }
    for (const auto& [key, array] : arrays) {
        auto named = [&](const auto& list, std::string_view prefix, auto projection) {
            return std::ranges::any_of(list, [&](const auto& item) {
                return key == std::string(prefix) + projection(item);
            });
        };
        bool known = named(inputs_, "", [](const Input& i) { return i.name; }) ||
                     named(attributes_, "attr_", [](const Attribute& a) { return a.name; }) ||
                     named(outputs_, "grad_", [](const std::string& o) { return o; }) ||
                     key.starts_with("expect_") || key.starts_with("tol_");
        if (!known) throwInput("{}: it has no input, attribute or gradient {}", name(), key);
    }

    declaration_.build(call);
    std::vector<std::pair<std::string, Tensor>> wanted = call.results;
    if (backward) {
        std::vector<std::pair<Tensor, Tensor>> upstream;
        for (const auto& [output, tensor] : call.results) {
            const Array* array = arrays.find("grad_" + output);
            if (!array) continue;
            if (array->shape != tensor.shape)
                throwInput("{}: expected the shape of {} {}, found {}", array->where, output,
                           toString(tensor.shape), array->shapeText());
            Tensor gradient = graph.input(tensor.shape);
            floats.emplace_back("grad_" + output, array->toF32());
            call.tensors["grad_" + output] = gradient;
            upstream.emplace_back(tensor, gradient);
        }
        graph.backward(upstream);
        for (const Input& input : inputs_)
            if (input.differentiable && call.tensors.contains(input.name))
                wanted.emplace_back("grad_" + input.name, graph.gradient(call.tensors[input.name]));
    }
    for (const auto& [output, tensor] : wanted) graph.output(tensor);
    graph.compile(options);
    for (const auto& [key, values] : floats) graph.write(call.tensors[key], values);
    graph.run();

    Npz out;
    for (const auto& [key, tensor] : wanted) {
        if (tensor.type == ElementType::I32)
            out.set(key, Array::i32(tensor.shape, graph.read<int32_t>(tensor)));
        else
            out.set(key, Array::f32(tensor.shape, graph.read<float>(tensor)));
    }
    return out;
}

}  // namespace doppel
