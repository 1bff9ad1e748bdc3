// The next vertex of the paths of a tile: what the ray hits, its light, and the direction that follows.
//
// Paper      section 3.2, f_dir (the first bounce that finds an emitter or the environment) and f_ind.
// Reads      paths that go on, path state, lights, acceleration structure, attributes of hits.
// Writes     path state, paths that go on to the next vertex.
// Reference  references.path_tracing
#include "raytracing/surface.glsl"
#include "pathtracing/light_sampling.glsl"
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
    vec4 diffuse = load_state(local, FIRST_DIFFUSE), glossy = load_state(local, FIRST_GLOSSY);
    vec3 d = light * diffuse.rgb, g = light * glossy.rgb;
    if (vertex == 1) {
        add_state(local, DIRECT_DIFFUSE, vec4(d, 0.0));
        add_state(local, DIRECT_GLOSSY, vec4(g, 0.0));
        store_state(local, FIRST_DIFFUSE, vec4(diffuse.rgb, diffuse.w + luminance(d + g)));
    } else {
        add_state(local, INDIRECT_DIFFUSE, vec4(d, 0.0));
        add_state(local, INDIRECT_GLOSSY, vec4(g, 0.0));
        store_state(local, FIRST_GLOSSY, vec4(glossy.rgb, glossy.w + luminance(d + g)));
    }
}

// Light that was scattered at this vertex too.
void contribute_indirect(ivec2 local, vec3 light) {
    light = finite_or_counted(light);
    if (!(luminance(light) > 0.0)) return;
    vec4 glossy = load_state(local, FIRST_GLOSSY);
    vec3 d = light * load_state(local, FIRST_DIFFUSE).rgb, g = light * glossy.rgb;
    add_state(local, INDIRECT_DIFFUSE, vec4(d, 0.0));
    add_state(local, INDIRECT_GLOSSY, vec4(g, 0.0));
    store_state(local, FIRST_GLOSSY, vec4(glossy.rgb, glossy.w + luminance(d + g)));
}

void main() {
    ivec2 local;
    if (!path_at(vertex, local)) return;
    NumbersOf numbers = numbers_of(local);
    vec4 origin = load_state(local, ORIGIN_PDF);
    vec3 throughput = load_state(local, THROUGHPUT).rgb;
    Ray ray = Ray(origin.xyz, load_state(local, DIRECTION).xyz, FAR);
    Hit hit = closest_hit(ray);
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
        add_state(local, DIRECT_GLOSSY, vec4(vec3(0.0), hit.t));
        add_state(local, INDIRECT_GLOSSY, vec4(vec3(0.0), 1.0));
    }
    vec4 of_emitter = sample_numbers_of(numbers, vertex, EMITTER);
    HitSurface x = surface_at(ray, hit, of_emitter.w);
#if EMITTERS
    if (x.emitter >= 0) {
        float cosine = abs(dot(x.geometric_normal, ray.direction));
        float pdf = emitter_pdf_area(x.emitter, x.area) * hit.t * hit.t / max(cosine, 1.0e-12);
        contribute(local, throughput * x.emission * power_heuristic(origin.w, pdf));
    }
#endif
    if (vertex >= LAST_VERTEX || x.unlit) return;
    Surface s;
    s.base_color = x.base_color;
    s.metallic = x.metallic;
    s.alpha = max(x.roughness * x.roughness, MIN_ALPHA);
    s.specular = x.specular;
    s.n = x.normal;
    s.v = -ray.direction;
    vec3 g = x.geometric_normal;
    vec2 before = vec2(origin.w, hit.t * hit.t / max(abs(dot(g, ray.direction)), 1.0e-12));
    Lobes light = next_event(s, x.position, g, of_emitter, sample_numbers_of(numbers, vertex, ENVIRONMENT_PUNCTUAL), 0, before);
#if BIDIRECTIONAL
    if (vertex < LAST_VERTEX - 1) {
        Lobes connected = connect(local, s, x.position, g);
        light = Lobes(light.diffuse + connected.diffuse, light.glossy + connected.glossy);
    }
#endif
    contribute_indirect(local, throughput * (light.diffuse + light.glossy));
    vec4 u = sample_numbers_of(numbers, vertex, SCATTER);
    BrdfSample next = sample_brdf(s, u.xyz);
    if (!(next.pdf > 0.0) || !faces(s, g, next.l)) return;
    Lobes f = evaluate_brdf(s, next.l);
    throughput *= (f.diffuse + f.glossy) / next.pdf;
    float peak = max(max(throughput.r, throughput.g), throughput.b);
    bool alive = peak > 0.0 && !non_finite(throughput);
    if (vertex >= ROULETTE_FROM) {
        float survival = clamp(peak, LEAST_SURVIVAL, 1.0);
        alive = alive && u.w < survival;
        throughput /= survival;
    }
    if (!alive) return;
    store_state(local, ORIGIN_PDF, vec4(offset_origin(x.position, g, next.l), next.pdf));
    store_state(local, DIRECTION, vec4(next.l, 0.0));
    store_state(local, THROUGHPUT, vec4(throughput, 0.0));
    go_on(local, vertex + 1);
}
