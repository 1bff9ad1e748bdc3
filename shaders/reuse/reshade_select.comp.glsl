// Chooses one surface sample of the previous frame for each 3x3 block of pixels: that of the first pixel of the block, from a
// random one on, whose history no geometry mask discards.
//
// Paper    Schied, Peters, Dachsbacher 2018, "Gradient Estimation for Real-Time Adaptive Temporal Filtering", section 3:
//          one gradient sample per stratum of 3x3 pixels.
// Departs  Samples are found from the current pixel, backward along its motion, instead of by projecting all samples forward.
// Reads    position, mask, motion
// Reference references.reshading
// Writes   link of the sample's pixel in the previous frame: current pixel + 1; the largest where two blocks choose one sample
#include "common/random.glsl"

uniform ivec2 size;
uniform uvec2 numbers; // frame, seed
uniform uint discarded; // reason bits

void main() {
    ivec2 block = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(3 * block, size))) return;
    uint first = pcg4d(uvec4(uvec2(block), numbers)).x % 9u;
    for (uint k = 0u; k < 9u; ++k) {
        int i = int((first + k) % 9u);
        ivec2 p = 3 * block + ivec2(i % 3, i / 3);
        if (any(greaterThanEqual(p, size)) || texelFetch(position, p, 0).w <= 0.0) continue;
        if ((texelFetch(mask, p, 0).r & discarded) != 0u) continue;
        ivec2 q = ivec2(floor(vec2(p) + texelFetch(motion, p, 0).xy + 0.5));
        if (any(lessThan(q, ivec2(0))) || any(greaterThanEqual(q, size))) continue;
        if (texelFetch(history_position, q, 0).w <= 0.0) continue;
        atomicMax(link[q.y * size.x + q.x], uint(p.y * size.x + p.x) + 1u);
        return;
    }
}
