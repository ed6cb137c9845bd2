// A projected triangle and the pixels around it. Positions are in pixels relative to the picture's
// centre: near zero floats are finest, and a pixel's centre is exact.

struct Triangle {
    vec2 a, b, c;
    vec3 inverseDepth;  // 1/m, of a, b, c
    float doubleArea;   // pixels^2; the sign tells how it is wound
    bool valid;
};

// corners: what project.comp wrote. Faces of doubleArea <= minDoubleArea are left out, and so is
// what is not finite.
Triangle makeTriangle(vec4 a, vec4 b, vec4 c, float minDoubleArea) {
    Triangle t;
    t.a = a.xy;
    t.b = b.xy;
    t.c = c.xy;
    t.inverseDepth = vec3(a.z, b.z, c.z);
    vec2 ab = t.b - t.a, ac = t.c - t.a;
    t.doubleArea = ab.x * ac.y - ab.y * ac.x;
    // Comparisons with NaN are false.
    t.valid = min(a.z, min(b.z, c.z)) > 0 && abs(t.doubleArea) > minDoubleArea &&
              abs(t.doubleArea) < 1e30;
    return t;
}

// Columns [x0, x1] and rows [y0, y1] whose pixel centres may be within reach; count of 0: none.
struct PixelBox {
    int x0, x1, y0, y1;
    uint count;
};

PixelBox pixelBox(Triangle t, float reach, uint width, uint height) {
    vec2 size = vec2(width, height);
    // Reach grows by more than rounding takes away; the exact test is made per pixel.
    float slack = reach * 1e-4 + 1e-3;
    vec2 low = min(t.a, min(t.b, t.c)) - (reach + slack);
    vec2 high = max(t.a, max(t.b, t.c)) + (reach + slack);
    vec2 first = clamp(ceil(low + (0.5 * size - 0.5)), vec2(0), size);
    vec2 last = clamp(floor(high + (0.5 * size - 0.5)), vec2(-1), size - 1);
    PixelBox box = PixelBox(int(first.x), int(last.x), int(first.y), int(last.y), 0);
    if (t.valid && box.x0 <= box.x1 && box.y0 <= box.y1)
        box.count = uint(box.x1 - box.x0 + 1) * uint(box.y1 - box.y0 + 1);
    return box;
}

// Centre of pixel (x, y), relative to the picture's centre.
vec2 pixelCentre(int x, int y, uint width, uint height) {
    return vec2(x, y) + 0.5 - 0.5 * vec2(width, height);
}

// Twice the signed area of (p, a, b), a and b being given relative to p. Exactly the opposite for
// (b, a), so that of two faces with a common edge at least one covers each pixel on it: therefore
// `precise`, which keeps the two products alike.
float edgeFunction(vec2 a, vec2 b) {
    precise float left = a.x * b.y;
    precise float right = a.y * b.x;
    precise float result = left - right;
    return result;
}
vec3 edgeFunctions(Triangle t, vec2 p) {
    vec2 a = t.a - p, b = t.b - p, c = t.c - p;
    return vec3(edgeFunction(b, c), edgeFunction(c, a), edgeFunction(a, b));
}

// Perspective-correct barycentrics and depth (m) at p of the face with these corners.
vec4 surfaceAt(vec4 a, vec4 b, vec4 c, vec2 p) {
    Triangle t = makeTriangle(a, b, c, 0);
    vec3 e = edgeFunctions(t, p), weights = e * t.inverseDepth;
    float total = weights.x + weights.y + weights.z;
    return vec4(weights / total, (e.x + e.y + e.z) / total);
}

// The number of a large face, out of their list. Lavapipe (Mesa 26 with LLVM 22) walks once through
// the body of a loop that no lane enters, and does not mask loads whose address all lanes share: a
// number from behind the list's end must not become an address.
uint faceInList(uint number, uint faces) { return min(number, max(faces, 1) - 1); }
