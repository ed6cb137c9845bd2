// A static graph of ops: built once, memory planned, reversed, recorded, replayed.
//
//     Graph graph(device);
//     Tensor x = graph.input({64, 3});
//     Tensor w = graph.parameter(parameters, "w");
//     Tensor y = leakyRelu(graph, linear(graph, x, w, b), 0.2f);
//     graph.backward(loss);
//     graph.output(loss);
//     graph.compile();
//     graph.write(x, values); graph.run(); graph.read<float>(loss);
#pragma once

#include <functional>
#include <initializer_list>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "engine/recorder.h"
#include "nn/core/parameters.h"
#include "nn/core/ranks.h"
#include "nn/core/tensor.h"
#include "shaders/common/step_params.h"

namespace doppel {

struct Argument {
    const char* name;  // as the shader calls it
    Tensor tensor;
};

struct CompileOptions {
    uint64_t memoryBudget = 0;  // bytes for temporaries; 0: as much as the device gives
    bool reuseMemory = true;    // temporaries with disjoint lifetimes share memory
    bool poison = false;        // fill temporaries with NaN first, so that an unwritten one shows
    bool timestamps = false;    // time per op, see profile()
    // Steps of a training (nn/steps) share their batches with these; null: they have them whole.
    Ranks* ranks = nullptr;
};

struct OpProfile {
    std::string name;
    uint64_t bytes = 0;  // of all buffers bound to its dispatches
    double flops = 0;
    double milliseconds = 0;
};

class Graph {
public:
    explicit Graph(Device& device);
    ~Graph();
    Graph(const Graph&) = delete;
    Graph& operator=(const Graph&) = delete;

    Device& device() { return device_; }

    // ---- ranks ------------------------------------------------------------------------------
    // What this graph computes is one rank's part of a batch; before any op. null: all of it.
    void join(Ranks* ranks);
    Ranks* ranks() const { return ranks_; }
    // mine [rows,n] of all ranks side by side, [rows,size,n]. No gradient flows through it.
    Tensor ofAllRanks(const Tensor& mine, int64_t rows = 1);

    // ---- tensors ----------------------------------------------------------------------------
    // Written by the host between replays; keeps its last value.
    Tensor input(Shape shape, ElementType type = ElementType::F32);
    // As input, and a gradient is computed for it.
    Tensor variable(Shape shape);
    // Uploaded once.
    Tensor constant(std::span<const float> values, Shape shape);
    Tensor constant(std::span<const int32_t> values, Shape shape);
    // Memory that somebody else owns and keeps alive.
    Tensor attach(const BufferView& view, Shape shape, ElementType type = ElementType::F32);
    // Its gradient lands in the parameters' gradient section.
    Tensor parameter(const Parameters& parameters, std::string_view name);
    // Memory that lives from its first use to its last in one replay.
    Tensor temporary(Shape shape, ElementType type = ElementType::F32);
    // Stands in where a kernel declares a buffer that this call does not need.
    Tensor none();
    // The StepParams of this graph, [8] of four bytes; see setStep().
    Tensor step();
    // Reads this tensor back after each replay.
    void output(const Tensor& tensor);

    // ---- for ops ----------------------------------------------------------------------------
    // Names what follows for profiles and errors, until the next call. flops: multiply and add
    // count as two.
    void beginOp(std::string name, double flops = 0);
    // Of the next dispatch alone, if they are many: it is cut where it may take a slow device too
    // long (Recorder::Work).
    void expectFlops(double flops) { expectedFlops_ = flops; }
    template <typename Params>
    void dispatch(const char* kernel, std::initializer_list<Argument> arguments,
                  const Params& params, uint64_t invocations, const Specialisation& spec = {}) {
        dispatchGroups(kernel, arguments, params, {0, 0, 0}, spec, invocations);
    }
    // With explicit workgroups (of spec "local_size", 64 unless given).
    template <typename Params>
    void dispatchGroups(const char* kernel, std::initializer_list<Argument> arguments,
                        const Params& params, Groups groups, const Specialisation& spec = {},
                        uint64_t invocations = 0) {
        static_assert(std::is_trivially_copyable_v<Params>);
        addDispatch(kernel, arguments, std::as_bytes(std::span(&params, 1)), groups, invocations,
                    spec);
    }
    // With as many workgroups as `groups` [3] says in each replay.
    template <typename Params>
    void dispatchIndirect(const char* kernel, std::initializer_list<Argument> arguments,
                          const Params& params, const Tensor& groups,
                          const Specialisation& spec = {}) {
        use(groups);
        dispatchGroups(kernel, arguments, params, {}, spec);
        steps_.back().indirect = groups;
    }
    void fill(const Tensor& tensor, uint32_t word = 0);
    void copy(const Tensor& source, const Tensor& target);

    // Declares how gradients flow from outputs to inputs. The function runs when the graph is
    // reversed, if any output has a gradient; it fetches gradient(output), and for every input
    // that wantsGradient() writes all of gradientTarget(input).
    void differentiate(std::vector<Tensor> inputs, std::vector<Tensor> outputs,
                       std::function<void()> backward);
    // Computes a gradient for this tensor though no op hands one on (a row of a trained table).
    void watch(const Tensor& tensor);
    bool wantsGradient(const Tensor& tensor) const;
    bool hasGradient(const Tensor& tensor) const;
    Tensor gradient(const Tensor& output);  // zeros where nothing flowed back to this output
    Tensor gradientTarget(const Tensor& input);

    // ---- reverse mode -----------------------------------------------------------------------
    // Gradients of a scalar loss, its own being 1; where ranks share the batch, those of parameters
    // are the mean over all ranks, whatever runs after this. Ops that the loss does not depend on
    // are left for a later backward(), so that one graph holds several updates, one after the
    // other; but each op is reversed once.
    void backward(const Tensor& loss);
    // Gradients of sum over pairs of <output, upstream>.
    void backward(const std::vector<std::pair<Tensor, Tensor>>& upstream);

    // ---- what replays leave to the next -----------------------------------------------------
    // This temporary's memory is its own, so that the next replay finds what this one left there.
    void keep(const Tensor& tensor);
    // What was added so far is the preparation, which prepare() runs and submit() does not: what
    // depends on parameters and on inputs that seldom change. Tensors of it that later ops use
    // keep what it left.
    void endPreparation();
    // Runs the preparation with the inputs as written, and waits. Comes before the first submit().
    void prepare();

    // ---- running ----------------------------------------------------------------------------
    void compile(const CompileOptions& options = {});
    template <typename T>
    void write(const Tensor& input, std::span<const T> values) {
        static_assert(sizeof(T) == 4);
        writeBytes(input, std::as_bytes(values));
    }
    void write(const Tensor& input, const std::vector<float>& values) {
        write(input, std::span<const float>(values));
    }
    void write(const Tensor& input, const std::vector<int32_t>& values) {
        write(input, std::span<const int32_t>(values));
    }
    void setStep(const StepParams& params);
    // Starts a replay with the inputs as written; up to two are in flight.
    void submit();
    // Waits for the newest replay, or for the one before it (back = 1).
    void wait(int back = 0);
    void run() {
        submit();
        wait();
    }
    // Of an output() tensor, from the newest replay, or from the one before it (back = 1), so that
    // the newest goes on meanwhile; waits for it.
    template <typename T = float>
    std::vector<T> read(const Tensor& output, int back = 0) {
        static_assert(sizeof(T) == 4);
        std::vector<T> values(static_cast<size_t>(output.elements()));
        readBytes(output, std::as_writable_bytes(std::span(values)), back);
        return values;
    }
    // The same into memory that is there.
    template <typename T>
    void read(const Tensor& output, std::span<T> values, int back = 0) {
        static_assert(sizeof(T) == 4);
        readBytes(output, std::as_writable_bytes(values), back);
    }
    float readScalar(const Tensor& output, int back = 0) { return read<float>(output, back).at(0); }

    // Bytes of the planned memory, and what it would take without reuse.
    uint64_t temporaryBytes() const { return plannedBytes_; }
    uint64_t unsharedBytes() const { return unsharedBytes_; }
    size_t dispatchCount() const { return steps_.size(); }
    // Of one replay, see Recorder::expect().
    size_t submissionCount() const;
    // Per op, in order, of the newest replay (compiled with timestamps).
    std::vector<OpProfile> profile();
    // The program: op, dispatches, bytes, flops, and time where there is one.
    std::string print();

private:
    enum class Kind { Input, Attached, Temporary };
    struct Storage {
        Kind kind;
        uint64_t bytes = 0;
        int firstUse = -1, lastUse = -1;  // steps
        bool differentiable = false, kept = false;
        BufferView view;  // known from the start (Attached) or after compile()
    };
    struct Step {
        enum class What { Dispatch, Fill, Copy } what;
        size_t op = 0;
        std::string kernel;
        Specialisation spec;
        std::vector<std::pair<std::string, Tensor>> arguments;  // Copy: source, target
        std::vector<std::byte> params;
        Groups groups;
        uint64_t invocations = 0;
        uint32_t word = 0;
        Tensor indirect;  // where the number of workgroups is read from
        double flops = 0;
    };
    struct Op {
        std::string name;
        double flops = 0;
    };
    struct Differentiable {
        std::string opName;
        std::vector<Tensor> inputs, outputs;
        std::function<void()> backward;
    };
    struct GradientKey {
        int storage;
        uint64_t offset;
        auto operator<=>(const GradientKey&) const = default;
    };
    struct HostInput {
        int storage;
        uint64_t stagingOffset, bytes;
        std::vector<std::byte> value;
        uint64_t version = 0;
        uint64_t slotVersion[2] = {0, 0};
    };
    struct HostOutput {
        Tensor tensor;
        uint64_t stagingOffset;
    };
    // Tensors that ranks exchange in the middle of a replay. They are final before the step
    // `ready`, and what becomes of them is there before the step `needed`; what lies between runs
    // meanwhile.
    struct Exchange {
        std::vector<Tensor> mine;  // averaged in place, or one that is gathered
        Tensor all;                // gathered here; empty: averaged
        int64_t rows = 1;
        size_t ready = 0, needed = 0;
        Buffer send, receive;
    };
    // Steps [begin,end) of a replay: all of it, where there are no exchanges.
    struct Segment {
        size_t begin, end;
        std::unique_ptr<Recorder> recorder;
    };
    using Segments = std::vector<Segment>;

    Tensor newStorage(Kind kind, Shape shape, ElementType type);
    Tensor newConstant(std::span<const std::byte> bytes, Shape shape, ElementType type);
    void addDispatch(const char* kernel, std::initializer_list<Argument> arguments,
                     std::span<const std::byte> params, Groups groups, uint64_t invocations,
                     const Specialisation& spec);
    void use(const Tensor& tensor);
    void accumulateGradients();
    void writeBytes(const Tensor& input, std::span<const std::byte> bytes);
    void readBytes(const Tensor& output, std::span<std::byte> bytes, int back);
    int slotOf(int back) const;
    void planMemory(const CompileOptions& options);
    void shareGradients(const std::vector<Tensor>& gradients);
    Segments recorded(int slot, size_t begin, size_t end, const CompileOptions& options);
    void record(Segment& segment, int slot, bool first, bool last, const CompileOptions& options);
    void complete(Exchange& exchange, const Segments& segments);
    static void wait(const Segments& segments);
    void stageInputs(int slot);
    BufferView viewOf(const Tensor& tensor) const;

    Device& device_;
    std::vector<Storage> storages_;
    std::vector<Op> ops_;
    std::vector<Step> steps_;
    std::vector<Differentiable> differentiables_;
    std::map<GradientKey, Tensor> gradients_;
    std::map<GradientKey, Tensor> fixedGradients_;  // parameters: where the gradient must land
    std::set<GradientKey> shared_;                  // of them, those that ranks have exchanged
    std::vector<std::pair<Tensor, Tensor>> pendingSums_;
    std::vector<HostInput> inputs_;
    std::vector<HostOutput> outputs_;
    std::vector<Buffer> buffers_;  // constants, inputs, temporaries
    Buffer upload_[2], readback_[2];
    Segments segments_[2], preparation_;
    Ranks* ranks_ = nullptr;
    std::vector<Exchange> exchanges_;  // in the order in which all ranks make them
    size_t preparationEnd_ = 0;        // steps
    bool prepared_ = false;
    Tensor none_, step_;
    int slot_ = 0;         // of the next submission
    int64_t replays_ = 0;  // submitted so far
    bool compiled_ = false;
    uint64_t plannedBytes_ = 0, unsharedBytes_ = 0;
    double expectedFlops_ = 0;
};

}  // namespace doppel
