// Rodrigues' formula and its derivative.

// Vulkan lets sin() and cos() be off by 2^-11; these are good to a few 1e-8 for |x| up to 1e4.
vec2 sinCos(float x) {
    precise float turns = round(x * 0.63661977);  // quarter turns
    // pi/2 in three parts, so that the products with `turns` are exact.
    precise float r = x - turns * 1.5703125;
    r = r - turns * 4.8375129699707e-4;
    r = r - turns * 7.5497899548918e-8;
    float z = r * r;
    float s = r + r * z * (-1.0 / 6 + z * (1.0 / 120 + z * (-1.0 / 5040 + z / 362880)));
    float c = 1 + z * (-0.5 + z * (1.0 / 24 + z * (-1.0 / 720 + z * (1.0 / 40320 - z / 3628800))));
    int quarter = int(turns) & 3;
    if ((quarter & 1) != 0) {
        float keep = s;
        s = c;
        c = -keep;
    }
    return quarter >= 2 ? vec2(-s, -c) : vec2(s, c);
}

// R(w) = c I + a [w] + b w w^T for the axis-angle w of length t: c = cos t, a = sin t / t,
// b = (1 - cos t) / t^2; da = a'/t, db = b'/t. [w] v is w x v.
struct RotationTerms {
    float c, a, b, da, db;
};
RotationTerms rotationTerms(vec3 w) {
    float q = dot(w, w);
    if (q < 0.3) {  // the quotients lose digits; four terms of the series leave 1e-8
        return RotationTerms(
            1 - q * (0.5 - q * (1.0 / 24 - q * (1.0 / 720 - q / 40320))),
            1 - q * (1.0 / 6 - q * (1.0 / 120 - q * (1.0 / 5040 - q / 362880))),
            0.5 - q * (1.0 / 24 - q * (1.0 / 720 - q * (1.0 / 40320 - q / 3628800))),
            -1.0 / 3 + q * (1.0 / 30 - q * (1.0 / 840 - q / 45360)),
            -1.0 / 12 + q * (1.0 / 180 - q * (1.0 / 6720 - q / 453600)));
    }
    float t = sqrt(q);
    vec2 sc = sinCos(t);
    float a = sc.x / t, b = (1 - sc.y) / q;
    return RotationTerms(sc.y, a, b, (sc.y - a) / q, (a - 2 * b) / q);
}

mat3 rotationOf(vec3 w) {
    RotationTerms r = rotationTerms(w);
    vec3 k = r.a * w;
    return mat3(r.c, k.z, -k.y, -k.z, r.c, k.x, k.y, -k.x, r.c) + r.b * outerProduct(w, w);
}

// dL/dw from dL/dR, which is laid out as R is.
vec3 rotationGradient(vec3 w, mat3 dR) {
    RotationTerms r = rotationTerms(w);
    float trace = dR[0][0] + dR[1][1] + dR[2][2];
    vec3 skew = vec3(dR[1][2] - dR[2][1], dR[2][0] - dR[0][2], dR[0][1] - dR[1][0]);
    vec3 right = dR * w;
    return r.a * (skew - trace * w) + r.da * dot(w, skew) * w + r.b * (right + w * dR) +
           r.db * dot(w, right) * w;
}

// A rigid transform [R | p] as three rows of four numbers, row r at d[3 * joint + r].
#define LOAD_ROTATION(buffer, joint)                                            \
    transpose(mat3(buffer.d[3 * (joint)].xyz, buffer.d[3 * (joint) + 1].xyz,    \
                   buffer.d[3 * (joint) + 2].xyz))
// A row is loaded whole: Mesa 22.3's lavapipe reads the first number where the last one alone is
// asked for.
#define LAST(row) dot(row, vec4(0, 0, 0, 1))
#define LOAD_ORIGIN(buffer, joint)                                     \
    vec3(LAST(buffer.d[3 * (joint)]), LAST(buffer.d[3 * (joint) + 1]), \
         LAST(buffer.d[3 * (joint) + 2]))
#define STORE_TRANSFORM(buffer, joint, R, p)                                  \
    for (int row = 0; row < 3; ++row) {                                       \
        buffer.d[3 * (joint) + row] = vec4(R[0][row], R[1][row], R[2][row], p[row]); \
    }
