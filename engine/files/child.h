// Work on a stranger's file by a library that may not survive it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace doppel {

// Does the work in a child process and returns its bytes. An InputError that it throws is
// thrown here. InputError "WHERE: expected …, found one that its reader does not
// survive" where the child crashes, throws anything else, or takes more than a minute of processor
// or 4 GiB of memory besides what this process has. MachineError where there can be no child.
//
// Other threads do not exist in the child: the work takes none of their locks, and draws nothing.
std::vector<uint8_t> inChild(const std::string& where, const std::string& expected,
                             const std::function<std::vector<uint8_t>()>& work);

}  // namespace doppel
