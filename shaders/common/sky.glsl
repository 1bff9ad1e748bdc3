// Light of a uniform sky on a surface, from the table of directional albedos.   Reference: metrics.lighting.albedo_table
#include "common/brdf.glsl"

#if SKY && GLOSSY
// Light of a uniform sky that the lobes send to the viewer: glossy F0 x + F90 y, diffuse 1 - Fresnel with z for Schlick's term.
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

Lobes sky_light(Surface s, float roughness, vec3 sky) {
    Lobes r = Lobes(vec3(0.0), vec3(0.0));
#if SKY && !GLOSSY
    r.diffuse = s.base_color * sky;
#elif SKY
    float n_v = max(dot(s.n, s.v), 1e-4);
    vec3 albedo = lobe_albedos(roughness, n_v);
    float dielectric = s.specular * (0.04 * albedo.x + albedo.y);
    float taken = s.specular * (0.04 + 0.96 * albedo.z);
    r.diffuse = (1.0 - s.metallic) * (1.0 - taken) * s.base_color * sky;
    r.glossy = ((1.0 - s.metallic) * dielectric + s.metallic * (s.base_color * albedo.x + albedo.y)) * sky;
#endif
    return r;
}
