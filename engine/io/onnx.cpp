#include "engine/io/onnx.h"

#include <fmt/format.h>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/protobuf.h"

// Numbers of fields and types are those of ONNX's own onnx.proto.

namespace doppel {

namespace {

constexpr uint64_t kIrVersion = 5;  // the file's layout, of the time of opset 10
constexpr uint64_t kFloat = 1, kInt64 = 7;
constexpr uint64_t kLargest = uint64_t{1} << 31;

// GraphProto
constexpr uint32_t kNode = 1, kName = 2, kInitialiser = 5, kDoc = 10, kInput = 11, kOutput = 12;

// ValueInfoProto
ProtoMessage valueInfo(const std::string& name, const std::vector<int64_t>& shape,
                       const std::string& about) {
    ProtoMessage dims, tensor, type;
    for (int64_t n : shape) {
        ProtoMessage dim;
        dims.message(1, dim.varint(1, static_cast<uint64_t>(n)));
    }
    tensor.varint(1, kFloat).message(2, dims);
    type.message(1, tensor);
    ProtoMessage info;
    info.bytes(1, name).message(2, type).bytes(3, about);
    return info;
}

// TensorProto
template <typename T>
ProtoMessage tensorProto(const std::string& name, uint64_t type, const std::vector<int64_t>& shape,
                         const std::vector<T>& values) {
    ProtoMessage tensor;
    for (int64_t n : shape) tensor.varint(1, static_cast<uint64_t>(n));
    tensor.varint(2, type).bytes(8, name);
    tensor.bytes(9, {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)});
    return tensor;
}

// AttributeProto
ProtoMessage attributeProto(const OnnxGraph::Attribute& attribute) {
    constexpr uint64_t kFloatType = 1, kIntType = 2, kTextType = 3, kIntsType = 7;
    ProtoMessage message;
    message.bytes(1, attribute.name);
    if (const auto* real = std::get_if<float>(&attribute.value))
        message.real32(2, *real).varint(20, kFloatType);
    else if (const auto* integer = std::get_if<int64_t>(&attribute.value))
        message.varint(3, static_cast<uint64_t>(*integer)).varint(20, kIntType);
    else if (const auto* text = std::get_if<std::string>(&attribute.value))
        message.bytes(4, *text).varint(20, kTextType);
    else {
        for (int64_t n : std::get<std::vector<int64_t>>(attribute.value))
            message.varint(8, static_cast<uint64_t>(n));
        message.varint(20, kIntsType);
    }
    return message;
}

std::string field(uint32_t number, const ProtoMessage& message) {
    return ProtoMessage().message(number, message).text();
}

}  // namespace

std::vector<std::string> onnxOutputs(std::string_view file) {
    constexpr uint64_t kGraph = 7, kOutput = 12, kName = 1;  // of ModelProto, GraphProto, ValueInfo
    std::vector<std::string> names;
    ProtoFields model(file);
    while (const auto part = model.next()) {
        if (part->number != kGraph) continue;
        ProtoFields graph(part->bytes);
        while (const auto field = graph.next()) {
            if (field->number != kOutput) continue;
            ProtoFields value(field->bytes);
            while (const auto about = value.next())
                if (about->number == kName) names.emplace_back(about->bytes);
        }
    }
    return names;
}

OnnxGraph::OnnxGraph(std::string name, std::string about)
    : name_(std::move(name)), about_(std::move(about)) {}

std::string OnnxGraph::input(const std::string& name, const std::vector<int64_t>& shape,
                             const std::string& about) {
    fields_.push_back(field(kInput, valueInfo(name, shape, about)));
    return name;
}

void OnnxGraph::output(const std::string& name, const std::string& value,
                       const std::vector<int64_t>& shape, const std::string& about) {
    node("Identity", {value}, name, {});
    fields_.push_back(field(kOutput, valueInfo(name, shape, about)));
}

std::string OnnxGraph::constant(const std::string& name, const Tensor32& tensor) {
    fields_.push_back(field(kInitialiser, tensorProto(name, kFloat, tensor.shape, tensor.values)));
    return name;
}

std::string OnnxGraph::number(const std::string& name, float value) {
    return constant(name, {{}, {value}});
}

std::string OnnxGraph::list(const std::string& name, const std::vector<int64_t>& values,
                            const std::vector<int64_t>& shape) {
    fields_.push_back(field(kInitialiser, tensorProto(name, kInt64, shape, values)));
    return name;
}

std::string OnnxGraph::list(const std::string& name, const std::vector<int64_t>& values) {
    return list(name, values, {static_cast<int64_t>(values.size())});
}

std::string OnnxGraph::add(const std::string& operation, const std::vector<std::string>& inputs,
                           const std::vector<Attribute>& attributes) {
    return node(operation, inputs, fmt::format("{}_{}", operation, nodes_), attributes);
}

std::string OnnxGraph::node(const std::string& operation, const std::vector<std::string>& inputs,
                            const std::string& output, const std::vector<Attribute>& attributes) {
    ProtoMessage message;
    for (const std::string& name : inputs) message.bytes(1, name);
    message.bytes(2, output).bytes(3, fmt::format("node_{}", nodes_++)).bytes(4, operation);
    for (const Attribute& attribute : attributes) message.message(5, attributeProto(attribute));
    fields_.push_back(field(kNode, message));
    return output;
}

void OnnxGraph::write(const std::filesystem::path& path) const {
    const ProtoMessage names = ProtoMessage().bytes(kName, name_).bytes(kDoc, about_);
    uint64_t size = names.text().size();
    for (const std::string& one : fields_) size += one.size();
    // ModelProto
    const ProtoMessage opset = ProtoMessage().bytes(1, "").varint(2, kOnnxOpset);
    const ProtoMessage model = ProtoMessage()
                                   .varint(1, kIrVersion)
                                   .bytes(2, "doppel")
                                   .message(8, opset)
                                   .bytesFollow(7, size);
    if (model.text().size() + size >= kLargest)
        throwInput("{}: expected a network of less than 2 GiB, which is ONNX's limit, found {} MiB",
                   path.string(), size >> 20);
    AtomicFile file(path);
    file.write(model.text());
    file.write(names.text());
    for (const std::string& one : fields_) file.write(one);
    file.commit();
}

}  // namespace doppel
