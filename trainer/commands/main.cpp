#include <unistd.h>

#include <cstdio>
#include <iostream>
#include <sstream>

#include "engine/instance.h"
#include "trainer/commands/cli.h"
#include "trainer/data/progress.h"
#include "trainer/ranks/launched.h"

namespace doppel {

namespace {

// Of several processes rank 0 speaks. Another one's last words are heard where it failed alone:
// most mistakes of users are all processes' alike.
int runOneOf(LaunchedRanks& ranks, const std::vector<std::string>& arguments) {
    const bool leads = ranks.rank() == 0;
    const int heard = dup(STDERR_FILENO);
    if (!leads &&
        (!std::freopen("/dev/null", "w", stdout) || !std::freopen("/dev/null", "w", stderr)))
        return 1;
    std::ostringstream unheard;
    int status = 2;
    if (arguments.empty() || (arguments[0] != "train" && !arguments[0].starts_with('-')))
        (leads ? std::cerr : unheard)
            << "doppel: several processes train one avatar (mpirun -n N doppel train …); other "
               "commands take one\n";
    else
        status = runCommandLine(arguments, std::cout, leads ? std::cerr : unheard);
    const bool stopped = interrupted() || status == interruptStatus();
    if (status == 0 || stopped || ranks.allHaveFailed()) {
        ranks.end(0);
        return status;
    }
    const std::string words =
        fmt::format("of {} processes, number {}: {}", ranks.size(), ranks.rank(), unheard.str());
    if (!leads && write(heard, words.data(), words.size()) < 0) status = 1;
    ranks.end(status);
    return status;
}

}  // namespace

}  // namespace doppel

int main(int argc, char** argv) {
    doppel::separateShaderCaches();
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    try {
        if (doppel::LaunchedRanks* ranks = doppel::launchedRanks())
            return doppel::runOneOf(*ranks, arguments);
    } catch (const doppel::MachineError& error) {
        std::cerr << "doppel: " << error.what() << "\n";
        return 1;
    }
    return doppel::runCommandLine(arguments, std::cout, std::cerr);
}
