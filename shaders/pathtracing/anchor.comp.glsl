// The points from which the paths of a tile start.
//
// The rasterizer snaps vertices to 1/256 pixel, so a pixel's surface point can lie that far beyond the edge of its triangle:
// in a corner, behind the other wall, where light from outside would reach it.  Such a point is moved along the view ray to just
// before that wall.
//
// Reads      position geometric_normal, acceleration structure.
// Writes     layer FIRST_POINT of the path state.
#include "pathtracing/state.glsl"
#include "common/affine.glsl"
#include "raytracing/trace.glsl"
#include "raytracing/alpha.glsl"

void main() {
    ivec2 local = local_pixel();
    if (outside_tile(local)) return;
    vec4 p = position_at(pixel_of(local));
    vec3 start = p.xyz;
    if (p.w > 0.0) {
        vec3 to_viewer = P.parallel_view.w > 0.5 ? P.parallel_view.xyz : safe_normalize(-p.xyz);
        float reach = (P.footprint.x + P.footprint.y * p.w) / 32.0, margin = 4.0 * ORIGIN_OFFSET * rounding_size(p.xyz);
        Hit wall = closest_hit(Ray(p.xyz + reach * to_viewer, -to_viewer, reach));
        // The point's own surface is met at its distance, give or take the margin.
        if (wall.instance >= 0 && wall.t < reach - margin) start += (reach - wall.t + margin) * to_viewer;
    }
    store_state(local, FIRST_POINT, vec4(start, 0.0));
}
