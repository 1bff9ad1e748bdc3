// Recurrent blur, then post-blur: what they write is the history of the next frame.
//
// Paper    Zhdanov 2021, ReBLUR, blur and post-blur: the radius decreases with the frames in history; light is blurred again
//          in every frame, so that few taps are enough.   Reference  references.reuse_methods.Reblur
// Departs  radius = minimum + maximum x hit factor x lobe factor / sqrt(frames); NRD's curve has other constants.
#define LIGHT(lobe, q) (lobe == 0 ? fetch_diffuse_now(q) : fetch_specular_now(q))
#include "blur_lobes.glsl"

void reuse(ivec2 p) {
    vec4 diffuse = fetch_diffuse_now(p), specular = fetch_specular_now(p);
    float depth = fetch_position(p).w;
    if (depth > 0.0) {
        vec2 lobe = vec2(1.0, lobe_factor(fetch_material(p).y));
        vec2 hit = vec2(hit_factor(diffuse.a, depth), hit_factor(specular.a, depth));
        vec2 radius = (min_radius + max_radius * hit / sqrt(fetch_count(p))) * lobe * rows();
        if (iteration == 1) radius *= post_scale;
        blur_lobes(p, radius, 2 + iteration, diffuse, specular);
    }
    write_diffuse_now(p, diffuse);
    write_specular_now(p, specular);
    if (iteration == 1) {
        write_diffuse_light(p, diffuse);
        write_specular_light(p, specular);
    }
}
