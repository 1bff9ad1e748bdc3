// Temporal anti-aliasing with a variance clip.
//
// Paper    Salvi 2016: m1 = mean, sigma = sqrt(m2 - m1^2) over 3x3 pixels in YCoCg; box = m1 +- gamma sigma.
//          Pedersen 2016: clip towards the center (clip_to_box).
// Reference references.reuse_methods.variance_box, clip_to_box
// Departs  Moments are relative to the color of the pixel: about 0, float32 has too little precision for bright colors.
//          With keep_own the box contains the color of the pixel; without it, one-pixel details fade in a still image.
void variance_box(ivec2 p, out vec3 low, out vec3 high) {
    vec3 own = ycocg_from_rgb(fetch_radiance(p).rgb);
    vec3 m1 = vec3(0.0), m2 = vec3(0.0);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            vec3 c = ycocg_from_rgb(fetch_radiance(p + ivec2(x, y)).rgb) - own;
            m1 += c;
            m2 += c * c;
        }
    m1 /= 9.0;
    vec3 sigma = sqrt(max(m2 / 9.0 - m1 * m1, 0.0));
    low = own + m1 - gamma * sigma;
    high = own + m1 + gamma * sigma;
    if (keep_own) {
        low = min(low, own);
        high = max(high, own);
    }
}

void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    vec2 at = vec2(p) + fetch_motion(dilate ? nearest_surface(p) : p);
    vec3 color = now;
    float kept = 0.0;
    vec4 fetched = vec4(0.0), used = vec4(0.0);
    if (frame.has_history == 1u && inside(at)) {
        vec3 low, high;
        variance_box(p, low, high);
        fetched = vec4(max(sample_prev_accumulated(at, filtering).rgb, 0.0), 1.0);
        vec3 history = rgb_from_ycocg(clip_to_box(low, high, ycocg_from_rgb(fetched.rgb)));
        used = vec4(history, 1.0);
        kept = 1.0 - alpha;
        color = mix(now, history, kept);
    }
    write_reprojected_history(p, fetched);
    write_rectified_history(p, used);
    write_accumulated(p, vec4(color, 1.0));
    write_result(p, vec4(color, kept));
}
