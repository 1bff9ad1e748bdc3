// One level of SVGF's a-trous filter; the light of the first level is the history of the next frame.
//
// Paper    Schied et al. 2017, section 4.3: c' = sum h w c / sum h w, var' = sum h^2 w^2 var / (sum h w)^2, kernel
//          h = (1/16, 1/4, 3/8, 1/4, 1/16) both ways, step 2^level; section 4.4: weights, variance under Eq. (5) smoothed
//          by a 3x3 Gaussian.   Reference  references.reuse_methods.EdgeStopping, smoothed_variance, atrous_level
#include "edges.glsl"

// Of direct and indirect light.
vec2 smoothed_variance(ivec2 p) {
    vec2 sum = vec2(0.0);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) {
            ivec2 q = p + ivec2(x, y);
            float weight = (x == 0 ? 0.5 : 0.25) * (y == 0 ? 0.5 : 0.25);
            sum += weight * vec2(fetch_direct_filtered(q).a, fetch_indirect_filtered(q).a);
        }
    return sum;
}

void reuse(ivec2 p) {
    const float kernel[3] = float[3](3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0);
    vec4 direct = fetch_direct_filtered(p), indirect = fetch_indirect_filtered(p), position = fetch_position(p);
    vec3 normal = fetch_normal(p).xyz;
    vec2 slope = depth_slope(p), variance = variance_prefilter ? smoothed_variance(p) : vec2(direct.a, indirect.a);
    vec2 l = vec2(luminance(direct.rgb), luminance(indirect.rgb));
    int stride = 1 << iteration;
    float own = kernel[0] * kernel[0];
    vec2 total = vec2(own);
    vec4 sum_direct = own * vec4(direct.rgb, own * direct.a), sum_indirect = own * vec4(indirect.rgb, own * indirect.a);
    for (int y = -2; y <= 2; ++y)
        for (int x = -2; x <= 2; ++x) {
            ivec2 q = p + stride * ivec2(x, y);
            if (!atrous || (x == 0 && y == 0) || !in_image(q)) continue;
            float w = kernel[abs(x)] * kernel[abs(y)]
                * geometry_weight(position, fetch_position(q), normal, fetch_normal(q).xyz, slope, vec2(q - p));
            if (w == 0.0) continue;
            vec4 other = fetch_direct_filtered(q);
            float w_direct = w * luminance_weight(l.x, luminance(other.rgb), variance.x);
            sum_direct += w_direct * vec4(other.rgb, w_direct * other.a);
            other = fetch_indirect_filtered(q);
            float w_indirect = w * luminance_weight(l.y, luminance(other.rgb), variance.y);
            sum_indirect += w_indirect * vec4(other.rgb, w_indirect * other.a);
            total += vec2(w_direct, w_indirect);
        }
    direct = sum_direct / vec4(vec3(total.x), total.x * total.x);
    indirect = sum_indirect / vec4(vec3(total.y), total.y * total.y);
    write_direct_filtered(p, direct);
    write_indirect_filtered(p, indirect);
    if (iteration == 0) {
        vec3 kept = feedback ? direct.rgb : fetch_direct_filtered(p).rgb;
        write_direct_light(p, vec4(kept, fetch_frames(p).x));
        write_indirect_light(p, vec4(feedback ? indirect.rgb : fetch_indirect_filtered(p).rgb, 0.0));
    }
}
