#include <iostream>

#include "trainer/commands/cli.h"

int main(int argc, char** argv) {
    using namespace doppel;
    const Commands commands{runDevices, runImport, runFit,  runTrain, runRender, runEval,
                            runAblate,  runExport, runView, runDemo,  runBench};
    return runCommandLine({argv + 1, argv + argc}, commands, std::cout, std::cerr);
}
