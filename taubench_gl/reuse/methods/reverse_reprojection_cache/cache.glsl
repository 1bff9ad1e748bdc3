// Fetches the shading result at the previous position of the point; misses and blocks due for refresh are reshaded.
//
// Paper    Nehab et al. 2007: hit if the cached depth is the reprojected depth; blocks of pixels are refreshed in turn.
// Reference references.reuse_methods.cache_hit, refresh_due
// Departs  The paper compares depth-buffer values; here the relative difference of planar depth in meters.
bool cache_hit(float expected, float cached_depth) {
    if (expected <= 0.0) return cached_depth <= 0.0; // sky matches only sky
    return abs(cached_depth - expected) <= depth_threshold * expected;
}

// Refresh order that spreads neighboring blocks: (5 x + 3 y) mod refresh.
bool refresh_due(ivec2 p) {
    ivec2 tile = p / block;
    return (5 * tile.x + 3 * tile.y + frame.index) % refresh == 0;
}

void reuse(ivec2 p) {
    vec3 shaded = fetch_radiance(p).rgb;
    vec2 at = previous_px(p);
    bool hit = false;
    if (frame.has_history == 1u && inside(at) && !refresh_due(p)) {
        bool sky = !(fetch_position(p).w > 0.0);
        float expected = sky ? 0.0 : dot(frame.prev_forward.xyz, fetch_prev_position(p).xyz);
        hit = cache_hit(expected, sample_history_position(at, filtering).w);
    }
    vec4 fetched = frame.has_history == 1u && inside(at) ? vec4(sample_prev_cached(at, filtering).rgb, 1.0) : vec4(0.0);
    write_reprojected_history(p, fetched);
    vec4 kept = hit ? sample_prev_cached(at, filtering) : vec4(shaded, 0.0);
    write_cached(p, vec4(kept.rgb, hit ? kept.a + 1.0 : 0.0));
    write_result(p, vec4(kept.rgb, hit ? 1.0 : 0.0));
}
