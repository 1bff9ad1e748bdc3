// Exposed linear radiance of light and emission, or of the sky.  A pixel that was not shaded in this frame gets the
// radiance of its nearest shaded neighbor.
//
// Reads    position; direct, indirect, emission where available
// Writes   radiance: rgb exposed, a 1 where shaded and 0 where filled; ACCUMULATE adds a share of rgb instead.
// Reference metrics.shading_rate.nearest_shaded, metrics.color (its exposure)
#include "common/environment.glsl"
#include "common/shading_rate.glsl"

uniform ivec2 size;
#if ENVIRONMENT_IMAGE
uniform vec3 sky_origin, sky_dx, sky_dy; // view direction of pixel (0, 0), and its steps
#else
uniform vec3 sky;
#endif
uniform float exposure;
#if SHADING_RATE > 0
uniform int phase;
#endif
#if ACCUMULATE
uniform float share; // negative: the first sample, which replaces the stored value
#endif

#define READ(channel, at) texelFetch(channel, at, 0)
#include "common/radiance.glsl"

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
#if SHADING_RATE > 0
    ivec2 from = nearest_shaded(pixel, phase, size);
#else
    ivec2 from = pixel;
#endif
#if ENVIRONMENT_IMAGE
    vec3 sky = environment_seen(sky_origin + float(from.x) * sky_dx + float(from.y) * sky_dy);
#endif
    vec3 radiance = radiance_at(from, sky) * exposure;
#if ACCUMULATE
    vec3 before = share < 0.0 ? vec3(0.0) : imageLoad(radiance_out, pixel).rgb;
    imageStore(radiance_out, pixel, vec4(before + abs(share) * radiance, 1.0));
#else
    imageStore(radiance_out, pixel, vec4(radiance, from == pixel ? 1.0 : 0.0));
#endif
}
