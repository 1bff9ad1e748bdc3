// The image of one method as the input of the next.
//
// Reads      result position, light_rest where OWN_LIGHT: indirect light and emission of the input, exposure applied
// Writes     radiance, and where OWN_LIGHT direct: as of reuse.frame.INPUTS

uniform ivec2 size;

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(p, size))) return;
    vec3 light = texelFetch(result, p, 0).rgb;
    imageStore(radiance_out, p, vec4(light, 1.0));
#if OWN_LIGHT
    bool surface = texelFetch(position, p, 0).w > 0.0;
    imageStore(direct_out, p, vec4(surface ? light - texelFetch(light_rest, p, 0).rgb : light, 1.0));
#endif
}
