// Next-event estimation: one light sample of each kind of source that the scene has.
//
// Punctual lights by resampled importance sampling (Talbot et al. 2005): candidates by what they bring to the point's cell of
// a grid, or all of them where they are few, then one of them in proportion to the light that it would reflect without
// shadow.  Emissive triangles by what they bring to the cell.  An environment image by its luminance.
// Power heuristic (Veach 1997, section 9.2.4) against BRDF sampling.
// Reference: references.path_tracing
#include "common/affine.glsl"
#include "pathtracing/state.glsl"
#include "common/brdf_sampling.glsl"
#if PUNCTUAL
#include "common/lights.glsl"
#endif
#include "common/environment.glsl"
#include "pathtracing/environment_sampling.glsl"
#include "pathtracing/shadow_reach.glsl"
#include "raytracing/trace.glsl"
#include "raytracing/alpha.glsl"
#include "pathtracing/media.glsl"
#if EMITTERS
#include "raytracing/emitters.glsl"
#endif
#if PUNCTUAL || EMITTERS
#include "pathtracing/light_cells.glsl"
#else
int cell_of(vec3 p) { return 0; }
#endif

struct LightRay {
    vec3 origin;
    vec3 l;        // unit, towards the light; 0: no light
    float t_max;
    vec3 radiance; // over its pdf, weighted against BRDF sampling
};

const LightRay NO_LIGHT = LightRay(vec3(0.0), vec3(0.0), 0.0, vec3(0.0));

float power_heuristic(float a, float b) {
    float ratio = b / a; // squares would overflow
    return 1.0 / (1.0 + ratio * ratio);
}

// Whether the surface can send light from l to the viewer.
bool faces(Surface s, vec3 g, vec3 l) {
    bool above = dot(g, l) > 0.0 && dot(s.n, l) > 0.0;
#if TRANSMISSION
    above = above || (s.transmission > 0.0 && dot(g, l) < 0.0 && dot(s.n, l) < 0.0);
#endif
    return above;
}

#if VOLUME
// The medium that light from l comes through.
float medium_towards(Surface s, vec3 g, vec3 l) { return dot(g, l) > 0.0 ? s.medium : s.beyond; }
#endif

#if PUNCTUAL
#if BIDIRECTIONAL
#include "common/light_choice.glsl"
#include "pathtracing/connection.glsl"
#endif

// ``cell``: that p lies in; ``before``: as of scattered_weight; x = 0: the point was not found by sampling a BRDF.
LightRay punctual_ray(Surface s, vec3 p, vec3 g, int cell, float pick, float keep, vec2 before) {
    LightRay r = NO_LIGHT;
    float total = 0.0, target = 0.0;
    int chosen = -1;
    ivec2 around = entries_of(0, cell);
    for (int i = 0; i < min(around.y, CANDIDATES); ++i) {
        int entry = around.x + i;
        float pdf = 1.0;
        if (around.y > CANDIDATES) {
            entry = choose_entry((float(i) + pick) / float(CANDIDATES), around);
            pdf = entry_probability(entry, around) * float(CANDIDATES);
        }
        int row = entry_row(entry);
        Incident arriving = incident(light_record(row), p);
        if (!faces(s, g, arriving.l)) continue;
#if BIDIRECTIONAL
        if (before.x > 0.0) arriving.radiance *= scattered_weight(before, subpath_pdf(row, light_record(row), p, g));
#endif
        Lobes f = evaluate_brdf(s, arriving.l);
        float reflected = luminance(all_lobes(f) * arriving.radiance);
        if (!(reflected > 0.0)) continue;
        float weight = reflected / pdf;
        total += weight;
        if (keep * total < weight) { // probability weight / total; what is left of the number is used again
            keep = keep * total / weight;
            chosen = row;
            target = reflected;
            r.l = arriving.l;
            r.radiance = arriving.radiance;
        } else {
            keep = (keep * total - weight) / (total - weight);
        }
    }
    if (chosen < 0) return NO_LIGHT;
    r.radiance *= total / target;
    r.origin = offset_origin(p, g, r.l);
    r.t_max = punctual_reach(light_record(chosen), r.origin);
    return r;
}
#endif

#if EMITTERS
LightRay emitter_ray(Surface s, vec3 p, vec3 g, int cell, vec4 u) {
    LightRay r = NO_LIGHT;
    int row = emitter_around(u.x, cell);
    if (row < 0) return r;
    EmitterSample e = emitter_point(row, u.yz);
    vec3 towards = e.position - p;
    float d2 = dot(towards, towards);
    if (!(d2 > 0.0) || !(e.pdf_area > 0.0)) return r;
    vec3 l = towards * inversesqrt(d2);
    float cosine = abs(dot(e.normal, l));
    if (!faces(s, g, l) || cosine <= 0.0) return r;
    float pdf = emitter_probability(row, cell) * e.pdf_area * d2 / cosine;
    r.radiance = e.radiance / pdf * power_heuristic(pdf, brdf_pdf(s, l));
    // The ray ends before the emitter by what keeps it from hitting the emitter itself.
    r.origin = offset_origin(p, g, l);
    vec3 span = offset_origin(e.position, e.normal, -l) - r.origin;
    r.t_max = length(span) * 0.999999;
    r.l = safe_normalize(span);
    return r;
}
#endif

#if ENVIRONMENT_IMAGE
float environment_pdf(vec3 d) {
    int height = ENVIRONMENT_CELLS, width = 2 * ENVIRONMENT_CELLS;
    int column = int((atan(d.z, d.x) / (2.0 * PI) + 0.5) * float(width));
    int row = int(atan(length(d.xz), d.y) / PI * float(height));
    return environment_choice_at(ivec2(clamp(column, 0, width - 1), clamp(row, 0, height - 1))).y;
}

LightRay environment_ray(Surface s, vec3 p, vec3 g, vec2 u) {
    BrdfSample e = sample_environment(u);
    if (!faces(s, g, e.l) || !(e.pdf > 0.0)) return NO_LIGHT;
    vec3 radiance = environment_seen(e.l) / e.pdf * power_heuristic(e.pdf, brdf_pdf(s, e.l));
    return LightRay(offset_origin(p, g, e.l), e.l, FAR, radiance);
}
#endif

const int FROM_PUNCTUAL = 0, FROM_EMITTERS = 1, FROM_ENVIRONMENT = 2;

// Light that one sample of each kind of source sends to the viewer.  ``cell``, ``before``: as of punctual_ray; ``sources``: of
// SOURCES, from ``first``.
Lobes next_event(Surface s, vec3 p, vec3 g, int cell, vec4 of_emitter, vec4 of_others, int first, vec2 before) {
    Lobes sum = no_light();
#if SOURCES > 0
    for (int i = first; i < SOURCES; ++i) { // one loop, so that the shadow ray is compiled once
        LightRay ray = NO_LIGHT;
        int source = SOURCE_KINDS[i];
#if PUNCTUAL
        if (source == FROM_PUNCTUAL) ray = punctual_ray(s, p, g, cell, of_others.z, of_others.w, before);
#endif
#if EMITTERS
        if (source == FROM_EMITTERS) ray = emitter_ray(s, p, g, cell, of_emitter);
#endif
#if ENVIRONMENT_IMAGE
        if (source == FROM_ENVIRONMENT) ray = environment_ray(s, p, g, of_others.xy);
#endif
        if (!(luminance(ray.radiance) > 0.0)) continue;
        if (occluded(Ray(ray.origin, ray.l, ray.t_max))) continue;
#if VOLUME
        ray.radiance *= transmittance(medium_towards(s, g, ray.l), ray.t_max);
#endif
        sum = plus(sum, times(evaluate_brdf(s, ray.l), ray.radiance));
    }
#endif
    return sum;
}
