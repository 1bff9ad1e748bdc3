// Which virtual lights each probe sees through the occupancy grid.  The same for every bounce, so it is found once.
//
// Reads    virtual lights, bricks of voxels.
// Writes   visibility: one bit per probe and virtual light, 32 lights a word, a row of words per probe.
layout(local_size_x = GROUP_X) in;

layout(std140, binding = 0) uniform Parameters { IndirectRecord P; };
#include "common/indirect.glsl"
#include "common/voxels.glsl"
#include "common/probes.glsl"
layout(std430, binding = 7) writeonly buffer Visibility { uint visibility[]; };

void main() {
    int i = int(gl_GlobalInvocationID.x), word = int(gl_GlobalInvocationID.y);
    if (i >= probe_count()) return;
    vec3 x = probe_place(i);
    uint seen = 0u;
    int last = min(32 * word + 32, P.counts.x);
    uint facing = 0u;
    for (int k = 32 * word; k < last; ++k) {
        ivec2 at = virtual_texel(k);
        vec4 place = imageLoad(virtual_lights, at);
        vec3 normal = imageLoad(virtual_lights, at + ivec2(1, 0)).xyz;
        if (place.w > 0.0 && dot(normal, place.xyz - x) < 0.0) facing |= 1u << (k & 31);
    }
    for (; facing != 0u; facing &= facing - 1u) {
        int k = 32 * word + findLSB(facing);
        ivec2 at = virtual_texel(k);
        vec4 place = imageLoad(virtual_lights, at), normal = imageLoad(virtual_lights, at + ivec2(1, 0));
        float slack = normal.w > P.grid_origin.w ? 0.5 : 0.0;
        if (sees(x, place.xyz + normal.w * normal.xyz, vec2(0.5, slack))) seen |= 1u << (k & 31);
    }
    visibility[i * ((P.counts.x + 31) / 32) + word] = seen;
}
