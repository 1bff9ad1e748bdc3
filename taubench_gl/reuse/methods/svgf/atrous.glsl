// One level of SVGF's a-trous filter; the color of the first level is the history of the next frame.
//
// Paper    Schied et al. 2017, section 4.3: c' = sum h w c / sum h w, var' = sum h^2 w^2 var / (sum h w)^2, kernel
//          h = (1/16, 1/4, 3/8, 1/4, 1/16) both ways, step 2^level; section 4.4: weights, variance under Eq. (5) smoothed
//          by a 3x3 Gaussian.   Reference  metrics.reuse_methods.EdgeStopping, atrous_level
#include "edges.glsl"

float smoothed_variance(ivec2 p) {
    float sum = 0.0;
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x)
            sum += (x == 0 ? 0.5 : 0.25) * (y == 0 ? 0.5 : 0.25) * fetch_filtered(p + ivec2(x, y)).a;
    return sum;
}

void reuse(ivec2 p) {
    const float kernel[3] = float[3](3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0);
    vec4 own = fetch_filtered(p), position = fetch_position(p);
    vec3 normal = fetch_normal(p).xyz;
    vec2 slope = depth_slope(p);
    float l = luminance(own.rgb), variance = smoothed_variance(p);
    int stride = 1 << iteration;
    float total = kernel[0] * kernel[0];
    vec4 sum = vec4(total * own.rgb, total * total * own.a);
    for (int y = -2; y <= 2; ++y)
        for (int x = -2; x <= 2; ++x) {
            ivec2 q = p + stride * ivec2(x, y);
            if ((x == 0 && y == 0) || !in_image(q)) continue;
            vec4 other = fetch_filtered(q);
            float w = kernel[abs(x)] * kernel[abs(y)] * luminance_weight(l, luminance(other.rgb), variance)
                * geometry_weight(position, fetch_position(q), normal, fetch_normal(q).xyz, slope, vec2(q - p));
            sum += vec4(w * other.rgb, w * w * other.a);
            total += w;
        }
    vec4 filtered = vec4(sum.rgb / total, sum.a / (total * total));
    write_filtered(p, filtered);
    if (iteration == 0) write_illumination(p, filtered);
}
