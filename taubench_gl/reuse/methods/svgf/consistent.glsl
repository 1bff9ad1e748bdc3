// Temporal consistency of one tap.  Paper: Schied et al. 2017, section 4.1: depth, normal, object.
// Reference  references.reuse_methods.consistent_history
bool consistent(ivec2 q, bool surface, float expected, vec3 normal, uint id) {
    if (!in_image(q)) return false;
    float depth = fetch_history_position(q).w;
    if ((depth > 0.0) != surface) return false;
    if (!surface) return true;
    if (abs(depth - expected) > depth_limit * expected) return false;
    if (dot(fetch_history_normal(q).xyz, normal) < normal_limit) return false;
    return !check_ids || fetch_history_ids(q).x == id;
}
