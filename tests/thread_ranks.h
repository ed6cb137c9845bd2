// Ranks that are threads of one process, for tests that look at all of them.
#pragma once

#include <barrier>
#include <cstring>
#include <exception>
#include <functional>
#include <thread>
#include <vector>

#include "nn/core/ranks.h"
#include "tests/op_test.h"

namespace doppel::test {

class ThreadRanks : public Ranks {
public:
    // Runs `work` as each of so many ranks; throws what the first of them threw.
    static void run(int count, const std::function<void(Ranks&)>& work) {
        Board board(count);
        std::vector<std::exception_ptr> errors(static_cast<size_t>(count));
        std::vector<std::jthread> threads;
        for (int rank = 0; rank < count; ++rank)
            threads.emplace_back([&, rank] {
                ThreadRanks mine(board, rank);
                try {
                    work(mine);
                } catch (...) {
                    errors[static_cast<size_t>(rank)] = std::current_exception();
                    board.barrier.arrive_and_drop();
                }
            });
        threads.clear();
        for (const std::exception_ptr& error : errors)
            if (error) std::rethrow_exception(error);
    }

    // The same, each with a device of its own.
    static void run(int count, const std::function<void(Ranks&, Device&)>& work) {
        const std::vector<Device*> devices = rankDevices(count);
        run(count,
            [&](Ranks& ranks) { work(ranks, *devices[static_cast<size_t>(ranks.rank())]); });
    }

    int rank() const override { return rank_; }
    int size() const override { return static_cast<int>(board_.data.size()); }

    void allToAll(const std::byte* out, std::byte* in, size_t bytes) override {
        share(out, [&](size_t from, const std::byte* data) {
            std::memcpy(in + from * bytes, data + static_cast<size_t>(rank_) * bytes, bytes);
        });
    }
    void allGather(const std::byte* mine, std::byte* all, size_t bytes) override {
        share(mine, [&](size_t from, const std::byte* data) {
            std::memcpy(all + from * bytes, data, bytes);
        });
    }
    void broadcast(std::byte* data, size_t bytes) override {
        share(data, [&](size_t from, const std::byte* theirs) {
            if (from == 0 && rank_ != 0) std::memcpy(data, theirs, bytes);
        });
    }

private:
    struct Board {
        explicit Board(int count) : data(static_cast<size_t>(count)), barrier(count) {}
        std::vector<const std::byte*> data;
        std::barrier<> barrier;
    };
    ThreadRanks(Board& board, int rank) : board_(board), rank_(rank) {}

    void share(const std::byte* mine,
               const std::function<void(size_t from, const std::byte*)>& take) {
        board_.data[static_cast<size_t>(rank_)] = mine;
        board_.barrier.arrive_and_wait();
        for (size_t from = 0; from < board_.data.size(); ++from) take(from, board_.data[from]);
        board_.barrier.arrive_and_wait();
    }

    Board& board_;
    int rank_;
};

}  // namespace doppel::test
