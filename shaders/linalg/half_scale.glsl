// Gradients may be far smaller than one, and the least half is 2^-24: before they are rounded to
// halves they are multiplied by this power of two, which brings the largest of them (its bits, see
// largest.comp) to [2^9, 2^10). That leaves a factor of 64 up to a half's end for the sums of
// Winograd's transforms. What is neither zero nor finite stays as it is, to be seen.
float halfScale(uint largestBits) {
    int exponent = int(largestBits >> 23) - 127;
    if (largestBits == 0 || exponent > 127) return 1.0;
    return uintBitsToFloat(uint(clamp(9 - exponent, -126, 126) + 127) << 23);
}
