// SVGF's variance estimate.  Paper: Schied et al. 2017, section 4.2: from the temporal moments, and for fewer than four
// frames from those of a 7x7 bilateral neighborhood.   Reference  references.reuse_methods.moments_variance, spatial_variance
#include "edges.glsl"
#include "moments.glsl"

void reuse(ivec2 p) {
    vec4 direct = fetch_direct_filtered(p), indirect = fetch_indirect_filtered(p);
    if (spatial_variance && fetch_frames(p).x < 3.5) { // a blend of integers is an integer only up to rounding
        vec4 position = fetch_position(p), moments = vec4(0.0);
        vec3 normal = fetch_normal(p).xyz;
        vec2 slope = depth_slope(p);
        float total = 0.0;
        for (int y = -3; y <= 3; ++y)
            for (int x = -3; x <= 3; ++x) {
                ivec2 q = p + ivec2(x, y);
                if (!in_image(q)) continue;
                float w = geometry_weight(position, fetch_position(q), normal, fetch_normal(q).xyz, slope, vec2(x, y));
                moments += w * fetch_moments(q);
                total += w;
            }
        moments /= total; // the center has weight 1
        vec2 variance = variance_of(moments.xz, moments.yw);
        direct.a = variance.x;
        indirect.a = variance.y;
    }
    write_direct_filtered(p, direct);
    write_indirect_filtered(p, indirect);
}
