#include "engine/error.h"
#include "trainer/commands.h"

namespace doppel {

void runExport(const ExportOptions&) { throwMachine("export: not there yet"); }

}  // namespace doppel
