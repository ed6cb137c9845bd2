#include "engine/error.h"
#include "trainer/commands.h"

namespace doppel {

void runRender(const RenderOptions&) { throwMachine("render: not there yet"); }

}  // namespace doppel
