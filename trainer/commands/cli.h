// The command line of `doppel`: what is typed, on top of what a config file says, as options.
#pragma once

#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#include "trainer/commands/commands.h"

namespace doppel {

// What the subcommands call.
struct Commands {
    std::function<void(const DevicesOptions&)> devices;
    std::function<void(const ImportOptions&)> import;
    std::function<void(const FitOptions&)> fit;
    std::function<void(const TrainOptions&)> train;
    std::function<void(const RenderOptions&)> render;
    std::function<void(const EvalOptions&)> eval;
    std::function<void(const AblateOptions&)> ablate;
    std::function<void(const ExportOptions&)> exportAvatar;
    std::function<void(const ViewOptions&)> view;
    std::function<void(const DemoOptions&)> demo;
    std::function<void()> bench;
};

// arguments: without the program's name. Returns the exit status: 0 done; 1 it failed; 2 the input
// or the flags are wrong; 130 interrupted (143, 129 by SIGTERM, SIGHUP). Whatever fails prints one line on `err`, help goes to
// `out`.
//
// A config file (--config FILE, TOML) holds long options as keys (device = "llvmpipe", seed = 7,
// stages = ["fit", "mesh"]) and a preset's numbers in tables ([mesh] batch = 8). One file can serve
// all subcommands: keys that another one knows are left alone, keys that none knows are refused.
// Flags win over the file, the file over the preset.
int runCommandLine(const std::vector<std::string>& arguments, const Commands& commands,
                   std::ostream& out, std::ostream& err);

}  // namespace doppel
