// The last shaded frame, rotated: samples it along the view ray of each pixel.  Ignores depth and camera translation.
//
// Paper    van Waveren 2016; Hartley and Zisserman 2004, section 8.4: at ~ K R_key^T R_now K^-1 p.
// Reference references.reuse_methods.timewarp_px
vec2 key_px(ivec2 p) {
    vec2 c = vec2(p) - frame.jitter_px; // sky rays include jitter; the image is sampled at pixel centers
    vec3 ray = (frame.sky_origin + c.x * frame.sky_dx + c.y * frame.sky_dy).xyz;
    vec4 clip = frame.key_clip_from_key * vec4(ray, frame.sky_origin.w);
    if (clip.w <= 0.0) return vec2(-1.0e6); // behind the camera of the shaded frame
    return (0.5 * clip.xy / clip.w + 0.5) * vec2(frame.size.xy) - 0.5;
}

void reuse(ivec2 p) {
    if (frame.is_key == 1u) {
        vec4 now = vec4(fetch_radiance(p).rgb, 1.0);
        write_shaded(p, now);
        write_reprojected_history(p, vec4(0.0));
        write_result(p, vec4(now.rgb, 0.0));
        return;
    }
    write_shaded(p, fetch_prev_shaded(p));
    vec2 at = key_px(p);
    bool seen = inside(at);
    vec3 warped = max(sample_prev_shaded(clamp(at, vec2(0.0), vec2(frame.size.xy - 1)), filtering).rgb, 0.0);
    vec4 shown = vec4(seen || border == BORDER_CLAMP ? warped : vec3(0.0), 1.0);
    write_reprojected_history(p, shown);
    write_result(p, shown);
}
