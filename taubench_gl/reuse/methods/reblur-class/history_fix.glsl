// Reconstruction where history is short: 5x5 taps, wide apart, of the same surface.
//
// Paper    Zhdanov 2021, ReBLUR, history fix; NRD since version 3: sparse taps instead of mipmaps, wider for fewer frames.
// Reference references.reuse_methods.Reblur
#include "disk.glsl"

void reuse(ivec2 p) {
    vec4 light[2] = vec4[2](fetch_diffuse_now(p), fetch_specular_now(p));
    vec2 count = fetch_count(p);
    vec4 position = fetch_position(p);
    vec3 n = fetch_normal(p).xyz;
    float rough = fetch_material(p).y;
    for (int lobe = 0; lobe < 2; ++lobe) {
        if (!(position.w > 0.0) || count[lobe] > float(fix_frames) + 0.5) continue;
        int stride = max(int(floor(fix_stride * rows() / count[lobe] + 0.5)), 1);
        float total = 0.0, width = lobe == 0 ? 1.0 : lobe_factor(rough);
        vec4 sum = vec4(0.0);
        for (int y = -2; y <= 2; ++y)
            for (int x = -2; x <= 2; ++x) {
                ivec2 q = p + stride * ivec2(x, y);
                if (!in_image(q)) continue;
                float w = surface_weight(position, n, fetch_position(q), fetch_normal(q).xyz, width);
                if (lobe == 1) w *= max(1.0 - abs(rough - fetch_material(q).y) / roughness_limit, 0.0);
                sum += w * (lobe == 0 ? fetch_diffuse_now(q) : fetch_specular_now(q));
                total += w;
            }
        light[lobe] = sum / total; // the weight of the pixel itself is 1
    }
    write_diffuse_now(p, light[0]);
    write_specular_now(p, light[1]);
}
