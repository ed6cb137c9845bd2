#include "engine/error.h"
#include "trainer/commands.h"

namespace doppel {

void runFit(const FitOptions&) { throwMachine("fit: not there yet"); }

}  // namespace doppel
