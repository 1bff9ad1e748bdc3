// Light of the environment on a surface, from the table of directional albedos.   Reference: metrics.lighting.albedo_table,
// metrics.environment
#include "common/affine.glsl"
#include "common/brdf.glsl"
#include "common/environment.glsl"

#if SKY && GLOSSY
#include "common/lobe_albedos.glsl"
#endif

// ``diffuse``: radiance that a white diffuse surface reflects; ``glossy``: mean radiance around the mirror direction.
Lobes reflected(Surface s, float roughness, vec3 diffuse, vec3 glossy) {
    Lobes r = Lobes(vec3(0.0), vec3(0.0));
#if SKY && !GLOSSY
    r.diffuse = s.base_color * diffuse;
#elif SKY
    float n_v = max(dot(s.n, s.v), 1e-4);
    vec3 albedo = lobe_albedos(roughness, n_v);
    float taken = s.specular * (0.04 + 0.96 * albedo.z);
    r.diffuse = (1.0 - s.metallic) * (1.0 - taken) * s.base_color * diffuse;
    r.glossy = glossy_albedo(s.base_color, s.metallic, s.specular, albedo) * glossy;
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
