// Light of a lobe without the color of the surface: light / albedo.  The albedo is never 0.
//
// Reads     diffuse, diffuse_albedo; specular, specular_albedo
// Writes    diffuse_demodulated; specular_demodulated
// Reference references.lobes
uniform ivec2 size;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
#if WRITE_DIFFUSE_DEMODULATED
    vec4 d = texelFetch(diffuse, pixel, 0);
    imageStore(diffuse_demodulated_out, pixel, vec4(d.rgb / texelFetch(diffuse_albedo, pixel, 0).rgb, d.a));
#endif
#if WRITE_SPECULAR_DEMODULATED
    vec4 s = texelFetch(specular, pixel, 0);
    imageStore(specular_demodulated_out, pixel, vec4(s.rgb / texelFetch(specular_albedo, pixel, 0).rgb, s.a));
#endif
}
