// SVGF's variance estimate.  Paper: Schied et al. 2017, section 4.2: from the temporal moments, and for fewer than four
// frames from a 7x7 bilateral neighborhood.   Reference  references.reuse_methods.moments_variance, spatial_estimate
// Departs  The spatial estimate is scaled by 4 / n, as in the authors' later code, which gives few frames a larger variance.
#include "edges.glsl"
#include "moments.glsl"

void reuse(ivec2 p) {
    vec4 own_direct = fetch_direct_filtered(p), own_indirect = fetch_indirect_filtered(p);
    float count = fetch_frames(p).x;
    if (count > 3.5) { // a blend of integers is an integer only up to rounding
        write_direct_filtered(p, own_direct);
        write_indirect_filtered(p, own_indirect);
        return;
    }
    vec4 position = fetch_position(p);
    vec3 normal = fetch_normal(p).xyz;
    vec2 slope = depth_slope(p);
    vec3 direct = vec3(0.0), indirect = vec3(0.0);
    vec4 moments = vec4(0.0);
    float total = 0.0;
    for (int y = -3; y <= 3; ++y)
        for (int x = -3; x <= 3; ++x) {
            ivec2 q = p + ivec2(x, y);
            if (!in_image(q)) continue;
            float w = geometry_weight(position, fetch_position(q), normal, fetch_normal(q).xyz, slope, vec2(x, y));
            direct += w * fetch_direct_filtered(q).rgb;
            indirect += w * fetch_indirect_filtered(q).rgb;
            moments += w * fetch_moments(q);
            total += w;
        }
    moments /= total; // the center has weight 1
    vec2 variance = variance_of(moments.xz, moments.yw) * 4.0 / count;
    write_direct_filtered(p, vec4(direct / total, variance.x));
    write_indirect_filtered(p, vec4(indirect / total, variance.y));
}
