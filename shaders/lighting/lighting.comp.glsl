// Direct radiance: what every punctual light and the uniform sky give the visible point, scattered once to the camera.
//
// Paper    section 3.2, f_dir: the direct radiance whose change is thresholded.
// Reads    position normal geometric_normal base_color material, light table, shadow atlas, per-tile light lists.
// Writes   direct (diffuse + glossy), and each lobe on request; only of the pixels shaded in this frame.
// Twin     metrics.lighting (albedo_table for the sky)
// Departs  The sky's own occlusion is not simulated: its light is that of an unoccluded point.
#include "common/affine.glsl"
#include "common/brdf.glsl"
#include "common/lights.glsl"
#include "common/shading_rate.glsl"
#include "common/sky.glsl"
#include "common/storage.glsl"
#if SHADOWS
#include "common/shadow.glsl"
#endif

layout(local_size_x = GROUP_X, local_size_y = GROUP_Y) in;

layout(std140, binding = 0) uniform Parameters { LightingRecord P; };
#if TILED
layout(std430, binding = 2) readonly buffer TileCounts { uint tile_counts[]; };
layout(std430, binding = 3) readonly buffer TileLists { uint tile_lists[]; };
#endif

uniform sampler2D position;
uniform sampler2D normal;
uniform sampler2D geometric_normal;
uniform sampler2D base_color;
uniform sampler2D material;
layout(RADIANCE_FORMAT, binding = 0) writeonly uniform image2D direct_out;
#if SPLIT_LOBES
layout(RADIANCE_FORMAT, binding = 1) writeonly uniform image2D direct_diffuse_out;
layout(RADIANCE_FORMAT, binding = 2) writeonly uniform image2D direct_glossy_out;
#endif

void add_light(LightRecord light, bool shadowed, Surface s, vec3 p, vec3 g, inout Lobes sum) {
    Incident in_light = incident(light, p);
    // Behind the triangle nothing arrives, whatever the interpolated normal says.
    vec3 radiance = dot(g, in_light.l) > 0.0 ? in_light.radiance : vec3(0.0);
    bool lit = radiance.r + radiance.g + radiance.b > 0.0 && dot(s.n, in_light.l) > 0.0;
#if BRANCHES
    if (!lit) return;
#endif
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
    vec4 p = texelFetch(position, pixel, 0);
    vec4 m = texelFetch(material, pixel, 0);
    Lobes sum = Lobes(vec3(0.0), vec3(0.0));
    if (p.w > 0.0 && m.w >= 0.0) { // a surface, and not unlit
        Surface s;
        s.base_color = texelFetch(base_color, pixel, 0).rgb;
        s.metallic = m.x;
        s.alpha = max(m.y * m.y, MIN_ALPHA);
        s.specular = m.w;
        s.n = texelFetch(normal, pixel, 0).xyz;
        s.v = P.parallel_view.w > 0.5 ? P.parallel_view.xyz : safe_normalize(-p.xyz);
        vec3 g = texelFetch(geometric_normal, pixel, 0).xyz;
#if LISTED_LIGHTS
#define ADD(i) add_light(listed_light(i), LISTED_FACES[i] >= 0.0, s, p.xyz, g, sum);
        EACH_LISTED_LIGHT(ADD)
#endif
#if UNLISTED_LIGHTS
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
#if LISTED_LIGHTS // those that have shadow maps
            if (light.color.w >= 0.0) continue;
#endif
            add_light(light, LISTED_LIGHTS == 0, s, p.xyz, g, sum);
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
