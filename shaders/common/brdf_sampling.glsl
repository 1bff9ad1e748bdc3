// Directions drawn for the BRDF of common/brdf.glsl: a cosine lobe or GGX, chosen by approximate albedo.
//
// Directions below the surface have BRDF 0 and pdf 0 here: what the GGX lobe sends there is a lost sample, pdf 0.
// Reference  references.brdf_sampling
#ifndef PRECISE_GGX
#define PRECISE_GGX 1
#endif
#include "common/brdf.glsl"

struct BrdfSample {
    vec3 l;
    float pdf; // per solid angle, of the whole mixture of lobes; 0: the sample contributes nothing
};

const float LEAST_N_V = 1e-4; // as evaluate_brdf: views below the surface are lifted to it

// Orthonormal basis whose z axis is the unit vector n: Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
mat3 basis_around(vec3 n) {
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z), b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

// Probability of the GGX lobe.  The diffuse share leaves the Fresnel factor out, so that no weight grows at grazing views.
float glossy_share(Surface s) {
#if GLOSSY
    float away = 1.0 - clamp(dot(s.n, s.v), 0.0, 1.0), away2 = away * away;
    float schlick = away2 * away2 * away;
    float color = max(s.base_color.r, max(s.base_color.g, s.base_color.b));
    float diffuse = (1.0 - s.metallic) * color;
    float glossy = (1.0 - s.metallic) * s.specular * (0.04 + 0.96 * schlick)
        + s.metallic * (color + (1.0 - color) * schlick);
    return glossy > 0.0 ? glossy / (diffuse + glossy) : 0.0;
#else
    return 0.0;
#endif
}

// The view direction that the GGX lobe is drawn for.
vec3 lobe_view(Surface s) {
    float n_v = dot(s.n, s.v);
    return n_v >= LEAST_N_V ? s.v : normalize(s.v + (LEAST_N_V - n_v) * s.n);
}

// Share of the cap of visible normals, per cosine of the view, that can reflect above the surface.
// Eto and Tokuyoshi 2023, "Bounded VNDF Sampling for Smith-GGX Reflections", equation 5.
float cap_bound(float n_v, float a2) {
    float s = 1.0 + sqrt(max(0.0, 1.0 - n_v * n_v)), s2 = s * s;
    return (1.0 - a2) * s2 / (s2 + a2 * n_v * n_v);
}

// pdf of GGX reflections of the view v, n.v > 0.  Eto and Tokuyoshi 2023, equation 8.
float ggx_pdf(Surface s, vec3 v, vec3 l) {
    float n_v = dot(s.n, v), a2 = s.alpha * s.alpha;
    vec3 h = l + v;
    h *= inversesqrt(max(dot(h, h), 1e-20));
    float d = ggx_d(s.n, h, clamp(dot(s.n, h), 0.0, 1.0), a2);
    return 0.5 * d / (cap_bound(n_v, a2) * n_v + sqrt(a2 * max(0.0, 1.0 - n_v * n_v) + n_v * n_v));
}

// A reflection of the view about a visible normal.  Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
// Spherical Caps", with the bound of Eto and Tokuyoshi.
vec3 sample_ggx(Surface s, mat3 world_from_local, vec2 u) {
    vec3 v = lobe_view(s) * world_from_local;
    vec3 stretched = normalize(vec3(s.alpha * v.xy, v.z));
    float low = -cap_bound(v.z, s.alpha * s.alpha) * stretched.z;
    float z = mix(1.0, low, u.y);
    float around = 2.0 * PI * u.x, r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    vec3 h = vec3(r * cos(around), r * sin(around), z) + stretched;
    h = normalize(vec3(s.alpha * h.xy, h.z));
    return normalize(world_from_local * (2.0 * dot(v, h) * h - v));
}

// pdf of ``sample_brdf``, 1/sr; 0 below the surface.
float brdf_pdf(Surface s, vec3 l) {
    float n_l = dot(s.n, l);
    if (n_l <= 0.0) return 0.0;
    float glossy = glossy_share(s), pdf = (1.0 - glossy) * n_l / PI;
#if GLOSSY
    if (glossy > 0.0) pdf += glossy * ggx_pdf(s, lobe_view(s), l);
#endif
    return pdf;
}

// ``u`` in [0, 1): u.xy the direction, u.z the lobe.
BrdfSample sample_brdf(Surface s, vec3 u) {
    mat3 world_from_local = basis_around(s.n);
    vec3 l;
    if (u.z < glossy_share(s)) {
        l = sample_ggx(s, world_from_local, u.xy);
    } else {
        float around = 2.0 * PI * u.x, r = sqrt(u.y);
        l = normalize(world_from_local * vec3(r * cos(around), r * sin(around), sqrt(1.0 - u.y)));
    }
    return BrdfSample(l, brdf_pdf(s, l));
}
