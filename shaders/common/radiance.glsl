// What a pixel sends to the camera: light and emission where there are, or the sky's radiance.  Linear, before exposure.
// READ(channel, texel): how the includer reads a channel.
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
