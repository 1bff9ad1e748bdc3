// What methods that compute their direct light themselves know of a pixel: its surface, and the light that they leave out.
//
// Reads      position normal geometric_normal base_color material, indirect where HAS_INDIRECT, emitted
// Writes     light_surfaces; light_rest: indirect light and emission, exposure applied
#include "common/affine.glsl"

uniform ivec2 size;
uniform float exposure;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    vec4 p = texelFetch(position, pixel, 0), m = texelFetch(material, pixel, 0);
    bool surface = p.w > 0.0;
    LightSurface x;
    x.position = vec4(p.xyz, surface && m.w >= 0.0 ? 1.0 : 0.0); // unlit surfaces scatter nothing
    x.normal = vec4(texelFetch(normal, pixel, 0).xyz, max(m.y * m.y, MIN_ALPHA));
    x.geometric_normal = vec4(safe_normalize(texelFetch(geometric_normal, pixel, 0).xyz), m.x);
    x.color = vec4(texelFetch(base_color, pixel, 0).rgb, m.w);
    light_surfaces[pixel.y * size.x + pixel.x] = x;
    vec3 rest = texelFetch(emitted, pixel, 0).rgb;
#if HAS_INDIRECT
    if (surface) rest += texelFetch(indirect, pixel, 0).rgb * exposure;
#endif
    imageStore(light_rest_out, pixel, vec4(rest, 1.0));
}
