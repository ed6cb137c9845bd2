// `doppel retarget`, and the figures that `doppel render` prints too.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "trainer/motion/retarget/retarget.h"

namespace doppel {

// Scale, contacts and figures of a motion that was changed.
nlohmann::ordered_json retargetJson(const Retargeted& retargeted);

}  // namespace doppel
