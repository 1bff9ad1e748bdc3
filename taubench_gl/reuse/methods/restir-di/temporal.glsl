// The reservoir of this frame and that of the surface in the previous frame.
//
// Paper      section 5, temporal reuse
// Reference  references.reuse_methods.restir.Restir.temporal
// Departs    History is found in the pixel nearest to the previous position; what the geometry mask discards is left out.
#include "combine.glsl"
#include "gate.glsl"

const int NUMBER = 256; // of random numbers: candidates have those before

void reuse(ivec2 p) {
    before_gate(p);
    SurfacePoint x = surface_at(p);
    Kept fresh = fetch_fresh(p), past = Kept(-1, vec2(0.0), 0.0, 0.0);
    ivec2 q = ivec2(floor(previous_px(p) + 0.5));
    if (temporal && x.lit && frame.has_history == 1u && in_image(q)) {
        Kept stored = fetch_prev_kept(q);
        bool keep = reusable_history(p, q);
        if (keep) past = stored;
        past.count = min(past.count, float(history_limit) * fresh.count);
        write_history_sample(p, vec4(stored.weight > 0.0 ? float(stored.light) : -1.0, stored.uv, float(keep)));
    } else {
        write_history_sample(p, vec4(-1.0, 0.0, 0.0, 0.0));
    }
    vec4 u = random(p, NUMBER);
    SurfacePoint before = prev_surface_at(q);
    float fresh_target = held(x, fresh, false, true), past_target = held(x, past, false, !PAIRWISE);
    float share_of_fresh = fresh.count, share_of_past = past.count;
    if (PAIRWISE) {
        float could = past.count > 0.0 ? held(before, fresh, true, false) : 0.0;
        share_of_fresh = 1.0 - pair_share(past.count, could, fresh.count, fresh_target);
        share_of_past = pair_share(past.count, held(before, past, true, true), fresh.count, past_target);
    }
    Combined c = nothing_combined();
    combine(c, fresh, 0, fresh_target, share_of_fresh, u.x);
    combine(c, past, 1, past_target, share_of_past, u.y);
    float z = 0.0; // counts of the reservoirs that could hold the kept sample
    bool here = true;
    if (c.from >= 0 && combination == COMBINATION_UNBIASED) {
        LightPoint at = light_at(c.kept.light, c.kept.uv);
        here = c.from == 0 || !visibility_reuse || visible(x, at);
        z = here ? fresh.count : 0.0;
        if (past.count > 0.0) {
            LightPoint was = prev_light_at(c.kept.light, c.kept.uv);
            bool reflects = target_of(before, was) > 0.0;
            if (reflects && (c.from == 1 || !visibility_reuse || prev_visible(before, was))) z += past.count;
        }
    }
    write_combined(p, closed(c, z, here));
}
