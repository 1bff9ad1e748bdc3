// glTF 2.0 metallic-roughness (appendix B of the specification), per lobe.  Reference: metrics.lighting
//
// Every function returns brdf * cos(theta_l) for unit vectors n, v, l.  ``specular`` scales the dielectric lobe
// (KHR_materials_specular): F0 = 0.04 specular, F90 = specular; 0 is a pure Lambert surface.
#include "common/affine.glsl"

#ifndef GLOSSY
#define GLOSSY 1
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
};

struct Lobes {
    vec3 diffuse;
    vec3 glossy;
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

Lobes evaluate_brdf(Surface s, vec3 l) {
    Lobes r = Lobes(vec3(0.0), vec3(0.0));
    float n_l = dot(s.n, l);
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
    float dielectric_f = s.specular * (0.04 + 0.96 * schlick);
    vec3 metal_f = s.base_color + (1.0 - s.base_color) * schlick;
    r.diffuse = (1.0 - s.metallic) * (1.0 - dielectric_f) * s.base_color / PI * n_l;
    r.glossy = ((1.0 - s.metallic) * dielectric_f + s.metallic * metal_f) * lobe * n_l;
    return r;
#endif
}
