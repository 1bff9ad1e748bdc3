// One normal per triangle for posed primitives without normals, from the posed corners.  Vertices are unwelded, three in a
// row are a triangle.
//
// Reads      posed positions.
// Writes     posed normals.
// Reference  frame.geometry.face_normals
#include "common/affine.glsl"

vec3 corner(uint at) { return vec3(position[3u * at], position[3u * at + 1u], position[3u * at + 2u]); }

void main() {
    uvec2 group = groups[gl_WorkGroupID.x];
    DeformJob job = jobs[group.x];
    uint triangle = group.y + gl_LocalInvocationID.x;
    if (3u * triangle >= job.vertex_count) return;
    uint at = job.posed_vertex + 3u * triangle;
    vec3 a = corner(at);
    vec3 n = job.mirror * safe_normalize(cross(corner(at + 1u) - a, corner(at + 2u) - a));
    for (uint i = 0u; i < 3u; ++i)
        for (uint c = 0u; c < 3u; ++c) out_normal[3u * (at + i) + c] = n[c];
}
