// How the matrices of a product lie in memory (linalg/gemm.comp), for everything that writes or
// reads them.
#ifndef COMMON_PANELS_H
#define COMMON_PANELS_H
#include "common/constants.h"
SHARED_BEGIN
// A panel is what a tile of the product needs of a matrix: some rows of the left side, or columns
// of the right one, step of the sum by step, without gaps. (Rows that are a power of two apart fall
// into the same few lines of a CPU's cache; panels do not.)
SHARED_CONSTANT uint kLayoutRows = 0;          // row by row
SHARED_CONSTANT uint kLayoutTransposed = 1;    // column by column
SHARED_CONSTANT uint kLayoutRowPanels = 2;     // panels of `width` rows, stepping along columns
SHARED_CONSTANT uint kLayoutColumnPanels = 3;  // panels of `width` columns, stepping along rows
// Panels of columns, pairs of a step and of the next by turns: a texel has two steps of two
// columns.
SHARED_CONSTANT uint kLayoutInterleaved = 4;

// Where an item (a row or a column) and a step are within their panel of `width` items.
SHARED_FUNCTION uint placeInPanel(uint item, uint step, uint width) { return step * width + item; }
// Likewise in panels of `width` items, a power of two, that have `steps` steps each.
SHARED_FUNCTION uint panelIndex(uint item, uint step, uint steps, uint width) {
    return placeInPanel(item % width, item / width * steps + step, width);
}
// Where the element of a row and a column lies in a matrix of kLayoutRows, kLayoutRowPanels (which
// may have more steps than the matrix has columns) or kLayoutColumnPanels.
SHARED_FUNCTION uint elementIndex(uint layoutOf, uint width, uint row, uint column, uint rows,
                                  uint columns) {
    if (layoutOf == kLayoutRowPanels) return panelIndex(row, column, columns, width);
    if (layoutOf == kLayoutColumnPanels) return panelIndex(column, row, rows, width);
    return row * columns + column;
}
SHARED_END
#endif
