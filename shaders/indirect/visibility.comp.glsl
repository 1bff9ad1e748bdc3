// Which VPLs each probe sees.  The same for every bounce, so it is computed once.
//
// Reads      VPLs, bricks of voxels, the lights' G-buffer.
// Writes     visibility: one bit per probe and VPL, 32 VPLs a word, a row of words per probe.
//
// Rays go through the occupancy grid to a point above the VPL.  Beside a light, a point that stays on the VPL's side of it
// may be too low: the grid would hide the VPL or not depending on where its voxels are, from frame to frame.  There the
// light's reflective shadow map tells what is near, which hides the VPL about where it hides the light, and the grid only
// what is farther away.
#include "common/affine.glsl"
#include "common/vpl.glsl"
#include "common/voxels.glsl"
#include "common/probes.glsl"

#if MAPPED
#include "common/rsm_face.glsl"

// The farthest of light and surfaces around it that the grid leaves to the map, in voxels: VPLs beside a light are at most
// 2 VPL_LIFT from it, and rays to them end VPL_LIFT before a point that is VPL_LIFT above them.
const float NEAR_LIGHT = 4.0 * VPL_LIFT;

// Whether nothing near the light whose faces start at ``first`` lies between it and x, scene space.  1: nothing; 0: a
// surface, and x is behind it; -1: its maps do not cover x.  The map has the shading normal of the surface.
int leaves_light(int first, vec3 x) {
    vec3 p = x - P.scene_from_relative.xyz;
    float row = faces[first].extent.w;
    for (int k = first; k < P.counts.z; ++k) {
        ShadowFace face = faces[k];
        if (face.extent.w != row) break;
        vec3 q = p - face.origin.xyz;
        vec2 at;
        if (!face_covers(face, q, at)) continue;
        vec2 texel = min(floor((at * 0.5 + 0.5) * face.extent.x), vec2(face.extent.x - 1.0));
        ivec2 texel_at = ivec2(vec2(face.right.w, face.up.w) + texel);
        vec4 normal_and_hit = normal_at(texel_at);
        vec3 hit = position_at(texel_at).xyz - face.origin.xyz;
        if (normal_and_hit.w <= 0.0 || length(hit) > min(length(q), NEAR_LIGHT * P.grid_origin.w)) return 1;
        // The plane of the surface: at grazing angles the texel's center is nearer than most of what it stands for.
        return dot(normal_and_hit.xyz, q - hit) * dot(normal_and_hit.xyz, -hit) > 0.0 ? 1 : 0;
    }
    return -1;
}
#endif

void main() {
    int i = int(gl_GlobalInvocationID.x), word = int(gl_GlobalInvocationID.y);
    if (i >= probe_count()) return;
    vec3 x = probe_place(i);
    uint seen = 0u;
    int last = min(32 * word + 32, P.counts.x);
    uint facing = 0u, beside = 0u; // VPLs that face x; those of them beside a light
    for (int k = 32 * word; k < last; ++k) {
        ivec2 at = vpl_texel(k);
        vec4 place = vpls_at(at), normal = vpls_at(at + ivec2(1, 0));
        if (!(place.w > 0.0 && dot(normal.xyz, place.xyz - x) < 0.0)) continue;
        facing |= 1u << (k & 31);
        if (normal.w < VPL_LIFT * P.grid_origin.w && k < P.counts.w) beside |= 1u << (k & 31);
    }
#if MAPPED
    uint raised = 0u; // those whose light's maps tell what is near
    while (beside != 0u) { // a light at a time: llvmpipe runs through branches that no lane takes
        int first = int(texels[32 * word + findLSB(beside)].w), leaves = leaves_light(first, x);
        uint own = 0u;
        for (int k = 32 * word; k < min(last, P.counts.w); ++k)
            if (int(texels[k].w) == first) own |= 1u << (k & 31);
        own &= beside;
        beside &= ~own;
        if (leaves == 0) facing &= ~own;
        if (leaves == 1) raised |= own;
    }
#endif
    for (; facing != 0u; facing &= facing - 1u) {
        int k = 32 * word + findLSB(facing);
        ivec2 at = vpl_texel(k);
        vec4 place = vpls_at(at), normal = vpls_at(at + ivec2(1, 0));
        float slack = normal.w > P.grid_origin.w ? 0.5 : 0.0;
#if MAPPED
        if ((raised >> (k & 31) & 1u) != 0u) {
            normal.w = VPL_LIFT * P.grid_origin.w;
            slack = VPL_LIFT;
        }
#endif
        if (sees(x, place.xyz + normal.w * normal.xyz, vec2(0.5, slack))) seen |= 1u << (k & 31);
    }
    visibility[i * ((P.counts.x + 31) / 32) + word] = seen;
}
