// Sums in a fixed order: strided partial sums without barriers (which cost much on CPU devices),
// then one workgroup adds those up as a tree, on a CPU its first subgroup lane by lane: a kernel
// with barriers takes some 0.3 seconds longer to compile there.
#if CPU
#extension GL_KHR_shader_subgroup_arithmetic : require
#endif
#extension GL_KHR_shader_subgroup_basic : require

shared vec2 lanes[gl_WorkGroupSize.x];

#if CPU
uint sumLanes() { return gl_SubgroupSize; }
vec2 workgroupSum(vec2 mine) { return subgroupAdd(mine); }
#else
// Lanes that share a sum.
uint sumLanes() { return gl_WorkGroupSize.x; }

// The sum over those lanes, in the workgroup's first one.
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
#endif

// sum: of the buffer partial, in the workgroup's first lane.
#define SUM_PARTIALS(sum)                                                \
    vec2 sum = vec2(0);                                                  \
    for (uint k = localIndex(); k < params.partials; k += sumLanes())    \
        sum += partial.d[k];                                             \
    sum = workgroupSum(sum)
