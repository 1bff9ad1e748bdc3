// Temporal anti-aliasing with a neighborhood clamp.
//
// Paper    Karis 2014: history is clamped to the YCoCg box of the 3x3 neighborhood, blended with weights 1 / (1 + L).
// Reference references.reuse_methods.neighborhood_box, karis_blend
// Departs  Karis also filters the new samples by a Blackman-Harris window around the jitter; here they are not filtered.
void neighborhood_box(ivec2 p, out vec3 low, out vec3 high) {
    vec3 cross_low = vec3(1.0e30), cross_high = vec3(-1.0e30);
    low = cross_low;
    high = cross_high;
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            vec3 c = ycocg_from_rgb(fetch_radiance(p + ivec2(x, y)).rgb);
            low = min(low, c);
            high = max(high, c);
            if (x == 0 || y == 0) {
                cross_low = min(cross_low, c);
                cross_high = max(cross_high, c);
            }
        }
    if (rounded) {
        low = 0.5 * (low + cross_low);
        high = 0.5 * (high + cross_high);
    }
}

void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    vec2 at = vec2(p) + fetch_motion(dilate ? nearest_surface(p) : p);
    vec3 color = now;
    float kept = 0.0;
    vec4 fetched = vec4(0.0), used = vec4(0.0);
    if (frame.has_history == 1u && inside(at)) {
        vec3 history = max(sample_prev_accumulated(at, filtering).rgb, 0.0); // cubic sampling can undershoot
        fetched = vec4(history, 1.0);
        if (clamping) {
            vec3 low, high;
            neighborhood_box(p, low, high);
            history = rgb_from_ycocg(clamp(ycocg_from_rgb(history), low, high));
        }
        used = vec4(history, 1.0);
        float w_now = alpha, w_history = 1.0 - alpha;
        if (weighting) {
            w_now /= 1.0 + max(luminance(now), 0.0);
            w_history /= 1.0 + max(luminance(history), 0.0);
        }
        kept = w_history / (w_now + w_history);
        color = mix(now, history, kept);
    }
    write_reprojected_history(p, fetched);
    write_rectified_history(p, used);
    write_accumulated(p, vec4(color, 1.0));
    write_result(p, vec4(color, kept));
}
