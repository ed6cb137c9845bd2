#include <iostream>

#include "trainer/commands/cli.h"

int main(int argc, char** argv) {
    return doppel::runCommandLine({argv + 1, argv + argc}, std::cout, std::cerr);
}
