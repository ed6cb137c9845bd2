#include "nn/core/graph.h"

#include <algorithm>
#include <set>
#include <utility>

#include "common/pairs.h"
#include "elementwise/params.h"
#include "engine/files/numbers.h"

namespace doppel {

Graph::Graph(Device& device) : device_(device) {}

Graph::~Graph() {
    // Recorders wait for what is in flight before the buffers go.
    for (Segments& segments : segments_) segments.clear();
    preparation_.clear();
}

// ---- ranks --------------------------------------------------------------------------------------

void Graph::join(Ranks* ranks) {
    CHECK(ops_.empty(), "a graph joins before its first op");
    ranks_ = ranks && ranks->size() > 1 ? ranks : nullptr;
}

Tensor Graph::ofAllRanks(const Tensor& mine, int64_t rows) {
    CHECK(ranks_ && mine.elements() % rows == 0, "ranks share {} rows of {}", rows,
          toString(mine.shape));
    Tensor all = temporary({rows, ranks_->size(), mine.elements() / rows});
    exchanges_.push_back({{mine}, all, rows, steps_.size(), 0, {}, {}});
    return all;
}

// Gradients that are final long before the last one travel while the others are computed.
void Graph::shareGradients(const std::vector<Tensor>& gradients) {
    constexpr uint64_t kBucketBytes = 4 << 20;  // a transfer's bytes outweigh its latency
    auto readyAt = [&](const Tensor& gradient) {
        return static_cast<size_t>(storages_[size_t(gradient.storage)].lastUse + 1);
    };
    std::vector<Tensor> order = gradients;
    std::ranges::stable_sort(order, {}, readyAt);
    Exchange bucket;
    uint64_t bytes = 0;
    for (const Tensor& gradient : order) {
        bucket.mine.push_back(gradient);
        bucket.ready = readyAt(gradient);
        bytes += gradient.bytes();
        if (bytes < kBucketBytes && &gradient != &order.back()) continue;
        bucket.needed = steps_.size();
        exchanges_.push_back(std::move(bucket));
        bucket = {};
        bytes = 0;
    }
}

// ---- tensors ------------------------------------------------------------------------------------

Tensor Graph::newStorage(Kind kind, Shape shape, ElementType type) {
    CHECK(!compiled_, "a compiled graph takes no more tensors");
    Tensor tensor{static_cast<int>(storages_.size()), 0, std::move(shape), type};
    storages_.push_back({kind, tensor.bytes()});
    return tensor;
}

Tensor Graph::input(Shape shape, ElementType type) {
    Tensor tensor = newStorage(Kind::Input, std::move(shape), type);
    inputs_.push_back(
        {tensor.storage, 0, tensor.bytes(), std::vector<std::byte>(tensor.bytes()), 1, {0, 0}});
    return tensor;
}

Tensor Graph::variable(Shape shape) {
    Tensor tensor = input(std::move(shape));
    storages_[size_t(tensor.storage)].differentiable = true;
    return tensor;
}

Tensor Graph::newConstant(std::span<const std::byte> bytes, Shape shape, ElementType type) {
    Tensor tensor = newStorage(Kind::Attached, std::move(shape), type);
    CHECK(bytes.size() == tensor.bytes(), "{} bytes fill {}", bytes.size(), toString(tensor.shape));
    buffers_.push_back(device_.allocate(tensor.bytes(), Memory::Device));
    // buffers_ may move its elements, so views point at them only after compile(); remember which.
    storages_.back().view = {nullptr, buffers_.size() - 1, tensor.bytes()};
    device_.upload({&buffers_.back(), 0, buffers_.back().bytes()}, bytes);
    return tensor;
}

Tensor Graph::constant(std::span<const float> values, Shape shape) {
    return newConstant(std::as_bytes(values), std::move(shape), ElementType::F32);
}
Tensor Graph::constant(std::span<const int32_t> values, Shape shape) {
    return newConstant(std::as_bytes(values), std::move(shape), ElementType::I32);
}

Tensor Graph::attach(const BufferView& view, Shape shape, ElementType type) {
    Tensor tensor = newStorage(Kind::Attached, std::move(shape), type);
    CHECK(view.bytes >= tensor.bytes(), "{} fits into {} bytes", toString(tensor.shape),
          view.bytes);
    storages_.back().view = {view.buffer, view.offset, tensor.bytes()};
    return tensor;
}

Tensor Graph::parameter(const Parameters& parameters, std::string_view name) {
    const Parameters::Entry* entry = parameters.find(name);
    CHECK(entry, "there is a parameter {}", name);
    Tensor value = attach(parameters.view(*entry, Parameters::kValues), entry->shape);
    storages_.back().differentiable = true;
    fixedGradients_[{value.storage, 0}] =
        attach(parameters.view(*entry, Parameters::kGradient), entry->shape);
    return value;
}

Tensor Graph::temporary(Shape shape, ElementType type) {
    return newStorage(Kind::Temporary, std::move(shape), type);
}

Tensor Graph::none() {
    if (!none_) none_ = constant(std::span<const float>(std::vector<float>(4)), {4});
    return none_;
}

Tensor Graph::step() {
    if (!step_) step_ = input({sizeof(StepParams) / 4}, ElementType::I32);
    return step_;
}

void Graph::setStep(const StepParams& params) {
    writeBytes(step(), std::as_bytes(std::span(&params, 1)));
}

void Graph::output(const Tensor& tensor) {
    CHECK(!compiled_, "outputs are named before compile()");
    outputs_.push_back({tensor, 0});
}

// ---- ops ----------------------------------------------------------------------------------------

void Graph::beginOp(std::string name, double flops) { ops_.push_back({std::move(name), flops}); }

void Graph::use(const Tensor& tensor) {
    CHECK(tensor, "every buffer of op {} is a tensor", ops_.empty() ? "?" : ops_.back().name);
    Storage& storage = storages_[size_t(tensor.storage)];
    int now = static_cast<int>(steps_.size());
    if (storage.firstUse < 0) storage.firstUse = now;
    storage.lastUse = now;
}

void Graph::addDispatch(const char* kernel, std::initializer_list<Argument> arguments,
                        std::span<const std::byte> params, Groups groups, uint64_t invocations,
                        const Specialisation& spec) {
    CHECK(!ops_.empty(), "beginOp() comes before the first dispatch");
    Step step{Step::What::Dispatch,
              ops_.size() - 1,
              kernel,
              spec,
              {},
              std::vector<std::byte>(params.begin(), params.end()),
              groups,
              invocations,
              0,
              {},
              std::exchange(expectedFlops_, 0)};
    for (const Argument& argument : arguments) {
        use(argument.tensor);
        step.arguments.emplace_back(argument.name, argument.tensor);
    }
    steps_.push_back(std::move(step));
}

void Graph::fill(const Tensor& tensor, uint32_t word) {
    use(tensor);
    steps_.push_back(
        {Step::What::Fill, ops_.size() - 1, {}, {}, {{"", tensor}}, {}, {}, 0, word, {}});
}

void Graph::copy(const Tensor& source, const Tensor& target) {
    use(source);
    use(target);
    steps_.push_back({Step::What::Copy,
                      ops_.size() - 1,
                      {},
                      {},
                      {{"", source}, {"", target}},
                      {},
                      {},
                      0,
                      0,
                      {}});
}

// ---- what replays leave to the next -------------------------------------------------------------

void Graph::keep(const Tensor& tensor) {
    CHECK(!compiled_, "what is kept is named before compile()");
    storages_[size_t(tensor.storage)].kept = true;
}

void Graph::endPreparation() {
    CHECK(!compiled_ && preparationEnd_ == 0, "a graph has one preparation");
    preparationEnd_ = steps_.size();
}

void Graph::prepare() {
    CHECK(compiled_ && !preparation_.empty(), "this graph has a preparation");
    for (const Segments& segments : segments_) wait(segments);
    stageInputs(0);
    preparation_[0].recorder->submit();
    wait(preparation_);
    prepared_ = true;
}

// ---- reverse mode -------------------------------------------------------------------------------

void Graph::differentiate(std::vector<Tensor> inputs, std::vector<Tensor> outputs,
                          std::function<void()> backward) {
    bool any = std::ranges::any_of(inputs, [&](const Tensor& t) { return t && wantsGradient(t); });
    if (!any) return;
    for (const Tensor& output : outputs) storages_[size_t(output.storage)].differentiable = true;
    // Where an op counts its products, their two factors come first, and the gradient of each takes
    // as many again; backward() has begun the op when this runs.
    if (double flops = ops_.back().flops; flops > 0) {
        auto factors = std::ranges::count_if(
            inputs.begin(), inputs.begin() + std::min<std::ptrdiff_t>(2, std::ssize(inputs)),
            [&](const Tensor& t) { return wantsGradient(t); });
        backward = [this, total = static_cast<double>(factors) * flops,
                    inner = std::move(backward)] {
            ops_.back().flops = total;
            inner();
        };
    }
    differentiables_.push_back(
        {ops_.back().name, std::move(inputs), std::move(outputs), std::move(backward)});
}

void Graph::watch(const Tensor& tensor) { storages_[size_t(tensor.storage)].differentiable = true; }

bool Graph::wantsGradient(const Tensor& tensor) const {
    return tensor && storages_[size_t(tensor.storage)].differentiable;
}

bool Graph::hasGradient(const Tensor& tensor) const {
    return gradients_.contains({tensor.storage, tensor.offset});
}

Tensor Graph::gradient(const Tensor& output) {
    auto found = gradients_.find({output.storage, output.offset});
    if (found != gradients_.end()) return found->second.reshaped(output.shape);
    Tensor zeros = temporary(output.shape);
    fill(zeros, 0);
    gradients_[{output.storage, output.offset}] = zeros;
    return zeros;
}

Tensor Graph::gradientTarget(const Tensor& input) {
    CHECK(wantsGradient(input), "a gradient is asked for where one is wanted");
    GradientKey key{input.storage, input.offset};
    auto present = gradients_.find(key);
    if (present != gradients_.end()) {
        Tensor more = temporary(input.shape);
        pendingSums_.emplace_back(present->second.reshaped(input.shape), more);
        return more;
    }
    auto fixed = fixedGradients_.find(key);
    Tensor target = fixed != fixedGradients_.end() ? fixed->second.reshaped(input.shape)
                                                   : temporary(input.shape);
    gradients_[key] = target;
    return target;
}

void Graph::accumulateGradients() {
    for (auto& [total, more] : pendingSums_) {
        const auto n = static_cast<uint64_t>(total.elements());
        dispatch("elementwise/add.into", {{"total", total}, {"more", more}}, ElementParams{u32(n)},
                 pairInvocations(n));
    }
    pendingSums_.clear();
}

void Graph::backward(const Tensor& loss) {
    CHECK(loss.elements() == 1, "the loss is one number");
    std::vector<float> one{1.0f};
    backward({{loss, constant(std::span<const float>(one), loss.shape)}});
}

void Graph::backward(const std::vector<std::pair<Tensor, Tensor>>& upstream) {
    for (const auto& [output, gradient] : upstream) {
        CHECK(output.shape == gradient.shape, "dy has the shape of y");
        gradients_[{output.storage, output.offset}] = gradient;
    }
    // Ops were added in an order in which inputs come first, so the reverse order is right.
    std::vector<Differentiable> reversed = std::move(differentiables_);
    differentiables_.clear();
    for (auto op = reversed.rbegin(); op != reversed.rend(); ++op) {
        if (std::ranges::none_of(op->outputs, [&](const Tensor& t) { return hasGradient(t); })) {
            differentiables_.push_back(std::move(*op));  // for a later backward()
            continue;
        }
        beginOp(op->opName + ".backward", 0);
        op->backward();
        accumulateGradients();
    }
    std::ranges::reverse(differentiables_);
    if (!ranks_) return;
    std::vector<Tensor> fresh;
    for (const auto& [key, fixed] : fixedGradients_)
        if (gradients_.contains(key) && shared_.insert(key).second) fresh.push_back(fixed);
    shareGradients(fresh);
}

// ---- memory -------------------------------------------------------------------------------------

void Graph::planMemory(const CompileOptions& options) {
    for (Exchange& exchange : exchanges_) {
        if (!exchange.all) continue;
        // Nobody else may have its memory before it has left; what is gathered is there when it is
        // first used.
        Storage& mine = storages_[size_t(exchange.mine[0].storage)];
        mine.lastUse = std::max(mine.lastUse, static_cast<int>(exchange.ready) - 1);
        const int use = storages_[size_t(exchange.all.storage)].firstUse;
        CHECK(use >= 0, "what is gathered is used");
        exchange.needed = static_cast<size_t>(use);
    }
    for (const HostOutput& output : outputs_) {
        Storage& storage = storages_[size_t(output.tensor.storage)];
        if (storage.firstUse < 0) storage.firstUse = 0;
        storage.lastUse = static_cast<int>(steps_.size());
    }
    for (Storage& storage : storages_) {
        auto ofPreparation = [&](int use) { return static_cast<size_t>(use) < preparationEnd_; };
        if (storage.firstUse < 0) continue;
        storage.kept |= ofPreparation(storage.firstUse) && !ofPreparation(storage.lastUse);
        if (!storage.kept) continue;
        storage.firstUse = 0;
        storage.lastUse = static_cast<int>(steps_.size());
    }
    std::vector<size_t> order;
    for (size_t i = 0; i < storages_.size(); ++i)
        if (storages_[i].kind == Kind::Temporary && storages_[i].firstUse >= 0) order.push_back(i);
    // Largest first, each at the lowest place that is free while it lives: within a few per cent
    // of the best for networks, and simple.
    std::ranges::stable_sort(
        order, [&](size_t a, size_t b) { return storages_[a].bytes > storages_[b].bytes; });

    struct Place {
        size_t storage;
        uint64_t begin, end;
    };
    struct Block {
        std::vector<Place> places;  // by begin
        uint64_t bytes = 0;
    };
    uint64_t limit = device_.info().maxAllocationBytes;
    if (device_.binding() == Binding::Descriptors)
        limit = std::min<uint64_t>(limit, uint64_t{1} << 31);
    std::vector<Block> blocks;
    std::vector<std::pair<size_t, uint64_t>> assigned(storages_.size());
    unsharedBytes_ = 0;
    for (size_t index : order) {
        const Storage& storage = storages_[index];
        uint64_t size = alignUp(std::max<uint64_t>(storage.bytes, 16), kBufferAlignment);
        if (size > limit)
            throwMachine("a tensor of {} bytes is more than {} allocates at once ({})", size,
                         device_.info().name, limit);
        unsharedBytes_ += size;
        for (size_t b = 0;; ++b) {
            if (b == blocks.size()) blocks.emplace_back();
            Block& block = blocks[b];
            uint64_t at = 0;
            for (const Place& place : block.places) {
                const Storage& other = storages_[place.storage];
                bool together = !options.reuseMemory || (other.firstUse <= storage.lastUse &&
                                                         storage.firstUse <= other.lastUse);
                if (!together) continue;
                if (at + size <= place.begin) break;
                at = std::max(at, place.end);
            }
            if (at + size > limit) continue;
            auto position = std::ranges::upper_bound(block.places, at, {}, &Place::begin);
            block.places.insert(position, {index, at, at + size});
            block.bytes = std::max(block.bytes, at + size);
            assigned[index] = {b, at};
            break;
        }
    }
    plannedBytes_ = 0;
    for (const Block& block : blocks) plannedBytes_ += block.bytes;
    // Beside the temporaries: constants and inputs, and others' memory that the graph uses, such as
    // parameters with their gradients and moments.
    uint64_t needed = plannedBytes_;
    for (const Buffer& buffer : buffers_) needed += buffer.bytes();
    for (const HostInput& input : inputs_) needed += input.bytes;
    std::set<const Buffer*> others;
    for (const Storage& storage : storages_)
        if (storage.kind == Kind::Attached && storage.view.buffer)
            others.insert(storage.view.buffer);
    for (const Buffer* buffer : others) needed += buffer->bytes();
    if (options.memoryBudget > 0 && needed > options.memoryBudget) {
        const auto mebibytes = [](uint64_t bytes) { return alignUp(bytes, 1 << 20) >> 20; };
        throwInput(
            "this needs {} MiB of device memory, {} of them for activations, the memory budget is "
            "{} MiB; use a smaller preset or raise --memory",
            mebibytes(needed), mebibytes(plannedBytes_), options.memoryBudget >> 20);
    }

    size_t firstBlock = buffers_.size();
    for (const Block& block : blocks)
        buffers_.push_back(device_.allocate(block.bytes, Memory::Device));
    std::vector<std::pair<size_t, size_t>> inputBuffers;
    for (const HostInput& input : inputs_) {
        inputBuffers.emplace_back(size_t(input.storage), buffers_.size());
        buffers_.push_back(device_.allocate(input.bytes, Memory::Device));
    }
    // buffers_ moves no more.
    for (size_t index : order)
        storages_[index].view = {&buffers_[firstBlock + assigned[index].first],
                                 assigned[index].second, storages_[index].bytes};
    for (auto [storage, buffer] : inputBuffers)
        storages_[storage].view = {&buffers_[buffer], 0, storages_[storage].bytes};
    for (Storage& storage : storages_)
        if (storage.kind == Kind::Attached && !storage.view.buffer)
            storage.view = {&buffers_[storage.view.offset], 0, storage.bytes};
}

BufferView Graph::viewOf(const Tensor& tensor) const {
    const BufferView& whole = storages_[size_t(tensor.storage)].view;
    CHECK(whole.buffer && tensor.offset + tensor.bytes() <= whole.bytes,
          "a tensor {} lies within its storage", toString(tensor.shape));
    return {whole.buffer, whole.offset + tensor.offset, tensor.bytes()};
}

}  // namespace doppel
