// The processes that train one avatar together, each with a device of its own: they run the same
// program on the same settings, each takes its part of every batch, and gradients are averaged
// before each update, so that all of them hold the same parameters.
//
//     graph.join(ranks);                      // before any op
//     … preset.batch / sizeOf(ranks) samples …
//     graph.backward(losses.sum());           // gradients of parameters are the mean over all
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace doppel {

// What carries bytes between them (trainer/ranks has MPI's). All ranks call the same functions in
// the same order; each returns when its results are there. MachineError where a transfer fails.
class Ranks {
public:
    virtual ~Ranks() = default;
    virtual int rank() const = 0;  // this process's number, from 0
    virtual int size() const = 0;  // how many there are

    // out [size,bytes]: for each rank; in [size,bytes]: from each rank, in their order.
    virtual void allToAll(const std::byte* out, std::byte* in, size_t bytes) = 0;
    // all [size,bytes]: each rank's `mine`, in their order.
    virtual void allGather(const std::byte* mine, std::byte* all, size_t bytes) = 0;
    // data becomes rank 0's.
    virtual void broadcast(std::byte* data, size_t bytes) = 0;

    // Returns when all have called it.
    void barrier();
    // Every rank's values become the mean over all, summed in the order of ranks, with the same
    // bits everywhere. Each number travels twice, which is the least possible: to the rank that
    // sums it, and from there to all.
    void average(std::span<float> values);
    // Bytes that this rank has sent in average() and allGather() so far.
    uint64_t bytesSent() const { return bytesSent_; }
    // all [rows,size,n] of mine [rows,n]: each row's parts lie side by side, in the order of ranks.
    void gather(std::span<const float> mine, std::span<float> all, size_t rows);

private:
    uint64_t bytesSent_ = 0;
    std::vector<float> out_, in_;
};

// null stands for a single process.
inline int sizeOf(const Ranks* ranks) { return ranks ? ranks->size() : 1; }
inline int rankOf(const Ranks* ranks) { return ranks ? ranks->rank() : 0; }

// The part of a batch that this rank takes; the batch's size is a multiple of the number of ranks.
template <typename T>
std::span<const T> partOf(const Ranks* ranks, const std::vector<T>& batch) {
    const size_t each = batch.size() / static_cast<size_t>(sizeOf(ranks));
    return std::span<const T>(batch).subspan(each * static_cast<size_t>(rankOf(ranks)), each);
}

}  // namespace doppel
