// Sample numbers: a scrambled Sobol sequence, a row for each sample, four dimensions a texel.
//
// Pattern `fixed`: the same numbers in every pixel and frame.  Pattern `independent`: each dimension is shifted by a hash
// of pixel, frame and seed; a digital (exclusive-or) shift keeps the stratification.   Reference: references.path_tracing
#include "pathtracing/state.glsl"
#include "common/random.glsl"

const int BLOCKS_PER_VERTEX = 3;
const int SCATTER = 0, EMITTER = 1, ENVIRONMENT_PUNCTUAL = 2; // blocks of a vertex

vec4 sample_numbers_of(NumbersOf of, int vertex, int block) {
    int column = vertex * BLOCKS_PER_VERTEX + block;
    uvec4 n = sample_table_at(ivec2(column, of.row));
#if INDEPENDENT
    n ^= pcg4d(uvec4(uint(of.pixel.x) | uint(of.pixel.y) << 16u, P.numbers.x, P.numbers.y, uint(column)));
#endif
    return vec4(n >> 8u) * (1.0 / 16777216.0);
}
