// A file for --config with which whole commands take seconds.
#pragma once

namespace doppel::test {

// Sizes and steps of all stages, under the flags of each command.
constexpr const char* kSmallRun = R"(
[fit]
size = 64
passes = 1
[shape]
size = 64
steps = 2
batch = 12
[texels]
size = 64
steps = 2
batch = 12
samples = 1
others = 1
[mesh]
size = 64
blocks = 1
layers = 2
hidden = 8
steps = 2
[texture]
size = 64
textureSize = 64
depth = 5
width = 2
block = 2
batch = 2
steps = 2
[refine]
size = 64
depth = 5
width = 2
discriminatorWidth = 2
faceSize = 16
steps = 1
)";

}  // namespace doppel::test
