// A quarter of the pixels is shaded per frame, in turn, at jittered positions; history accumulates them.
//
// Paper    Yang et al. 2020, section 5: f_n(p) = a b s_n(p) + (1 - a b) f_(n-1)(pi(p)); s_n: new samples weighted by
//          their distance from the pixel center, b: the weight of the nearest sample.
// Reference references.reuse_methods.upsample_blend
// Departs  a is 1 / (accumulated confidence) until it reaches alpha: a new pixel does not start from the fill.
vec4 new_samples(ivec2 p, float reach, out float best) {
    vec4 sum = vec4(0.0);
    best = 0.0;
    for (int y = -2; y <= 2; ++y)
        for (int x = -2; x <= 2; ++x) {
            ivec2 q = p + ivec2(x, y);
            vec4 c = fetch_radiance(q);
            if (c.a < 0.5 || !in_image(q)) continue;
            // The sample of pixel q is at q + jitter.
            vec2 tent = max(1.0 - abs(vec2(x, y) + frame.jitter_px) / reach, 0.0);
            float w = tent.x * tent.y;
            sum += w * vec4(c.rgb, 1.0);
            best = max(best, w);
        }
    return sum;
}

void reuse(ivec2 p) {
    float best, unused;
    vec4 sum = new_samples(p, radius, best);
    if (sum.a <= 0.0) sum = new_samples(p, 3.0, unused); // no near sample: a wide fill without confidence
    vec4 now = vec4(sum.a > 0.0 ? sum.rgb / sum.a : fetch_radiance(p).rgb, pow(best, confidence));
    vec2 at = previous_px(p);
    vec4 color = now;
    float kept = 0.0;
    vec4 fetched = vec4(0.0);
    if (reusable(p) && inside(at)) {
        vec3 history = max(sample_prev_accumulated(at, filtering).rgb, 0.0);
        fetched = vec4(history, 1.0);
        float gathered = nearest_prev_accumulated(at).a + now.a;
        float share = gathered > 0.0 ? max(now.a / gathered, alpha * now.a) : 0.5;
        kept = 1.0 - share;
        color = vec4(mix(now.rgb, history, kept), min(gathered, 1.0 / alpha));
    }
    write_reprojected_history(p, fetched);
    write_blend_input(p, now.rgb);
    write_accumulated(p, color);
    write_result(p, vec4(color.rgb, kept));
}
