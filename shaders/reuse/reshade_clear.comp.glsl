// No pixel has a re-shaded sample yet.
//
// Writes   reshaded, reshaded_direct, reshaded_before, link
uniform ivec2 size;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    imageStore(reshaded_out, pixel, vec4(0.0));
    imageStore(reshaded_direct_out, pixel, vec4(0.0));
    imageStore(reshaded_before_out, pixel, vec4(0.0));
    link[pixel.y * size.x + pixel.x] = 0u;
}
