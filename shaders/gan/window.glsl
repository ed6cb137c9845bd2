// The first pixel of a window of `size` pixels around `centre` pixels (centres at a half): the
// window of whole pixels whose middle is nearest. Centres far outside the picture stay there.
int windowStart(float centre, uint size) {
    return int(clamp(floor(centre - 0.5 * float(size) + 0.5), -1e6, 1e6));
}
