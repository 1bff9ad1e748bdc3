// The light of the kept sample, with one shadow ray; the reservoir of the next frame's history.
//
// Paper      algorithm 5
// Reference  references.reuse_methods.restir.Restir.frame
// Departs    With visibility_reuse the unbiased combination keeps no occluded sample: its reservoir could not hold it.

void reuse(ivec2 p) {
    SurfacePoint x = surface_at(p);
    Kept kept = fetch_combined(p);
    vec3 light = vec3(0.0);
    if (kept.weight > 0.0) {
        LightPoint at = light_at(kept.light, kept.uv);
        if (visible(x, at)) light = reflected(x, at) * kept.weight;
        else if (visibility_reuse && combination != COMBINATION_BIASED) kept.weight = 0.0;
    }
    write_kept(p, kept);
    write_kept_sample(p, vec4(kept.weight > 0.0 ? float(kept.light) : -1.0, kept.uv, kept.count));
    write_result(p, vec4(light, x.lit ? 1.0 - min(fetch_fresh(p).count / max(kept.count, 1.0), 1.0) : 0.0));
}
