// Sharpening, inverse tone map, result.
//
// Paper    FSR2 documentation: "Robust Contrast Adaptive Sharpening": of the cross of five pixels, the most negative lobe that
//          keeps the result within their range, limited to 3/16, times 2^(-2 (1 - sharpness)).
// Reference references.reuse_methods.fsr2_rcas, fsr2_radiance
// Departs  White is halfway from the brightest of the five pixels to 1, not 1: the inverse tone map of 1 is infinite, that of this
//          white is at most 2 r + 1 for the largest radiance r.
vec3 shown(ivec2 p) { return clamp(fetch_color(p).rgb, 0.0, 1.0); }

void reuse(ivec2 p) {
    vec3 color = shown(p);
    if (sharpen) {
        vec3 left = shown(p - ivec2(1, 0)), right = shown(p + ivec2(1, 0));
        vec3 down = shown(p - ivec2(0, 1)), up = shown(p + ivec2(0, 1));
        vec3 low = min(min(left, right), min(down, up)), high = max(max(left, right), max(down, up));
        vec3 to_black = min(low, color) / max(4.0 * high, 1.0e-6);
        vec3 bright = max(high, color);
        float white = 0.5 + 0.5 * max(bright.r, max(bright.g, bright.b));
        vec3 to_white = (white - bright) / min(4.0 * low - 4.0 * white, -1.0e-6);
        vec3 lobes = max(-to_black, to_white);
        float lobe = max(-0.1875, min(max(lobes.r, max(lobes.g, lobes.b)), 0.0)) * exp2(-2.0 * (1.0 - sharpness));
        color = clamp((lobe * (left + right + down + up) + color) / (4.0 * lobe + 1.0), 0.0, white);
    }
    float most = max(color.r, max(color.g, color.b));
    write_result(p, vec4(color / max(1.0 - most, 1.0e-5), fetch_lock(p).a));
}
