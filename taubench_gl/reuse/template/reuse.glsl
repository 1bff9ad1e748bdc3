// Runs once per pixel p; p = (0, 0) is the bottom left pixel.
void reuse(ivec2 p) {
    vec3 color = fetch_radiance(p).rgb;
    vec4 past = vec4(0.0); // rgb: history as it is fetched; a: 1 where there is history
    float history = 0.0;   // weight of history in the result
    if (reusable(p)) {     // there is history, and the surface at p was visible in the previous frame
        vec2 at = previous_px(p); // previous position of the surface, in pixels
        past = vec4(sample_prev_accumulated(at).rgb, 1.0);
        color = mix(past.rgb, color, alpha);
        history = 1.0 - alpha;
    }
    write_accumulated(p, vec4(color, 1.0));
    write_result(p, vec4(color, history));
    write_reprojected_history(p, past); // for the bound: the best blend of this history with the new frame
}
