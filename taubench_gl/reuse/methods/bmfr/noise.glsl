// Random numbers of a counter: pcg4d of Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", listing 1.
// Reference references.reuse_methods.feature_noise, block_offset
uvec4 hashed(uvec4 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.w; v.y += v.z * v.x; v.z += v.x * v.y; v.w += v.y * v.z;
    v ^= v >> 16u;
    v.x += v.y * v.w; v.y += v.z * v.x; v.z += v.x * v.y; v.w += v.y * v.z;
    return v;
}

// Four numbers in [0, 1), multiples of 2^-24, of pixel, frame and a number.
vec4 random_numbers(ivec2 p, int number) {
    return vec4(hashed(uvec4(uvec2(p), uint(frame.index), uint(number))) >> 8u) * (1.0 / 16777216.0);
}

const int OFFSET_NUMBER = 3; // 0 to 2 are the noise of the features

// How far the grid of blocks is shifted to the left and down in this frame, pixels.
ivec2 block_offset() {
    if (!shift_blocks) return ivec2(0);
    return ivec2(floor(random_numbers(ivec2(0), OFFSET_NUMBER).xy * vec2(block_size)));
}
