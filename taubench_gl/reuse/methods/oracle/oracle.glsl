// Running mean along the motion, reset exactly where the exact mask discards history.
//
// Paper    TauBench section 3.2 (the masks); Yang et al. 2020, Eq. (1), with a = 1 / n.
// Reference metrics.reuse_methods.running_mean
void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    vec2 at = previous_px(p);
    vec4 mean = vec4(0.0);
    if (reusable_exact(p) && inside(at)) {
        mean = max(sample_prev_accumulated(at, filtering), 0.0);
        mean.a = min(nearest_prev_accumulated(at).a, float(cap - 1)); // a count is not filtered
    }
    mean.a += 1.0;
    mean.rgb += (now - mean.rgb) / mean.a;
    write_accumulated(p, mean);
    write_result(p, vec4(mean.rgb, 1.0 - 1.0 / mean.a));
}
