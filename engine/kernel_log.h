// Which kernels this process has recorded for a device: the tests ask whether each entry of each
// shader ran.
#pragma once

#include <set>
#include <string>
#include <string_view>

namespace doppel {

// One line per kernel and flavour, "<family>/<op>.<entry> addresses" or "... descriptors". Any
// thread may note a kernel or ask.
void noteKernel(std::string_view kernel, bool descriptors);
std::set<std::string> notedKernels();

}  // namespace doppel
