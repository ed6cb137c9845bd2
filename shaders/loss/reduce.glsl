// Sums in a fixed order: strided partial sums without barriers (which cost much on CPU devices),
// then one workgroup adds those up as a tree.
shared vec2 lanes[gl_WorkGroupSize.x];

// The sum over the workgroup, in its first lane.
vec2 workgroupSum(vec2 mine) {
    uint lane = localIndex();
    lanes[lane] = mine;
    barrier();
    for (uint half_ = gl_WorkGroupSize.x / 2; half_ > 0; half_ /= 2) {
        if (lane < half_) lanes[lane] += lanes[lane + half_];
        barrier();
    }
    return lanes[0];
}

// sum: of the buffer partial, in the workgroup's first lane.
#define SUM_PARTIALS(sum)                                                                          \
    vec2 sum = vec2(0);                                                                            \
    for (uint k = localIndex(); k < params.partials; k += gl_WorkGroupSize.x) sum += partial.d[k]; \
    sum = workgroupSum(sum)
