// Weights that other programs have trained: a safetensors file, or what torch.save makes of a
// state_dict, read as data (see pickle.h); nothing in it is ever run.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "engine/io/safetensors.h"

namespace doppel {

// Which of the three it is, the bytes say: safetensors; a zip archive of PyTorch 1.6 and later; the
// stream of pickles of earlier ones. Tensors of a state_dict, or of the dict called state_dict,
// model_state_dict, model or net in a checkpoint; float32, and float16, bfloat16 and float64
// converted. Tensors of integers (a count of batches) are left out.
// InputError that names the file where it is cut short, a tensor reaches beyond its storage, a
// storage beyond the file, the tensors are far larger than the file, or it holds code: a whole
// model instead of its state_dict, or TorchScript.
Safetensors readWeights(const std::filesystem::path& path);
Safetensors weightsFromBytes(std::span<const uint8_t> file, const std::string& name);

}  // namespace doppel
