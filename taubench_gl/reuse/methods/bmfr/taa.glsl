// Temporal anti-aliasing of the display-encoded image.
//
// Paper    Koskela et al. 2019, post-processing, after Karis 2014: history is clamped to the YCoCg box of the 3x3 neighborhood,
//          averaged with that of the plus-shaped five pixels; weight of the new frame alpha_taa.
// Reference references.reuse_methods.neighborhood_box, exponential_average, display_decoded
void reuse(ivec2 p) {
    vec4 own = fetch_shaded(p);
    vec3 color = own.rgb;
    float share = 1.0;
    vec2 at = previous_px(p);
    if (frame.has_history == 1u && inside(at)) {
        vec3 low = vec3(1.0e30), high = vec3(-1.0e30), cross_low = low, cross_high = high;
        for (int y = -1; y <= 1; ++y)
            for (int x = -1; x <= 1; ++x) {
                vec3 c = ycocg_from_rgb(fetch_shaded(p + ivec2(x, y)).rgb);
                low = min(low, c);
                high = max(high, c);
                if (x == 0 || y == 0) {
                    cross_low = min(cross_low, c);
                    cross_high = max(cross_high, c);
                }
            }
        vec3 before = ycocg_from_rgb(sample_prev_antialiased(at).rgb);
        before = rgb_from_ycocg(clamp(before, 0.5 * (low + cross_low), 0.5 * (high + cross_high)));
        share = alpha_taa;
        color = mix(before, color, share);
    }
    write_antialiased(p, vec4(color, 1.0));
    write_result(p, vec4(pow(max(color, 0.0), vec3(2.2)), 1.0 - share * own.a));
}
