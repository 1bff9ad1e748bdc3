// Running mean along the motion, reset exactly where the exact mask discards history.
//
// Paper    TauBench section 3.2 (the masks); Yang et al. 2020, Eq. (1), with a = 1 / n.
// Reference references.reuse_methods.running_mean
void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    vec2 at = previous_px(p);
    bool known = frame.has_history == 1u && inside(at);
    vec4 fetched = known ? max(sample_prev_accumulated(at, filtering), 0.0) : vec4(0.0);
    write_reprojected_history(p, vec4(fetched.rgb, known ? 1.0 : 0.0)); // also where the masks reject it
    vec4 mean = vec4(0.0);
    if (known && reusable_exact(p)) {
        mean = fetched;
        mean.a = min(nearest_prev_accumulated(at).a, float(cap - 1)); // a count is not filtered
    }
    mean.a += 1.0;
    mean.rgb += (now - mean.rgb) / mean.a;
    write_accumulated(p, mean);
    write_result(p, vec4(mean.rgb, 1.0 - 1.0 / mean.a));
}
