// Gradient samples of 3x3 blocks.  Pixel b < blocks of the outputs is block b, whose pixels are 3 b .. 3 b + 2.
//
// Paper    Schied, Peters, Dachsbacher 2018: one surface sample of the previous frame per 3x3 block is projected forward
//          and shaded again with its old random numbers; gradient = luminance now - luminance then, normalization =
//          max(now, then).   Reference  references.reuse_methods.gradient_samples
#include "moments.glsl"

void reuse(ivec2 b) {
    vec4 gradient = vec4(0.0); // x: gradient, y: normalization, z: weight
    vec3 moments = vec3(0.0);
    if (all(lessThan(b, (frame.size.xy + 2) / 3)))
        for (int i = 0; i < 9; ++i) {
            ivec2 p = 3 * b + ivec2(i % 3, i / 3);
            if (!in_image(p)) continue;
            vec4 again = fetch_reshaded(p);
            if (again.a > 0.5) {
                float now = luminance(again.rgb), then = luminance(fetch_reshaded_before(p).rgb);
                gradient.xyz += vec3(now - then, max(now, then), 1.0);
            }
            float l = luminance(fetch_sampled_light(p).rgb);
            moments += vec3(l, l * l, 1.0);
        }
    moments.xy /= max(moments.z, 1.0);
    write_gradient(b, gradient);
    write_blocks(b, vec2(moments.x, variance_of(moments.xx, moments.yy).x));
}
