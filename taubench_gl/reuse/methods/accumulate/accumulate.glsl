// Running mean of all frames along the motion; rejects only history that was off-screen.
// Paper    Yang et al. 2020, Eq. (1), with a = 1 / n.   Reference  references.reuse_methods.running_mean
void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    vec2 at = previous_px(p);
    vec4 mean = vec4(0.0);
    float known = 0.0;
    if (frame.has_history == 1u && inside(at)) {
        mean = max(sample_prev_accumulated(at, filtering), 0.0); // cubic sampling can undershoot
        known = 1.0;
        mean.a = min(nearest_prev_accumulated(at).a, float(cap - 1)); // a count is not filtered
    }
    write_reprojected_history(p, vec4(mean.rgb, known));
    mean.a += 1.0;
    mean.rgb += (now - mean.rgb) / mean.a;
    write_accumulated(p, mean);
    write_result(p, vec4(mean.rgb, 1.0 - 1.0 / mean.a));
}
