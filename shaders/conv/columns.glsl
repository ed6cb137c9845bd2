// Columns, the matrix [rows, windows] of what each window sees (a row is a channel, ky and kx; the
// windows are those of one image after the other), lie
// as the panels of a product's right side (linalg/gemm.glsl): for the product weight · columns in
// panels of some windows, for maps · columns^T in panels of some rows.
struct Panels {
    uint rows, windows;
    uint width;          // of a panel, a power of two
    bool windowPanels;
};

uint panelIndex(Panels p, uint row, uint window) {
    return p.windowPanels
               ? (window / p.width * p.rows + row) * p.width + window % p.width
               : (row / p.width * p.windows + window) * p.width + row % p.width;
}
