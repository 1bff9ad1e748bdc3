// Running mean along the motion whose history a rejection test may reject: a reuse method.
//
// Paper      Yang et al. 2020, Eq. (1), with a = 1 / n.
// Needs      before it reject/contract.glsl and float difference(Point now, Point history, Pixel pixel)

vec3 radiance_at_pixel(ivec2 at) { return fetch_radiance(clamp(at, ivec2(0), frame.size.xy - 1)).rgb; }
vec3 history_radiance(ivec2 at) { return fetch_prev_accumulated(at).rgb; }
#include "reject/history.glsl"

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
