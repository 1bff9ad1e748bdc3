// Light of the environment on a surface, from the table of directional albedos.   Reference: metrics.lighting.albedo_table,
// metrics.environment
#include "common/affine.glsl"
#include "common/brdf.glsl"
#include "common/environment.glsl"

#if SKY && GLOSSY
// Light of a uniform environment that the lobes send to the viewer: glossy F0 x + F90 y, diffuse 1 - Fresnel with z for Schlick's term.
vec3 lobe_albedos(float roughness, float n_v) {
    vec2 at = clamp(vec2(n_v, roughness), 0.0, 1.0) * float(textureSize(albedo_table, 0).x - 1);
    ivec2 base = min(ivec2(at), textureSize(albedo_table, 0) - 2);
    vec2 f = at - vec2(base);
    vec3 low = mix(albedo_table_at(base).xyz, albedo_table_at(base + ivec2(1, 0)).xyz, f.x);
    base.y += 1;
    vec3 high = mix(albedo_table_at(base).xyz, albedo_table_at(base + ivec2(1, 0)).xyz, f.x);
    return mix(low, high, f.y);
}
#endif

// ``diffuse``: radiance that a white diffuse surface reflects; ``glossy``: mean radiance around the mirror direction.
Lobes reflected(Surface s, float roughness, vec3 diffuse, vec3 glossy) {
    Lobes r = Lobes(vec3(0.0), vec3(0.0));
#if SKY && !GLOSSY
    r.diffuse = s.base_color * diffuse;
#elif SKY
    float n_v = max(dot(s.n, s.v), 1e-4);
    vec3 albedo = lobe_albedos(roughness, n_v);
    float dielectric = s.specular * (0.04 * albedo.x + albedo.y);
    float taken = s.specular * (0.04 + 0.96 * albedo.z);
    r.diffuse = (1.0 - s.metallic) * (1.0 - taken) * s.base_color * diffuse;
    r.glossy = ((1.0 - s.metallic) * dielectric + s.metallic * (s.base_color * albedo.x + albedo.y)) * glossy;
#endif
    return r;
}

// ``sky``: radiance of a uniform environment.
Lobes sky_light(Surface s, float roughness, vec3 sky) {
#if ENVIRONMENT_IMAGE
    vec3 mirror = safe_normalize(2.0 * dot(s.n, s.v) * s.n - s.v);
    return reflected(s, roughness, environment_diffuse(s.n), environment_glossy(mirror, roughness));
#else
    return reflected(s, roughness, sky, sky);
#endif
}
