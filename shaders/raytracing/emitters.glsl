// Points on emissive triangles, uniform on the triangle as it is in this frame, and the choice by power.  Both sides emit.
// The path tracer chooses by cells of a grid (pathtracing/light_cells.glsl).
//
// Reads      tables of hits, hit_atlas, posed vertices   Reference: frame/raytracing/emitters.py
#include "raytracing/surface.glsl"

struct EmitterSample {
    vec3 position; // camera-relative
    vec3 normal;   // unit, of the triangle, on either side
    vec3 radiance; // linear
    float pdf_area; // per square meter; 0: nothing was sampled
};

const EmitterSample NO_EMITTER = EmitterSample(vec3(0.0), vec3(0.0), vec3(0.0), 0.0);

// x: draw, y: triangle, z: cumulative probability, w: probability
uvec4 emitter_words(int emitter) { return hit_words(uint(EMITTERS_AT + emitter)); }

float emitter_cumulative(int emitter) { return emitter < 0 ? 0.0 : uintBitsToFloat(emitter_words(emitter).z); }

float emitter_probability(int emitter) { return uintBitsToFloat(emitter_words(emitter).w); }

// The first row from ``low`` to ``high`` whose cumulative probability is above ``pick``.
int emitter_between(int low, int high, float pick) {
    for (int i = 0; i < 32 && low < high; ++i) {
        int middle = (low + high) >> 1;
        if (pick < emitter_cumulative(middle)) high = middle;
        else low = middle + 1;
    }
    return low;
}

// The row that ``pick`` in [0, 1) chooses by power: between the bounds that the cell of ``pick`` names.
int emitter_chosen(float pick) {
    int cell = clamp(int(pick * float(EMITTER_CELLS)), 0, EMITTER_CELLS - 1);
    uvec4 bounds = hit_words(uint(EMITTER_CELLS_AT + cell));
    return emitter_between(int(bounds.x), int(bounds.y), pick);
}

float triangle_area(HitCorners c) { return 0.5 * length(cross(c.e1, c.e2)); }

// The point of row ``emitter`` that ``u`` names.
EmitterSample emitter_point(int emitter, vec2 u) {
#if HIT_EMISSION
    uvec4 words = emitter_words(emitter);
    int draw = int(words.x);
    HitDraw d = hit_draw(draw);
    float root = sqrt(u.x);
    HitTriangle t = hit_triangle(d, int(words.y), root * vec2(1.0 - u.y, u.y));
    HitCorners c = hit_corners(draw, d, t.vertices);
    float area = triangle_area(c);
    if (!draw_is(d, DRAW_VISIBLE) || !(area > 0.0)) return NO_EMITTER;
    vec4 texcoords = vec4(0.0);
#if HIT_EMISSIVE_MAPS
    texcoords = hit_texcoords(d, t);
#endif
    EmitterSample r;
    r.position = point_on(c, t.weights);
    r.normal = safe_normalize(cross(c.e1, c.e2));
    r.radiance = hit_emission(d.words.z, texcoords, fract(4096.0 * u.y)); // low bits choose the texel
    r.pdf_area = 1.0 / area;
    return r;
#else
    return NO_EMITTER;
#endif
}
