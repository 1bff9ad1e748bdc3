// Irradiance at a grid of probes: six directions each (ambient cube, Valve 2004), every virtual light tested against the
// occupancy grid.
//
// Reads    virtual lights, voxels.   Writes   probes: 6 x vec4 per probe, w of the first: 0 where the probe lies inside.
layout(local_size_x = 16) in;

layout(std430, binding = 0) readonly buffer Parameters { IndirectRecord P; };
#include "common/indirect.glsl"
#include "common/voxels.glsl"
layout(std430, binding = 2) readonly buffer Virtual { VirtualLight virtual_lights[]; };
layout(std430, binding = 6) writeonly buffer Probes { vec4 probes[]; };

void main() {
    int i = int(gl_GlobalInvocationID.x);
    ivec3 n = P.probe_counts.xyz;
    if (i >= n.x * n.y * n.z) return;
    ivec3 at = ivec3(i % n.x, (i / n.x) % n.y, i / (n.x * n.y));
    vec3 x = P.probe_origin.xyz + vec3(at) * P.probe_step.xyz;
    vec3 cube[6];
    for (int side = 0; side < 6; ++side) cube[side] = vec3(0.0);
    for (int k = 0; k < P.counts.x; ++k) {
        VirtualLight v = virtual_lights[k];
        vec3 d = v.position.xyz - x;
        if (dot(v.normal.xyz, d) >= 0.0 || dot(v.flux.rgb, vec3(1.0)) <= 0.0) continue;
        if (!sees(x, v.position.xyz, vec2(0.5, 1.8))) continue;
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
