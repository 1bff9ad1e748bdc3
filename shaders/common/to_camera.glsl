// Unit direction from a surface point of this frame to the camera that sees it, or the one given for its pixel.
// Needs      P.parallel_view
#include "common/affine.glsl"

vec3 direction_to_camera(ivec2 pixel, vec3 p) {
#if GIVEN_DIRECTIONS
    return to_camera_at(pixel).xyz;
#else
    return P.parallel_view.w > 0.5 ? P.parallel_view.xyz : safe_normalize(-p);
#endif
}
