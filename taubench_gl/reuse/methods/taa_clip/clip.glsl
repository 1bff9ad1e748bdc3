// Temporal anti-aliasing with a neighborhood clip.
//
// Paper    Karis 2014: history is clipped to the YCoCg box of the 3x3 neighborhood where the ray from it to the average of the
//          neighborhood enters the box; blended with weights 1 / (1 + L).  A clamp moves each component apart and so changes hue.
//          The new samples are filtered by a Blackman-Harris window of 3.3 pixels, as a Gaussian, around the pixel center.
// Reference references.reuse_methods.neighborhood_box, neighborhood_mean, clip_towards, karis_blend, windowed
// Departs  The window is off by default: without jitter it only blurs.
vec3 windowed(ivec2 p) {
    vec4 sum = vec4(0.0);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            vec2 d = vec2(x, y) + frame.jitter_px;
            sum += exp(-2.29 * dot(d, d)) * vec4(fetch_radiance(p + ivec2(x, y)).rgb, 1.0);
        }
    return sum.rgb / sum.a;
}

void reuse(ivec2 p) {
    vec3 now = window ? windowed(p) : fetch_radiance(p).rgb;
    vec2 at = vec2(p) + fetch_motion(dilate ? nearest_surface(p) : p);
    vec3 color = now;
    float kept = 0.0;
    vec4 fetched = vec4(0.0), used = vec4(0.0);
    if (frame.has_history == 1u && inside(at)) {
        vec3 low = vec3(1.0e30), high = vec3(-1.0e30), cross_low = low, cross_high = high, mean = vec3(0.0);
        for (int y = -1; y <= 1; ++y)
            for (int x = -1; x <= 1; ++x) {
                vec3 c = ycocg_from_rgb(fetch_radiance(p + ivec2(x, y)).rgb);
                low = min(low, c);
                high = max(high, c);
                mean += c / 9.0;
                if (x == 0 || y == 0) {
                    cross_low = min(cross_low, c);
                    cross_high = max(cross_high, c);
                }
            }
        if (rounded) { // the mean is inside this box too: at most 4 of 9 pixels are outside the plus-shaped five
            low = 0.5 * (low + cross_low);
            high = 0.5 * (high + cross_high);
        }
        vec3 history = max(sample_prev_accumulated(at, filtering).rgb, 0.0); // cubic sampling can undershoot
        fetched = vec4(history, 1.0);
        history = rgb_from_ycocg(clip_towards(low, high, clamp(mean, low, high), ycocg_from_rgb(history)));
        used = vec4(history, 1.0);
        float w_now = alpha, w_history = 1.0 - alpha;
        if (weighting) {
            w_now /= 1.0 + max(luminance(now), 0.0);
            w_history /= 1.0 + max(luminance(history), 0.0);
        }
        kept = w_history / (w_now + w_history);
        color = mix(now, history, kept);
    }
    write_blend_input(p, now);
    write_reprojected_history(p, fetched);
    write_rectified_history(p, used);
    write_accumulated(p, vec4(color, 1.0));
    write_result(p, vec4(color, kept));
}
