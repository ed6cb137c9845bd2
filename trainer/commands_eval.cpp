#include "engine/error.h"
#include "trainer/commands.h"

namespace doppel {

void runEval(const EvalOptions&) { throwMachine("eval: not there yet"); }

}  // namespace doppel
