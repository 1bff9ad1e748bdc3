// One more bounce: every virtual light also reflects what the probes around it receive.
// A patch that several lights see has a virtual light of each, so each reflects its share.
// Reads    probes, virtual lights' place, area, albedo, share and first flux.   Writes   their flux, on top of the first bounce's.
layout(local_size_x = GROUP_X) in;

layout(std140, binding = 0) uniform Parameters { IndirectRecord P; };
#include "common/indirect.glsl"
#include "common/probe_lookup.glsl"
layout(rgba32f, binding = 5) writeonly uniform image2D flux_out;

void main() {
    int i = int(gl_GlobalInvocationID.x);
    if (i >= P.counts.x) return;
    VirtualLight v = virtual_light(i);
    if (v.position.w > 0.0)
        v.flux.rgb += v.albedo.rgb * (v.position.w * v.albedo.w) * probe_irradiance(v.position.xyz, v.normal.xyz);
    imageStore(flux_out, ivec2(uint(i) % uint(VIRTUAL_ROW), uint(i) / uint(VIRTUAL_ROW)), v.flux);
}
