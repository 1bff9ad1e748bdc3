// Indirect radiance of every pixel from the irradiance around it: from probes, or from the small gathered image, upsampled
// between samples of the same plane and orientation.  A pixel without such samples, and every pixel with GATHER_EACH,
// gathers all VPLs.
//
// Paper      section 3.2, f_ind.
// Reads      position normal base_color material, and probes, or irradiance and VPLs.
// Writes     indirect and, where requested, each lobe; only of the pixels shaded in this frame.
// Departs    The glossy lobe sees the irradiance of its mirror direction, not an image; only diffuse light bounces on.
#include "common/vpl.glsl"
#include "common/shading_rate.glsl"
#include "common/to_camera.glsl"

#if PROBES
#include "common/probe_lookup.glsl"
#endif

#if !PROBES
vec3 upsampled(ivec2 pixel, vec3 p, vec3 n, float depth) {
#if !GATHER_EACH
    vec2 at = (vec2(pixel) - float(SCALE / 2)) / float(SCALE);
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    vec3 sum = vec3(0.0);
    float total = 0.0;
    for (int tap = 0; tap < 4; ++tap) {
        ivec2 offset = ivec2(tap & 1, tap >> 1);
        ivec2 small = clamp(base + offset, ivec2(0), P.size.zw - 1);
        ivec2 source = min(small * SCALE + SCALE / 2, P.size.xy - 1);
        vec4 q = position_at(source);
        if (!(q.w > 0.0)) continue;
        vec3 m = normal_at(source).xyz;
        float plane = abs(dot(n, q.xyz - p)) / (0.02 * depth);
        float weight = max(dot(n, m), 0.0);
        weight = pow(weight, 8.0) * max(0.0, 1.0 - plane);
        weight *= (offset.x == 1 ? f.x : 1.0 - f.x) * (offset.y == 1 ? f.y : 1.0 - f.y);
        sum += weight * irradiance_at(small).rgb;
        total += weight;
    }
    if (total > 1e-3) return sum / total;
#endif
    vec3 own = vec3(0.0);
    for (int k = 0; k < P.counts.x; ++k) own += vpl_irradiance(vpl(k), p + P.scene_from_relative.xyz, n);
    return own;
}
#endif

void main() {
    ivec2 pixel = shaded_pixel(ivec2(gl_GlobalInvocationID.xy), P.counts.y);
    if (any(greaterThanEqual(pixel, P.size.xy))) return;
    vec4 p = position_at(pixel);
    vec4 m = material_at(pixel);
    vec3 radiance = vec3(0.0), diffuse_lobe = vec3(0.0), glossy_lobe = vec3(0.0);
    if (p.w > 0.0 && m.w >= 0.0) {
        vec3 n = normal_at(pixel).xyz, base = base_color_at(pixel).rgb;
        vec3 v = direction_to_camera(pixel, p.xyz);
        float fresnel = 0.04 * m.w;
#if PROBES
        vec3 x = p.xyz + P.scene_from_relative.xyz;
        vec3 e = probe_irradiance(x, n), mirrored = vec3(0.0);
#if GLOSSY
        mirrored = probe_irradiance(x, reflect(-v, n));
#endif
#else
        vec3 e = upsampled(pixel, p.xyz, n, p.w), mirrored = e;
#endif
        vec3 glossy = mix(vec3(fresnel), base, m.x);
        diffuse_lobe = (1.0 - m.x) * (1.0 - fresnel) * base * e;
        glossy_lobe = glossy * mirrored;
        radiance = (diffuse_lobe + glossy_lobe) / IRRADIANCE_PI;
    }
    imageStore(indirect_out, pixel, vec4(radiance, 1.0));
#if SPLIT_LOBES
    imageStore(indirect_diffuse_out, pixel, vec4(diffuse_lobe / IRRADIANCE_PI, 1.0));
    imageStore(indirect_glossy_out, pixel, vec4(glossy_lobe / IRRADIANCE_PI, 1.0));
#endif
}
