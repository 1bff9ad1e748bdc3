// An unbiased estimate of what lighting.comp (and, per pixel, indirect/apply.comp with method rsm) computes exactly: random
// samples of lights and VPLs, each divided by its probability, and one random tap of the shadow filter.
//
// Paper      section 3.2, f_dir and f_ind, with the noise of a real-time renderer.
// Reads      position normal geometric_normal base_color material, light table, light probabilities, shadow atlas, VPLs.
// Writes     direct and, where enabled, indirect, and where requested their lobes; only of the pixels shaded in this frame.
// Reference  references.stochastic
// Departs    As lighting.comp: occlusion of the sky is not simulated, so its light has no noise.
#include "common/to_camera.glsl"
#include "common/brdf.glsl"
#include "common/light_choice.glsl"
#include "common/lights.glsl"
#include "common/random.glsl"
#include "common/shading_rate.glsl"
#include "common/sky.glsl"
#if SHADOWS
#include "common/shadow.glsl"
#endif
#if INDIRECT
#include "common/vpl.glsl"
#endif

const uint INDIRECT_SAMPLE = 0x8000u; // samples of VPLs are numbered from here

// -> diffuse and glossy lobe
Lobes direct_sample(Surface s, vec3 p, vec3 g, vec4 u) {
    int i = choose_light(u.x, S.counts.x);
    LightRecord light = light_record(i);
    Incident in_light = incident(light, p);
    if (dot(g, in_light.l) <= 0.0) return Lobes(vec3(0.0), vec3(0.0));
    Lobes lobes = evaluate_brdf(s, in_light.l);
    vec3 radiance = in_light.radiance / light_choice[i].y;
#if SHADOWS
#if SHADOW_RANDOM
    shadow_random = u.yz;
#endif
    radiance *= visibility(light, p, g, radiance.r + radiance.g + radiance.b > 0.0);
#endif
    return Lobes(lobes.diffuse * radiance, lobes.glossy * radiance);
}

void main() {
    ivec2 pixel = shaded_pixel(ivec2(gl_GlobalInvocationID.xy), S.counts.z);
    if (any(greaterThanEqual(pixel, P.size.xy))) return;
    vec4 p = position_at(pixel);
    vec4 m = material_at(pixel);
    Lobes direct = Lobes(vec3(0.0), vec3(0.0)), indirect = direct;
    if (p.w > 0.0 && m.w >= 0.0) { // a surface, and not unlit
        Surface s;
        s.base_color = base_color_at(pixel).rgb;
        s.metallic = m.x;
        s.alpha = max(m.y * m.y, MIN_ALPHA);
        s.specular = m.w;
        s.n = normal_at(pixel).xyz;
        s.v = direction_to_camera(pixel, p.xyz);
        vec3 g = geometric_normal_at(pixel).xyz;
        uint samples = S.counts.x > 0 ? S.samples.z : 0u;
        for (uint k = 0u; k < samples; ++k) {
            Lobes one = direct_sample(s, p.xyz, g, random4(pixel, S.samples.x, S.samples.y, k));
            direct = Lobes(direct.diffuse + one.diffuse, direct.glossy + one.glossy);
        }
        if (samples > 0u) direct = Lobes(direct.diffuse / float(samples), direct.glossy / float(samples));
#if SKY
        Lobes sky = sky_light(s, m.y, P.sky.rgb);
        direct = Lobes(direct.diffuse + sky.diffuse, direct.glossy + sky.glossy);
#endif
#if INDIRECT
        vec3 x = p.xyz + S.scene_from_relative.xyz, e = vec3(0.0);
        for (uint k = 0u; k < S.samples.w; ++k) {
            float u = random4(pixel, S.samples.x, S.samples.y, INDIRECT_SAMPLE + k).x;
            e += vpl_irradiance(vpl(min(int(u * float(S.counts.y)), S.counts.y - 1)), x, s.n);
        }
        e *= float(S.counts.y) / float(S.samples.w);
        float fresnel = 0.04 * m.w; // as indirect/apply.comp
        indirect = Lobes((1.0 - m.x) * (1.0 - fresnel) * s.base_color * e / IRRADIANCE_PI,
                         mix(vec3(fresnel), s.base_color, m.x) * e / IRRADIANCE_PI);
#endif
    }
    imageStore(direct_out, pixel, vec4(direct.diffuse + direct.glossy, 1.0));
#if SPLIT_LOBES
    imageStore(direct_diffuse_out, pixel, vec4(direct.diffuse, 1.0));
    imageStore(direct_glossy_out, pixel, vec4(direct.glossy, 1.0));
#endif
#if INDIRECT
    imageStore(indirect_out, pixel, vec4(indirect.diffuse + indirect.glossy, 1.0));
#if SPLIT_LOBES
    imageStore(indirect_diffuse_out, pixel, vec4(indirect.diffuse, 1.0));
    imageStore(indirect_glossy_out, pixel, vec4(indirect.glossy, 1.0));
#endif
#endif
}
