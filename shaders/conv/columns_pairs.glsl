PARAMS(ColumnsParams, 2)
#if TEXEL_LOADS
TEXELS(0, image);
#else
BUFFER(0, readonly, uint64_t, image);     // pairs of pixels
#endif
BUFFER(1, writeonly, uint64_t, columns);  // pairs of windows or of rows

layout(constant_id = 4) const uint kWidth = 32;
layout(constant_id = 5) const bool kWindowPanels = true;

vec2 unpackPair(uint64_t pair) { return uintBitsToFloat(unpackUint2x32(pair)); }
uint64_t packPair(float first, float second) {
    return packUint2x32(floatBitsToUint(vec2(first, second)));
}

// As columns.gather for kernels 4x4, stride 2, padding 1, on images and maps of even width, in
// loads and stores of eight bytes: an invocation does two windows, whose pixels are four pairs in
// each of four rows. A pair is inside the image or outside as a whole.
// With TEXEL_LOADS = 1, for CPUs and images of widths divisible by four, these pairs are read as the
// middle of three texels.
void gatherPairs() {
    uint window = 2 * (gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x);
    uint channel = gl_WorkGroupID.y, n = gl_WorkGroupID.z;
    uint width = params.width, height = params.height;
    if (window >= params.windows) return;
    uint at = window + params.firstWindow;
    uint oy = quotient(at, params.byOutWidth), ox = remainder(at, oy, params.byOutWidth);
    uint y = 2 * oy - 1, x = 2 * ox - 2;
    uint plane = params.startImage + (n * params.channels + channel) * height * width;
    uint place = n * params.windows + window;
    Panels panels = Panels(params.channels * 16, params.images * params.windows, kWidth, kWindowPanels);
    [[unroll]] for (uint ky = 0; ky < 4; ++ky) {
        bool rowInside = y + ky < height;
        float v[8];  // pixels x to x + 7; the windows start at x + 1 and x + 3
#if TEXEL_LOADS
        [[unroll]] for (uint i = 0; i < 3; ++i) {
            uint first = x - 2 + 4 * i;
            bool inside = rowInside && first < width;
            vec4 four = texelFetch(image, int((plane + (inside ? (y + ky) * width + first : 0)) / 4));
            [[unroll]] for (uint k = 0; k < 4; ++k)
                if (4 * i + k >= 2 && 4 * i + k < 10) v[4 * i + k - 2] = inside ? four[k] : 0;
        }
#else
        [[unroll]] for (uint i = 0; i < 4; ++i) {
            bool inside = rowInside && x + 2 * i < width;
            uint pixel = inside ? (y + ky) * width + x + 2 * i : 0;
            vec2 pair = unpackPair(image.d[(plane + pixel) / 2]);
            v[2 * i] = inside ? pair.x : 0;
            v[2 * i + 1] = inside ? pair.y : 0;
        }
#endif
        uint row = channel * 16 + ky * 4;
        if (kWindowPanels) {
            [[unroll]] for (uint kx = 0; kx < 4; ++kx)
                columns.d[panelIndex(panels, row + kx, place) / 2] =
                    packPair(v[kx + 1], v[kx + 3]);
        } else {
            [[unroll]] for (uint i = 0; i < 4; ++i) {  // window i / 2, kx = 2 (i % 2)
                uint first = 1 + 2 * (i / 2) + 2 * (i % 2);
                columns.d[panelIndex(panels, row + 2 * (i % 2), place + i / 2) / 2] =
                    packPair(v[first], v[first + 1]);
            }
        }
    }
}
