// Recording a graph once, and running it again and again.
#include "nn/core/graph.h"

#include <algorithm>
#include <cstring>
#include <set>

namespace doppel {

namespace {

// A workgroup costs a CPU two microseconds before it does anything, so that large dispatches get
// large ones there; every device has workgroups of so many. What a kernel computes does not depend
// on it.
constexpr uint32_t kLargeWorkgroup = 256;
constexpr uint64_t kLargeDispatch = 64 * kLargeWorkgroup;  // with work left for many cores

}  // namespace

void Graph::compile(const CompileOptions& options) {
    CHECK(!compiled_, "a graph is compiled once");
    planMemory(options);
    uint64_t uploadBytes = 0, readbackBytes = 0;
    for (HostInput& input : inputs_) {
        input.stagingOffset = uploadBytes;
        uploadBytes += alignUp(input.bytes, kBufferAlignment);
    }
    for (HostOutput& output : outputs_) {
        output.stagingOffset = readbackBytes;
        readbackBytes += alignUp(output.tensor.bytes(), kBufferAlignment);
    }
    for (int slot = 0; slot < 2; ++slot) {
        upload_[slot] = device_.allocate(uploadBytes, Memory::Upload);
        readback_[slot] = device_.allocate(readbackBytes, Memory::Readback);
    }
    for (Exchange& exchange : exchanges_) {
        uint64_t bytes = 0;
        for (const Tensor& one : exchange.mine) bytes += one.bytes();
        exchange.send = device_.allocate(bytes, Memory::Readback);
        exchange.receive =
            device_.allocate(exchange.all ? exchange.all.bytes() : bytes, Memory::Upload);
    }
    for (int slot = 0; slot < 2; ++slot)
        segments_[slot] = recorded(slot, preparationEnd_, steps_.size(), options);
    if (preparationEnd_ > 0) preparation_ = recorded(0, 0, preparationEnd_, options);
    compiled_ = true;
}

// A recording of the steps [begin, end), cut where ranks exchange something.
Graph::Segments Graph::recorded(int slot, size_t begin, size_t end, const CompileOptions& options) {
    std::set<size_t> cuts{end};
    for (const Exchange& exchange : exchanges_) {
        CHECK(exchange.ready > preparationEnd_, "a preparation exchanges nothing");
        if (end == preparationEnd_) continue;
        cuts.insert(exchange.ready);
        cuts.insert(exchange.needed);
    }
    CHECK(cuts.size() == 1 || !options.timestamps, "what several ranks run has no profile");
    Segments segments;
    for (size_t cut : cuts)
        segments.push_back({segments.empty() ? begin : segments.back().end, cut, nullptr});
    // What comes last may have nothing to run behind it, but is there for the host.
    if (end != preparationEnd_ && std::ranges::count(exchanges_, end, &Exchange::needed) > 0)
        segments.push_back({end, end, nullptr});
    for (Segment& segment : segments)
        record(segment, slot, &segment == &segments.front(), &segment == &segments.back(), options);
    return segments;
}

void Graph::record(Segment& segment, int slot, bool first, bool last,
                   const CompileOptions& options) {
    segment.recorder = std::make_unique<Recorder>(device_);
    Recorder& recorder = *segment.recorder;
    const bool preparing = segment.begin < preparationEnd_;
    for (const HostInput& input : inputs_)
        if (input.bytes > 0 && first)
            recorder.copy({&upload_[slot], input.stagingOffset, input.bytes},
                          storages_[size_t(input.storage)].view);
    if (options.poison && first)
        for (const Storage& storage : storages_)
            if (storage.kind == Kind::Temporary && storage.view.buffer && storage.bytes > 0 &&
                (preparing || !storage.kept))
                recorder.fill(storage.view, 0xffffffffu);
    for (const Exchange& exchange : exchanges_) {
        if (exchange.needed != segment.begin || first) continue;
        uint64_t at = 0;
        for (const Tensor& one : exchange.all ? std::vector<Tensor>{exchange.all} : exchange.mine) {
            recorder.copy({&exchange.receive, at, one.bytes()}, viewOf(one));
            at += one.bytes();
        }
    }
    if (options.timestamps) recorder.timestamp();
    for (size_t i = segment.begin; i < segment.end; ++i) {
        const Step& step = steps_[i];
        Recorder::Work work{step.flops, 0};
        for (const auto& [name, tensor] : step.arguments)
            work.bytes += static_cast<double>(tensor.bytes());
        recorder.expect(work);
        switch (step.what) {
            case Step::What::Fill:
                if (step.arguments[0].second.bytes() > 0)
                    recorder.fill(viewOf(step.arguments[0].second), step.word);
                break;
            case Step::What::Copy:
                if (step.arguments[0].second.bytes() > 0)
                    recorder.copy(viewOf(step.arguments[0].second),
                                  viewOf(step.arguments[1].second));
                break;
            case Step::What::Dispatch: {
                Specialisation spec = step.spec;
                Groups groups = step.groups;
                if (groups.x == 0 && step.invocations >= kLargeDispatch &&
                    device_.kernelPath().onCpu)
                    spec.try_emplace("local_size", kLargeWorkgroup);
                const Kernel& kernel = device_.kernel(step.kernel, spec);
                if (groups.x == 0)
                    groups =
                        linearGroups(step.invocations, kernel.localSize(), recorder.pieces(work));
                std::vector<BoundBuffer> buffers;
                for (const auto& [name, tensor] : step.arguments)
                    buffers.push_back({name, viewOf(tensor)});
                if (step.indirect)
                    recorder.dispatchIndirect(kernel, buffers, step.params, viewOf(step.indirect));
                else
                    recorder.dispatch(kernel, buffers, step.params, groups, recorder.pieces(work));
                break;
            }
        }
        bool lastOfOp = i + 1 == segment.end || steps_[i + 1].op != step.op;
        if (options.timestamps && lastOfOp) recorder.timestamp();
    }
    for (const Exchange& exchange : exchanges_) {
        if (exchange.ready != segment.end || segment.begin == segment.end || preparing) continue;
        uint64_t at = 0;
        for (const Tensor& one : exchange.mine) {
            recorder.copy(viewOf(one), {&exchange.send, at, one.bytes()});
            at += one.bytes();
        }
    }
    for (const HostOutput& output : outputs_)
        if (output.tensor.bytes() > 0 && !preparing && last)
            recorder.copy(viewOf(output.tensor),
                          {&readback_[slot], output.stagingOffset, output.tensor.bytes()});
    recorder.finish();
}

void Graph::writeBytes(const Tensor& tensor, std::span<const std::byte> bytes) {
    auto input = std::ranges::find(inputs_, tensor.storage, &HostInput::storage);
    CHECK(input != inputs_.end(), "only inputs are written");
    CHECK(bytes.size() == tensor.bytes(), "{} bytes fill an input of shape {}", bytes.size(),
          toString(tensor.shape));
    // The same as before, a texture of all frames for instance, is not uploaded again.
    std::byte* value = input->value.data() + tensor.offset;
    if (bytes.empty() || std::memcmp(value, bytes.data(), bytes.size()) == 0) return;
    std::ranges::copy(bytes, value);
    ++input->version;
}

void Graph::submit() {
    CHECK(compiled_, "a graph is compiled before it runs");
    CHECK(preparation_.empty() || prepared_,
          "a graph with a preparation is prepared before it runs");
    Segments& segments = segments_[slot_];
    wait(segments);  // this slot's replay before last still reads its staging memory
    stageInputs(slot_);
    // Whatever has left the device by the time that something is needed follows while the device
    // works on what needed it: an order that does not depend on how fast a rank is.
    std::vector<bool> done(exchanges_.size());
    size_t left = 0;
    auto take = [&](auto&& isDue) {
        for (size_t k = 0; k < exchanges_.size(); ++k) {
            if (done[k] || !isDue(exchanges_[k])) continue;
            complete(exchanges_[k], segments);
            done[k] = true;
            left = std::max(left, exchanges_[k].ready);
        }
    };
    for (Segment& segment : segments) {
        const bool first = &segment == &segments.front();
        take([&](const Exchange& one) { return !first && one.needed == segment.begin; });
        segment.recorder->submit();
        take([&](const Exchange& one) { return one.ready <= left; });
    }
    slot_ ^= 1;
    ++replays_;
}

// Waits for what this rank has to send, and brings what comes of it to where the device finds it.
void Graph::complete(Exchange& exchange, const Segments& segments) {
    const auto sender = std::ranges::find(segments, exchange.ready, &Segment::end);
    CHECK(sender != segments.end(), "a segment ends where an exchange begins");
    sender->recorder->wait();
    auto floats = [](Buffer& buffer) {
        return std::span(reinterpret_cast<float*>(buffer.mapped()), buffer.bytes() / sizeof(float));
    };
    std::span<float> mine = floats(exchange.send), result = floats(exchange.receive);
    if (exchange.all) {
        const auto n = static_cast<size_t>(exchange.mine[0].elements());
        ranks_->gather(mine.first(n), result.first(n * static_cast<size_t>(ranks_->size())),
                       static_cast<size_t>(exchange.rows));
        return;
    }
    uint64_t bytes = 0;
    for (const Tensor& one : exchange.mine) bytes += one.bytes();
    const size_t n = bytes / sizeof(float);
    ranks_->average(mine.first(n));
    std::ranges::copy(mine.first(n), result.begin());
}

void Graph::wait(const Segments& segments) {
    for (const Segment& segment : segments) segment.recorder->wait();
}

size_t Graph::submissionCount() const {
    size_t count = 0;
    for (const Segment& segment : segments_[0]) count += segment.recorder->submissionCount();
    return count;
}

void Graph::stageInputs(int slot) {
    for (HostInput& input : inputs_) {
        if (input.slotVersion[slot] == input.version) continue;
        std::ranges::copy(input.value, upload_[slot].mapped() + input.stagingOffset);
        input.slotVersion[slot] = input.version;
    }
}

int Graph::slotOf(int back) const {
    CHECK(back >= 0 && back < 2 && back < replays_,
          "of the {} replays so far, the newest or the one before is waited for, not {} back",
          replays_, back);
    return slot_ ^ 1 ^ back;
}

void Graph::wait(int back) { wait(segments_[slotOf(back)]); }

void Graph::readBytes(const Tensor& tensor, std::span<std::byte> bytes, int back) {
    wait(back);
    auto output = std::ranges::find_if(outputs_, [&](const HostOutput& o) {
        return o.tensor.storage == tensor.storage && o.tensor.offset == tensor.offset;
    });
    CHECK(output != outputs_.end(), "only outputs are read");
    const std::byte* source = readback_[slotOf(back)].mapped() + output->stagingOffset;
    std::copy(source, source + bytes.size(), bytes.begin());
}

std::vector<OpProfile> Graph::profile() {
    std::vector<double> times = segments_[slot_ ^ 1][0].recorder->timestamps();
    std::vector<OpProfile> profiles;
    size_t stamp = 0;
    for (size_t i = preparationEnd_; i < steps_.size(); ++i) {
        const Step& step = steps_[i];
        if (i == preparationEnd_ || steps_[i - 1].op != step.op)
            profiles.push_back({ops_[step.op].name, 0, ops_[step.op].flops, 0});
        for (const auto& [name, tensor] : step.arguments) profiles.back().bytes += tensor.bytes();
        bool lastOfOp = i + 1 == steps_.size() || steps_[i + 1].op != step.op;
        if (lastOfOp && stamp + 1 < times.size()) {
            profiles.back().milliseconds = (times[stamp + 1] - times[stamp]) * 1e-6;
            ++stamp;
        }
    }
    return profiles;
}

std::string Graph::print() {
    std::string text = fmt::format("{:<40} {:>10} {:>10} {:>10}\n", "op", "MiB", "MFLOP", "ms");
    for (const OpProfile& op : profile())
        text += fmt::format("{:<40} {:>10.2f} {:>10.2f} {:>10.3f}\n", op.name,
                            static_cast<double>(op.bytes) / (1 << 20), op.flops * 1e-6,
                            op.milliseconds);
    return text;
}

}  // namespace doppel
