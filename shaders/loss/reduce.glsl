// Sums in a fixed order: strided partial sums without barriers (which cost much on CPU devices),
// then one workgroup adds those up as a tree, on a CPU its first subgroup lane by lane: a kernel
// with barriers takes some 0.3 seconds longer to compile there. Descriptors, which are for tests,
// keep to the tree.
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_basic : require

shared vec2 lanes[gl_WorkGroupSize.x];

// Lanes that share a sum.
bool bySubgroup() { return kOnCpu && DESCRIPTORS == 0; }
uint sumLanes() { return bySubgroup() ? gl_SubgroupSize : gl_WorkGroupSize.x; }

// The sum over those lanes, in the workgroup's first one.
vec2 workgroupSum(vec2 mine) {
    if (bySubgroup()) return subgroupAdd(mine);
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
#define SUM_PARTIALS(sum)                                                \
    vec2 sum = vec2(0);                                                  \
    for (uint k = localIndex(); k < params.partials; k += sumLanes())    \
        sum += partial.d[k];                                             \
    sum = workgroupSum(sum)
