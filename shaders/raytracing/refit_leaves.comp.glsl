// Leaves of the trees of posed draws: triangles into the grid of their tree, and the leaf's bounds around them.
//
// Reads      posed positions; refit_leaves (node, first triangle, triangles, job), refit_corners (vertices, triangle).
// Writes     nodes and triangles of posed draws.
// Reference  tests/raytracing/test_refit.py
//
// A triangle that is not finite, or beyond the grid, is never hit.
#include "common/numbers.glsl"

uniform int first, count; // first: triangle of the first entry of refit_corners

ivec2 texel(uint i) { return ivec2(i & ((1u << TRACE_ROW_BITS) - 1u), i >> TRACE_ROW_BITS); }

vec3 corner(uint vertex, RefitJob job) {
    vec3 p = vec3(position[3u * vertex], position[3u * vertex + 1u], position[3u * vertex + 2u]);
    return (p - job.center.xyz) * job.scale.xyz;
}

bool on_grid(vec3 p) { return !non_finite(p) && all(lessThanEqual(abs(p), vec3(TRACE_HALF_GRID))); }

void main() {
    if (gl_GlobalInvocationID.x >= uint(count)) return;
    uvec4 leaf = refit_leaves_at(texel(gl_GlobalInvocationID.x));
    RefitJob job = refit_jobs[leaf.w];
    vec3 low = vec3(TRACE_HALF_GRID), high = vec3(-TRACE_HALF_GRID);
    for (uint i = 0u; i < leaf.z; ++i) {
        uint slot = leaf.y + i;
        uvec4 corners = refit_corners_at(texel(slot - uint(first)));
        vec3 a = corner(corners.x, job), b = corner(corners.y, job), c = corner(corners.z, job);
        if (on_grid(a) && on_grid(b) && on_grid(c)) {
            low = min(low, min(a, min(b, c)));
            high = max(high, max(a, max(b, c)));
        } else {
            a = b = c = vec3(0.0);
        }
        imageStore(trace_triangles_out, texel(3u * slot), uvec4(floatBitsToUint(a), corners.w & 0x7FFFFFFFu));
        imageStore(trace_triangles_out, texel(3u * slot + 1u), uvec4(floatBitsToUint(b), 0u));
        imageStore(trace_triangles_out, texel(3u * slot + 2u), uvec4(floatBitsToUint(c), corners.w >> 31));
    }
    uvec3 down = uvec3(ivec3(floor(low))) & 0xFFFFu, up = uvec3(ivec3(ceil(high))) & 0xFFFFu;
    uint last = 0x80000000u | (leaf.z - 1u) << TRACE_LEAF_COUNT_SHIFT | leaf.y;
    imageStore(trace_nodes_out, texel(leaf.x), uvec4(down | up << 16, last));
}
