// Irradiance at a grid of probes, in six directions each (ambient cube, Valve 2004), from the VPLs that each probe sees.
//
// Reads      VPLs, their flux after the last bounce, visibility, bricks of voxels.
// Writes     (adds to) probes: six texels per probe, w: 0 where the probe lies inside geometry.
#include "common/vpl.glsl"
#include "common/voxels.glsl"
#include "common/probes.glsl"

// VPLs [x, y) of this dispatch, both multiples of 32 except the last; later chunks add to the sums (tuning.VPL_CHUNK).
uniform ivec2 chunk;

void main() {
    int i = int(gl_GlobalInvocationID.x);
    if (i >= probe_count()) return;
    ivec2 texel = probe_texel(probe_cell(i));
    vec3 x = probe_place(i);
    vec3 cube[6];
    for (int side = 0; side < 6; ++side)
        cube[side] = chunk.x == 0 ? vec3(0.0) : probes_at(texel + ivec2(side, 0)).rgb;
    int words = (P.counts.x + 31) / 32;
    for (int first = chunk.x; first < chunk.y; first += 32) {
        // Only the VPLs that this probe sees.
        for (uint seen = visibility[i * words + first / 32]; seen != 0u; seen &= seen - 1u) {
            int k = first + findLSB(seen);
            ivec2 at = vpl_texel(k);
            vec4 place = vpls_at(at);
            vec3 normal = vpls_at(at + ivec2(1, 0)).xyz;
#if FIRST_BOUNCE
            vec3 out_flux = vpls_at(at + ivec2(2, 0)).rgb;
#else
            vec3 out_flux = flux_at(ivec2(uint(k) % uint(VPL_ROW), uint(k) / uint(VPL_ROW))).rgb;
#endif
            VirtualPointLight v = VirtualPointLight(place, vec4(normal, 0.0), vec4(out_flux, 0.0), vec4(0.0));
            for (int side = 0; side < 6; ++side) {
                vec3 axis = vec3(0.0);
                axis[side >> 1] = (side & 1) == 0 ? 1.0 : -1.0;
                cube[side] += vpl_irradiance(v, x, axis);
            }
        }
    }
    ivec3 cell = ivec3(floor((x - P.grid_origin.xyz) / P.grid_origin.w));
    float valid = occupied(cell) ? 0.0 : 1.0;
    for (int side = 0; side < 6; ++side) imageStore(probes, texel + ivec2(side, 0), vec4(cube[side], valid));
}
