// Irradiance at a grid of probes: six directions each (ambient cube, Valve 2004), from the virtual lights each one sees.
//
// Reads    virtual lights, their flux after the last bounce, visibility, voxels.
// Writes   (adds to) probes: six texels per probe, w: 0 where the probe lies inside geometry.
layout(local_size_x = GROUP_X) in;

layout(std140, binding = 0) uniform Parameters { IndirectRecord P; };
#include "common/indirect.glsl"
#include "common/voxels.glsl"
#include "common/probes.glsl"
layout(rgba32f, binding = 0) uniform image2D probes;
layout(std430, binding = 7) readonly buffer Visibility { uint visibility[]; };
#if !FIRST_BOUNCE
uniform sampler2D flux;
#endif

// Virtual lights [x, y) of this dispatch.  Mesa's llvmpipe ends every loop of an invocation after 65,535 turns in all,
// without a word; so the lights come in chunks that cannot reach that, and the sums go on where they stopped.
uniform ivec2 chunk; // both ends multiples of 32, but the last

void main() {
    int i = int(gl_GlobalInvocationID.x);
    if (i >= probe_count()) return;
    ivec2 texel = probe_texel(probe_cell(i));
    vec3 x = probe_place(i);
    vec3 cube[6];
    for (int side = 0; side < 6; ++side)
        cube[side] = chunk.x == 0 ? vec3(0.0) : imageLoad(probes, texel + ivec2(side, 0)).rgb;
    int words = (P.counts.x + 31) / 32;
    uint seen = 0u;
    for (int k = chunk.x; k < chunk.y; ++k) {
        if ((k & 31) == 0) seen = visibility[i * words + k / 32];
        if ((seen >> uint(k & 31) & 1u) == 0u) continue;
        ivec2 at = virtual_texel(k);
        vec4 place = texelFetch(virtual_lights, at, 0);
        vec3 normal = texelFetch(virtual_lights, at + ivec2(1, 0), 0).xyz;
#if FIRST_BOUNCE
        vec3 out_flux = texelFetch(virtual_lights, at + ivec2(2, 0), 0).rgb;
#else
        vec3 out_flux = texelFetch(flux, ivec2(uint(k) % uint(VIRTUAL_ROW), uint(k) / uint(VIRTUAL_ROW)), 0).rgb;
#endif
        if (!(dot(out_flux, vec3(1.0)) > 0.0)) continue;
        VirtualLight v = VirtualLight(place, vec4(normal, 0.0), vec4(out_flux, 0.0), vec4(0.0));
        for (int side = 0; side < 6; ++side) {
            vec3 axis = vec3(0.0);
            axis[side >> 1] = (side & 1) == 0 ? 1.0 : -1.0;
            cube[side] += vpl_irradiance(v, x, axis);
        }
    }
    ivec3 cell = ivec3(floor((x - P.grid_origin.xyz) / P.grid_origin.w));
    float valid = occupied(cell) ? 0.0 : 1.0;
    for (int side = 0; side < 6; ++side) imageStore(probes, texel + ivec2(side, 0), vec4(cube[side], valid));
}
