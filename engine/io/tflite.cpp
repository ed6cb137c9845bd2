// The schema is TensorFlow's tensorflow/lite/schema/schema.fbs; numbers below are places of fields
// in its tables.
#include "engine/io/tflite.h"

#include <flatbuffers/flatbuffers.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <optional>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/numbers.h"

namespace doppel {

namespace {

namespace fb = flatbuffers;

constexpr int64_t kMostElements = int64_t{1} << 26;  // of a tensor
constexpr size_t kMostTensors = 1 << 14, kMostConstants = size_t{1} << 27;

// What of a file is read goes through here.
class Bytes {
public:
    Bytes(std::span<const uint8_t> file, const std::string& name)
        : file_(file), name_(name), verifier_(file.data(), file.size()) {}

    [[noreturn]] void damaged() const {
        throwInput("{}: expected a TensorFlow Lite model, found a damaged one", name_);
    }

    const fb::Table* root() {
        if (file_.size() < 8 || !fb::BufferHasIdentifier(file_.data(), "TFL3")) {
            throwInput("{}: expected a TensorFlow Lite model (TFL3), found something else", name_);
        }
        if (!verifier_.VerifyOffset(size_t{0})) damaged();
        return checked(fb::GetRoot<fb::Table>(file_.data()));
    }

    // A number of a table, or what it is where the table does not say.
    template <typename T>
    T number(const fb::Table* table, int slot, T otherwise = 0) const {
        const auto field = place(slot);
        if (!table->VerifyField<T>(verifier_, field, sizeof(T))) damaged();
        return table->GetField<T>(field, otherwise);
    }

    // A table in a table; null where there is none.
    const fb::Table* table(const fb::Table* in, int slot) {
        const auto field = place(slot);
        if (!in->VerifyOffset(verifier_, field)) damaged();
        const auto* found = in->GetPointer<const fb::Table*>(field);
        return found ? checked(found) : nullptr;
    }

    // A vector in a table; empty where there is none. The bytes may lie at any address.
    template <typename T>
    std::vector<T> numbers(const fb::Table* in, int slot) const {
        const auto* found = vector<T>(in, slot);
        if (!found) return {};
        std::vector<T> values(found->size());
        if (!values.empty()) std::memcpy(values.data(), found->Data(), values.size() * sizeof(T));
        return values;
    }

    std::vector<const fb::Table*> tables(const fb::Table* in, int slot) {
        const auto* found = vector<fb::Offset<fb::Table>>(in, slot);
        std::vector<const fb::Table*> all;
        for (fb::uoffset_t i = 0; found && i < found->size(); ++i) {
            const auto* at =
                reinterpret_cast<const uint8_t*>(found->Data()) + i * sizeof(fb::uoffset_t);
            if (!verifier_.VerifyOffset(static_cast<size_t>(at - file_.data()))) damaged();
            all.push_back(checked(found->Get(i)));
        }
        return all;
    }

    std::string text(const fb::Table* in, int slot) const {
        const std::vector<uint8_t> letters = numbers<uint8_t>(in, slot);
        return {letters.begin(), letters.end()};
    }

private:
    static fb::voffset_t place(int slot) { return static_cast<fb::voffset_t>(4 + 2 * slot); }

    const fb::Table* checked(const fb::Table* table) {
        if (!table->VerifyTableStart(verifier_)) damaged();
        verifier_.EndTable();
        return table;
    }

    template <typename T>
    const fb::Vector<T>* vector(const fb::Table* in, int slot) const {
        const auto field = place(slot);
        if (!in->VerifyOffset(verifier_, field)) damaged();
        const auto* found = in->GetPointer<const fb::Vector<T>*>(field);
        if (!verifier_.VerifyVector(found)) damaged();
        return found;
    }

    std::span<const uint8_t> file_;
    const std::string& name_;
    fb::Verifier verifier_;
};

// Of the schema's BuiltinOperator.
enum Code {
    kAdd = 0,
    kConcatenation = 2,
    kConv = 3,
    kDepthwiseConv = 4,
    kDepthToSpace = 5,
    kDequantize = 6,
    kLogistic = 14,
    kMaxPool = 17,
    kReshape = 22,
    kResizeBilinear = 23,
    kPad = 34,
    kPrelu = 54,
    kDensify = 124,
};

enum Type { kFloat32 = 0, kFloat16 = 1, kInt32 = 2 };

class Reader {
public:
    Reader(std::span<const uint8_t> file, const std::string& name) : bytes_(file, name) {
        model_.file = name;
    }

    TfliteModel read() {
        const fb::Table* root = bytes_.root();
        for (const fb::Table* code : bytes_.tables(root, 1)) {
            codes_.push_back(
                std::max<int>(bytes_.number<int32_t>(code, 3), bytes_.number<int8_t>(code, 0)));
        }
        const auto graphs = bytes_.tables(root, 2);
        if (graphs.size() != 1) wrong("one graph", fmt::format("{}", graphs.size()));
        buffers_ = bytes_.tables(root, 4);
        for (const fb::Table* tensor : bytes_.tables(graphs[0], 0)) readTensor(tensor);
        model_.inputs = places(graphs[0], 1);
        model_.outputs = places(graphs[0], 2);
        for (int input : model_.inputs) known_[size_t(input)] = true;
        for (const fb::Table* op : bytes_.tables(graphs[0], 3)) readOperator(op);
        for (int output : model_.outputs) {
            if (!known_[size_t(output)]) wrong("outputs that are computed", "one that is not");
        }
        if (model_.inputs.empty() || model_.outputs.empty()) {
            wrong("inputs and outputs", "none");
        }
        return std::move(model_);
    }

private:
    [[noreturn]] void wrong(std::string_view expected, std::string_view found) const {
        throwInput("{}: expected {}, found {}", model_.file, expected, found);
    }

    // Numbers of tensors.
    std::vector<int> places(const fb::Table* table, int slot) const {
        std::vector<int> all;
        for (int32_t i : bytes_.numbers<int32_t>(table, slot)) {
            if (i < 0 || size_t(i) >= model_.tensors.size()) {
                wrong(fmt::format("tensors 0 to {}", model_.tensors.size()), fmt::format("{}", i));
            }
            all.push_back(i);
        }
        return all;
    }

    void readTensor(const fb::Table* table) {
        TfliteTensor tensor;
        tensor.name = bytes_.text(table, 3);
        int64_t elements = 1;
        for (int32_t side : bytes_.numbers<int32_t>(table, 0)) {
            if (side < 1 || (elements *= side) > kMostElements) {
                wrong("tensors of 1 to 67108864 elements",
                      fmt::format("a side of {} in tensor {}", side, model_.tensors.size()));
            }
            tensor.shape.push_back(side);
        }
        const int type = bytes_.number<int8_t>(table, 1);
        const auto buffer = bytes_.number<uint32_t>(table, 2);
        if (buffer >= buffers_.size() || model_.tensors.size() >= kMostTensors) bytes_.damaged();
        const std::vector<uint8_t> data = bytes_.numbers<uint8_t>(buffers_[buffer], 0);
        std::vector<size_t> places;  // of the values that are stored
        const fb::Table* sparsity = bytes_.table(table, 6);
        if (!data.empty()) {
            if (sparsity) places = placesOfSparse(sparsity, tensor.shape);
            const size_t stored = sparsity ? places.size() : size_t(elements);
            const size_t each = type == kFloat16 ? 2 : 4;
            if (type != kFloat32 && type != kFloat16 && type != kInt32) {
                wrong("constants of type float32, float16 or int32", fmt::format("type {}", type));
            }
            if (data.size() != stored * each) {
                wrong(fmt::format("{} bytes for the constant {}", stored * each, tensor.name),
                      fmt::format("{}", data.size()));
            }
            if ((constants_ += size_t(elements)) > kMostConstants) {
                wrong("at most 134217728 constants", "more");
            }
            if (type == kInt32)
                tensor.integers.resize(size_t(elements));
            else
                tensor.values.resize(size_t(elements));
            for (size_t i = 0; i < stored; ++i) {
                const size_t at = sparsity ? places[i] : i;
                if (type == kInt32)
                    tensor.integers[at] = loadAt<int32_t>(data.data(), i);
                else if (type == kFloat32)
                    tensor.values[at] = loadAt<float>(data.data(), i);
                else
                    tensor.values[at] = halfToFloat(loadAt<uint16_t>(data.data(), i));
            }
            if (!std::all_of(tensor.values.begin(), tensor.values.end(),
                             [](float v) { return std::isfinite(v); })) {
                wrong(fmt::format("finite numbers in the constant {}", tensor.name), "others");
            }
        }
        known_.push_back(!data.empty());
        model_.tensors.push_back(std::move(tensor));
    }

    // Dense but for the last dimension, whose stored places are listed row by row.
    std::vector<size_t> placesOfSparse(const fb::Table* sparsity,
                                       const std::vector<int64_t>& shape) {
        const auto order = bytes_.numbers<int32_t>(sparsity, 0);
        const auto dimensions = bytes_.tables(sparsity, 2);
        bool plain = order.size() == shape.size() && dimensions.size() == shape.size() &&
                     !shape.empty() && bytes_.numbers<int32_t>(sparsity, 1).empty();
        size_t rows = 1;
        for (size_t i = 0; plain && i < shape.size(); ++i) {
            const bool last = i + 1 == shape.size();
            plain = order[i] == int32_t(i) &&
                    bytes_.number<int8_t>(dimensions[i], 0) == (last ? 1 : 0) &&
                    (last || bytes_.number<int32_t>(dimensions[i], 1) == shape[i]);
            if (!last) rows *= size_t(shape[i]);
        }
        if (!plain) wrong("sparse constants whose last dimension is listed", "another layout");
        const auto segments = list(dimensions.back(), 2), columns = list(dimensions.back(), 4);
        if (segments.size() != rows + 1 || segments.front() != 0 ||
            segments.back() != int64_t(columns.size())) {
            bytes_.damaged();
        }
        std::vector<size_t> places;
        for (size_t row = 0; row < rows; ++row) {
            if (segments[row] > segments[row + 1] || segments[row + 1] > segments.back()) {
                bytes_.damaged();
            }
            for (int64_t i = segments[row]; i < segments[row + 1]; ++i) {
                const int64_t column = columns[size_t(i)];
                if (column < 0 || column >= shape.back()) bytes_.damaged();
                places.push_back(row * size_t(shape.back()) + size_t(column));
            }
        }
        return places;
    }

    // A union of vectors: its type in `slot`, its table behind it.
    std::vector<int64_t> list(const fb::Table* dimension, int slot) {
        const fb::Table* table = bytes_.table(dimension, slot + 1);
        if (!table) bytes_.damaged();
        const auto widened = [](const auto& numbers) {
            return std::vector<int64_t>(numbers.begin(), numbers.end());
        };
        switch (bytes_.number<uint8_t>(dimension, slot)) {
            case 1:
                return widened(bytes_.numbers<int32_t>(table, 0));
            case 2:
                return widened(bytes_.numbers<uint16_t>(table, 0));
            case 3:
                return widened(bytes_.numbers<uint8_t>(table, 0));
            default:
                bytes_.damaged();
        }
    }

    // An option: a number that has to have this value.
    template <typename T>
    void only(const fb::Table* options, int slot, T otherwise, T value, const char* what) const {
        const T found = options ? bytes_.number<T>(options, slot, otherwise) : otherwise;
        if (found != value) {
            wrong(fmt::format("{} {}", what, int64_t(value)), fmt::format("{}", int64_t(found)));
        }
    }

    void activation(const fb::Table* options, int slot, TfliteOperator& op) const {
        const int found = options ? bytes_.number<int8_t>(options, slot) : 0;
        if (found != 0 && found != 3) {
            wrong("operators followed by ReLU6 or nothing", fmt::format("activation {}", found));
        }
        op.relu6 = found == 3;
    }

    void windows(const fb::Table* options, TfliteOperator& op) const {
        if (!options) bytes_.damaged();
        const int padding = bytes_.number<int8_t>(options, 0);
        const int across = bytes_.number<int32_t>(options, 1);
        const int down = bytes_.number<int32_t>(options, 2);
        if (padding < 0 || padding > 1 || across < 1 || down < 1 || across > 64 || down > 64) {
            bytes_.damaged();
        }
        op.same = padding == 0;
        op.stride = {down, across};
    }

    void readOperator(const fb::Table* table) {
        const auto index = bytes_.number<uint32_t>(table, 0);
        if (index >= codes_.size()) bytes_.damaged();
        TfliteOperator op;
        op.inputs = places(table, 1);
        const auto outputs = places(table, 2);
        const fb::Table* options = bytes_.table(table, 4);
        if (outputs.size() != 1 || op.inputs.empty()) bytes_.damaged();
        op.output = outputs[0];
        for (int input : op.inputs) {
            if (!known_[size_t(input)]) wrong("operators in the order of execution", "others");
        }
        if (known_[size_t(op.output)]) wrong("each tensor computed once", "one that is twice");
        known_[size_t(op.output)] = true;
        size_t count = 1;  // inputs
        switch (codes_[index]) {
            case kDequantize:
            case kDensify: {
                TfliteTensor& from = model_.tensors[size_t(op.inputs[0])];
                TfliteTensor& to = model_.tensors[size_t(op.output)];
                if (from.values.empty() || from.shape != to.shape) {
                    wrong("conversions of constants only", to.name);
                }
                to.values = from.values;
                return;
            }
            case kAdd:
                op.kind = TfliteKind::Add;
                activation(options, 0, op);
                count = 2;
                break;
            case kConcatenation:
                op.kind = TfliteKind::Concatenation;
                op.axis = options ? bytes_.number<int32_t>(options, 0) : 0;
                only<int8_t>(options, 1, 0, 0, "activation");
                count = op.inputs.size();
                break;
            case kConv:
                op.kind = TfliteKind::Conv;
                windows(options, op);
                activation(options, 3, op);
                only<int32_t>(options, 4, 1, 1, "dilation");
                only<int32_t>(options, 5, 1, 1, "dilation");
                count = 3;
                break;
            case kDepthwiseConv:
                op.kind = TfliteKind::DepthwiseConv;
                windows(options, op);
                only<int32_t>(options, 3, 0, 1, "depth multiplier");
                activation(options, 4, op);
                only<int32_t>(options, 5, 1, 1, "dilation");
                only<int32_t>(options, 6, 1, 1, "dilation");
                count = 3;
                break;
            case kMaxPool:
                op.kind = TfliteKind::MaxPool;
                windows(options, op);
                only<int32_t>(options, 1, 0, 2, "stride");
                only<int32_t>(options, 2, 0, 2, "stride");
                only<int32_t>(options, 3, 0, 2, "filter");
                only<int32_t>(options, 4, 0, 2, "filter");
                only<int8_t>(options, 5, 0, 0, "activation");
                break;
            case kDepthToSpace:
                op.kind = TfliteKind::DepthToSpace;
                only<int32_t>(options, 0, 0, 2, "block");
                break;
            case kResizeBilinear:
                op.kind = TfliteKind::ResizeBilinear;
                only<uint8_t>(options, 2, 0, 0, "align_corners");
                only<uint8_t>(options, 3, 0, 1, "half_pixel_centers");
                count = 2;
                break;
            case kLogistic:
                op.kind = TfliteKind::Logistic;
                break;
            case kReshape:
                op.kind = TfliteKind::Reshape;
                count = op.inputs.size() == 2 ? 2 : 1;
                break;
            case kPad:
                op.kind = TfliteKind::Pad;
                count = 2;
                break;
            case kPrelu:
                op.kind = TfliteKind::Prelu;
                count = 2;
                break;
            default:
                wrong("operators of convolutional networks",
                      fmt::format("operator {}", codes_[index]));
        }
        if (op.inputs.size() != count) {
            wrong(fmt::format("{} inputs of operator {}", count, codes_[index]),
                  fmt::format("{}", op.inputs.size()));
        }
        model_.operators.push_back(std::move(op));
    }

    Bytes bytes_;
    TfliteModel model_;
    std::vector<int> codes_;
    std::vector<const fb::Table*> buffers_;
    size_t constants_ = 0;     // elements so far
    std::vector<bool> known_;  // tensors that are constants or computed so far
};

}  // namespace

TfliteModel tfliteFromBytes(std::span<const uint8_t> file, const std::string& name) {
    return Reader(file, name).read();
}

TfliteModel readTflite(const std::filesystem::path& path) {
    return tfliteFromBytes(readWholeFile(path), path.string());
}

}  // namespace doppel
