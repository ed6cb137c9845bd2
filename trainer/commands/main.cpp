#include <iostream>

#include "engine/instance.h"
#include "trainer/commands/cli.h"

int main(int argc, char** argv) {
    doppel::separateShaderCaches();
    return doppel::runCommandLine({argv + 1, argv + argc}, std::cout, std::cerr);
}
