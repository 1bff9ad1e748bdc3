// SVGF's variance estimate.  Paper: Schied et al. 2017, section 4.2: from the temporal moments, and for fewer than four
// frames from a 7x7 bilateral neighborhood.   Reference  metrics.reuse_methods.moments_variance
// Departs  The spatial estimate is scaled by 4 / n, as in the authors' later code, which gives few frames a larger variance.
#include "edges.glsl"

void reuse(ivec2 p) {
    vec4 own = fetch_filtered(p);
    float count = fetch_moments(p).z;
    if (count > 3.5) { // a blend of integers is an integer only up to rounding
        write_filtered(p, own);
        return;
    }
    vec4 position = fetch_position(p);
    vec3 normal = fetch_normal(p).xyz;
    vec2 slope = depth_slope(p);
    vec3 color = vec3(0.0);
    vec2 moments = vec2(0.0);
    float total = 0.0;
    for (int y = -3; y <= 3; ++y)
        for (int x = -3; x <= 3; ++x) {
            ivec2 q = p + ivec2(x, y);
            if (!in_image(q)) continue;
            float w = geometry_weight(position, fetch_position(q), normal, fetch_normal(q).xyz, slope, vec2(x, y));
            color += w * fetch_filtered(q).rgb;
            moments += w * fetch_moments(q).xy;
            total += w;
        }
    color /= total; // the center has weight 1
    moments /= total;
    write_filtered(p, vec4(color, max(moments.y - moments.x * moments.x, 0.0) * 4.0 / count));
}
