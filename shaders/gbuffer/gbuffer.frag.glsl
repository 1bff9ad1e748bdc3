// Geometry pass, fragments: one set of channels per visible surface point.
//
// Writes     the channels of OUTPUT_<name> (channels.py), each at its own attachment.
// Departs    Shading normals are turned over where the *triangle* faces away (as Cycles does), not where the interpolated
//            normal does: turning smooth normals at a silhouette would make them jump by 180 degrees.
#include "common/affine.glsl"
#include "common/material.glsl"
#include "common/numbers.glsl"
#include "common/stochastic_alpha.glsl"

in vec3 pos_rel;
in vec3 normal_ws;
flat in uvec4 ids;
#if PREV_POSITION
in vec3 prev_pos_rel;
#endif
#if TANGENTS
in vec4 tangent_ws;
#endif
#if COLORS
in vec4 vertex_color;
#endif

vec3 shading_normal(MaterialRecord m) {
    vec3 n = safe_normalize(normal_ws);
#if NORMAL_MAP
    vec3 t = safe_normalize(tangent_ws.xyz - n * dot(n, tangent_ws.xyz));
    vec3 b = tangent_ws.w * cross(n, t);
    vec3 texel = sample_map(normal_map, m, SLOT_NORMAL).xyz * 2.0 - 1.0;
    texel.xy *= m.factors.z;
    n = safe_normalize(texel.x * t + texel.y * b + texel.z * n);
#endif
    return gl_FrontFacing ? n : -n;
}

#if AT_CENTERS
// Steps of dFdx and dFdy from the point, along its triangle, to the center of the pixel.  GPUs interpolate between corners that
// are snapped to 1/256 pixel.
vec2 to_center() {
    vec4 at = F.clip_from_relative * vec4(pos_rel, 1.0);
    vec4 right = F.clip_from_relative * vec4(dFdx(pos_rel), 0.0), up = F.clip_from_relative * vec4(dFdy(pos_rel), 0.0);
    vec2 center = gl_FragCoord.xy / F.half_size - 1.0;
    mat2 place = mat2(right.xy - center * right.w, up.xy - center * up.w);
    float area = determinant(place);
    if (!(abs(area) > 0.0)) return vec2(0.0);
    vec2 off = center * at.w - at.xy;
    vec2 steps = vec2(place[1].y * off.x - place[1].x * off.y, place[0].x * off.y - place[0].y * off.x) / area;
    // The derivatives of a sliver are none: its neighbors lie outside.
    return non_finite(steps) || any(greaterThan(abs(steps), vec2(1.0 / 128.0))) ? vec2(0.0) : steps;
}

// ``precise``: the current and the previous place of a still point must come out with the same bits.
vec3 moved(vec3 p, vec2 steps) {
    precise vec3 r = p + steps.x * dFdx(p) + steps.y * dFdy(p);
    return r;
}
#endif

void main() {
#if AT_CENTERS
    vec2 steps = to_center();
    vec3 here = moved(pos_rel, steps);
#if PREV_POSITION
    vec3 before = moved(prev_pos_rel, steps);
#endif
#else
    vec3 here = pos_rel;
#if PREV_POSITION
    vec3 before = prev_pos_rel;
#endif
#endif
    MaterialRecord m = material;
#if ALPHA_TEST || OUTPUT_BASE_COLOR
    vec4 base = m.base_color;
#if BASE_COLOR_MAP
#if OUTPUT_BASE_COLOR
    vec4 texel = sample_map(base_color_map, m, SLOT_BASE_COLOR);
#else
    vec4 texel = vec4(1.0);
#endif
#if ALPHA_TEST
    texel.a = sample_alpha(base_color_map, m, SLOT_BASE_COLOR);
#endif
    base *= texel;
#endif
#if COLORS
    base *= vertex_color;
#endif
#endif
#if ALPHA_TEST
#if STOCHASTIC_ALPHA
    if (base.a < alpha_threshold(ids.x)) discard;
#else
    if (base.a < m.alpha_cutoff.x) discard;
#endif
#endif
#if OUTPUT_POSITION
    out_position = vec4(here, dot(F.forward.xyz, here));
#endif
#if OUTPUT_NORMAL
    out_normal = vec4(shading_normal(m), 1.0);
#endif
#if OUTPUT_PREV_POSITION
    out_prev_position = vec4(before, 1.0);
#endif
#if OUTPUT_GEOMETRIC_NORMAL
    // The triangle's plane from screen-space derivatives; where they vanish (sub-pixel slivers) the vertex normal is used.
    vec3 g = safe_normalize(cross(dFdx(pos_rel), dFdy(pos_rel)));
    if (g == vec3(0.0)) g = safe_normalize(normal_ws) * (gl_FrontFacing ? 1.0 : -1.0);
    vec3 from_viewer = F.forward.w > 0.5 ? F.forward.xyz : pos_rel; // a parallel camera has no one position
    out_geometric_normal = vec4(dot(g, from_viewer) > 0.0 ? -g : g, 1.0);
#endif
#if OUTPUT_BASE_COLOR
    out_base_color = base;
#endif
#if OUTPUT_MATERIAL
    vec2 metallic_roughness = m.factors.xy;
#if METALLIC_ROUGHNESS_MAP
    metallic_roughness *= sample_map(metallic_roughness_map, m, SLOT_METALLIC_ROUGHNESS).bg;
#endif
    float occlusion = 1.0;
#if OCCLUSION_MAP
    occlusion = 1.0 + m.factors.w * (sample_map(occlusion_map, m, SLOT_OCCLUSION).r - 1.0);
#endif
    out_material = vec4(metallic_roughness, occlusion, m.emissive.w > 0.5 ? -1.0 : m.alpha_cutoff.y);
#endif
#if OUTPUT_EMISSION
    vec3 emission = m.emissive.xyz;
#if EMISSIVE_MAP
    emission *= sample_map(emissive_map, m, SLOT_EMISSIVE).rgb;
#endif
#if OUTPUT_BASE_COLOR
    if (m.emissive.w > 0.5) emission = base.rgb; // an unlit surface emits its base color
#endif
    out_emission = vec4(emission, 1.0);
#endif
#if OUTPUT_IDS
    out_ids = uvec2(ids.x, ids.y | ids.z);
#endif
}
