// op_runner OP IN.npz OUT.npz [--device NAME]: runs one op, forward and backward, on any device.
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/instance.h"
#include "nn/core/op.h"

namespace {

constexpr const char* kUsage =
    "usage: op_runner OP IN.npz OUT.npz [--device NAME] [--precision NAME]\n"
    "       op_runner --list\n"
    "\n"
    "Runs one op. IN.npz: inputs by name, attr_NAME (0-d), grad_OUTPUT for backward.\n"
    "OUT.npz: outputs by name, and grad_INPUT for differentiable inputs.\n"
    "  --list         every op with its inputs, attributes and outputs\n"
    "  --device NAME  part of a device's name, or its index (default: the best one)\n"
    "  --precision fp32|mixed  of products of matrices (default: fp32)\n";

void list() {
    for (const doppel::Op* op : doppel::Op::all()) {
        const doppel::OpDeclaration& d = op->declaration();
        fmt::print("{}\n  inputs: {}\n", d.name, d.inputs);
        if (!d.attributes.empty()) fmt::print("  attributes: {}\n", d.attributes);
        fmt::print("  outputs: {}\n", d.outputs);
        if (!d.differentiable.empty()) fmt::print("  differentiable in: {}\n", d.differentiable);
    }
}

int run(std::vector<std::string> arguments) {
    using namespace doppel;
    DeviceOptions options;
    for (size_t i = 0; i < arguments.size(); ++i) {
        if (arguments[i] == "--help" || arguments[i] == "-h") {
            fmt::print("{}", kUsage);
            return 0;
        }
        if (arguments[i] == "--list") {
            list();
            return 0;
        }
        bool isDevice = arguments[i] == "--device";
        if (isDevice || arguments[i] == "--precision") {
            if (i + 1 == arguments.size()) throwInput("{}: a name is missing", arguments[i]);
            if (isDevice)
                options.name = arguments[i + 1];
            else
                options.precision = precisionNamed(arguments[i + 1]);
            arguments.erase(arguments.begin() + long(i), arguments.begin() + long(i) + 2);
            --i;
        }
    }
    if (arguments.size() != 3) {
        fmt::print(stderr, "{}", kUsage);
        return 2;
    }
    const Op* op = Op::find(arguments[0]);
    if (!op) throwInput("{}: no such op; op_runner --list shows them all", arguments[0]);
    Npz in = readNpz(arguments[1]);
    Device device(options);
    writeNpz(arguments[2], op->run(device, in, {}), false);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    doppel::separateShaderCaches();
    try {
        return run({argv + 1, argv + argc});
    } catch (const doppel::InputError& error) {
        fmt::print(stderr, "op_runner: {}\n", error.what());
        return 2;
    } catch (const std::exception& error) {
        fmt::print(stderr, "op_runner: {}\n", error.what());
        return 1;
    }
}
