// Columns of convolutions (shaders/conv/columns.comp), for the ways of computing them.
#pragma once

#include "nn/ops/conv/windows.h"

namespace doppel {

// The columns of a layer, what each window sees, are several times its images; they are made for
// as many images, windows or channels at once as fit into this.
constexpr int64_t kColumnsElements = int64_t{1} << 20;

// Columns of some images, [rows, images * windows], as panels for the right side of a product: of
// windows for weight columns, of rows for maps columns^T. turned: rows count the kernel from its
// last place.
Tensor gatherColumns(Graph& graph, const Windows& w, const Tensor& image, int64_t firstImage,
                     int64_t images, int64_t firstWindow, int64_t windows, bool windowPanels,
                     bool turned = false);

}  // namespace doppel
