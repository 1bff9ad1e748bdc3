// Which of the four bilinear taps of the history belong to the surface of a pixel; both accumulations use the same test.
//
// Paper    Koskela et al. 2019, pre-processing: world position and shading normal of a tap must be near those of the pixel.
//          Limits as in the data of their published code, which has squares for each scene: 0.01 m^2 and 1 of Classroom
//          (Sponza: 0.0016 m^2 and 0.25).
// Reference references.reuse_methods.accept_taps
// Departs  A moving point is compared at its previous position (prev_position); the scenes of the paper are static.
bool accepted(ivec2 p, Tap t) {
    if (t.weight <= 0.0 || !in_image(t.at)) return false;
    bool surface = fetch_position(p).w > 0.0;
    vec4 there = fetch_history_position(t.at);
    if ((there.w > 0.0) != surface) return false;
    return !surface || (distance(there.xyz, fetch_prev_position(p).xyz) <= position_limit
        && distance(fetch_history_normal(t.at).xyz, fetch_normal(p).xyz) <= normal_limit);
}
