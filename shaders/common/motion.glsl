// Motion of a surface point or of the sky.   Paper: Eq. (3).
//
// ``q``: then, relative to the previous camera; ``p``: now, relative to the current one.  Pixels, previous - current, +y up.
vec2 motion_in_pixels(mat4 prev_clip_from_prev, vec4 q, mat4 clip_from_current, vec4 p, ivec2 size) {
    // ``precise``: both places of a still point must have the same bits, also where compilers fuse multiply and add.
    precise vec4 prev_clip = prev_clip_from_prev * q;
    precise vec4 clip = clip_from_current * p;
    precise vec2 then = prev_clip.xy / prev_clip.w;
    precise vec2 now = clip.xy / clip.w;
    return (then - now) * 0.5 * vec2(size);
}
