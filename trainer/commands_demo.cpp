#include "engine/error.h"
#include "trainer/commands.h"

namespace doppel {

void runDemo(const DemoOptions&) { throwMachine("demo: not there yet"); }

}  // namespace doppel
