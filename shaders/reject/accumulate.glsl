// Running mean along the motion whose history a rejection test may reject: a reuse method.
//
// Paper      Yang et al. 2020, Eq. (1), with a = 1 / n.
// Needs      before it reject/contract.glsl and float difference(Point now, Point history, Pixel pixel)
// Departs    Triangle normals are not an input of reuse methods: they are the cross product of changes to the next pixels, and
//            history has its shading normal instead.

ivec2 inside(ivec2 at) { return clamp(at, ivec2(0), frame.size.xy - 1); }
bool is_surface(ivec2 at) { return fetch_position(at).w > 0.0; }
float then_depth(ivec2 at) { return dot(frame.prev_forward.xyz, fetch_prev_position(at).xyz); }
vec3 normal_of(ivec2 at) { return fetch_normal(at).xyz; }
vec3 radiance_at_pixel(ivec2 at) { return fetch_radiance(inside(at)).rgb; }
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
    history.radiance = fetch_prev_accumulated(there).rgb;
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

void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    vec2 at = previous_px(p);
    write_moved(p, fetch_motion(p));
    float count = 0.0;
    vec3 mean = vec3(0.0);
    if (frame.has_history == 1u && inside(at) && !history_rejected(p, at)) {
        vec4 kept = nearest_prev_accumulated(at); // the pixel that the test has seen
        mean = kept.rgb;
        count = min(kept.a, float(cap - 1));
    }
    write_reprojected_history(p, vec4(mean, float(count > 0.0)));
    count += 1.0;
    mean += (now - mean) / count;
    write_accumulated(p, vec4(mean, count));
    write_result(p, vec4(mean, 1.0 - 1.0 / count));
}
