// The blur of both lobes over disks.   Reference  references.reuse_methods.Reblur
#include "disk.glsl"

// Both lobes of pixel p blurred over disks of radii in pixels.  Needs LIGHT(lobe, q): rgb, a: hit distance.
void blur_lobes(ivec2 p, vec2 radius, int salt, out vec4 diffuse, out vec4 specular) {
    vec4 position = fetch_position(p);
    vec3 n = fetch_normal(p).xyz, t, b;
    tangents(n, t, b);
    float angle = kernel_angle(p, salt), rough = fetch_material(p).y;
    for (int lobe = 0; lobe < 2; ++lobe) {
        vec4 own = LIGHT(lobe, p), sum = own;
        float total = 1.0, width = lobe == 0 ? 1.0 : lobe_factor(rough);
        for (int i = 0; i < TAPS; ++i) {
            vec2 o = disk_offset(i, angle);
            ivec2 q = pixel_of(position.xyz + radius[lobe] * pixel_size(position.w) * (o.x * t + o.y * b), p);
            if (!in_image(q)) continue;
            float w = surface_weight(position, n, fetch_position(q), fetch_normal(q).xyz, width) * exp(-dot(o, o));
            if (lobe == 1) w *= max(1.0 - abs(rough - fetch_material(q).y) / roughness_limit, 0.0);
            if (w == 0.0) continue;
            vec4 other = LIGHT(lobe, q);
            w *= hit_weight(own.a, other.a);
            sum += w * other;
            total += w;
        }
        if (lobe == 0) diffuse = sum / total;
        else specular = sum / total;
    }
}
