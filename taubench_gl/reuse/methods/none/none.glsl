// The current frame without reuse.
void reuse(ivec2 p) {
    write_reprojected_history(p, vec4(0.0));
    write_result(p, vec4(fetch_radiance(p).rgb, 0.0));
}
