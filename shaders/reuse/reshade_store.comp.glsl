// Light of the re-shaded samples, and the light they had in the previous frame, at the current pixels that found them.
//
// Reads    link; direct and indirect light of the samples, now and before
// Writes   reshaded, the direct part of it, reshaded_before
uniform ivec2 size;
uniform float exposure;

void main() {
    ivec2 q = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(q, size))) return;
    uint found = link[q.y * size.x + q.x];
    if (found == 0u) return;
    int index = int(found) - 1;
    ivec2 p = ivec2(index % size.x, index / size.x);
    vec3 now = texelFetch(direct, q, 0).rgb, lit = now, before = texelFetch(history_direct, q, 0).rgb;
#if HAS_INDIRECT
    now += texelFetch(indirect, q, 0).rgb;
    before += texelFetch(history_indirect, q, 0).rgb;
#endif
    imageStore(reshaded_out, p, vec4(now * exposure, 1.0));
    imageStore(reshaded_direct_out, p, vec4(lit * exposure, 1.0));
    imageStore(reshaded_before_out, p, vec4(before * exposure, 1.0));
}
