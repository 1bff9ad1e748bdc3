// Combining reservoirs: the resampling weight of an input is m target(y) W at the current surface.
//
// ``pairwise``: m is the sample's multiple-importance weight of Bitterli 2022 (thesis, pairwise MIS) with the confidence weights of Lin et
// al. 2022 (generalized RIS).  The reservoir of the pixel itself, c, shares each sample y with every other one, j, by the balance heuristic:
//   m_j(y) = M_j / S  S p_j(y) / (S p_j(y) + M_c p_c(y)),  m_c(y) = sum over j of M_j / S  M_c p_c(y) / (S p_j(y) + M_c p_c(y))
// where S is the sum of all M_j and p_j the target of j, 0 for what j could not hold.  Then W = sum of weights / target.
// ``unbiased``, ``biased`` (Bitterli et al. 2020): m = M.  Then W = sum of weights / (Z target): Z adds the M of the inputs that could
// hold the sample (algorithm 6), or all (algorithm 4).
//
// What a reservoir could hold: what its surface reflects, with visibility_reuse only what it sees.
// Reference  references.reuse_methods.restir

#define PAIRWISE (combination == COMBINATION_PAIRWISE)

float target_of(SurfacePoint x, LightPoint at) { return luminance(reflected(x, at)); }

// Target of the sample of r at a surface; 0 where its reservoir could not hold it.  ``known``: nothing needs to be traced.
float held(SurfacePoint x, Kept r, bool previous, bool known) {
    if (!(r.weight > 0.0)) return 0.0;
    LightPoint at = light_in(r.light, r.uv, previous);
    float target = target_of(x, at);
    return target > 0.0 && visibility_reuse && !known && !visible_in(x, at, previous) ? 0.0 : target;
}

// Share of a sample that the pair leaves to the other reservoirs, of count ``others`` and target ``theirs``.
float pair_share(float others, float theirs, float count, float target) {
    float sum = others * theirs + count * target;
    return sum > 0.0 ? others * theirs / sum : 0.0;
}

struct Combined {
    Kept kept;
    float sum;    // of weights
    float target; // of the kept sample at the current surface
    int from;     // input that holds it
};

Combined nothing_combined() { return Combined(Kept(-1, vec2(0.0), 0.0, 0.0), 0.0, 0.0, -1); }

// target: of the sample of r at the current surface.
void combine(inout Combined c, Kept r, int number, float target, float m, float u) {
    c.kept.count += r.count;
    float weight = m * target * r.weight;
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
    if (PAIRWISE) z = 1.0;
    else if (combination == COMBINATION_BIASED) z = c.kept.count;
    else if (!here) z = 0.0;
    c.kept.weight = z > 0.0 && c.target > 0.0 ? c.sum / (z * c.target) : 0.0;
    return c.kept;
}
