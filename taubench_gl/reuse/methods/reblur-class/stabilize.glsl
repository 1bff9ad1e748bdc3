// Temporal stabilization of the luminance of both lobes, anti-lag, and the result.
//
// Paper    Zhdanov 2021, ReBLUR, temporal stabilization: stabilized history is clamped to mean and deviation of the
//          neighborhood and blended; the more it is clamped, the fewer frames the accumulation keeps (anti-lag).
// Reference references.reuse_methods.Reblur
// Departs  3x3 pixels; anti-lag = 1 / (1 + strength x distance outside the range / the larger luminance).
// Mean and deviation of the luminance of both lobes; relative to that of the pixel, so that float32 is precise enough.
void local_range(ivec2 p, out vec2 mean, out vec2 sigma) {
    vec2 own = vec2(luminance(fetch_diffuse_now(p).rgb), luminance(fetch_specular_now(p).rgb));
    vec3 d = vec3(0.0), s = vec3(0.0); // sums of 1, difference, difference^2
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            ivec2 q = p + ivec2(x, y);
            if (!in_image(q) || !(fetch_position(q).w > 0.0)) continue;
            float l_d = luminance(fetch_diffuse_now(q).rgb) - own.x, l_s = luminance(fetch_specular_now(q).rgb) - own.y;
            d += vec3(1.0, l_d, l_d * l_d);
            s += vec3(1.0, l_s, l_s * l_s);
        }
    mean = vec2(d.y, s.y) / d.x;
    sigma = sqrt(max(vec2(d.z, s.z) / d.x - mean * mean, 0.0));
    mean += own;
}

void reuse(ivec2 p) {
    vec2 at = previous_px(p), stable = vec2(0.0), count = fetch_count(p);
    if (!(fetch_position(p).w > 0.0)) {
        write_stable(p, stable);
        write_frames(p, vec2(0.0));
        write_result(p, vec4(fetch_emitted(p).rgb, 0.0));
        return;
    }
    vec3 light[2] = vec3[2](fetch_diffuse_now(p).rgb, fetch_specular_now(p).rgb);
    vec2 mean, sigma, kept = 1.0 - 1.0 / count;
    local_range(p, mean, sigma);
    bool seen = frame.has_history == 1u && inside(at);
    vec2 before = seen ? sample_prev_stable(at) : vec2(0.0);
    for (int lobe = 0; lobe < 2; ++lobe) {
        float l = luminance(light[lobe]);
        stable[lobe] = l;
        if (!seen || count[lobe] < 1.5) continue;
        float inner = clamp(before[lobe], mean[lobe] - clamp_sigma * sigma[lobe], mean[lobe] + clamp_sigma * sigma[lobe]);
        float lag = abs(before[lobe] - inner) / max(max(before[lobe], l), 1.0e-6);
        float trust = 1.0 / (1.0 + anti_lag * lag), frames = min(count[lobe] - 1.0, float(stable_frames));
        stable[lobe] = mix(l, inner, trust * frames / (1.0 + frames));
        count[lobe] *= trust;
        if (l > 0.0) light[lobe] *= stable[lobe] / l;
    }
    vec3 d = light[0] * fetch_diffuse_albedo(p).rgb, s = light[1] * fetch_specular_albedo(p).rgb;
    vec2 part = max(vec2(luminance(d), luminance(s)), 1.0e-9);
    write_stable(p, stable);
    write_frames(p, count);
    write_result(p, vec4(max(d + s + fetch_emitted(p).rgb, 0.0), dot(part, kept) / (part.x + part.y)));
}
