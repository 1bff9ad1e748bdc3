// One more bounce: every VPL also reflects the irradiance of the probes around it.  A patch that several lights see has a
// VPL of each, so each reflects its share.
//
// Reads      VPLs (position, area, albedo, share, flux of the first bounce), probes.
// Writes     flux of the VPLs: the first bounce's plus this one's.
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
