// Colour of a pixel: direct + indirect + emission (or the sky's radiance), exposed, tone-mapped, sRGB-encoded.
// Writes   color in [0, 1].   Twin   metrics.color
layout(local_size_x = GROUP_X, local_size_y = GROUP_Y) in;

layout(std430, binding = 0) readonly buffer Parameters { LightingRecord P; };

uniform sampler2D position;
uniform sampler2D direct;
#if HAS_INDIRECT
uniform sampler2D indirect;
#endif
#if HAS_EMISSION
uniform sampler2D emission;
#endif
layout(rgba32f, binding = 0) writeonly uniform image2D color_out;

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
    vec3 radiance = texelFetch(direct, pixel, 0).rgb;
#if HAS_INDIRECT
    radiance += texelFetch(indirect, pixel, 0).rgb;
#endif
#if HAS_EMISSION
    radiance += texelFetch(emission, pixel, 0).rgb;
#endif
    if (!(texelFetch(position, pixel, 0).w > 0.0)) radiance = P.sky.rgb;
    vec3 mapped = tone_map(max(radiance * P.exposure, vec3(0.0)));
    imageStore(color_out, pixel, vec4(srgb(mapped.r), srgb(mapped.g), srgb(mapped.b), 1.0));
}
