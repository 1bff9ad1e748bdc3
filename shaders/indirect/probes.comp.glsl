// Irradiance at a grid of probes: six directions each (ambient cube, Valve 2004), every virtual light tested against the
// occupancy grid.
//
// Reads    virtual lights, voxels.
// Writes   (adds to) probes: 6 x vec4 per probe, w of the first: 0 where the probe lies inside geometry.
layout(local_size_x = 16) in;

layout(std430, binding = 0) readonly buffer Parameters { IndirectRecord P; };
#include "common/indirect.glsl"
#include "common/voxels.glsl"
layout(std430, binding = 2) readonly buffer Virtual { VirtualLight virtual_lights[]; };
layout(std430, binding = 6) buffer Probes { vec4 probes[]; };
layout(std430, binding = 7) buffer Visibility { uint visibility[]; }; // one bit per probe and virtual light

// Virtual lights [x, y) of this dispatch.  Mesa's llvmpipe ends every loop of an invocation after 65,535 turns in all,
// without a word; so the lights come in chunks that cannot reach that, and the sums go on where they stopped.
uniform ivec2 chunk; // both ends multiples of 32, but the last

void main() {
    int i = int(gl_GlobalInvocationID.x);
    ivec3 n = P.probe_counts.xyz;
    if (i >= n.x * n.y * n.z) return;
    ivec3 at = ivec3(i % n.x, (i / n.x) % n.y, i / (n.x * n.y));
    vec3 x = P.probe_origin.xyz + vec3(at) * P.probe_step.xyz;
    vec3 cube[6];
    for (int side = 0; side < 6; ++side) cube[side] = chunk.x == 0 ? vec3(0.0) : probes[6 * i + side].rgb;
    int words = (P.counts.x + 31) / 32;
    uint seen = 0u;
    for (int k = chunk.x; k < chunk.y; ++k) {
        VirtualLight v = virtual_lights[k];
        int word = i * words + k / 32;
        uint bit = 1u << (k & 31);
#if FIRST_BOUNCE
        // Aim above the patch: a ray that grazes a wall would run through the wall's own voxels before it gets there.
        // Where it cannot aim above its own voxel, it must not reach through that voxel either.
        float slack = v.normal.w > P.grid_origin.w ? 0.5 : 0.0;
        if (v.position.w > 0.0 && dot(v.normal.xyz, v.position.xyz - x) < 0.0 &&
            sees(x, v.position.xyz + v.normal.w * v.normal.xyz, vec2(0.5, slack))) seen |= bit;
        if ((k & 31) == 31 || k + 1 == chunk.y) visibility[word] = seen;
#else
        if ((k & 31) == 0) seen = visibility[word];
#endif
        bool lights = (seen & bit) != 0u && dot(v.flux.rgb, vec3(1.0)) > 0.0;
#if FIRST_BOUNCE
        if ((k & 31) == 31) seen = 0u;
#endif
        if (!lights) continue;
        for (int side = 0; side < 6; ++side) {
            vec3 axis = vec3(0.0);
            axis[side >> 1] = (side & 1) == 0 ? 1.0 : -1.0;
            cube[side] += vpl_irradiance(v, x, axis);
        }
    }
    ivec3 cell = ivec3(floor((x - P.grid_origin.xyz) / P.grid_origin.w));
    float valid = occupied(cell) ? 0.0 : 1.0;
    for (int side = 0; side < 6; ++side) probes[6 * i + side] = vec4(cube[side], valid);
}
