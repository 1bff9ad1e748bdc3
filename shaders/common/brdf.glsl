// glTF 2.0 metallic-roughness (appendix B of the specification), per lobe.  Reference: metrics.lighting
//
// Every function returns brdf * cos(theta_l) for unit vectors n, v, l.  ``specular`` scales the dielectric lobe
// (KHR_materials_specular): F0 = 0.04 specular, F90 = specular; 0 is a pure Lambert surface.
#include "common/affine.glsl"
#include "common/lobes.glsl"

#ifndef GLOSSY
#define GLOSSY 1
#endif
#ifndef DIELECTRICS
#define DIELECTRICS 0 // 1: dielectric lobes of any color and index of refraction
#endif
#ifndef TRANSMISSION
#define TRANSMISSION 0 // 1: surfaces that light goes through; needs DIELECTRICS
#endif
#ifndef VOLUME
#define VOLUME 0 // 1: media that absorb light; needs TRANSMISSION
#endif
#ifndef PRECISE_GGX
#define PRECISE_GGX 0 // 1: narrow lobes keep their digits, which costs a cross product
#endif

const float PI = 3.14159265358979;

struct Surface {
    vec3 base_color;
    float metallic;
    float alpha; // perceptual roughness squared
    float specular;
    vec3 n;
    vec3 v; // towards the camera
#if DIELECTRICS
    vec3 f0; // reflectance of the dielectric lobe at normal incidence
#endif
#if TRANSMISSION
    float transmission; // share of the light under the dielectric lobe that goes through
    float eta;  // index of refraction beyond the surface over that on the viewer's side; 0: the lobe has Schlick's factor
    bool thick; // light is refracted; else it goes straight through a thin wall
#endif
#if VOLUME
    float medium; // on the viewer's side: place of a material among the tables of hits, 0: none
    float beyond; // on the other side
#endif
};

// GGX distribution of normals at the unit half vector h, 1/sr.
float ggx_d(vec3 n, vec3 h, float n_h, float a2) {
#if PRECISE_GGX
    vec3 sine = cross(n, h);
    float f = n_h * n_h * a2 + dot(sine, sine);
#else
    float f = n_h * n_h * (a2 - 1.0) + 1.0;
#endif
    return a2 / (PI * f * f);
}

#if DIELECTRICS
#include "common/dielectric.glsl"
#endif

Lobes evaluate_brdf(Surface s, vec3 l) {
    Lobes r = no_light();
    float n_l = dot(s.n, l);
#if TRANSMISSION
    if (n_l < 0.0) r.transmission = evaluate_btdf(s, l);
#endif
    if (n_l <= 0.0) return r;
#if !GLOSSY
    r.diffuse = s.base_color / PI * n_l; // every dielectric here has specular 0, and nothing is metal
    return r;
#else
    float n_v = max(dot(s.n, s.v), 1e-4);
    vec3 h = l + s.v;
    float h_length = inversesqrt(max(dot(h, h), 1e-20));
    float n_h = clamp(dot(s.n, h) * h_length, 0.0, 1.0), v_h = clamp(dot(s.v, h) * h_length, 0.0, 1.0);
    float away = 1.0 - v_h, away2 = away * away;
    float schlick = away2 * away2 * away;
    float a2 = s.alpha * s.alpha;
    float d = ggx_d(s.n, h * h_length, n_h, a2);
    float vis = 0.5 / (n_l * sqrt(n_v * n_v * (1.0 - a2) + a2) + n_v * sqrt(n_l * n_l * (1.0 - a2) + a2));
    float lobe = d * vis;
#if DIELECTRICS
    vec3 dielectric_f = dielectric_fresnel(s, v_h);
    float taken = max(dielectric_f.r, max(dielectric_f.g, dielectric_f.b));
#else
    float dielectric_f = s.specular * (0.04 + 0.96 * schlick), taken = dielectric_f;
#endif
    vec3 metal_f = s.base_color + (1.0 - s.base_color) * schlick;
    r.diffuse = (1.0 - s.metallic) * (1.0 - taken) * s.base_color / PI * n_l;
#if TRANSMISSION
    r.diffuse *= 1.0 - s.transmission;
#endif
    r.glossy = ((1.0 - s.metallic) * dielectric_f + s.metallic * metal_f) * lobe * n_l;
    return r;
#endif
}
