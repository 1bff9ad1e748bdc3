// One more bounce: every virtual light also reflects what the probes around it receive.
// A patch that several lights see has a virtual light of each, so each reflects its share.
// Reads    probes, virtual lights' place, area, albedo, share and first flux.   Writes   their flux, on top of the first bounce's.
#include "common/vpl.glsl"
#include "common/probe_lookup.glsl"

void main() {
    int i = int(gl_GlobalInvocationID.x);
    if (i >= P.counts.x) return;
    VirtualPointLight v = vpl(i);
    if (v.position.w > 0.0)
        v.flux.rgb += v.albedo.rgb * (v.position.w * v.albedo.w) * probe_irradiance(v.position.xyz, v.normal.xyz);
    imageStore(flux_out, ivec2(uint(i) % uint(VPL_ROW), uint(i) / uint(VPL_ROW)), v.flux);
}
