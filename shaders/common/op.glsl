// What every op's shader starts with: two binding flavours from one source, entries, indices.
//
//     #include "common/op.glsl"
//     #include "elementwise/params.h"
//     PARAMS(LeakyReluParams, 4)                 // push constants; 4 buffers in this file
//     BUFFER(0, readonly, float, x);             // [n]
//     BUFFER(1, writeonly, float, y);            // [n]
//     ENTRY(forward) { uint i = linearIndex(); if (i >= params.n) return; y.d[i] = ...; }
//
// A buffer's elements are name.d[i]. Buffers start and end (with padding) at multiples of 16 bytes.
// An entry is given only the buffers that it uses. In the flavour "addresses" they travel behind
// the parameters as push constants: sizeof(parameters) + 8 bytes per buffer must stay within 128
// bytes.
//
// shaders.cmake says what a line "// VARIANTS: plain, cpu" and CPU_ENTRY do, and common/loads.glsl
// how the two variants differ.
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_samplerless_texture_functions : require
#if !DESCRIPTORS
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif

#define readwrite
#define ENTRY(name) void entry_##name()
#define CPU_ENTRY(name) void entry_##name()
#ifndef CPU
#define CPU 0
#endif

#if DESCRIPTORS
#define PARAMS(Type, bufferCount) \
    layout(push_constant, scalar) uniform PushConstants { Type params; };
#define BUFFER(slot, access, type, name) \
    layout(set = 0, binding = slot, scalar) access buffer name##Block { type d[]; } name
#else
#define PARAMS(Type, bufferCount)                           \
    layout(push_constant, scalar) uniform PushConstants {   \
        Type params;                                        \
        uvec2 bufferAddresses[bufferCount];                 \
    };
#define BUFFER(slot, access, type, name)                                                        \
    layout(buffer_reference, scalar, buffer_reference_align = 16) access buffer name##Block {   \
        type d[];                                                                               \
    };                                                                                          \
    name##Block name = name##Block(bufferAddresses[slot])
#endif

// The host chooses the workgroup's size (64 unless a dispatch says otherwise).
layout(local_size_x_id = 0, local_size_x = 64) in;

#extension GL_KHR_shader_subgroup_basic : require
// Set by the host for CPUs, whose subgroups are consecutive invocations.
layout(constant_id = 30) const bool kOnCpu = false;

// gl_LocalInvocationID.x, for which lavapipe divides once per lane.
uint localIndex() {
    return kOnCpu ? gl_SubgroupID * gl_SubgroupSize + gl_SubgroupInvocationID
                  : gl_LocalInvocationID.x;
}

// This invocation's number in a linear dispatch. Large dispatches are folded into two dimensions
// because a device need not accept more than 65,535 workgroups in one.
uint linearIndex() {
    return (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * gl_WorkGroupSize.x +
           localIndex();
}
