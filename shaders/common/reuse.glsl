// Functions for all reuse methods: color spaces, boxes, taps, kernels.
// Reference  references.reuse_methods
#include "common/luminance.glsl"
#include "common/numbers.glsl"

const int NEAREST = 0, BILINEAR = 1, CATMULL_ROM = 2; // second argument of sample_<name>(at, filtering)

// Malvar and Sullivan 2003, "YCoCg-R", the real-valued transform: Y in x, Co in y, Cg in z.
vec3 ycocg_from_rgb(vec3 c) {
    return vec3(0.25 * c.r + 0.5 * c.g + 0.25 * c.b, 0.5 * c.r - 0.5 * c.b, -0.25 * c.r + 0.5 * c.g - 0.25 * c.b);
}
vec3 rgb_from_ycocg(vec3 c) { return vec3(c.x + c.y - c.z, c.x + c.z, c.x - c.y - c.z); }

// Moves a color towards the center of the box until it is inside (Pedersen 2016, "Temporal Reprojection Anti-Aliasing in
// INSIDE").  Keeps the direction of the difference; a clamp changes it.
vec3 clip_to_box(vec3 low, vec3 high, vec3 c) {
    vec3 middle = 0.5 * (high + low), extent = 0.5 * (high - low) + 1.0e-7;
    vec3 offset = c - middle;
    vec3 reach = abs(offset) / extent;
    float farthest = max(reach.x, max(reach.y, reach.z));
    return farthest > 1.0 ? middle + offset / farthest : c;
}

// Moves a color towards ``target``, a point inside the box, until it is inside (Karis 2014: clip the ray from the history
// towards the average of the neighborhood).
vec3 clip_towards(vec3 low, vec3 high, vec3 target, vec3 c) {
    float entry = 0.0;
    for (int i = 0; i < 3; ++i) {
        float edge = clamp(c[i], low[i], high[i]);
        if (edge != c[i]) entry = max(entry, (edge - c[i]) / (target[i] - c[i]));
    }
    return mix(c, target, min(entry, 1.0));
}

// Keys 1981, a = -1/2 (Catmull-Rom): weights of the taps at -1, 0, 1, 2 for a point f in [0, 1) after tap 0.
vec4 catmull_rom_weights(float f) {
    float f2 = f * f, f3 = f2 * f;
    return vec4(-0.5 * f3 + f2 - 0.5 * f, 1.5 * f3 - 2.5 * f2 + 1.0, -1.5 * f3 + 2.0 * f2 + 0.5 * f, 0.5 * f3 - 0.5 * f2);
}

struct Tap { ivec2 at; float weight; };

// Tap i = 0 .. 3 of the bilinear footprint of ``at``; the weights add up to 1.
Tap bilinear_tap(vec2 at, int i) {
    ivec2 offset = ivec2(i & 1, i >> 1);
    vec2 f = at - floor(at);
    vec2 w = mix(1.0 - f, f, vec2(offset));
    return Tap(ivec2(floor(at)) + offset, w.x * w.y);
}
