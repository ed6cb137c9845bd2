// The module doppel-mpi.so: LaunchedRanks by MPI, whose own handler ends all processes where a
// transfer fails.
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <climits>
#include <iostream>
#include <optional>
#include <thread>

#include "engine/error.h"
#include "trainer/ranks/launched.h"

namespace doppel {

namespace {

class MpiRanks : public LaunchedRanks {
public:
    MpiRanks() {
        MPI_Init(nullptr, nullptr);
        MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
        MPI_Comm_size(MPI_COMM_WORLD, &size_);
        MPI_Comm machine = MPI_COMM_NULL;
        MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, rank_, MPI_INFO_NULL, &machine);
        MPI_Comm_rank(machine, &localRank_);
        MPI_Comm_free(&machine);
        MPI_Comm_dup(MPI_COMM_WORLD, &failures_);
    }

    int rank() const override { return rank_; }
    int size() const override { return size_; }
    int localRank() const override { return localRank_; }

    std::string transport() const override {
        std::string text(MPI_MAX_LIBRARY_VERSION_STRING, 0);
        int length = 0;
        MPI_Get_library_version(text.data(), &length);
        return text.substr(0, text.find(','));
    }

    void allToAll(const std::byte* out, std::byte* in, size_t bytes) override {
        MPI_Request request = MPI_REQUEST_NULL;
        MPI_Ialltoall(out, count(bytes), MPI_BYTE, in, count(bytes), MPI_BYTE, MPI_COMM_WORLD,
                      &request);
        await(request);
    }
    void allGather(const std::byte* mine, std::byte* all, size_t bytes) override {
        MPI_Request request = MPI_REQUEST_NULL;
        MPI_Iallgather(mine, count(bytes), MPI_BYTE, all, count(bytes), MPI_BYTE, MPI_COMM_WORLD,
                       &request);
        await(request);
    }
    void broadcast(std::byte* data, size_t bytes) override {
        constexpr size_t kPart = size_t{1} << 30;
        for (size_t at = 0; at < bytes; at += kPart) {
            MPI_Request request = MPI_REQUEST_NULL;
            MPI_Ibcast(data + at, count(std::min(kPart, bytes - at)), MPI_BYTE, 0, MPI_COMM_WORLD,
                       &request);
            await(request);
        }
    }

    bool allHaveFailed() override {
        MPI_Request request = MPI_REQUEST_NULL;
        MPI_Ibarrier(failures_, &request);
        for (int i = 0; i < 200; ++i) {
            int done = 0;
            MPI_Test(&request, &done, MPI_STATUS_IGNORE);
            if (done) return true;
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        return false;
    }
    void end(int status) override {
        if (status == 0)
            MPI_Finalize();
        else
            MPI_Abort(MPI_COMM_WORLD, status);
    }

private:
    using Clock = std::chrono::steady_clock;

    // A launcher gives those that another has left a second to end. Where a stop was asked for and
    // the others do not come, the first process says what that may mean, once, and waits on.
    void await(MPI_Request& request) {
        constexpr auto kPatience = std::chrono::milliseconds(500);
        int done = 0;
        MPI_Test(&request, &done, MPI_STATUS_IGNORE);
        for (std::optional<Clock::time_point> since; !done;
             MPI_Test(&request, &done, MPI_STATUS_IGNORE)) {
            if (rank_ != 0 || said_ || !stopping || !stopping()) continue;
            const Clock::time_point now = Clock::now();
            if (!since) since = now;
            if (now - *since < kPatience) continue;
            said_ = true;
            std::cerr << "doppel: stopped, and waits for the other processes; if one of them has "
                         "ended, the same command goes on from the newest checkpoint"
                      << std::endl;
        }
    }
    static int count(size_t bytes) {
        if (bytes > INT_MAX) throwMachine("MPI transfers {} bytes at most, not {}", INT_MAX, bytes);
        return static_cast<int>(bytes);
    }

    int rank_ = 0, size_ = 1, localRank_ = 0;
    bool said_ = false;
    MPI_Comm failures_ = MPI_COMM_NULL;  // apart from transfers that others may be in
};

}  // namespace

}  // namespace doppel

extern "C" doppel::LaunchedRanks* doppelRanks();
// Lives as long as the process.
doppel::LaunchedRanks* doppelRanks() { return new doppel::MpiRanks; }
