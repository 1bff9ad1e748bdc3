// Geometry pass, vertices: object space to camera-relative world axes, in this frame and the frame before.
//
// Reads      DrawRecord of this draw as attributes that advance once per instance (posed pool: already posed, only its ids).
// Reference  animation.pose.pose_vertices
#include "common/affine.glsl"

in vec3 in_position;
in vec3 in_normal;
in uvec4 record_ids;
#if POSED
#if PREV_POSITION
in vec3 in_prev_position;
#endif
#else
in vec4 record_x;
in vec4 record_y;
in vec4 record_z;
#if PREV_POSITION
in vec4 record_prev_x;
in vec4 record_prev_y;
in vec4 record_prev_z;
#endif
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
#if STOCHASTIC_ALPHA && !POSED
out vec3 pos_object;
#endif

invariant gl_Position; // the depth pre-pass covers exactly the pixels of the channels

void main() {
    ids = record_ids;
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
    Affine relative_from_object = Affine(record_x, record_y, record_z);
    pos_rel = transform_point(relative_from_object, in_position);
    normal_ws = safe_normalize(transform_normal(relative_from_object, in_normal));
#if PREV_POSITION
    prev_pos_rel = transform_point(Affine(record_prev_x, record_prev_y, record_prev_z), in_position);
#endif
#if TANGENTS
    float mirror = dot(record_x.xyz, cross(record_y.xyz, record_z.xyz)) < 0.0 ? -1.0 : 1.0;
    tangent_ws = vec4(safe_normalize(transform_vector(relative_from_object, in_tangent.xyz)), in_tangent.w * mirror);
#endif
#endif
#if TEXCOORDS
    texcoord = vec4(in_texcoord0, in_texcoord1);
#endif
#if COLORS
    vertex_color = in_color;
#endif
#if STOCHASTIC_ALPHA && !POSED
    pos_object = in_position;
#endif
    gl_Position = F.clip_from_relative * vec4(pos_rel, 1.0);
}
