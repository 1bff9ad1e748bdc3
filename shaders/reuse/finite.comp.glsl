// Counts pixels of a result that are NaN or infinite where the input radiance is finite.
//
// Reads    result, radiance
// Counts   found.x: such pixels; found.y: their smallest index y * width + x
#include "common/numbers.glsl"

uniform bool has_radiance;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(result, 0);
    if (any(greaterThanEqual(pixel, size))) return;
    if (!non_finite(texelFetch(result, pixel, 0))) return;
    if (has_radiance && non_finite(texelFetch(radiance, pixel, 0).rgb)) return;
    atomicAdd(found[0], 1u);
    atomicMin(found[1], uint(pixel.y * size.x + pixel.x));
}
