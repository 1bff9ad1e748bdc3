// One more bounce: every virtual light also reflects what the probes around it receive.
// Reads    probes, virtual lights' place, area and albedo.   Writes   their flux, on top of the first bounce's.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Parameters { IndirectRecord P; };
layout(std430, binding = 2) buffer Virtual { VirtualLight virtual_lights[]; };
layout(std430, binding = 7) readonly buffer First { VirtualLight first[]; };
#include "common/probe_lookup.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(P.counts.x)) return;
    VirtualLight v = first[i];
    if (v.position.w > 0.0)
        v.flux.rgb += v.albedo.rgb * v.position.w * probe_irradiance(v.position.xyz, v.normal.xyz);
    virtual_lights[i].flux = v.flux;
}
