// Pixels shaded in this frame are kept; others use valid history, else the mean of their shaded neighbors.
//
// Paper    El Mansouri 2016 (history, clamp), Wihlidal 2017 (fallback: mean of the shaded neighbors).
// Reference references.reuse_methods.shaded_neighbors
// Departs  The originals validate history with id buffers; here the geometry mask does.
void reuse(ivec2 p) {
    vec4 own = fetch_radiance(p);
    vec3 color = own.rgb;
    float kept = 0.0;
    vec4 fetched = vec4(0.0), used = vec4(0.0);
    vec3 spatial = own.rgb;
    if (own.a < 0.5) {
        vec3 low = vec3(1.0e30), high = vec3(-1.0e30), sum = vec3(0.0);
        float count = 0.0;
        for (int i = 0; i < 4; ++i) {
            vec4 c = fetch_radiance(p + ivec2[4](ivec2(1, 0), ivec2(-1, 0), ivec2(0, 1), ivec2(0, -1))[i]);
            if (c.a < 0.5) continue;
            low = min(low, c.rgb);
            high = max(high, c.rgb);
            sum += c.rgb;
            count += 1.0;
        }
        if (count > 0.0) color = sum / count;
        spatial = color;
        vec2 at = previous_px(p);
        if (reusable(p) && inside(at)) {
            color = max(sample_prev_resolved(at, filtering).rgb, 0.0);
            fetched = vec4(color, 1.0);
            if (clamping && count > 0.0) color = clamp(color, low - slack * (high - low), high + slack * (high - low));
            used = vec4(color, 1.0);
            kept = 1.0;
        }
    }
    write_reprojected_history(p, fetched);
    write_rectified_history(p, used);
    write_blend_input(p, spatial);
    write_resolved(p, vec4(color, 1.0));
    write_result(p, vec4(color, kept));
}
