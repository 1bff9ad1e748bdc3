// Modulation by albedo and addition of emission.  Paper: Schied et al. 2017, section 4 (reconstruction).
#include "albedo.glsl"

void reuse(ivec2 p) {
    vec3 color = fetch_filtered(p).rgb;
    if (fetch_position(p).w > 0.0)
        color = color * albedo_of(fetch_base_color(p)) + frame.exposure * fetch_emission(p).rgb;
    write_result(p, vec4(max(color, 0.0), 1.0 - fetch_moments(p).w));
}
