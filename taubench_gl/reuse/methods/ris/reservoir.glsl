// A sample kept out of a stream, each with probability weight / sum of weights (Chao 1982), as Bitterli et al. 2020, algorithm 2.
// Reference  references.reuse_methods.restir

struct Reservoir {
    LightSample kept;
    float target; // of the kept sample: luminance of the light that the surface reflects without shadow
    float sum;    // of weights
};

Reservoir empty_reservoir() { return Reservoir(LightSample(-1, vec2(0.0), 0.0), 0.0, 0.0); }

// u in [0, 1): whether the new sample takes the place of the kept one.
void offer(inout Reservoir r, LightSample candidate, float target, float weight, float u) {
    if (!(weight > 0.0)) return;
    r.sum += weight;
    if (u * r.sum < weight) {
        r.kept = candidate;
        r.target = target;
    }
}

// Candidate k of pixel p: its weight is target / density (Talbot et al. 2005, Eq. (6)).
void offer_candidate(inout Reservoir r, SurfacePoint x, ivec2 p, int k) {
    vec4 u = random(p, k);
    LightSample candidate = sample_light(u);
    if (candidate.light < 0) return;
    float target = luminance(reflected(x, light_at(candidate.light, candidate.uv)));
    offer(r, candidate, target, target / candidate.density, u.w);
}
