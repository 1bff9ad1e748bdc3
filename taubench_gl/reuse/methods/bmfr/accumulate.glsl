// Accumulation of noisy illumination along the motion, tap by tap.
//
// Paper    Koskela et al. 2019, pre-processing: accepted taps are blended, their weights renormalized; weight of the new frame
//          max(1 / n, alpha).
// Reference references.reuse_methods.consistent_blend, exponential_average
#include "albedo.glsl"
#include "taps.glsl"

// The history of noisy illumination as a color.  It is not rectified; the regression comes after the blend.
void report(ivec2 p, vec3 history, float known) {
    if (fetch_position(p).w > 0.0)
        history = history * albedo_of(fetch_base_color(p)) + frame.exposure * fetch_emission(p).rgb;
    vec4 color = known > 0.0 ? vec4(history, 1.0) : vec4(0.0);
    write_reprojected_history(p, color);
    write_rectified_history(p, color);
}

void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    if (fetch_position(p).w > 0.0)
        now = (now - frame.exposure * fetch_emission(p).rgb) / albedo_of(fetch_base_color(p));
    vec2 at = previous_px(p);
    vec4 sum = vec4(0.0);
    float total = 0.0;
    if (frame.has_history == 1u && inside(at)) {
        for (int i = 0; i < 4; ++i) {
            Tap t = bilinear_tap(at, i);
            if (!accepted(p, t)) continue;
            sum += t.weight * fetch_prev_accumulated(t.at);
            total += t.weight;
        }
    }
    vec4 mean = total > 0.0 ? sum / total : vec4(0.0);
    report(p, mean.rgb, total);
    float count = mean.a + 1.0;
    float share = total > 0.0 ? max(1.0 / count, alpha) : 1.0;
    write_accumulated(p, vec4(mix(mean.rgb, now, share), min(count, 4096.0)));
}
