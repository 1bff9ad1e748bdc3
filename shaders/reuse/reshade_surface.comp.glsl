// The chosen surface samples of the previous frame, moved with their surfaces to this frame, at their pixels of the previous
// frame: there they get the random numbers they had.
//
// A sample moves by the displacement of the surface at the current pixel that found it: exact for still and for translated
// surfaces.  Where the surface moved, its normals are those of the current pixel, because it may have turned.
//
// Reads      link; position, prev_position, normals of this frame; position, normals, color, material of the previous one
// Writes     surface channels; positions with w = 0, which are not lit, where there is no sample
// Reference  references.reshading
uniform ivec2 size;
uniform vec3 camera_delta; // current - previous camera position
uniform vec3 forward;      // view direction of the current camera

void main() {
    ivec2 q = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(q, size))) return;
    uint found = link[q.y * size.x + q.x];
    if (found == 0u) {
        imageStore(surface_position_out, q, vec4(0.0));
        return;
    }
    int index = int(found) - 1;
    ivec2 p = ivec2(index % size.x, index / size.x);
    vec4 before = texelFetch(history_position, q, 0), now = texelFetch(position, p, 0);
    vec3 moved = now.xyz - (texelFetch(prev_position, p, 0).xyz - camera_delta); // displacement of the surface
    bool still = length(moved) <= 1e-5 * (1.0 + length(now.xyz));
    vec3 at = before.xyz - camera_delta + (still ? vec3(0.0) : moved);
    imageStore(surface_position_out, q, vec4(at, dot(at, forward)));
    imageStore(surface_normal_out, q, still ? texelFetch(history_normal, q, 0) : texelFetch(normal, p, 0));
    imageStore(surface_geometric_normal_out, q,
               still ? texelFetch(history_geometric_normal, q, 0) : texelFetch(geometric_normal, p, 0));
    imageStore(surface_base_color_out, q, texelFetch(history_base_color, q, 0));
    imageStore(surface_material_out, q, texelFetch(history_material, q, 0));
}
