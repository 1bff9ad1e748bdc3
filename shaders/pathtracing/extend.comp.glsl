// The next vertex of the paths of a tile: what the ray hits, its light, and the direction that follows.
//
// Paper      section 3.2, f_dir (the first bounce that finds an emitter or the environment) and f_ind.
// Reads      paths that go on, path state, lights, acceleration structure, attributes of hits.
// Writes     path state, paths that go on to the next vertex.
// Reference  references.path_tracing
#include "raytracing/surface.glsl"
#include "pathtracing/light_sampling.glsl"
#include "pathtracing/hit_vertex.glsl"
#include "pathtracing/lobe_sums.glsl"
#include "pathtracing/numbers.glsl"
#include "pathtracing/state.glsl"
#include "pathtracing/going_on.glsl"

uniform int vertex; // 1: the hit of the first bounce

const int ROULETTE_FROM = 3; // vertex
const float LEAST_SURVIVAL = 0.05;

// Light towards the camera's vertex: direct if it was scattered once, there, else indirect.
void contribute(ivec2 local, vec3 light) {
    light = finite_or_counted(light);
    if (!(luminance(light) > 0.0)) return;
    Lobes x = first_lobes(local, light);
    if (vertex == 1) {
        add_direct(local, x);
        add_state(local, FIRST(diffuse), vec4(vec3(0.0), luminance(all_lobes(x))));
    } else {
        add_indirect(local, x);
        add_state(local, FIRST(glossy), vec4(vec3(0.0), luminance(all_lobes(x))));
    }
}

// Light that was scattered at this vertex too.
void contribute_indirect(ivec2 local, vec3 light) {
    light = finite_or_counted(light);
    if (!(luminance(light) > 0.0)) return;
    Lobes x = first_lobes(local, light);
    add_indirect(local, x);
    add_state(local, FIRST(glossy), vec4(vec3(0.0), luminance(all_lobes(x))));
}

void main() {
    ivec2 local;
    if (!path_at(vertex, local)) return;
    NumbersOf numbers = numbers_of(local);
    vec4 origin = load_state(local, ORIGIN_PDF);
    vec4 stored = load_state(local, THROUGHPUT);
    vec3 throughput = stored.rgb;
    vec4 direction = load_state(local, DIRECTION);
    Ray ray = Ray(origin.xyz, direction.xyz, FAR);
    Hit hit = closest_hit(ray);
#if VOLUME
    if (hit.instance < 0) throughput *= transmittance(direction.w, FAR);
#endif
    if (hit.instance < 0) {
#if ENVIRONMENT
#if ENVIRONMENT_IMAGE
        contribute(local, throughput * environment_seen(ray.direction) *
                              power_heuristic(origin.w, environment_pdf(ray.direction)));
#else
        contribute(local, throughput * P.sky.rgb);
#endif
#endif
        return;
    }
    if (vertex == 1) {
        add_state(local, DIRECT(glossy), vec4(vec3(0.0), hit.t));
        add_state(local, INDIRECT(glossy), vec4(vec3(0.0), 1.0));
    }
    vec4 of_emitter = sample_numbers_of(numbers, vertex, EMITTER);
    HitSurface x = surface_at(ray, hit, of_emitter.w);
    Surface s = hit_vertex(x, -ray.direction, direction.w);
#if VOLUME
    throughput *= transmittance(s.medium, hit.t);
#endif
#if EMITTERS
    if (x.emitter >= 0) {
        float cosine = abs(dot(x.geometric_normal, ray.direction));
        float pdf = 0.0;
        if (x.area > 0.0) pdf = emitter_probability(x.emitter, int(stored.w)) / x.area * hit.t * hit.t / max(cosine, 1.0e-12);
        contribute(local, throughput * x.emission * power_heuristic(origin.w, pdf));
    }
#endif
    if (vertex >= LAST_VERTEX || x.unlit) return;
    vec3 g = x.geometric_normal;
    vec2 before = vec2(origin.w, hit.t * hit.t / max(abs(dot(g, ray.direction)), 1.0e-12));
#if TRANSMISSION
    if (s.transmission > 0.0) before.x = 0.0; // no light subpath ends there
#endif
    int cell = cell_of(x.position);
    vec4 of_others = sample_numbers_of(numbers, vertex, ENVIRONMENT_PUNCTUAL);
    Lobes light = next_event(s, x.position, g, cell, of_emitter, of_others, 0, before);
#if BIDIRECTIONAL
    if (vertex < LAST_VERTEX - 1) {
        light = plus(light, connect(local, s, x.position, g));
    }
#endif
    contribute_indirect(local, throughput * all_lobes(light));
    vec4 u = sample_numbers_of(numbers, vertex, SCATTER);
    BrdfSample next = sample_brdf(s, u.xyz);
    if (!(next.pdf > 0.0) || !faces(s, g, next.l)) return;
    Lobes f = evaluate_brdf(s, next.l);
    throughput *= all_lobes(f) / next.pdf;
    float brightest = max(max(throughput.r, throughput.g), throughput.b);
    bool alive = brightest > 0.0 && !non_finite(throughput);
    if (vertex >= ROULETTE_FROM) {
        float survival = clamp(brightest, LEAST_SURVIVAL, 1.0);
        alive = alive && u.w < survival;
        throughput /= survival;
    }
    if (!alive) return;
    store_state(local, ORIGIN_PDF, vec4(offset_origin(x.position, g, next.l), next.pdf));
#if VOLUME
    store_state(local, DIRECTION, vec4(next.l, medium_towards(s, g, next.l)));
#else
    store_state(local, DIRECTION, vec4(next.l, 0.0));
#endif
    store_state(local, THROUGHPUT, vec4(throughput, float(cell)));
    go_on(local, vertex + 1);
}
