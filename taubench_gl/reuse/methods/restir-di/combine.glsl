// Combining reservoirs (Bitterli et al. 2020, section 4): the weight of an input is target(y) W M at the current surface.
//
// A reservoir holds only samples that its surface reflects, with visibility_reuse also only visible ones: its support.  An output
// has W = sum of weights / (Z target): Z adds the counts of the inputs whose support has the sample (algorithm 6).  A sample that
// the current surface cannot see is dropped: it is outside of the support of the output.
// Reference  references.reuse_methods.restir
// Departs    With ``biased`` as algorithm 4, Z is the sum of all counts and nothing is traced.

float target_of(SurfacePoint x, LightPoint at) { return luminance(reflected(x, at)); }

struct Combined {
    Kept kept;
    float sum;    // of weights
    float target; // of the kept sample at the current surface
    int from;     // input that holds it
};

Combined nothing_combined() { return Combined(Kept(-1, vec2(0.0), 0.0, 0.0), 0.0, 0.0, -1); }

void combine(inout Combined c, SurfacePoint x, Kept r, int number, float u) {
    c.kept.count += r.count;
    if (!(r.weight > 0.0)) return;
    float target = target_of(x, light_at(r.light, r.uv)), weight = target * r.weight * r.count;
    if (!(weight > 0.0)) return;
    c.sum += weight;
    if (u * c.sum < weight) {
        c.kept.light = r.light;
        c.kept.uv = r.uv;
        c.target = target;
        c.from = number;
    }
}

// z: counts of the inputs that could hold the kept sample; here: whether the current surface could.
Kept closed(Combined c, float z, bool here) {
    if (combination == COMBINATION_BIASED) z = c.kept.count;
    else if (!here) z = 0.0;
    c.kept.weight = z > 0.0 && c.target > 0.0 ? c.sum / (z * c.target) : 0.0;
    return c.kept;
}
