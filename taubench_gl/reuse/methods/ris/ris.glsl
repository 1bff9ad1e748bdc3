// Resampled importance sampling of direct light (Talbot et al. 2005): ``candidates`` light samples, one shadow ray.
//
// Reference  references.reuse_methods.restir.ris
// Departs    A reservoir keeps the sample while the candidates are drawn, so that none is stored (Bitterli et al. 2020, section 3.1).
#include "reservoir.glsl"

void reuse(ivec2 p) {
    SurfacePoint x = surface_at(p);
    Reservoir r = empty_reservoir();
    vec3 light = vec3(0.0);
    if (x.lit) {
        for (int k = 0; k < candidates; ++k) offer_candidate(r, x, p, k);
        if (r.sum > 0.0) {
            LightPoint at = light_at(r.kept.light, r.kept.uv);
            if (visible(x, at)) light = reflected(x, at) * r.sum / (float(candidates) * r.target); // Eq. (5)
        }
    }
    write_kept_sample(p, vec4(r.sum > 0.0 ? float(r.kept.light) : -1.0, r.kept.uv, float(candidates)));
    write_result(p, vec4(light, 0.0));
}
