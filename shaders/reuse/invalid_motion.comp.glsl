// Fills the motion of pixels that were behind the previous camera or invalid with a value outside of every image.
//
// Reads    mask
// Writes   motion where the mask is BEHIND or INVALID
uniform ivec2 size;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    if ((texelFetch(mask, pixel, 0).r & (BEHIND | INVALID)) != 0u) imageStore(motion, pixel, vec4(FAR_AWAY_PX));
}
