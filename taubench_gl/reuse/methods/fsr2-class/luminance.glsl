// Mean logarithm of the luminance of blocks of 16x16 input pixels: a level of FSR2's luminance pyramid.
//
// Paper    FSR2 documentation: "Compute luminance pyramid"; the level is that of its shading change detection.
// Reference references.reuse_methods.fsr2_block_luminance
// Departs  The exposure of the pyramid's last level is not needed: the inputs are exposed.
shared vec2 sums[block_threads];

void reuse_block(ivec2 block, int thread) {
    ivec2 p = block * block_size + ivec2(thread % block_size.x, thread / block_size.x);
    bool inside_image = in_image(p);
    sums[thread] = inside_image ? vec2(log(max(luminance(fetch_radiance(p).rgb), 1.0e-4)), 1.0) : vec2(0.0);
    for (int width = block_threads / 2; width > 0; width /= 2) {
        barrier();
        if (thread < width) sums[thread] += sums[thread + width];
    }
    barrier();
    if (inside_image) write_pyramid(p, sums[0].x / sums[0].y);
}
