// Which VPLs each probe sees through the occupancy grid.  The same for every bounce, so it is computed once.
//
// Reads      VPLs, bricks of voxels.
// Writes     visibility: one bit per probe and VPL, 32 VPLs a word, a row of words per probe.
#include "common/vpl.glsl"
#include "common/voxels.glsl"
#include "common/probes.glsl"

void main() {
    int i = int(gl_GlobalInvocationID.x), word = int(gl_GlobalInvocationID.y);
    if (i >= probe_count()) return;
    vec3 x = probe_place(i);
    uint seen = 0u;
    int last = min(32 * word + 32, P.counts.x);
    uint facing = 0u;
    for (int k = 32 * word; k < last; ++k) {
        ivec2 at = vpl_texel(k);
        vec4 place = vpls_at(at);
        vec3 normal = vpls_at(at + ivec2(1, 0)).xyz;
        if (place.w > 0.0 && dot(normal, place.xyz - x) < 0.0) facing |= 1u << (k & 31);
    }
    for (; facing != 0u; facing &= facing - 1u) {
        int k = 32 * word + findLSB(facing);
        ivec2 at = vpl_texel(k);
        vec4 place = vpls_at(at), normal = vpls_at(at + ivec2(1, 0));
        float slack = normal.w > P.grid_origin.w ? 0.5 : 0.0;
        if (sees(x, place.xyz + normal.w * normal.xyz, vec2(0.5, slack))) seen |= 1u << (k & 31);
    }
    visibility[i * ((P.counts.x + 31) / 32) + word] = seen;
}
