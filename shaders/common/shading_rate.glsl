// Which pixels of a frame are shaded, and which of them replaces one that is not.   Reference: references.shading_rate
// 0 full; 1 half: every second row; 2 checkerboard; 3 quarter: one pixel of each 2x2 block.  ``phase``: which of them.
#ifndef SHADING_RATE
#define SHADING_RATE 0
#endif

// Pixel of invocation ``id``: there is one for each shaded pixel, so other pixels cost nothing.
ivec2 shaded_pixel(ivec2 id, int phase) {
#if SHADING_RATE == 1
    return ivec2(id.x, 2 * id.y + phase);
#elif SHADING_RATE == 2
    return ivec2(2 * id.x + (id.y + phase & 1), id.y);
#elif SHADING_RATE == 3
    return 2 * id + ivec2(phase & 1, phase >> 1);
#else
    return id;
#endif
}

// The nearest shaded pixel; of two as near, the left or lower one.
ivec2 nearest_shaded(ivec2 pixel, int phase, ivec2 size) {
    ivec2 at = pixel;
#if SHADING_RATE == 1
    if ((pixel.y & 1) != phase) at.y = pixel.y > 0 ? pixel.y - 1 : pixel.y + 1;
#elif SHADING_RATE == 2
    if ((pixel.x + pixel.y + phase & 1) != 0) at.x = pixel.x > 0 ? pixel.x - 1 : pixel.x + 1;
#elif SHADING_RATE == 3
    ivec2 odd = ivec2(phase & 1, phase >> 1);
    for (int k = 0; k < 2; ++k)
        if ((pixel[k] & 1) != odd[k]) at[k] = pixel[k] > 0 ? pixel[k] - 1 : pixel[k] + 1;
#endif
    return clamp(at, ivec2(0), size - 1);
}
