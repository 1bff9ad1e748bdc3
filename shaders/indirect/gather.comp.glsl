// Method rsm: irradiance of all VPLs, without visibility, at every SCALE-th pixel of both axes.
//
// Reads      position, normal, VPLs.
// Writes     a small irradiance image.
#include "common/vpl.glsl"

void main() {
    ivec2 small = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(small, P.size.zw))) return;
    ivec2 pixel = min(small * SCALE + SCALE / 2, P.size.xy - 1);
    vec4 p = position_at(pixel);
    vec3 sum = vec3(0.0);
    if (p.w > 0.0) {
        vec3 x = p.xyz + P.scene_from_relative.xyz, n = normal_at(pixel).xyz;
        for (int k = 0; k < P.counts.x; ++k) sum += vpl_irradiance(vpl(k), x, n);
    }
    imageStore(irradiance_out, small, vec4(sum, 1.0));
}
