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
        Kept held = fetch_prev_kept(q);
        bool keep = reusable_history(p, q);
        if (keep) past = held;
        past.count = min(past.count, float(history_limit) * fresh.count);
        write_history_sample(p, vec4(held.weight > 0.0 ? float(held.light) : -1.0, held.uv, float(keep)));
    } else {
        write_history_sample(p, vec4(-1.0, 0.0, 0.0, 0.0));
    }
    vec4 u = random(p, NUMBER);
    Combined c = nothing_combined();
    combine(c, x, fresh, 0, u.x);
    combine(c, x, past, 1, u.y);
    float z = 0.0; // counts of the reservoirs that could hold the kept sample
    bool here = true;
    if (c.from >= 0 && combination != COMBINATION_BIASED) {
        LightPoint at = light_at(c.kept.light, c.kept.uv);
        here = c.from == 0 || !visibility_reuse || visible(x, at);
        z = here ? fresh.count : 0.0;
        if (past.count > 0.0) {
            SurfacePoint before = prev_surface_at(q);
            LightPoint was = prev_light_at(c.kept.light, c.kept.uv);
            bool reflects = target_of(before, was) > 0.0;
            if (reflects && (c.from == 1 || !visibility_reuse || prev_visible(before, was))) z += past.count;
        }
    }
    write_combined(p, closed(c, z, here));
}
