// Reconstruction: sum of direct and indirect light, modulation by albedo, emission; then the tone map.
//
// Paper    Schied et al. 2017, section 4 (reconstruction, tone mapping).   Reference  references.reuse_methods.modulated,
//          tone_mapped
// Departs  The paper does not name its curve; Reinhard's x / (1 + x) per channel is used because it has an inverse.
#include "albedo.glsl"
#include "tone.glsl"

void reuse(ivec2 p) {
    vec3 color = fetch_direct_filtered(p).rgb + fetch_indirect_filtered(p).rgb;
    if (fetch_position(p).w > 0.0)
        color = color * albedo_of(fetch_base_color(p)) + frame.exposure * fetch_emission(p).rgb;
    write_mapped(p, vec4(tone_mapped(color), 1.0));
}
