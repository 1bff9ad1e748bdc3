// The dielectric lobe with any color and index of refraction (KHR_materials_specular, KHR_materials_ior), and what goes through
// the surface under it (KHR_materials_transmission, KHR_materials_volume).
//
// Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces".   Reference  references.dielectric
// Departs    Radiance in a medium is that over its squared index, as in Cycles: entering and leaving do not scale it.  A thin wall
//            sends light straight on: its lobe is the reflected one, mirrored at the surface, as KHR_materials_transmission has it.

float peak(vec3 c) { return max(c.r, max(c.g, c.b)); }

#if TRANSMISSION
// Fresnel's factor of unpolarized light; 1 where it is totally reflected.  eta: index beyond over index before.
float exact_fresnel(float cosine, float eta) {
    float c = clamp(cosine, 0.0, 1.0), g2 = eta * eta - 1.0 + c * c;
    if (g2 <= 0.0) return 1.0;
    float g = sqrt(g2), a = (g - c) / (g + c), b = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
    return 0.5 * a * a * (1.0 + b * b);
}
#endif

// From f0 at normal incidence to ``specular`` at grazing: by Schlick's term or, where light goes through, as the exact factor.
vec3 dielectric_fresnel(Surface s, float v_h) {
    float away = 1.0 - v_h, away2 = away * away, rise = away2 * away2 * away;
#if TRANSMISSION
    if (s.eta > 0.0) {
        float normal = exact_fresnel(1.0, s.eta), exact = exact_fresnel(v_h, s.eta);
        if (exact >= 1.0) return vec3(1.0); // totally reflected, whatever ``specular``: there is no way through
        rise = (exact - normal) / (1.0 - normal);
    }
#endif
    return s.f0 + (vec3(s.specular) - s.f0) * rise;
}

#if TRANSMISSION
const float LEAST_BEND = 0.01; // indices that differ by less refract nothing

bool refracts(Surface s) { return s.thick && abs(s.eta - 1.0) >= LEAST_BEND; }

// The normal, on the viewer's side, at which light from l, beyond the surface, goes on to the viewer; 0: there is none.
vec3 half_beyond(Surface s, vec3 v, vec3 l) {
    if (!refracts(s)) return safe_normalize(v + l - 2.0 * dot(s.n, l) * s.n);
    vec3 h = safe_normalize(v + s.eta * l);
    h = dot(s.n, h) < 0.0 ? -h : h;
    return dot(v, h) > 0.0 && dot(l, h) < 0.0 ? h : vec3(0.0);
}

// pdf of l where h has pdf 1: solid angles of h for each one of l.
float bend_jacobian(Surface s, vec3 v, vec3 l, vec3 h) {
    float v_h = dot(v, h);
    if (!refracts(s)) return 0.25 / max(v_h, 1e-20);
    float l_h = dot(l, h), across = v_h + s.eta * l_h;
    return s.eta * s.eta * abs(l_h) / max(across * across, 1e-20);
}

// btdf * cos(theta_l) of light from beyond the surface.
vec3 evaluate_btdf(Surface s, vec3 l) {
    if (!(s.transmission > 0.0)) return vec3(0.0);
    float n_v = max(dot(s.n, s.v), 1e-4), n_l = -dot(s.n, l), a2 = s.alpha * s.alpha;
    vec3 h = half_beyond(s, s.v, l);
    float n_h = dot(s.n, h), v_h = dot(s.v, h);
    if (!(n_h > 0.0 && v_h > 0.0)) return vec3(0.0);
    vec3 f = dielectric_fresnel(s, min(v_h, 1.0));
    // Height-correlated masking of both sides: G2 = 2 n_l n_v / (n_l .. + n_v ..), here over n_v.
    float g2 = 2.0 * n_l / (n_l * sqrt(n_v * n_v * (1.0 - a2) + a2) + n_v * sqrt(n_l * n_l * (1.0 - a2) + a2));
    float lobe = ggx_d(s.n, h, min(n_h, 1.0), a2) * g2 * v_h * bend_jacobian(s, s.v, l, h);
    return (1.0 - s.metallic) * s.transmission * (1.0 - min(peak(f), 1.0)) * s.base_color * lobe;
}
#endif
