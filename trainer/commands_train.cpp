#include "engine/error.h"
#include "trainer/commands.h"

namespace doppel {

void runTrain(const TrainOptions&) { throwMachine("train: not there yet"); }

}  // namespace doppel
