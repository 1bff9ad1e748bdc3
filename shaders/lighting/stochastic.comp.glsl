// An unbiased estimate of what lighting.comp (and, per pixel, indirect/apply.comp on the rsm rung) computes exactly: a few
// lights and virtual lights drawn at random, each divided by its probability, and one random tap of the shadow filter.
//
// Paper    section 3.2, f_dir and f_ind, as noisy as a renderer in real time has them.
// Reads    position normal geometric_normal base_color material, light table, shadow atlas, virtual lights.
// Writes   direct, indirect (where asked for); only of the pixels shaded in this frame.
// Twin     metrics.stochastic
// Departs  As lighting.comp: the sky's own occlusion is not simulated, so its light carries no noise.
#include "common/affine.glsl"
#include "common/brdf.glsl"
#include "common/lights.glsl"
#include "common/random.glsl"
#include "common/shading_rate.glsl"
#include "common/sky.glsl"
#include "common/storage.glsl"
#if SHADOWS
#include "common/shadow.glsl"
#endif
#if INDIRECT
#include "common/indirect.glsl"
#endif

layout(local_size_x = GROUP_X, local_size_y = GROUP_Y) in;

layout(std140, binding = 0) uniform Parameters { LightingRecord P; };
layout(std430, binding = 4) readonly buffer Choice { vec2 choice[]; }; // x: cumulative probability, y: probability
layout(std140, binding = 1) uniform Draws { StochasticRecord S; };

uniform sampler2D position;
uniform sampler2D normal;
uniform sampler2D geometric_normal;
uniform sampler2D base_color;
uniform sampler2D material;
layout(RADIANCE_FORMAT, binding = 0) writeonly uniform image2D direct_out;
#if INDIRECT
layout(RADIANCE_FORMAT, binding = 1) writeonly uniform image2D indirect_out;
#endif

const uint INDIRECT_DRAW = 0x8000u; // draws of virtual lights are numbered from here

// The first light whose cumulative probability is above u.
int choose_light(float u) {
    int low = 0, high = S.counts.x - 1;
    while (low < high) {
        int middle = (low + high) >> 1;
        if (u < choice[middle].x) high = middle;
        else low = middle + 1;
    }
    return low;
}

vec3 direct_sample(Surface s, vec3 p, vec3 g, vec4 u) {
    int i = choose_light(u.x);
    LightRecord light = light_record(i);
    Incident in_light = incident(light, p);
    if (dot(g, in_light.l) <= 0.0) return vec3(0.0);
    Lobes lobes = evaluate_brdf(s, in_light.l);
    vec3 radiance = in_light.radiance / choice[i].y;
#if SHADOWS
#if SHADOW_RANDOM
    shadow_random = u.yz;
#endif
    radiance *= visibility(light, p, g, radiance.r + radiance.g + radiance.b > 0.0);
#endif
    return (lobes.diffuse + lobes.glossy) * radiance;
}

void main() {
    ivec2 pixel = shaded_pixel(ivec2(gl_GlobalInvocationID.xy), S.counts.z);
    if (any(greaterThanEqual(pixel, P.size.xy))) return;
    vec4 p = texelFetch(position, pixel, 0);
    vec4 m = texelFetch(material, pixel, 0);
    vec3 direct = vec3(0.0), indirect = vec3(0.0);
    if (p.w > 0.0 && m.w >= 0.0) { // a surface, and not unlit
        Surface s;
        s.base_color = texelFetch(base_color, pixel, 0).rgb;
        s.metallic = m.x;
        s.alpha = max(m.y * m.y, MIN_ALPHA);
        s.specular = m.w;
        s.n = texelFetch(normal, pixel, 0).xyz;
        s.v = P.parallel_view.w > 0.5 ? P.parallel_view.xyz : safe_normalize(-p.xyz);
        vec3 g = texelFetch(geometric_normal, pixel, 0).xyz;
        uint samples = S.counts.x > 0 ? S.draws.z : 0u;
        for (uint k = 0u; k < samples; ++k) direct += direct_sample(s, p.xyz, g, random4(pixel, S.draws.x, S.draws.y, k));
        if (samples > 0u) direct /= float(samples);
#if SKY
        Lobes sky = sky_light(s, m.y, P.sky.rgb);
        direct += sky.diffuse + sky.glossy;
#endif
#if INDIRECT
        vec3 x = p.xyz + S.scene_from_relative.xyz, e = vec3(0.0);
        for (uint k = 0u; k < S.draws.w; ++k) {
            float u = random4(pixel, S.draws.x, S.draws.y, INDIRECT_DRAW + k).x;
            e += vpl_irradiance(virtual_light(min(int(u * float(S.counts.y)), S.counts.y - 1)), x, s.n);
        }
        e *= float(S.counts.y) / float(S.draws.w);
        float fresnel = 0.04 * m.w; // as indirect/apply.comp
        indirect = ((1.0 - m.x) * (1.0 - fresnel) * s.base_color + mix(vec3(fresnel), s.base_color, m.x)) * e /
                   IRRADIANCE_PI;
#endif
    }
    imageStore(direct_out, pixel, vec4(direct, 1.0));
#if INDIRECT
    imageStore(indirect_out, pixel, vec4(indirect, 1.0));
#endif
}
