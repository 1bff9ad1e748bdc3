// Accumulation of the fitted illumination with the taps of the first accumulation; then modulation by albedo.
//
// Paper    Koskela et al. 2019, post-processing: weight of the new frame max(1 / n, alpha_filtered), n frames of noisy data in
//          the pixel; color = albedo x illumination, display-encoded for the anti-aliasing that follows.
// Reference references.reuse_methods.consistent_blend, exponential_average, display_encoded
// Departs  The encoding x^(1 / 2.2) is not clamped at 1, so that the result is linear radiance again.
#include "albedo.glsl"
#include "taps.glsl"

void reuse(ivec2 p) {
    vec3 color = fetch_fitted(p).rgb;
    vec2 at = previous_px(p);
    vec3 sum = vec3(0.0);
    float total = 0.0;
    if (frame.has_history == 1u && inside(at)) {
        for (int i = 0; i < 4; ++i) {
            Tap t = bilinear_tap(at, i);
            if (!accepted(p, t)) continue;
            sum += t.weight * fetch_prev_filtered(t.at).rgb;
            total += t.weight;
        }
    }
    float count = fetch_accumulated(p).a;
    float share = total > 0.0 ? max(1.0 / count, alpha_filtered) : 1.0;
    if (total > 0.0) color = mix(sum / total, color, share);
    write_filtered(p, vec4(color, 1.0));
    if (fetch_position(p).w > 0.0)
        color = color * albedo_of(fetch_base_color(p)) + frame.exposure * fetch_emission(p).rgb;
    float share_noisy = total > 0.0 ? max(1.0 / count, alpha) : 1.0;
    write_shaded(p, vec4(pow(max(color, 0.0), vec3(1.0 / 2.2)), share * share_noisy));
}
