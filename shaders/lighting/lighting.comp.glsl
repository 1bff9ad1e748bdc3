// Direct radiance: light of every punctual light and of the environment that the visible point scatters to the
// camera.
//
// Paper      section 3.2, f_dir: the direct radiance whose change is thresholded.
// Reads      position normal geometric_normal base_color material, light table, shadow atlas, tile light lists.
// Writes     direct (diffuse + glossy) and, where requested, each lobe; only of the pixels shaded in this frame.
// Reference  metrics.lighting (albedo_table for the environment), metrics.environment
// Departs    Occlusion of the environment is not simulated: its light is that of an unoccluded point.  Glossy light of an image
//            is its split sum.
#include "common/brdf.glsl"
#include "common/lights.glsl"
#include "common/shading_rate.glsl"
#include "common/sky.glsl"
#include "common/to_camera.glsl"
#include "common/tuning.glsl"
#if SHADOWS
#include "common/shadow.glsl"
#endif

void add_light(LightRecord light, bool shadowed, Surface s, vec3 p, vec3 g, inout Lobes sum) {
    Incident in_light = incident(light, p);
    // No light arrives behind the triangle, whichever way the interpolated normal points.
    vec3 radiance = dot(g, in_light.l) > 0.0 ? in_light.radiance : vec3(0.0);
    bool lit = radiance.r + radiance.g + radiance.b > 0.0 && dot(s.n, in_light.l) > 0.0;
    RETURN_IF(!lit);
#if SHADOWS
    if (shadowed) radiance *= visibility(light, p, g, lit);
#endif
    Lobes lobes = evaluate_brdf(s, in_light.l);
    sum.diffuse += lobes.diffuse * radiance;
    sum.glossy += lobes.glossy * radiance;
}

void main() {
    ivec2 pixel = shaded_pixel(ivec2(gl_GlobalInvocationID.xy), P.phase);
    if (any(greaterThanEqual(pixel, P.size.xy))) return;
    vec4 p = position_at(pixel);
    vec4 m = material_at(pixel);
    Lobes sum = Lobes(vec3(0.0), vec3(0.0));
    if (p.w > 0.0 && m.w >= 0.0) { // a surface, and not unlit
        Surface s;
        s.base_color = base_color_at(pixel).rgb;
        s.metallic = m.x;
        s.alpha = max(m.y * m.y, MIN_ALPHA);
        s.specular = m.w;
        s.n = normal_at(pixel).xyz;
        s.v = direction_to_camera(pixel, p.xyz);
        vec3 g = geometric_normal_at(pixel).xyz;
#if UNROLLED_LIGHTS
#define ADD(i) add_light(unrolled_light(i), UNROLLED_FACES[i] >= 0.0, s, p.xyz, g, sum);
        EACH_UNROLLED_LIGHT(ADD)
#endif
#if LOOPED_LIGHTS
#if TILED
        uint tile = uint(pixel.y / TILE) * uint(P.size.z) + uint(pixel.x / TILE);
        uint count = tile_counts[tile];
#else
        uint count = uint(P.size.w);
#endif
        for (uint i = 0u; i < count; ++i) {
#if TILED
            LightRecord light = light_record(int(tile_lists[tile * uint(P.size.w) + i]));
#else
            LightRecord light = light_record(int(i));
#endif
#if UNROLLED_LIGHTS // those that have shadow maps
            if (light.color.w >= 0.0) continue;
#endif
            add_light(light, UNROLLED_LIGHTS == 0, s, p.xyz, g, sum);
        }
#endif
#if SKY
        Lobes sky = sky_light(s, m.y, P.sky.rgb);
        sum.diffuse += sky.diffuse;
        sum.glossy += sky.glossy;
#endif
    }
    imageStore(direct_out, pixel, vec4(sum.diffuse + sum.glossy, 1.0));
#if SPLIT_LOBES
    imageStore(direct_diffuse_out, pixel, vec4(sum.diffuse, 1.0));
    imageStore(direct_glossy_out, pixel, vec4(sum.glossy, 1.0));
#endif
}
