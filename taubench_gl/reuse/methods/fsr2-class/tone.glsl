// FSR2's local tone map c / (1 + max c), which fits bright colors into the boxes.
// Reference references.reuse_methods.fsr2_tone_mapped, fsr2_radiance
vec3 tone_mapped(ivec2 p) {
    vec3 c = max(fetch_radiance(p).rgb, 0.0);
    return c / (1.0 + max(c.r, max(c.g, c.b)));
}
