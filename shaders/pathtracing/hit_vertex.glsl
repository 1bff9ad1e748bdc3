// The surface that a ray hit as a vertex of a path.
#include "raytracing/surface.glsl"

// ``v``: unit, to the vertex before; ``medium``: that the ray was in, as it left that vertex.
Surface hit_vertex(HitSurface x, vec3 v, float medium) {
    Surface s;
    s.base_color = x.base_color;
    s.metallic = x.metallic;
    s.alpha = max(x.roughness * x.roughness, MIN_ALPHA);
    s.specular = x.specular;
    s.n = x.normal;
    s.v = v;
#if DIELECTRICS
    s.f0 = x.dielectric.f0;
#endif
#if TRANSMISSION
    s.transmission = x.dielectric.transmission;
    s.eta = x.dielectric.eta;
    s.thick = x.dielectric.thick;
#endif
#if VOLUME
    s.medium = x.dielectric.medium < 0.0 ? -x.dielectric.medium : medium;
    s.beyond = x.dielectric.medium == 0.0 ? medium : max(x.dielectric.medium, 0.0);
#endif
    return s;
}
