#include "nn/nets/tflite_net.h"

#include <algorithm>
#include <optional>

#include "engine/files/numbers.h"
#include "nn/ops/conv/conv.h"
#include "nn/ops/elementwise.h"
#include "nn/ops/features.h"
#include "nn/ops/inference/inference.h"

namespace doppel {

namespace {

// Images [1,H,W,C] as our ops have them.
Shape channelsFirst(const Shape& shape) {
    return shape.size() == 4 ? Shape{shape[0], shape[3], shape[1], shape[2]} : shape;
}

class Builder {
public:
    Builder(Graph& graph, const TfliteModel& model)
        : graph_(graph), model_(model), tensors_(model.tensors.size()), uses_(tensors_.size()) {
        for (size_t i = 0; i < model.operators.size(); ++i)
            for (int input : model.operators[i].inputs) uses_[size_t(input)].push_back(i);
    }

    std::vector<Tensor> build(const Tensor& x) {
        if (model_.inputs.size() != 1 || info(model_.inputs[0]).shape.size() != 4)
            wrong("one picture as input", "another");
        set(model_.inputs[0], x);
        done_.resize(model_.operators.size());
        for (at_ = 0; at_ < model_.operators.size(); ++at_) {
            if (!done_[at_]) add(model_.operators[at_]);
        }
        std::vector<Tensor> outputs;
        for (int output : model_.outputs) outputs.push_back(get(output));
        return outputs;
    }

private:
    struct Padded {
        int tensor;
        Borders borders;
    };

    [[noreturn]] void wrong(std::string_view expected, std::string_view found) const {
        throwInput("{}: operator {}: expected {}, found {}", model_.file, at_, expected, found);
    }

    const TfliteTensor& info(int tensor) const { return model_.tensors[size_t(tensor)]; }

    // A computed tensor.
    const Tensor& get(int tensor) {
        const Tensor& found = tensors_[size_t(tensor)];
        if (!found) wrong("a computed tensor that is not padded", info(tensor).name);
        return found;
    }

    const Tensor& picture(int tensor) {
        const Tensor& found = get(tensor);
        if (found.shape.size() != 4 || found.dim(0) != 1) {
            wrong("one picture", toString(found.shape));
        }
        return found;
    }

    void set(int tensor, const Tensor& value) {
        const Shape shape = channelsFirst(info(tensor).shape);
        if (value.shape != shape) wrong(toString(shape), toString(value.shape));
        tensors_[size_t(tensor)] = value;
    }

    // Of an operator's result.
    int64_t channelsOf(int tensor) const {
        const Shape& shape = info(tensor).shape;
        if (shape.size() != 4) wrong("a picture", toString(shape));
        return shape.back();
    }

    // A constant of floats with this shape; −1: any side.
    const TfliteTensor& constant(int tensor, const Shape& shape) const {
        const TfliteTensor& found = info(tensor);
        bool fits = !found.values.empty() && found.shape.size() == shape.size();
        for (size_t i = 0; fits && i < shape.size(); ++i)
            fits = shape[i] < 0 || found.shape[i] == shape[i];
        if (!fits) wrong("a constant " + toString(shape), toString(found.shape));
        return found;
    }

    bool isOutput(int tensor) const { return std::ranges::count(model_.outputs, tensor) > 0; }

    // The sum that `output`, just made, goes into and nothing else, with what else is summed there,
    // if that is known by now.
    struct Sum {
        size_t op;
        int other;
    };
    std::optional<Sum> sumOf(int output) const {
        const auto& uses = uses_[size_t(output)];
        if (uses.size() != 1 || isOutput(output)) return {};
        const TfliteOperator& op = model_.operators[uses[0]];
        if (op.kind != TfliteKind::Add) return {};
        const int other = op.inputs[op.inputs[0] == output ? 1 : 0];
        if (other == output || !tensors_[size_t(other)] || info(other).shape != info(output).shape)
            return {};
        return Sum{uses[0], other};
    }

    // Whether the sum is the last to need this tensor, and nothing between here and there does. (A
    // reshaped tensor is the same memory.)
    bool mayOverwrite(const Sum& sum) const {
        return !isOutput(sum.other) && std::ranges::count(model_.inputs, sum.other) == 0 &&
               std::ranges::all_of(uses_[size_t(sum.other)], [&](size_t use) {
                   return (use < at_ || use == sum.op) &&
                          model_.operators[use].kind != TfliteKind::Reshape;
               });
    }

    void finishSum(const Sum& sum, const Tensor& value) {
        set(model_.operators[sum.op].output, value);
        done_[sum.op] = true;
    }

    Tensor clamped(const Tensor& x, bool relu6) { return relu6 ? clamp(graph_, x, 0, 6) : x; }

    // What an operator's windows lie over: a picture, and zeros around it.
    std::pair<Tensor, Borders> padded(const TfliteOperator& op, int64_t kernelH, int64_t kernelW) {
        const int input = op.inputs[0];
        const auto explicitly = padded_.find(input);
        if (explicitly != padded_.end()) {
            if (op.same) wrong("padding VALID behind a PAD", "SAME");
            return {picture(explicitly->second.tensor), explicitly->second.borders};
        }
        Borders borders;
        const Tensor& x = picture(input);
        if (op.same) {
            const SameWindows down(x.dim(2), u32(kernelH), u32(op.stride[0])),
                across(x.dim(3), u32(kernelW), u32(op.stride[1]));
            borders = {u32(down.before), u32(down.total - down.before), u32(across.before),
                       u32(across.total - across.before)};
        }
        return {x, borders};
    }

    void addConv(const TfliteOperator& op) {
        const int64_t O = channelsOf(op.output);
        const TfliteTensor& weight = constant(op.inputs[1], {O, -1, -1, -1});
        const int64_t kh = weight.shape[1], kw = weight.shape[2], C = weight.shape[3];
        const TfliteTensor& bias = constant(op.inputs[2], {O});
        auto [x, borders] = padded(op, kh, kw);
        if (C != x.dim(1))
            wrong(fmt::format("weights for {} channels", x.dim(1)), toString(weight.shape));
        if (op.stride[0] != op.stride[1]) wrong("equal strides", "others");
        if (kh == 1 && kw == 1 && op.stride[0] == 1 && borders == Borders{}) {
            const auto sum = op.relu6 ? std::nullopt : sumOf(op.output);
            if (sum && mayOverwrite(*sum)) {
                finishSum(*sum, pixelConv2d(graph_, x, weight.values, bias.values,
                                            model_.operators[sum->op].relu6, get(sum->other)));
            } else {
                set(op.output, pixelConv2d(graph_, x, weight.values, bias.values, op.relu6));
            }
            return;
        }
        // Ours have the same border on all sides. A smaller one above and on the left is as good as
        // a kernel that begins with zeros.
        const uint32_t border = borders.bottom;
        const int64_t more = int64_t(border) - int64_t(borders.top);
        if (borders.right != border || borders.left != borders.top || more < 0 ||
            x.dim(2) + borders.top + border < kh || x.dim(3) + borders.left + border < kw) {
            wrong(
                "a convolution with equal borders, or one more below and on the right, within its "
                "picture",
                "another");
        }
        const int64_t kH = kh + more, kW = kw + more;
        std::vector<float> turned(size_t(O * C * kH * kW));  // [O,C,kH,kW]
        for (int64_t o = 0; o < O; ++o)
            for (int64_t i = 0; i < kh; ++i)
                for (int64_t j = 0; j < kw; ++j)
                    for (int64_t c = 0; c < C; ++c)
                        turned[size_t(((o * C + c) * kH + i + more) * kW + j + more)] =
                            weight.values[size_t(((o * kh + i) * kw + j) * C + c)];
        const Tensor y = conv2d(
            graph_, x, graph_.constant(std::span<const float>(turned), {O, C, kH, kW}),
            graph_.constant(std::span<const float>(bias.values), {O}), u32(op.stride[0]), border);
        set(op.output, clamped(y, op.relu6));
    }

    void addDepthwise(const TfliteOperator& op) {
        const int64_t C = channelsOf(op.output);
        const TfliteTensor& weight = constant(op.inputs[1], {1, -1, -1, C});
        const TfliteTensor& bias = constant(op.inputs[2], {C});
        const int64_t kernel = weight.shape[1];
        auto [x, borders] = padded(op, kernel, kernel);
        if ((kernel != 3 && kernel != 5) || weight.shape[2] != kernel || x.dim(1) != C ||
            op.stride[0] != op.stride[1] || x.dim(2) + borders.top + borders.bottom < kernel ||
            x.dim(3) + borders.left + borders.right < kernel) {
            wrong("a depthwise convolution 3x3 or 5x5 within its picture", toString(weight.shape));
        }
        std::vector<float> turned(weight.values.size());  // [C,K,K]
        for (int64_t c = 0; c < C; ++c)
            for (int64_t p = 0; p < kernel * kernel; ++p)
                turned[size_t(c * kernel * kernel + p)] = weight.values[size_t(p * C + c)];
        const std::vector<float> rows = depthwiseWeights(turned, bias.values, C, kernel);
        set(op.output, depthwiseConv2d(graph_, x,
                                       graph_.constant(std::span<const float>(rows),
                                                       {C, int64_t(rows.size()) / C}),
                                       kernel, op.stride[0], borders, op.relu6));
    }

    // Around pictures the zeros are left to who reads them; behind the channels they are written.
    void addPad(const TfliteOperator& op) {
        const std::vector<int32_t>& sides = info(op.inputs[1]).integers;
        if (sides.size() != 8 || info(op.inputs[0]).shape.size() != 4 ||
            std::ranges::any_of(sides, [](int32_t s) { return s < 0 || s > 4096; }) ||
            sides[0] != 0 || sides[1] != 0 || sides[6] != 0) {
            wrong("a picture and its borders [4,2]", "something else");
        }
        if (sides[7] == 0) {
            padded_[op.output] = {op.inputs[0],
                                  {u32(sides[2]), u32(sides[3]), u32(sides[4]), u32(sides[5])}};
            return;
        }
        if (sides[2] || sides[3] || sides[4] || sides[5]) wrong("channels or borders", "both");
        const Tensor& x = picture(op.inputs[0]);
        const int64_t channels = x.dim(1), all = channels + sides[7], pixels = x.dim(2) * x.dim(3);
        const Tensor y = graph_.temporary({all, pixels});
        graph_.beginOp("pad channels");
        graph_.copy(x, y.slice(0, channels));
        graph_.fill(y.slice(channels, sides[7]));
        set(op.output, y.reshaped({1, all, x.dim(2), x.dim(3)}));
    }

    // relu(x) − slope relu(−x), the second by a product with a diagonal matrix.
    void addPrelu(const TfliteOperator& op) {
        const Tensor& x = picture(op.inputs[0]);
        const int64_t C = x.dim(1);
        const TfliteTensor& slope = constant(op.inputs[1], {1, 1, C});
        std::vector<float> diagonal(size_t(C * C));
        for (int64_t c = 0; c < C; ++c) diagonal[size_t(c * C + c)] = -slope.values[size_t(c)];
        const Tensor below = doppel::relu(graph_, scaleShift(graph_, x, -1, 0));
        set(op.output, pixelConv2d(graph_, below, diagonal, std::vector<float>(size_t(C)), false,
                                   doppel::relu(graph_, x)));
    }

    void addConcatenation(const TfliteOperator& op) {
        const Shape& shape = info(op.output).shape;
        int64_t rows = 0;
        bool rowsOnly = shape.size() == 3 && shape[0] == 1 && op.axis == 1;
        for (int input : op.inputs) {
            const Shape& part = info(input).shape;
            rowsOnly = rowsOnly && part.size() == 3 && part[0] == 1 && part[2] == shape[2];
            if (rowsOnly) rows += part[1];
        }
        if (!rowsOnly || rows != shape[1]) wrong("rows [1,N,C] one after the other", "others");
        const Tensor y = graph_.temporary({shape[1], shape[2]});
        graph_.beginOp("concatenation");
        int64_t begin = 0;
        for (int input : op.inputs) {
            const Tensor& part = get(input);
            graph_.copy(part, y.slice(begin, part.dim(1)));
            begin += part.dim(1);
        }
        set(op.output, y.reshaped(shape));
    }

    void add(const TfliteOperator& op) {
        switch (op.kind) {
            case TfliteKind::Conv:
                return addConv(op);
            case TfliteKind::DepthwiseConv:
                return addDepthwise(op);
            case TfliteKind::Pad:
                return addPad(op);
            case TfliteKind::Prelu:
                return addPrelu(op);
            case TfliteKind::Concatenation:
                return addConcatenation(op);
            case TfliteKind::Add: {
                const Tensor &a = get(op.inputs[0]), &b = get(op.inputs[1]);
                if (a.shape != b.shape) wrong(toString(a.shape), toString(b.shape));
                return set(op.output, clamped(doppel::add(graph_, a, b), op.relu6));
            }
            case TfliteKind::MaxPool: {
                const Tensor& x = picture(op.inputs[0]);
                if (op.stride != std::array<int64_t, 2>{2, 2} || x.dim(2) % 2 || x.dim(3) % 2)
                    wrong("windows 2x2 that fill an even picture", toString(x.shape));
                return set(op.output, maxPool2d(graph_, x, 2, 2));
            }
            case TfliteKind::DepthToSpace: {
                const Tensor& x = picture(op.inputs[0]);
                if (x.dim(1) % 4) wrong("channels for blocks of 2x2", toString(x.shape));
                return set(op.output, depthToSpace2(graph_, x));
            }
            case TfliteKind::ResizeBilinear: {
                const Tensor& x = picture(op.inputs[0]);
                const Shape out{1, x.dim(1), 2 * x.dim(2), 2 * x.dim(3)};
                if (channelsFirst(info(op.output).shape) != out)
                    wrong("twice the size", info(op.output).name);
                const auto sum = sumOf(op.output);
                if (sum && !model_.operators[sum->op].relu6)
                    return finishSum(*sum, upsample2(graph_, x, get(sum->other)));
                return set(op.output, upsample2(graph_, x));
            }
            case TfliteKind::Logistic:
                return set(op.output, sigmoid(graph_, get(op.inputs[0])));
            case TfliteKind::Reshape: {
                Tensor x = get(op.inputs[0]);
                const Shape& shape = info(op.output).shape;
                if (shape.size() == 4 || elementCount(shape) != x.elements())
                    wrong("another view of as many elements", toString(shape));
                // The elements of a pixel follow each other there.
                if (x.shape.size() == 4 && x.dim(2) * x.dim(3) > 1) x = channelsLast(graph_, x);
                return set(op.output, x.reshaped(shape));
            }
        }
    }

    Graph& graph_;
    const TfliteModel& model_;
    std::vector<Tensor> tensors_;
    std::vector<std::vector<size_t>> uses_;  // operators that read each tensor
    std::map<int, Padded> padded_;           // by the tensor that is never made
    std::vector<bool> done_;                 // operators that an earlier one has seen to
    size_t at_ = 0;                          // the operator at hand
};

}  // namespace

std::vector<Tensor> tfliteNet(Graph& graph, const TfliteModel& model, const Tensor& x) {
    return Builder(graph, model).build(x);
}

}  // namespace doppel
