// The reservoir of a pixel and those of random neighbors.
//
// Paper      section 5, spatial reuse
// Reference  references.reuse_methods.restir.Restir.spatial
// Departs    The radius is a share of the image height: the paper has 30 pixels at 1920x1080.
#include "combine.glsl"

const float SIMILAR_NORMAL = 0.90630779; // cosine of 25 degrees
const float SIMILAR_DEPTH = 0.1;
const float MIN_RADIUS = 2.0; // pixels
const int NUMBER = 272; // of random numbers, 16 for each round

bool similar(SurfacePoint a, SurfacePoint b) {
    float da = length(a.p), db = length(b.p);
    return b.lit && dot(a.s.n, b.s.n) > SIMILAR_NORMAL && abs(da - db) < SIMILAR_DEPTH * da;
}

// Neighbor i = 1 .. neighbors of pixel p, uniform in a disk; i = 0: p itself.
ivec2 neighbor(ivec2 p, int i) {
    if (i == 0) return p;
    vec4 u = random(p, NUMBER + 16 * iteration + i);
    float angle = 2.0 * PI * u.y, most = max(radius * float(frame.size.y), MIN_RADIUS);
    return p + ivec2(floor(most * sqrt(u.x) * vec2(cos(angle), sin(angle)) + 0.5));
}

void reuse(ivec2 p) {
    SurfacePoint x = surface_at(p);
    Kept own = fetch_combined(p);
    if (!x.lit || neighbors == 0) {
        write_combined(p, own);
        return;
    }
    float others = 0.0; // counts of the neighbors with similar surfaces
    uint near = 0u;
    for (int i = 1; i <= neighbors; ++i) {
        ivec2 q = neighbor(p, i);
        if (!similar(x, surface_at(q))) continue;
        near |= 1u << i;
        others += fetch_combined(q).count;
    }
    Combined c = nothing_combined();
    float own_target = held(x, own, false, true), own_share = PAIRWISE ? 1.0 : own.count;
    for (int i = 1; i <= neighbors; ++i) {
        if ((near & (1u << i)) == 0u) continue;
        ivec2 q = neighbor(p, i);
        Kept r = fetch_combined(q);
        float target = held(x, r, false, !PAIRWISE), share = r.count;
        if (PAIRWISE && r.count > 0.0) {
            SurfacePoint y = surface_at(q);
            share = r.count / others * pair_share(others, held(y, r, false, true), own.count, target);
            own_share -= r.count / others * pair_share(others, held(y, own, false, false), own.count, own_target);
        }
        combine(c, r, i, target, share, random(p, NUMBER + 16 * iteration + i).z);
    }
    combine(c, own, 0, own_target, own_share, random(p, NUMBER + 16 * iteration).z);
    float z = 0.0; // counts of the reservoirs that could hold the kept sample
    bool here = true;
    if (c.from >= 0 && combination == COMBINATION_UNBIASED) {
        LightPoint at = light_at(c.kept.light, c.kept.uv);
        for (int i = 0; i <= neighbors; ++i) {
            if (i > 0 && (near & (1u << i)) == 0u) continue;
            ivec2 q = neighbor(p, i);
            SurfacePoint y = surface_at(q);
            bool could = target_of(y, at) > 0.0 && (c.from == i || !visibility_reuse || visible(y, at));
            if (could) z += fetch_combined(q).count;
            if (i == 0) here = could;
        }
    }
    write_combined(p, closed(c, z, here));
}
