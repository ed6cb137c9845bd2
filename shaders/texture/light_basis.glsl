// The spherical harmonics that a capture's light is made of (nn/steps/light.h), up to the second
// degree, scaled so that the mean of each one's square over all directions is 1, as that of Y_0 = 1.

struct LightBasis {
    float y[9];
};

// n: of unit length, or zero, where all but Y_0 are zero.
LightBasis lightBasis(vec3 n) {
    const float k1 = sqrt(3.0), k2 = sqrt(15.0), k20 = sqrt(5.0) / 2;
    return LightBasis(float[9](1, k1 * n.y, k1 * n.z, k1 * n.x, k2 * n.x * n.y, k2 * n.y * n.z,
                               n != vec3(0) ? k20 * (3 * n.z * n.z - 1) : 0, k2 * n.x * n.z,
                               k2 / 2 * (n.x * n.x - n.y * n.y)));
}
