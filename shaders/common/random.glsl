// Counter-based random numbers: a hash of (pixel, frame, seed, sample).  Nothing is stored, so any frame can be rendered again.
// pcg4d of Jarzynski and Olano 2020, "Hash Functions for GPU Rendering", listing 1.   Reference: references.stochastic.pcg4d
uvec4 pcg4d(uvec4 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.w; v.y += v.z * v.x; v.z += v.x * v.y; v.w += v.y * v.z;
    v ^= v >> 16u;
    v.x += v.y * v.w; v.y += v.z * v.x; v.z += v.x * v.y; v.w += v.y * v.z;
    return v;
}

// Four numbers in [0, 1), multiples of 2^-24: every one of them is a float.
vec4 random4(ivec2 pixel, uint frame, uint seed, uint sample_number) {
    return vec4(pcg4d(uvec4(uvec2(pixel), frame, seed << 16u | sample_number)) >> 8u) * (1.0 / 16777216.0);
}
