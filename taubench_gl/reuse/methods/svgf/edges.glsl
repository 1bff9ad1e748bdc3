// Edge-stopping functions.  Paper: Schied et al. 2017, section 4.4.   Reference  references.reuse_methods.EdgeStopping

// Clip-space depth is a constant less a multiple of this, and so linear over the image of a plane; 0: sky.
float inverse_depth(vec4 position) { return position.w > 0.0 ? 1.0 / position.w : 0.0; }

// Change of inverse depth per pixel to the right and up: the smaller one-sided difference, so that an edge is no slope.
vec2 depth_slope(ivec2 p) {
    float z = inverse_depth(fetch_position(p));
    vec2 slope = vec2(0.0);
    for (int axis = 0; axis < 2; ++axis) {
        ivec2 e = axis == 0 ? ivec2(1, 0) : ivec2(0, 1);
        float after = in_image(p + e) ? inverse_depth(fetch_position(p + e)) : 0.0;
        float before = in_image(p - e) ? inverse_depth(fetch_position(p - e)) : 0.0;
        float forward = after > 0.0 ? after - z : 1.0e30, backward = before > 0.0 ? z - before : 1.0e30;
        float least = abs(forward) < abs(backward) ? forward : backward;
        slope[axis] = abs(least) < 1.0e29 ? least : 0.0;
    }
    return slope;
}

// w_z w_n of pixels p and q = p + offset, both of them surface or both sky.
float geometry_weight(vec4 p, vec4 q, vec3 normal_p, vec3 normal_q, vec2 slope, vec2 offset) {
    if ((p.w > 0.0) != (q.w > 0.0)) return 0.0;
    if (!(p.w > 0.0)) return 1.0;
    float z_p = inverse_depth(p), difference = abs(z_p - inverse_depth(q));
    float w_z = exp(-difference / (sigma_z * abs(dot(slope, offset)) + 1.0e-3 * z_p)); // Eq. (3)
    float w_n = pow(max(dot(normal_p, normal_q), 0.0), sigma_n);                       // Eq. (4)
    return (depth_edges ? w_z : 1.0) * (normal_edges ? w_n : 1.0);
}

// Eq. (5); ``variance`` of the luminance at p.
float luminance_weight(float l_p, float l_q, float variance) {
    if (!luminance_edges) return 1.0;
    return exp(-abs(l_p - l_q) / (sigma_l * sqrt(max(variance, 0.0)) + 1.0e-6));
}
