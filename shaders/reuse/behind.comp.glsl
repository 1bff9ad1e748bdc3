// Motion of what was behind the previous camera: none the mask pass could give, so a number no picture is as wide as.
// Reads    mask.   Writes   motion where it was BEHIND or INVALID.
layout(local_size_x = GROUP_X, local_size_y = GROUP_Y) in;

uniform ivec2 size;
uniform usampler2D mask;
layout(rg32f, binding = 0) writeonly uniform image2D motion_out;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, size))) return;
    if ((texelFetch(mask, pixel, 0).r & (BEHIND | INVALID)) != 0u) imageStore(motion_out, pixel, vec4(FAR_AWAY_PX));
}
