// Whether a rejection test rejects the history of a pixel of a reuse method.
//
// Needs      before it reject/contract.glsl and float difference(Point now, Point history, Pixel pixel); radiance_at_pixel(ivec2) and
//            vec3 history_radiance(ivec2): of this frame and of history, of color tests; history ``moved``; setting ``threshold``
// Departs    Triangle normals are not an input of reuse methods: they are the cross product of changes to the next pixels, and
//            history has its shading normal instead.

ivec2 inside(ivec2 at) { return clamp(at, ivec2(0), frame.size.xy - 1); }
bool is_surface(ivec2 at) { return fetch_position(at).w > 0.0; }
float then_depth(ivec2 at) { return dot(frame.prev_forward.xyz, fetch_prev_position(at).xyz); }
vec3 normal_of(ivec2 at) { return fetch_normal(at).xyz; }
#include "reject/neighbors.glsl"

vec3 tangent(ivec2 at, ivec2 step, float here) {
    int side = smoother_side(at, step, here);
    return float(side) * (fetch_prev_position(at + side * step).xyz - fetch_prev_position(at).xyz);
}

bool history_rejected(ivec2 p, vec2 at) {
    ivec2 there = inside(ivec2(floor(at + 0.5)));
    vec4 then = fetch_history_position(there);
    if (is_surface(p) != (then.w > 0.0)) return true;
    if (!is_surface(p)) return false;
    Point now, history;
    Pixel pixel;
    now.position = fetch_prev_position(p).xyz;
    now.depth = then_depth(p);
    now.normal = normal_of(p);
    vec3 facing = cross(tangent(p, ivec2(1, 0), now.depth), tangent(p, ivec2(0, 1), now.depth));
    now.facing = dot(facing, facing) > 0.0 ? normalize(facing) : now.normal;
    now.object = fetch_ids(p).x;
    now.motion = fetch_motion(p);
    now.radiance = radiance_at_pixel(p);
    history.position = then.xyz;
    history.depth = then.w;
    history.normal = fetch_history_normal(there).xyz;
    history.facing = history.normal;
    history.object = fetch_history_ids(there).x;
    history.motion = fetch_prev_moved(there);
    history.radiance = history_radiance(there);
    mat4 m = frame.prev_clip_from_prev;
    vec2 scale = vec2(length(vec3(m[0][0], m[1][0], m[2][0])), length(vec3(m[0][1], m[1][1], m[2][1])));
    bool parallel = vec3(m[0][3], m[1][3], m[2][3]) == vec3(0.0);
    vec2 side = 2.0 / (scale * vec2(frame.size.xy));
    pixel.at = p;
    pixel.history_at = at;
    pixel.depth_gradient = vec2(slope(p, ivec2(1, 0), now.depth), slope(p, ivec2(0, 1), now.depth));
    pixel.normal_change = turn(p, ivec2(1, 0), now.normal) + turn(p, ivec2(0, 1), now.normal);
    pixel.footprint = max(side.x, side.y) * (parallel ? 1.0 : now.depth);
    pixel.image_height = pixel.footprint * float(frame.size.y);
    vec3 ray = fetch_position(p).xyz;
    pixel.cosine = abs(dot(now.facing, ray)) / max(length(ray), 1e-30);
    return difference(now, history, pixel) > threshold;
}
