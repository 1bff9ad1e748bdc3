// Geometry pass, vertices: object space to camera-relative world axes, now and one frame ago.
//
// Reads    DrawRecord of this draw (fixed pool: matrices; posed pool: already posed, the record's matrix is the identity).
// Twin     animation.pose.pose_vertices
#include "common/affine.glsl"

layout(std430, binding = 0) readonly buffer Records { DrawRecord records[]; };
layout(std430, binding = 2) readonly buffer Frame { FrameRecord F; };

in vec3 in_position;
in vec3 in_normal;
in uint in_record;
#if POSED && PREV_POSITION
in vec3 in_prev_position;
#endif
#if TANGENTS
in vec4 in_tangent;
#endif
#if TEXCOORDS
in vec2 in_texcoord0;
in vec2 in_texcoord1;
#endif
#if COLORS
in vec4 in_color;
#endif

out vec3 pos_rel;
out vec3 normal_ws;
flat out uvec4 ids;
#if PREV_POSITION
out vec3 prev_pos_rel;
#endif
#if TANGENTS
out vec4 tangent_ws;
#endif
#if TEXCOORDS
out vec4 texcoord;
#endif
#if COLORS
out vec4 vertex_color;
#endif

void main() {
    DrawRecord r = records[in_record];
    ids = r.ids;
#if POSED
    pos_rel = in_position;
    normal_ws = in_normal;
#if PREV_POSITION
    prev_pos_rel = in_prev_position;
#endif
#if TANGENTS
    tangent_ws = in_tangent;
#endif
#else
    Affine relative_from_object = Affine(r.x, r.y, r.z);
    pos_rel = transform_point(relative_from_object, in_position);
    normal_ws = safe_normalize(transform_normal(relative_from_object, in_normal));
#if PREV_POSITION
    prev_pos_rel = transform_point(Affine(r.prev_x, r.prev_y, r.prev_z), in_position);
#endif
#if TANGENTS
    float mirror = dot(r.x.xyz, cross(r.y.xyz, r.z.xyz)) < 0.0 ? -1.0 : 1.0;
    tangent_ws = vec4(safe_normalize(transform_vector(relative_from_object, in_tangent.xyz)), in_tangent.w * mirror);
#endif
#endif
#if TEXCOORDS
    texcoord = vec4(in_texcoord0, in_texcoord1);
#endif
#if COLORS
    vertex_color = in_color;
#endif
    gl_Position = F.clip_from_relative * vec4(pos_rel, 1.0);
}
