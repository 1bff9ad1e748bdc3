// Points on emissive triangles, chosen by power and uniform on the triangle as it is in this frame.  Both sides emit.
//
// Reads      tables of hits, hit_atlas, posed vertices   Reference: frame/raytracing/emitters.py
#include "raytracing/surface.glsl"

struct EmitterSample {
    vec3 position; // camera-relative
    vec3 normal;   // unit, of the triangle, on either side
    vec3 radiance; // linear
    float pdf_area; // per square meter, choice included; 0: nothing was sampled
};

const EmitterSample NO_EMITTER = EmitterSample(vec3(0.0), vec3(0.0), vec3(0.0), 0.0);

// x: draw, y: triangle, z: cumulative probability, w: probability
uvec4 emitter_words(int emitter) { return hit_words(uint(EMITTERS_AT + emitter)); }

// The first row whose cumulative probability is above ``pick``: between the bounds that the cell of ``pick`` names.
int emitter_chosen(float pick) {
    int cell = clamp(int(pick * float(EMITTER_CELLS)), 0, EMITTER_CELLS - 1);
    uvec4 bounds = hit_words(uint(EMITTER_CELLS_AT + cell));
    int low = int(bounds.x), high = int(bounds.y);
    for (int i = 0; i < 32 && low < high; ++i) {
        int middle = (low + high) >> 1;
        if (pick < uintBitsToFloat(emitter_words(middle).z)) high = middle;
        else low = middle + 1;
    }
    return low;
}

float triangle_area(HitCorners c) { return 0.5 * length(cross(c.e1, c.e2)); }

// pdf per square meter of ``sample_emitter`` on the triangle of row ``emitter``, whose area in this frame is ``area``.
float emitter_pdf_area(int emitter, float area) {
    if (emitter < 0 || !(area > 0.0)) return 0.0;
    return uintBitsToFloat(emitter_words(emitter).w) / area;
}

float emitter_pdf_area(int emitter, Hit hit) {
    HitDraw d = hit_draw(hit.instance);
    uvec3 vertices = hit_words(d.words.x + uint(hit.triangle)).xyz;
    return emitter_pdf_area(emitter, triangle_area(hit_corners(hit.instance, d, vertices)));
}

// The point of row ``emitter`` that ``u`` names.
EmitterSample emitter_point(int emitter, vec2 u) {
#if HIT_EMISSION
    uvec4 words = emitter_words(emitter);
    int draw = int(words.x);
    HitDraw d = hit_draw(draw);
    float root = sqrt(u.x), probability = uintBitsToFloat(words.w);
    HitTriangle t = hit_triangle(d, int(words.y), root * vec2(1.0 - u.y, u.y));
    HitCorners c = hit_corners(draw, d, t.vertices);
    float area = triangle_area(c);
    if (!draw_is(d, DRAW_VISIBLE) || !(area > 0.0) || !(probability > 0.0)) return NO_EMITTER;
    vec4 texcoords = vec4(0.0);
#if HIT_EMISSIVE_MAPS
    texcoords = hit_texcoords(d, t);
#endif
    EmitterSample r;
    r.position = point_on(c, t.weights);
    r.normal = safe_normalize(cross(c.e1, c.e2));
    r.radiance = hit_emission(d.words.z, texcoords, fract(4096.0 * u.y)); // low bits choose the texel
    r.pdf_area = probability / area;
    return r;
#else
    return NO_EMITTER;
#endif
}

// ``pick`` in [0, 1) chooses the triangle, ``u`` the point.
EmitterSample sample_emitter(float pick, vec2 u) {
    if (EMITTER_COUNT == 0) return NO_EMITTER;
    return emitter_point(emitter_chosen(pick), u);
}
