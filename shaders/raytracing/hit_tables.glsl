// The tables of hits: rows of draws, triangles, vertices and materials.
//
// Reads      hit_static, hit_draws, posed_positions   Layout: frame/raytracing/hit_tables.py
#include "common/affine.glsl"

struct HitDraw {
    uvec4 words;  // x: first triangle, y: DRAW_* bits, z: material, w: first emitter + 1
    uvec4 places; // x: vertices, y: tangents, z: second texture coordinates, w: colors
};

struct HitTriangle {
    uvec3 vertices; // within the draw
    vec3 weights;
};

// Corners of a triangle, camera-relative: one, and the two edges from it.
struct HitCorners {
    vec3 a;
    vec3 e1;
    vec3 e2;
};

uvec4 hit_words(uint at) { return hit_static_at(ivec2(at & uint(HIT_ROW_MASK), at >> HIT_ROW_BITS)); }
vec4 hit_floats(uint at) { return uintBitsToFloat(hit_words(at)); }

uvec4 draw_words(int draw, uint part) {
    uint at = uint(draw) * DRAW_TEXELS + part;
    return hit_draws_at(ivec2(at & uint(HIT_ROW_MASK), at >> HIT_ROW_BITS));
}

HitDraw hit_draw(int draw) { return HitDraw(draw_words(draw, 3u), draw_words(draw, 4u)); }
bool draw_is(HitDraw d, uint bit) { return (d.words.y & bit) != 0u; }

Affine draw_transform(int draw) {
    return Affine(uintBitsToFloat(draw_words(draw, 0u)), uintBitsToFloat(draw_words(draw, 1u)),
                  uintBitsToFloat(draw_words(draw, 2u)));
}

HitTriangle hit_triangle(HitDraw d, int triangle, vec2 barycentrics) {
    vec3 weights = vec3(1.0 - barycentrics.x - barycentrics.y, barycentrics);
    return HitTriangle(hit_words(d.words.x + uint(triangle)).xyz, weights);
}

// Position and the first component of the normal of a vertex.
vec4 vertex_place(HitDraw d, uint vertex) { return hit_floats(d.places.x + 2u * vertex); }

// First texture coordinates, and y and z of the normal.
vec4 vertex_rest(HitDraw d, uint vertex) { return hit_floats(d.places.x + 2u * vertex + 1u); }

#if HIT_POSED
uint posed_vertex(int draw) { return draw_words(draw, 0u).x; }

vec3 posed_position(uint at) {
    return vec3(posed_positions[3u * at], posed_positions[3u * at + 1u], posed_positions[3u * at + 2u]);
}
#endif

HitCorners hit_corners(int draw, HitDraw d, uvec3 vertices) {
    HitCorners r;
#if HIT_POSED
    if (draw_is(d, DRAW_POSED)) {
        uint first = posed_vertex(draw);
        r.a = posed_position(first + vertices.x);
        r.e1 = posed_position(first + vertices.y) - r.a;
        r.e2 = posed_position(first + vertices.z) - r.a;
        return r;
    }
#endif
    Affine m = draw_transform(draw);
    vec3 a = vertex_place(d, vertices.x).xyz;
    r.a = transform_point(m, a);
    r.e1 = transform_vector(m, vertex_place(d, vertices.y).xyz - a);
    r.e2 = transform_vector(m, vertex_place(d, vertices.z).xyz - a);
    return r;
}

vec3 point_on(HitCorners c, vec3 weights) { return c.a + (weights.y * c.e1 + weights.z * c.e2); }

#if HIT_TEXTURES
// Both sets of texture coordinates.
vec4 hit_texcoords(HitDraw d, HitTriangle t) {
    vec4 r = vec4(0.0);
    for (int i = 0; i < 3; ++i) r.xy += t.weights[i] * vertex_rest(d, t.vertices[i]).xy;
#if HIT_UV1
    if (draw_is(d, DRAW_UV1))
        for (int i = 0; i < 3; ++i) r.zw += t.weights[i] * hit_floats(d.places.z + t.vertices[i]).xy;
#endif
    return r;
}
#endif

#if HIT_COLORS
vec4 hit_color(HitDraw d, HitTriangle t) {
    if (!draw_is(d, DRAW_COLORS)) return vec4(1.0);
    vec4 r = vec4(0.0);
    for (int i = 0; i < 3; ++i) r += t.weights[i] * hit_floats(d.places.w + t.vertices[i]);
    return r;
}
#endif
