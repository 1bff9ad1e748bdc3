// Exposed linear radiance of light and emission, or of the sky.  A pixel that was not shaded in this frame gets the
// radiance of its nearest shaded neighbor.
//
// Reads    position; direct, indirect, emission where available; lobes and path_info where an output needs them
// Writes   radiance: rgb exposed, a 1 where shaded and 0 where filled; ACCUMULATE adds a share of rgb instead.  Where
//          requested its parts, each exposed: direct, diffuse, specular, emitted; samples, hits, variance.
// Reference references.shading_rate.nearest_shaded, metrics.color (its exposure)
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

#if WRITE_SAMPLE_COUNT
uniform float samples; // per shaded pixel
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
    float shaded = from == pixel ? 1.0 : 0.0;
    imageStore(radiance_out, pixel, vec4(radiance, shaded));
#endif
#if WRITE_DIRECT || WRITE_DIFFUSE || WRITE_SPECULAR || WRITE_EMITTED
    bool surface = READ(position, from).w > 0.0;
#endif
#if WRITE_DIRECT
#if HAS_DIRECT
    vec3 direct_light = surface ? READ(direct, from).rgb : sky;
#else
    vec3 direct_light = surface ? vec3(0.0) : sky;
#endif
    imageStore(direct_out, pixel, vec4(direct_light * exposure, shaded));
#endif
#if WRITE_DIFFUSE
    vec3 diffuse = vec3(0.0);
#define ADD_DIFFUSE(channel) diffuse += READ(channel, from).rgb;
    EACH_DIFFUSE(ADD_DIFFUSE)
    imageStore(diffuse_out, pixel, vec4(surface ? diffuse * exposure : vec3(0.0), shaded));
#endif
#if WRITE_SPECULAR
    vec3 specular = vec3(0.0);
#define ADD_SPECULAR(channel) specular += READ(channel, from).rgb;
    EACH_SPECULAR(ADD_SPECULAR)
    imageStore(specular_out, pixel, vec4(surface ? specular * exposure : vec3(0.0), shaded));
#endif
#if WRITE_EMITTED
#if HAS_EMISSION
    vec3 emitted = surface ? READ(emission, from).rgb : sky;
#else
    vec3 emitted = surface ? vec3(0.0) : sky;
#endif
    imageStore(emitted_out, pixel, vec4(emitted * exposure, 1.0));
#endif
#if WRITE_SAMPLE_COUNT
    imageStore(sample_count_out, pixel, vec4(samples * shaded));
#endif
#if WRITE_HIT_DISTANCE
    imageStore(hit_distance_out, pixel, vec4(READ(path_info, from).x));
#endif
#if WRITE_VARIANCE
    imageStore(variance_out, pixel, vec4((READ(path_info, from).z + READ(path_info, from).w) * exposure * exposure));
#endif
}
