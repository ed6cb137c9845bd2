// The numbers of AdamW that the presets of all networks have.
#pragma once

#include "nn/core/numbers.h"
#include "nn/ops/optim.h"

namespace doppel {

#define ADAMW_NUMBERS(NUMBER)                                                             \
    NUMBER(double, beta1, .5, 0, .999999, "AdamW's decay of the mean gradient")           \
    NUMBER(double, beta2, .999, 0, .999999, "AdamW's decay of the mean squared gradient") \
    NUMBER(double, weightDecay, 1e-2, 0, 10, "AdamW's weight decay, times the rate")      \
    NUMBER(double, constantPart, .5, 0, 1, "part of the steps at full rate; then linear to 0")

template <typename Preset>
AdamWOptions adamwOptions(const Preset& preset) {
    return {.beta1 = static_cast<float>(preset.beta1),
            .beta2 = static_cast<float>(preset.beta2),
            .weightDecay = static_cast<float>(preset.weightDecay)};
}

}  // namespace doppel
