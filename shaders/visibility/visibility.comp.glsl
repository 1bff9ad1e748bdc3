// Whether the previous camera saw the surface point of each pixel: one ray each, against the surfaces of the frame before.
//
// Paper      Eq. (3), of the point's own previous position.
// Reads      position, prev_position, ids, acceleration structure of the frame before.
// Writes     prev_visibility (bits VISIBILITY_*)
// Reference  references.visibility.visibility
// Departs    Surfaces within V.footprint / 32 before a point do not hide it: the rasterizer snaps corners to 1/256 pixel, so a
//            point can lie that far behind the next triangle.
#include "common/affine.glsl"
#include "common/motion.glsl"
#include "common/numbers.glsl"
#include "raytracing/trace.glsl"
#if TRACE_ALPHA
#include "raytracing/alpha.glsl"
#endif

// Bits of a surface point that was at q, relative to the previous camera.
uint seen(vec3 q, float depth) {
    float whole = V.parallel > 0.5 ? depth : 1.0; // length of ``along`` in multiples of what is traced
    vec3 along = V.parallel > 0.5 ? V.prev_forward.xyz * depth : q;
    vec3 start = q - along; // on the previous camera, or on its plane
    float skipped = V.prev_near / depth; // nothing is drawn before the near plane
    if (skipped >= 1.0) return VISIBILITY_VISIBLE;
    vec3 rest = (1.0 - skipped) * along;
    float reach = (V.footprint.x + V.footprint.y * depth) / 32.0;
    float t_max = 1.0 - reach / length(rest);
    if (t_max <= 0.0) return VISIBILITY_VISIBLE;
    vec3 origin = start + skipped * along - V.camera_delta.xyz; // rays are relative to the current camera
    sight_slack = ORIGIN_OFFSET * max(rounding_size(q), rounding_size(origin));
    return occluded_before(Ray(origin, rest, t_max)) ? VISIBILITY_OCCLUDED : VISIBILITY_VISIBLE;
}

uint sky_seen(vec4 q) {
    vec3 direction = V.parallel > 0.5 ? V.prev_forward.xyz : normalize(q.xyz);
    float depth = dot(V.prev_forward.xyz, direction);
    vec3 start = V.parallel > 0.5 ? q.xyz - V.prev_forward.xyz * dot(V.prev_forward.xyz, q.xyz) : vec3(0.0);
    vec3 origin = start + direction * (V.prev_near / depth) - V.camera_delta.xyz;
    sight_slack = -1.0;
    return occluded_before(Ray(origin, direction, 1e30)) ? VISIBILITY_OCCLUDED : VISIBILITY_VISIBLE;
}

uint classify(ivec2 pixel) {
    vec4 p = position_at(pixel);
    bool surface = p.w > 0.0;
    uint bits = surface ? 0u : VISIBILITY_SKY;
    if (non_finite(p)) return VISIBILITY_INVALID;
    vec4 q, now = vec4(p.xyz, 1.0); // then and now, relative to the previous and to the current camera
    if (surface) {
        uvec2 ids = ids_at(pixel).xy;
        bool absent = (draw_sides[int(ids.x) - 1] & SIDE_ABSENT) != 0u;
        if (absent || (ids.y & NO_HISTORY) != 0u) return VISIBILITY_NEW;
        q = vec4(prev_position_at(pixel).xyz, 1.0);
        if (non_finite(q)) return VISIBILITY_INVALID;
        if (distance(q.xyz, p.xyz + V.camera_delta.xyz) > V.threshold_position) bits |= VISIBILITY_MOVED;
    } else {
        now = V.sky_origin + float(pixel.x) * V.sky_dx + float(pixel.y) * V.sky_dy;
        q = vec4(now.xyz + V.sky_origin.w * V.camera_delta.xyz, now.w);
    }
    float depth = dot(V.prev_forward.xyz, q.xyz);
    float limit = surface ? V.guarded_near - max(V.near - p.w, 0.0) : 0.0;
    if (depth <= limit) return bits | VISIBILITY_BEHIND;
    vec2 at = vec2(pixel) + motion_in_pixels(V.prev_clip_from_prev, q, V.clip_from_current, now, V.size.xy);
    if (non_finite(at)) return VISIBILITY_INVALID;
    vec2 last = vec2(V.size.xy - 1);
    if (any(lessThan(at, vec2(-V.guard_px))) || any(greaterThan(at, last + V.guard_px))) return bits | VISIBILITY_OUTSIDE;
    return bits | (surface ? seen(q.xyz, depth) : sky_seen(q));
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, V.size.xy))) return;
    imageStore(prev_visibility_out, pixel, uvec4(classify(pixel)));
}
