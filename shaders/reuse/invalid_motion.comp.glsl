// Fills the motion of pixels that were behind the previous camera or invalid with a value outside of every image.
//
// Reads    mask
// Writes   motion where the mask is BEHIND or INVALID
layout(local_size_x = GROUP_X, local_size_y = GROUP_Y) in;

uniform ivec2 size;
uniform usampler2D mask;
layout(rg32f, binding = 0) writeonly uniform image2D motion_out;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    if ((texelFetch(mask, pixel, 0).r & (BEHIND | INVALID)) != 0u) imageStore(motion_out, pixel, vec4(FAR_AWAY_PX));
}
