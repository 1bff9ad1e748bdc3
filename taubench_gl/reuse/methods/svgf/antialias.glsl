// Temporal anti-aliasing of the tone-mapped image; the result is linear again.
//
// Paper    Schied et al. 2017, section 4: the tone-mapped image is anti-aliased over time as in Karis 2014: motion of the
//          nearest surface, history clipped to the rounded box of 3x3 colors in YCoCg, exponential average.
// Reference references.reuse_methods.antialiased, neighborhood_box, clip_to_box, tone_unmapped
// Departs  The result of a method is linear radiance, so the tone map is inverted after the average.  Karis weights colors
//          by 1 / (1 + luminance) because he averages before his tone map; here the average is after it.
#include "tone.glsl"

void rounded_box(ivec2 p, out vec3 low, out vec3 high) {
    vec3 cross_low, cross_high;
    low = high = cross_low = cross_high = ycocg_from_rgb(fetch_mapped(p).rgb);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            vec3 c = ycocg_from_rgb(fetch_mapped(p + ivec2(x, y)).rgb);
            low = min(low, c);
            high = max(high, c);
            if (x != 0 && y != 0) continue;
            cross_low = min(cross_low, c);
            cross_high = max(cross_high, c);
        }
    low = 0.5 * (low + cross_low);
    high = 0.5 * (high + cross_high);
}

void reuse(ivec2 p) {
    vec3 color = fetch_mapped(p).rgb;
    vec2 at = vec2(p) + fetch_motion(nearest_surface(p));
    float share = fetch_frames(p).y;
    if (taa && frame.has_history == 1u && inside(at)) {
        vec3 low, high;
        rounded_box(p, low, high);
        vec3 history = ycocg_from_rgb(sample_prev_antialiased(at, taa_filtering).rgb);
        color = mix(rgb_from_ycocg(clip_to_box(low, high, history)), color, taa_alpha);
        share *= taa_alpha;
    }
    write_antialiased(p, vec4(color, 1.0));
    write_result(p, vec4(tone_unmapped(color), 1.0 - share));
}
