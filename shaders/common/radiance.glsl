// Radiance of a pixel: light and emission where they are enabled, or the sky's radiance.  Linear, before exposure.
// READ(channel, texel): how the including shader reads a channel.
vec3 radiance_at(ivec2 at, vec3 sky) {
    vec3 sum = vec3(0.0);
#if HAS_DIRECT
    sum += READ(direct, at).rgb;
#endif
#if HAS_INDIRECT
    sum += READ(indirect, at).rgb;
#endif
#if HAS_EMISSION
    sum += READ(emission, at).rgb;
#endif
    return READ(position, at).w > 0.0 ? sum : sky;
}
