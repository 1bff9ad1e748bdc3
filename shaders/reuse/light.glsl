// What a method that computes its direct light itself (light = "own") can call: lights and surfaces of this frame and of the
// previous one, shadow rays, the BRDF, random numbers.
//
// Reads      tables of lights, acceleration structure, tables of hits, light_surfaces (taubench_gl/reuse/scene_light.py)
// Counts     light_tally: shadow rays, light samples, evaluations of reflected light of this invocation
// Reference  references.own_light
//
// Positions of this frame are relative to this camera, those of the previous frame to the previous one.
#include "common/reuse.glsl"
#include "common/affine.glsl"
#include "common/brdf_sampling.glsl"
#include "common/random.glsl"
#include "common/light_choice.glsl"
#include "common/lights.glsl"
#include "common/environment.glsl"
#include "pathtracing/environment_sampling.glsl"
#include "pathtracing/shadow_reach.glsl"
#include "raytracing/trace.glsl"
#if EMITTERS
// The tables of draws of either frame behind one name.
bool hits_before = false;
#undef hit_draws_at
#if LLVMPIPE
#define hit_draws_at(texel) (hits_before ? imageLoad(prev_hit_draws, texel) : imageLoad(hit_draws, texel))
#else
#define hit_draws_at(texel) (hits_before ? texelFetch(prev_hit_draws, texel, 0) : texelFetch(hit_draws, texel, 0))
#endif
#endif
#include "raytracing/alpha.glsl"
#if EMITTERS
#include "raytracing/emitters.glsl"
#endif

uvec3 light_tally = uvec3(0u);


// --- surfaces
struct SurfacePoint {
    bool lit;  // a surface that scatters light
    vec3 p;    // relative to the camera of its frame
    vec3 g;    // unit normal of the triangle, facing the viewer
    Surface s; // material, shading normal, direction to the viewer
};

SurfacePoint surface_of(ivec2 p, LightSurface stored, vec4 parallel_view) {
    SurfacePoint x;
    x.lit = all(greaterThanEqual(p, ivec2(0))) && all(lessThan(p, light_frame[0].size.xy)) && stored.position.w > 0.0;
    x.p = stored.position.xyz;
    x.g = stored.geometric_normal.xyz;
    vec3 v = parallel_view.w > 0.5 ? parallel_view.xyz : safe_normalize(-x.p);
    x.s = Surface(stored.color.rgb, stored.geometric_normal.w, stored.normal.w, stored.color.w, stored.normal.xyz, v);
    return x;
}

int surface_row(ivec2 p) {
    ivec2 size = light_frame[0].size.xy, at = clamp(p, ivec2(0), size - 1);
    return at.y * size.x + at.x;
}

// The surface of pixel p; outside the image none is lit.
SurfacePoint surface_at(ivec2 p) { return surface_of(p, light_surfaces[surface_row(p)], light_frame[0].parallel_view); }

// The surface that pixel p had in the previous frame.
SurfacePoint prev_surface_at(ivec2 p) {
    return surface_of(p, prev_light_surfaces[surface_row(p)], light_frame[0].prev_parallel_view);
}

// BRDF times cosine, both lobes, 1/sr; 0 from behind the triangle.  wi: unit, towards the light.
vec3 brdf(SurfacePoint x, vec3 wi) {
    if (!x.lit || dot(x.g, wi) <= 0.0) return vec3(0.0);
    Lobes f = evaluate_brdf(x.s, wi);
    return f.diffuse + f.glossy;
}

// --- lights
struct LightSample {
    int light;     // number: rows of punctual lights, then of emissive triangles, then the environment; -1: none
    vec2 uv;       // which point of a triangle, or direction
    float density; // probability of the number; uv is uniform in the unit square
};

struct LightPoint {
    LightRecord record; // of a triangle: position of the point, radiance times area; of the environment: a directional light
    vec3 normal;        // unit, of a triangle; 0 of a punctual light
};

// Four numbers in [0, 1), by pixel, frame and seed.  n: from 0 to 65535.
vec4 random(ivec2 p, int n) { return random4(p, light_frame[0].numbers.x, light_frame[0].numbers.y, uint(n)); }

LightSample sample_light(vec4 u) {
    light_tally.y++;
    LightSample r = LightSample(-1, u.yz, 0.0);
#if PUNCTUAL
    if (u.x < PUNCTUAL_SHARE) {
        r.light = choose_light(u.x / PUNCTUAL_SHARE, LIGHT_COUNT);
        r.density = PUNCTUAL_SHARE * light_choice[r.light].y;
    }
#endif
#if EMITTERS
    float pick = (u.x - PUNCTUAL_SHARE) / EMITTER_SHARE;
    if (pick >= 0.0 && pick < 1.0) {
        int row = emitter_chosen(pick);
        r.light = LIGHT_COUNT + row;
        r.density = EMITTER_SHARE * emitter_probability(row);
    }
#endif
#if ENVIRONMENT_LIGHT
    if (u.x >= PUNCTUAL_SHARE + EMITTER_SHARE) {
        r.light = LIGHT_COUNT + EMITTER_COUNT;
        r.density = 1.0 - PUNCTUAL_SHARE - EMITTER_SHARE;
    }
#endif
    if (!(r.density > 0.0)) r.light = -1;
    return r;
}

#if PUNCTUAL
LightRecord prev_light_record(int i) {
    ivec2 at = light_texel(i);
    return LIGHT_RECORD_AT(prev_light_table_at, at);
}
#endif

LightPoint light_in(int light, vec2 uv, bool before) {
    LightPoint r = LightPoint(LightRecord(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)), vec3(0.0));
#if PUNCTUAL
    if (light >= 0 && light < LIGHT_COUNT) {
        if (before) r.record = prev_light_record(light);
        else r.record = light_record(light);
    }
#endif
#if ENVIRONMENT_LIGHT
    if (light == LIGHT_COUNT + EMITTER_COUNT) {
#if ENVIRONMENT_IMAGE
        BrdfSample e = sample_environment(uv);
        vec3 seen = e.pdf > 0.0 ? environment_seen(e.l) / e.pdf : vec3(0.0);
#else
        float y = 1.0 - 2.0 * uv.x, sine = sqrt(max(1.0 - y * y, 0.0)), phi = 2.0 * PI * uv.y;
        BrdfSample e = BrdfSample(vec3(sine * cos(phi), y, sine * sin(phi)), 0.25 / PI);
        vec3 seen = light_frame[0].sky.rgb / e.pdf;
#endif
        r.record.direction = vec4(-e.l, KIND_DIRECTIONAL);
        r.record.color.rgb = seen;
    }
#endif
#if EMITTERS
    if (light >= LIGHT_COUNT && light < LIGHT_COUNT + EMITTER_COUNT) {
        hits_before = before;
        EmitterSample e = emitter_point(light - LIGHT_COUNT, uv);
        hits_before = false;
        r.record.position.xyz = e.position;
        r.record.color.rgb = e.pdf_area > 0.0 ? e.radiance / e.pdf_area : vec3(0.0);
        r.normal = e.normal;
    }
#endif
    return r;
}

// A light, or a point of an emissive triangle, in this frame and in the previous one.  One that is off has no radiance.
LightPoint light_at(int light, vec2 uv) { return light_in(light, uv, false); }
LightPoint prev_light_at(int light, vec2 uv) { return light_in(light, uv, true); }

// Direction to the light and what arrives at p without shadow; divided by the density of a sample it estimates irradiance on
// a surface that faces the light.
Incident incident(LightPoint at, vec3 p) {
    if (at.normal == vec3(0.0)) return incident(at.record, p);
    vec3 towards = at.record.position.xyz - p;
    float d2 = dot(towards, towards);
    if (!(d2 > 0.0)) return Incident(vec3(0.0), vec3(0.0));
    vec3 l = towards * inversesqrt(d2);
    return Incident(l, at.record.color.rgb * abs(dot(at.normal, l)) / d2);
}

// Radiance that the surface reflects to its viewer, without shadow, exposure not applied.
vec3 reflected(SurfacePoint x, LightPoint at) {
    light_tally.z++;
    if (!x.lit) return vec3(0.0);
    Incident arriving = incident(at, x.p);
    return brdf(x, arriving.l) * arriving.radiance;
}

// Whether nothing lies between the surface and the light.  ``previous``: in the previous frame, both of which are of it.
bool visible_in(SurfacePoint x, LightPoint at, bool previous) {
    light_tally.x++;
    vec3 shift = previous ? -light_frame[0].camera_delta.xyz : vec3(0.0);
    vec3 p = x.p + shift;
    at.record.position.xyz += shift;
    Ray ray;
    ray.direction = incident(at, p).l;
    ray.origin = offset_origin(p, x.g, ray.direction);
    ray.t_max = FAR;
    if (at.normal == vec3(0.0)) {
#if PUNCTUAL
        ray.t_max = punctual_reach(at.record, ray.origin);
#endif
    } else { // the ray ends before the emitter by what keeps it from hitting the emitter itself
        vec3 span = offset_origin(at.record.position.xyz, at.normal, -ray.direction) - ray.origin;
        ray.t_max = length(span) * 0.999999;
        ray.direction = safe_normalize(span);
    }
    return trace(ray, previous ? TRACE_PREVIOUS_TOP : 0, true).instance < 0;
}

bool visible(SurfacePoint x, LightPoint at) { return visible_in(x, at, false); }
bool prev_visible(SurfacePoint x, LightPoint at) { return visible_in(x, at, true); }
