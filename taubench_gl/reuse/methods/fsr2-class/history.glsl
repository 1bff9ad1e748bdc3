// The accumulated color at a point of the previous image: Lanczos weights of 4x4 pixels, limited to the range of the nearest
// 2x2, so that the negative lobes leave no rings.   Reference references.reuse_methods.fsr2_sample_history
vec4 reprojected_color(vec2 at) {
    ivec2 base = ivec2(floor(at));
    vec2 f = at - floor(at);
    vec4 sum = vec4(0.0), low = vec4(1.0e30), high = vec4(-1.0e30);
    float total = 0.0;
    for (int i = 0; i < 16; ++i) {
        ivec2 o = ivec2(i % 4, i / 4) - 1;
        vec4 c = fetch_prev_color(base + o);
        float w = lanczos2(float(o.x) - f.x) * lanczos2(float(o.y) - f.y);
        sum += w * c;
        total += w;
        if (o.x >= 0 && o.x <= 1 && o.y >= 0 && o.y <= 1) {
            low = min(low, c);
            high = max(high, c);
        }
    }
    return clamp(sum / total, low, high);
}
