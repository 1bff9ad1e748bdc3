// The points from which the paths of a tile start.
//
// The rasterizer snaps vertices to 1/256 pixel, so a pixel's surface point can lie that far beyond the edge of its triangle:
// in a corner, behind the other wall, where light from outside would reach it.  Such a point is moved along the view ray to just
// before that wall.
//
// With DIELECTRICS also the lobe of the visible surface, which the rasterizer's channels do not have: a ray finds its triangle for
// the textures and the side that is seen; where it passes by (a silhouette), ids has the material, without textures.
//
// Reads      position, acceleration structure; DIELECTRICS: ids, attributes of hits.
// Writes     layer FIRST_POINT of the path state; DIELECTRICS: FIRST_F0, FIRST_GLASS.
#include "pathtracing/state.glsl"
#include "common/affine.glsl"
#include "raytracing/trace.glsl"
#include "raytracing/alpha.glsl"
#if DIELECTRICS
#include "raytracing/surface.glsl"
#endif

void main() {
    ivec2 local = local_pixel();
    if (outside_tile(local)) return;
    vec4 p = position_at(pixel_of(local));
    vec3 start = p.xyz;
#if DIELECTRICS
    Dielectric lobe = dielectric_at(HIT_MATERIAL_TEXELS * (ids_at(pixel_of(local)).y & ~MARKS), false, vec4(0.0), false);
#endif
    if (p.w > 0.0) {
        vec3 to_viewer = P.parallel_view.w > 0.5 ? P.parallel_view.xyz : safe_normalize(-p.xyz);
        float reach = (P.footprint.x + P.footprint.y * p.w) / 32.0, margin = 4.0 * ORIGIN_OFFSET * rounding_size(p.xyz);
#if DIELECTRICS
        float beyond = reach;
#else
        float beyond = 0.0;
#endif
        Ray ray = Ray(p.xyz + reach * to_viewer, -to_viewer, reach + beyond);
        Hit wall = closest_hit(ray);
        // The point's own surface is met at its distance, give or take the margin.
        if (wall.instance >= 0 && wall.t < reach - margin) start += (reach - wall.t + margin) * to_viewer;
#if DIELECTRICS
        else if (wall.instance >= 0) lobe = surface_at(ray, wall, 0.5).dielectric;
#endif
    }
#if DIELECTRICS
    store_state(local, FIRST_F0, vec4(lobe.f0, lobe.specular));
#if TRANSMISSION
    store_state(local, FIRST_GLASS, vec4(lobe.transmission, lobe.eta, float(lobe.thick), lobe.medium));
#endif
#endif
    store_state(local, FIRST_POINT, vec4(start, 0.0));
}
