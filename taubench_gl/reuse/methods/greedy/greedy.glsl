// Blends the frame with its own history by the weight in [0, 1] that brings each pixel nearest to the reference.
//
// Paper    none: w = clamp(<R - I, H - I> / <H - I, H - I>, 0, 1), the projection of R on the segment from I to H.
// Reference metrics.blending.nearest_weight
void reuse(ivec2 p) {
    vec3 now = fetch_radiance(p).rgb;
    vec2 at = previous_px(p);
    vec3 color = now;
    vec4 history = vec4(0.0);
    float kept = 0.0;
    if (frame.has_history == 1u && inside(at)) {
        history = vec4(max(sample_prev_accumulated(at, filtering).rgb, 0.0), 1.0); // cubic sampling can undershoot
        vec3 way = history.rgb - now;
        float square = dot(way, way);
        if (square > 0.0) kept = clamp(dot(fetch_reference(p).rgb - now, way) / square, 0.0, 1.0);
        color = mix(now, history.rgb, kept);
    }
    write_reprojected_history(p, history);
    write_accumulated(p, vec4(color, 1.0));
    write_result(p, vec4(color, kept));
}
