// Stochastic alpha: a surface is present where its alpha reaches a threshold that is uniform in (0, 1) over its points.
//
// Paper      Wyman and McGuire 2017, "Hashed Alpha Testing": the threshold is a hash of the point in object space, in
//            cells of about a pixel.  It moves with the surface, and has no other state: frames are reproducible.
// Departs    Cells are hashed as integers (pcg4d).  The vertices of skinned and morphed surfaces have no object space
//            here: the threshold is a hash of the pixel.
#include "common/random.glsl"
#if STOCHASTIC_ALPHA
#if !POSED
in vec3 pos_object;

float cell_hash(vec3 cell) { return float(pcg4d(uvec4(ivec3(cell), 0)).x >> 8u) * (1.0 / 16777216.0); }

float alpha_threshold(uint draw) {
    float pixel = max(max(length(dFdx(pos_object)), length(dFdy(pos_object))), 1e-20);
    float level = -log2(pixel); // cells per unit of length
    float between = fract(level);
    float fine = cell_hash(floor(pos_object * exp2(ceil(level))));
    float coarse = cell_hash(floor(pos_object * exp2(floor(level))));
    float x = mix(coarse, fine, between);
    // A mix of two uniform numbers is not uniform: its distribution function is.
    float a = max(min(between, 1.0 - between), 1e-6);
    float rising = x * x / (2.0 * a * (1.0 - a));
    float falling = 1.0 - (1.0 - x) * (1.0 - x) / (2.0 * a * (1.0 - a));
    float threshold = x < a ? rising : x < 1.0 - a ? (x - 0.5 * a) / (1.0 - a) : falling;
    return clamp(threshold, 1e-6, 1.0);
}
#else
float alpha_threshold(uint draw) {
    uint bits = pcg4d(uvec4(uvec2(gl_FragCoord.xy), draw, 1u)).x >> 8u;
    return (float(bits) + 1.0) * (1.0 / 16777216.0);
}
#endif
#endif
