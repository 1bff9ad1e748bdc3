// Pre-blur of the new samples, with a radius by hit distance and lobe.
//
// Paper    Zhdanov 2021, ReBLUR, pre-blur: as little as is needed to stabilize the input of temporal accumulation.
// Reference references.reuse_methods.Reblur
#define LIGHT(lobe, q) \
    vec4(lobe == 0 ? fetch_diffuse_demodulated(q).rgb : fetch_specular_demodulated(q).rgb, fetch_hit_distance(q))
#include "blur_lobes.glsl"

void reuse(ivec2 p) {
    vec4 diffuse = vec4(0.0), specular = vec4(0.0);
    float depth = fetch_position(p).w;
    if (depth > 0.0) {
        float radius = preblur_radius * rows() * hit_factor(fetch_hit_distance(p), depth);
        blur_lobes(p, radius * vec2(1.0, lobe_factor(fetch_material(p).y)), 1, diffuse, specular);
    }
    write_diffuse_now(p, diffuse);
    write_specular_now(p, specular);
}
