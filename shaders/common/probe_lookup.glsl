// Irradiance from the eight probes around x: trilinear, without those inside geometry, less from those behind the surface.
#include "common/probes.glsl"

vec3 probe_irradiance(vec3 x, vec3 n) {
    ivec3 counts = P.probe_counts.xyz;
    // Half a voxel off the surface, so that a wall reads the probes in front of it.
    vec3 g = clamp((x + 0.5 * P.grid_origin.w * n - P.probe_origin.xyz) / P.probe_step.xyz, vec3(0.0), vec3(counts - 1));
    ivec3 base = min(ivec3(g), counts - 2);
    vec3 f = clamp(g - vec3(base), vec3(0.0), vec3(1.0));
    vec3 squares = n * n;
    ivec3 sides = ivec3(n.x >= 0.0 ? 0 : 1, n.y >= 0.0 ? 2 : 3, n.z >= 0.0 ? 4 : 5);
    ivec2 first = probe_texel(base);
    vec3 sum = vec3(0.0);
    float total = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
        ivec3 offset = ivec3(corner & 1, corner >> 1 & 1, corner >> 2);
        ivec3 at = base + offset; // there are at least two along every axis
        vec3 w = mix(1.0 - f, f, vec3(offset));
        float weight = w.x * w.y * w.z;
        ivec2 texel = first + ivec2(6 * offset.x, offset.z * counts.y + offset.y);
        vec3 to_probe = P.probe_origin.xyz + vec3(at) * P.probe_step.xyz - x;
        float facing = 0.5 + 0.5 * dot(n, to_probe) / max(length(to_probe), 1e-6); // wrapped, as Majercik et al. 2019
        vec4 along_x = probes_at(texel + ivec2(sides.x, 0)); // w: of the whole probe, in each of its sides
        weight *= along_x.w * (facing * facing + 0.05) + 1e-6;
        sum += weight * (squares.x * along_x.rgb + squares.y * probes_at(texel + ivec2(sides.y, 0)).rgb +
                         squares.z * probes_at(texel + ivec2(sides.z, 0)).rgb);
        total += weight;
    }
    return sum / total;
}
