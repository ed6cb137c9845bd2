// Libraries of ours that the program loads when it first needs them, for what few runs need or what
// is slow to load.
#pragma once

#include <string>

namespace doppel {

// The function of this name in a module ("doppel-mpi.so"), which is loaded from modulesFolder() or,
// where another program has our library linked in, from that program's run path. MachineError says
// why it cannot be loaded, and the advice. global: the module's libraries see each other's symbols.
void* moduleFunction(const char* module, const char* function, const std::string& advice,
                     bool global = false);

}  // namespace doppel
