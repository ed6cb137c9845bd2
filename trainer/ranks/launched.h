// What `mpirun` started together with this process. MPI is in a module of its own, doppel-mpi.so,
// which is loaded only then, so that the program needs none.
#pragma once

#include <functional>
#include <string>

#include "nn/core/ranks.h"

namespace doppel {

// A process of several that a launcher started.
class LaunchedRanks : public Ranks {
public:
    std::function<bool()> stopping;             // whether this process was asked to stop
    virtual int localRank() const = 0;          // among those on the same machine
    virtual std::string transport() const = 0;  // "Open MPI 4.1.4"
    // For one that has failed: waits two seconds at most for the others to say the same.
    virtual bool allHaveFailed() = 0;
    // Ends this process's part: 0 waits for the others' ends, anything else ends them all.
    virtual void end(int status) = 0;
};

// null where this process was started alone. MachineError where it was not, and the program was
// built without MPI.
LaunchedRanks* launchedRanks();

// --device as this rank takes it: as it was asked for or, where nothing was asked for and the
// machine has several of its best device, the next one for each of the machine's ranks.
std::string deviceOf(const LaunchedRanks& ranks, const std::string& asked);

}  // namespace doppel
