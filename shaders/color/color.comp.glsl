// Color of a pixel: direct + indirect + emission (or the radiance of the environment), exposed, tone-mapped, sRGB-encoded.
//
// Paper      section 3.2, f_color.
// Reads      position and, where enabled, direct, indirect, emission.
// Writes     color in [0, 1].
// Reference  metrics.color
#define READ(channel, at) channel##_at(at)
#include "common/environment.glsl"
#include "common/numbers.glsl"
#include "common/radiance.glsl"

float srgb(float x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055; }

vec3 tone_map(vec3 x) {
#if TONE_MAP == 1 // Reinhard et al. 2002, Eq. 3, per channel
    return x / (1.0 + x);
#elif TONE_MAP == 2 // Narkowicz 2015's fit of the ACES curve
    return clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0);
#else
    return clamp(x, 0.0, 1.0);
#endif
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, P.size.xy))) return;
#if ENVIRONMENT_IMAGE
    vec3 sky = environment_seen((P.sky_origin + float(pixel.x) * P.sky_dx + float(pixel.y) * P.sky_dy).xyz);
#else
    vec3 sky = P.sky.rgb;
#endif
    vec3 radiance = radiance_at(pixel, sky);
    // Above 1e6 every curve is 1, and its products would overflow.
    vec3 mapped = tone_map(clamp(radiance * P.exposure, 0.0, 1.0e6));
    vec3 color = vec3(srgb(mapped.r), srgb(mapped.g), srgb(mapped.b));
    // Not a number stays one: the masks count it as INVALID.
    if (non_finite(radiance)) color = vec3(uintBitsToFloat(0x7fc00000u));
    imageStore(color_out, pixel, vec4(color, 1.0));
}
