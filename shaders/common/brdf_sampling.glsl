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
#if DIELECTRICS
    float dielectric = peak(dielectric_fresnel(s, clamp(dot(s.n, s.v), 0.0, 1.0)));
#if TRANSMISSION
    dielectric += (1.0 - dielectric) * s.transmission * color; // the normals of what goes through are drawn from it too
    diffuse *= 1.0 - s.transmission;
#endif
    float glossy = (1.0 - s.metallic) * dielectric + s.metallic * (color + (1.0 - color) * schlick);
#else
    float glossy = (1.0 - s.metallic) * s.specular * (0.04 + 0.96 * schlick)
        + s.metallic * (color + (1.0 - color) * schlick);
#endif
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

// A visible normal of the view v; both in the basis around n.  Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
// Spherical Caps".  ``bound``: of the cap, 1: all of it.
vec3 sample_normal(Surface s, vec3 v, float bound, vec2 u) {
    vec3 stretched = normalize(vec3(s.alpha * v.xy, v.z));
    float low = -bound * stretched.z;
    float z = mix(1.0, low, u.y);
    float around = 2.0 * PI * u.x, r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    vec3 h = vec3(r * cos(around), r * sin(around), z) + stretched;
    return normalize(vec3(s.alpha * h.xy, h.z));
}

// A reflection of the view about a visible normal, with the bound of Eto and Tokuyoshi.
vec3 sample_ggx(Surface s, mat3 world_from_local, vec2 u) {
    vec3 v = lobe_view(s) * world_from_local;
    vec3 h = sample_normal(s, v, cap_bound(v.z, s.alpha * s.alpha), u);
    return normalize(world_from_local * (2.0 * dot(v, h) * h - v));
}

#if TRANSMISSION
// Probability that light goes through at a visible normal whose cosine to the view is v_h, and is not reflected there.
float through_share(Surface s, float v_h) {
    float away = 1.0 - v_h, away2 = away * away, color = peak(s.base_color);
    float f = min(peak(dielectric_fresnel(s, v_h)), 1.0), base = 1.0 - s.metallic;
    float through = base * (1.0 - f) * s.transmission * color;
    float reflected = base * f + s.metallic * (color + (1.0 - color) * away2 * away2 * away);
    return through > 0.0 ? through / (through + reflected) : 0.0;
}

// pdf of l among directions drawn by visible normals, reflected or not.  Heitz 2018, "Sampling the GGX Distribution of Visible
// Normals", equation 17.
float normals_pdf(Surface s, vec3 v, vec3 l) {
    bool above = dot(s.n, l) > 0.0;
    vec3 h = above ? safe_normalize(l + v) : half_beyond(s, v, l);
    float v_h = min(dot(v, h), 1.0), n_v = dot(s.n, v), a2 = s.alpha * s.alpha;
    if (!(v_h > 0.0) || !(dot(s.n, h) > 0.0)) return 0.0;
    float d = ggx_d(s.n, h, min(dot(s.n, h), 1.0), a2);
    float pdf = d * 2.0 * v_h / (n_v + sqrt(n_v * n_v * (1.0 - a2) + a2)), through = through_share(s, v_h);
    return above ? (1.0 - through) * pdf * 0.25 / v_h : through * pdf * bend_jacobian(s, v, l, h);
}

// As sample_ggx, of a surface that light goes through; ``choice`` in [0, 1).  0: the direction is on the wrong side.
vec3 sample_through(Surface s, mat3 world_from_local, vec2 u, float choice) {
    vec3 v = lobe_view(s) * world_from_local, h = sample_normal(s, v, 1.0, u);
    float v_h = dot(v, h);
    vec3 l = 2.0 * v_h * h - v;
    bool goes_through = choice < through_share(s, clamp(v_h, 0.0, 1.0));
    if (goes_through) l = refracts(s) ? refract(-v, h, 1.0 / s.eta) : vec3(l.xy, -l.z);
    return (goes_through ? l.z < 0.0 : l.z > 0.0) ? normalize(world_from_local * l) : vec3(0.0);
}
#endif

// pdf of ``sample_brdf``, 1/sr; 0 below the surface.
float brdf_pdf(Surface s, vec3 l) {
    float n_l = dot(s.n, l);
#if TRANSMISSION
    if (s.transmission > 0.0) {
        float share = glossy_share(s);
        return (1.0 - share) * max(n_l, 0.0) / PI + share * normals_pdf(s, lobe_view(s), l);
    }
#endif
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
    float glossy = glossy_share(s);
    if (u.z < glossy) {
#if TRANSMISSION
        l = s.transmission > 0.0 ? sample_through(s, world_from_local, u.xy, u.z / glossy)
                                 : sample_ggx(s, world_from_local, u.xy);
        if (l == vec3(0.0)) return BrdfSample(s.n, 0.0);
#else
        l = sample_ggx(s, world_from_local, u.xy);
#endif
    } else {
        float around = 2.0 * PI * u.x, r = sqrt(u.y);
        l = normalize(world_from_local * vec3(r * cos(around), r * sin(around), sqrt(1.0 - u.y)));
    }
    return BrdfSample(l, brdf_pdf(s, l));
}
