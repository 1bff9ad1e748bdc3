// Candidates of this frame and, with visibility_reuse, a shadow ray to the winner.
//
// Paper      algorithm 3
// Reference  references.reuse_methods.restir.Restir.initial
#include "reservoir.glsl"

void reuse(ivec2 p) {
    SurfacePoint x = surface_at(p);
    Reservoir r = empty_reservoir();
    Kept kept = Kept(-1, vec2(0.0), 0.0, 0.0);
    if (x.lit) {
        for (int k = 0; k < candidates; ++k) offer_candidate(r, x, p, k);
        kept = Kept(r.kept.light, r.kept.uv, 0.0, float(candidates));
        if (r.sum > 0.0) kept.weight = r.sum / (kept.count * r.target);
        if (visibility_reuse && r.sum > 0.0 && !visible(x, light_at(kept.light, kept.uv))) kept.weight = 0.0;
    }
    write_fresh(p, kept);
}
