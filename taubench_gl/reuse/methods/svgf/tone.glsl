// Reinhard et al. 2002, Eq. (3), per channel, and its inverse.   Reference  references.reuse_methods.tone_mapped, tone_unmapped
vec3 tone_mapped(vec3 c) {
    c = clamp(c, 0.0, 1.0e6);
    return c / (1.0 + c);
}
vec3 tone_unmapped(vec3 c) {
    c = clamp(c, 0.0, 0.999999);
    return c / (1.0 - c);
}
