// Accumulation whose four bilinear taps are each accepted or rejected by world position and normal.
//
// Paper    Koskela et al. 2019, accumulation of noisy data: taps within both limits are blended, their weights
//          renormalized; weight of the new frame max(1 / n, alpha).  Limits as in the method bmfr.
// Reference references.reuse_methods.consistent_blend
// Departs  A moving point is compared at its previous position (prev_position); the scenes of the paper are static.  The
//          stages after it are in the method bmfr.
void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    bool surface = fetch_position(p).w > 0.0;
    vec3 expected = fetch_prev_position(p).xyz, normal = fetch_normal(p).xyz;
    vec2 at = previous_px(p);
    vec4 sum = vec4(0.0);
    float total = 0.0;
    if (frame.has_history == 1u && inside(at)) {
        for (int i = 0; i < 4; ++i) {
            Tap t = bilinear_tap(at, i);
            if (t.weight <= 0.0 || !in_image(t.at)) continue;
            vec4 there = fetch_history_position(t.at);
            if ((there.w > 0.0) != surface) continue;
            if (surface) {
                if (distance(there.xyz, expected) > position_limit) continue;
                if (distance(fetch_history_normal(t.at).xyz, normal) > normal_limit) continue;
            }
            sum += t.weight * fetch_prev_accumulated(t.at);
            total += t.weight;
        }
    }
    vec4 mean = total > 0.0 ? sum / total : vec4(0.0);
    write_reprojected_history(p, vec4(mean.rgb, total > 0.0 ? 1.0 : 0.0));
    float count = mean.a + 1.0;
    float share = total > 0.0 ? max(1.0 / count, alpha) : 1.0;
    mean.rgb += share * (now - mean.rgb);
    write_accumulated(p, vec4(mean.rgb, min(count, 4096.0)));
    write_result(p, vec4(mean.rgb, 1.0 - share));
}
