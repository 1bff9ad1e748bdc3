// What denoisers and upscalers know about a surface besides its light: albedo of each lobe, reactive mask, transparency mask.
//
// Reads      position normal base_color material ids; blended materials; table of directional albedos
// Writes     those of diffuse_albedo specular_albedo reactive transparency that a method reads
// Reference  references.lobes
#include "common/affine.glsl"
#include "common/lobe_albedos.glsl"
#include "common/luminance.glsl"

uniform ivec2 size;
uniform vec4 parallel_view; // xyz: towards a parallel camera; w: 1 if the camera is parallel

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    vec4 p = texelFetch(position, pixel, 0), m = texelFetch(material, pixel, 0), color = texelFetch(base_color, pixel, 0);
    bool lit = p.w > 0.0 && m.w >= 0.0;
    vec3 diffuse = vec3(0.0), specular = vec3(0.0);
    if (lit) {
        vec3 v = parallel_view.w > 0.5 ? parallel_view.xyz : safe_normalize(-p.xyz);
        float n_v = max(dot(texelFetch(normal, pixel, 0).xyz, v), 1e-4);
        diffuse = color.rgb * (1.0 - m.x);
        specular = glossy_albedo(color.rgb, m.x, m.w, lobe_albedos(m.y, n_v));
    }
#if WRITE_DIFFUSE_ALBEDO
    imageStore(diffuse_albedo_out, pixel, vec4(max(diffuse, vec3(MIN_ALBEDO)), 1.0));
#endif
#if WRITE_SPECULAR_ALBEDO
    imageStore(specular_albedo_out, pixel, vec4(max(specular, vec3(MIN_ALBEDO)), 1.0));
#endif
#if WRITE_REACTIVE
    uint index = texelFetch(ids, pixel, 0).y & 0x3fffffffu; // material + 1; the two highest bits mark a cut
    bool is_blended = p.w > 0.0 && blended[index] != 0u;
    imageStore(reactive_out, pixel, vec4(is_blended ? min(color.a, MAX_REACTIVE) : 0.0));
#endif
#if WRITE_TRANSPARENCY
    float mirror = luminance(specular) / max(luminance(specular + diffuse), 1e-6);
    imageStore(transparency_out, pixel, vec4((1.0 - m.y) * (1.0 - m.y) * mirror));
#endif
}
