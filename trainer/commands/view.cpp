#include "trainer/commands/commands.h"
#include "viewer/viewer.h"

namespace doppel {

void runView(const ViewOptions& options) { Viewer(options).run(); }

}  // namespace doppel
