// Motion of a surface point or of the sky.   Paper: Eq. (3).
//
// ``q``: then, relative to the previous camera; ``p``: now, relative to the current one.  Pixels, previous - current, +y up.
vec2 motion_in_pixels(mat4 prev_clip_from_prev, vec4 q, mat4 clip_from_current, vec4 p, ivec2 size) {
    precise vec4 prev_clip = prev_clip_from_prev * q; // ``precise``: both of a still point have the same bits
    precise vec4 clip = clip_from_current * p;
    if (prev_clip == clip) return vec2(0.0); // NVIDIA's compiler rounds equal quotients differently
    return (prev_clip.xy / prev_clip.w - clip.xy / clip.w) * 0.5 * vec2(size);
}
