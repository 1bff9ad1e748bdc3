// The last rendered frame, shown again: the baseline of methods that generate frames.
void reuse(ivec2 p) {
    write_result(p, fetch_radiance(p).rgb);
}
