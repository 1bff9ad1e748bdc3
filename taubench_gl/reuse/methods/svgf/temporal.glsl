// SVGF's temporal filter: demodulated radiance and the moments of its luminance, along the motion, tap by tap.
//
// Paper    Schied et al. 2017, section 4.1: 2x2 taps with bilinear weights, each tested for depth, normal and object; if
//          none passes, a 3x3 neighborhood is used; exponential moving average with alpha.
// Reference metrics.reuse_methods.consistent_blend, exponential_average
// Departs  The paper filters direct and indirect light separately; here their sum.  Weight of the new frame
//          max(1 / n, alpha), as in the authors' later code, so that the first frames have equal weights.
#include "albedo.glsl"

bool consistent(ivec2 q, bool surface, float expected, vec3 normal, uint id) {
    if (!in_image(q)) return false;
    float depth = fetch_history_position(q).w;
    if ((depth > 0.0) != surface) return false;
    if (!surface) return true;
    if (abs(depth - expected) > depth_limit * expected) return false;
    if (dot(fetch_history_normal(q).xyz, normal) < normal_limit) return false;
    return !check_ids || fetch_history_ids(q).x == id;
}

void reuse(ivec2 p) {
    bool surface = fetch_position(p).w > 0.0;
    vec3 now = fetch_radiance(p).rgb;
    if (surface) now = (now - frame.exposure * fetch_emission(p).rgb) / albedo_of(fetch_base_color(p));
    float expected = dot(frame.prev_forward.xyz, fetch_prev_position(p).xyz);
    vec3 normal = fetch_normal(p).xyz;
    uint id = fetch_ids(p).x;
    vec2 at = previous_px(p);
    vec3 color = vec3(0.0), moments = vec3(0.0);
    float total = 0.0;
    if (frame.has_history == 1u && inside(at)) {
        for (int i = 0; i < 4; ++i) {
            Tap t = bilinear_tap(at, i);
            if (t.weight <= 0.0 || !consistent(t.at, surface, expected, normal, id)) continue;
            color += t.weight * fetch_prev_illumination(t.at).rgb;
            moments += t.weight * fetch_prev_moments(t.at).xyz;
            total += t.weight;
        }
        if (total <= 0.0) {
            ivec2 middle = ivec2(floor(at + 0.5));
            for (int i = 0; i < 9; ++i) {
                ivec2 q = middle + ivec2(i % 3 - 1, i / 3 - 1);
                if (!consistent(q, surface, expected, normal, id)) continue;
                color += fetch_prev_illumination(q).rgb;
                moments += fetch_prev_moments(q).xyz;
                total += 1.0;
            }
        }
    }
    if (total > 0.0) {
        color /= total;
        moments /= total;
    }
    float l = luminance(now), count = moments.z + 1.0;
    float share = total > 0.0 ? max(1.0 / count, alpha) : 1.0;
    float share_moments = total > 0.0 ? max(1.0 / count, alpha_moments) : 1.0;
    color = mix(color, now, share);
    moments.xy = mix(moments.xy, vec2(l, l * l), share_moments);
    write_moments(p, vec4(moments.xy, min(count, 256.0), share));
    write_filtered(p, vec4(color, max(moments.y - moments.x * moments.x, 0.0)));
}
