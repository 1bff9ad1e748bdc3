// One new light sample and the kept one compete; one shadow ray to the winner.  It forgets that they were sampled for another
// surface, which darkens or brightens edges: restir-di corrects that.
float target(SurfacePoint x, int light, vec2 uv) { return luminance(reflected(x, light_at(light, uv))); }

void reuse(ivec2 p) {
    SurfacePoint x = surface_at(p);
    vec4 u = random(p, 0);
    LightSample fresh = sample_light(u);
    Kept r = Kept(fresh.light, fresh.uv, 0.0, 1.0);
    float sum = fresh.light < 0 ? 0.0 : target(x, fresh.light, fresh.uv) / fresh.density;
    Kept past = fetch_prev_kept(ivec2(floor(previous_px(p) + 0.5)));
    bool keep = reusable(p);
    write_history_sample(p, vec4(past.weight > 0.0 ? float(past.light) : -1.0, past.uv, float(keep))); // for scores
    float count = keep ? min(past.count, float(most)) : 0.0, share = target(x, past.light, past.uv) * past.weight * count;
    sum += share;
    r.count += count;
    if (u.w * sum < share) { r.light = past.light; r.uv = past.uv; }
    float kept = target(x, r.light, r.uv);
    r.weight = kept > 0.0 ? sum / (r.count * kept) : 0.0;
    write_kept(p, r);
    write_kept_sample(p, vec4(r.weight > 0.0 ? float(r.light) : -1.0, r.uv, r.count));
    LightPoint at = light_at(r.light, r.uv);
    bool lit = r.weight > 0.0 && visible(x, at);
    write_result(p, vec4(lit ? reflected(x, at) * r.weight : vec3(0.0), 1.0 - 1.0 / r.count));
}
