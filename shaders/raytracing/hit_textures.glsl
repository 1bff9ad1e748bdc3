// Textures of hits, all in one atlas of encoded texels, sampled at the largest size.
//
// Reads      hit_atlas, hit_static   Layout: frame/raytracing/hit_tables.py
#include "raytracing/hit_tables.glsl"

#if HIT_TEXTURES
// Where a texture is sampled: its place in the atlas and coordinates in texels.
struct MapPoint {
    ivec2 origin;
    ivec2 size;
    uint modes;
    vec2 at;
};

// Into [0, 1) where coordinates repeat; a mirrored coordinate folds (as common/material.glsl), others are clamped.
float wrapped(float x, uint mode) {
    if (mode == WRAP_REPEAT) return x - floor(x);
    return mode == WRAP_MIRROR ? 1.0 - abs(mod(x, 2.0) - 1.0) : clamp(x, 0.0, 1.0);
}

MapPoint map_point(uint material, uint slot, vec4 texcoords) {
    uint record = material + MATERIAL_TEXELS + SLOT_TEXELS * slot;
    uvec4 words = hit_words(record);
    MapPoint p;
    p.origin = ivec2(words.x & 0xFFFFu, words.x >> 16);
    p.size = ivec2(words.y & 0xFFFFu, words.y >> 16);
    p.modes = words.z;
    vec2 uv = (p.modes & MAP_UV1) != 0u ? texcoords.zw : texcoords.xy;
#if HIT_UV_TRANSFORMS
    if ((p.modes & MAP_TRANSFORMED) != 0u) {
        vec3 x = hit_floats(record + 1u).xyz, y = hit_floats(record + 2u).xyz;
        uv = vec2(dot(x, vec3(uv, 1.0)), dot(y, vec3(uv, 1.0)));
    }
#endif
    p.at = vec2(wrapped(uv.x, p.modes & 3u), wrapped(uv.y, p.modes >> 2 & 3u)) * vec2(p.size);
    return p;
}

// The texel at index i, which is at most one outside of the texture.
vec4 texel_of(MapPoint p, ivec2 i) {
    if ((p.modes & 3u) == WRAP_REPEAT) i.x = i.x < 0 ? i.x + p.size.x : i.x >= p.size.x ? i.x - p.size.x : i.x;
    if ((p.modes >> 2 & 3u) == WRAP_REPEAT) i.y = i.y < 0 ? i.y + p.size.y : i.y >= p.size.y ? i.y - p.size.y : i.y;
    return hit_atlas_at(p.origin + clamp(i, ivec2(0), p.size - 1));
}

// One texel, chosen by u in [0, 1) with its bilinear weight: the mean over u is the bilinear value.
vec4 one_texel(MapPoint p, float u) {
    if ((p.modes & MAP_NEAREST) != 0u) return texel_of(p, ivec2(p.at));
    vec2 low = floor(p.at - 0.5), f = p.at - 0.5 - low;
    bool right = u < f.x;
    u = right ? u / f.x : (u - f.x) / (1.0 - f.x);
    return texel_of(p, ivec2(low) + ivec2(right, u < f.y));
}

// For what is not linear in the light: normals, roughness, coverage.
vec4 bilinear(MapPoint p) {
    if ((p.modes & MAP_NEAREST) != 0u) return texel_of(p, ivec2(p.at));
    vec2 low = floor(p.at - 0.5), f = p.at - 0.5 - low;
    ivec2 i = ivec2(low);
    vec4 below = mix(texel_of(p, i), texel_of(p, i + ivec2(1, 0)), f.x);
    vec4 above = mix(texel_of(p, i + ivec2(0, 1)), texel_of(p, i + ivec2(1, 1)), f.x);
    return mix(below, above, f.y);
}

// IEC 61966-2-1.
vec3 linear_of_srgb(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), greaterThan(c, vec3(0.04045)));
}

#if HIT_SPECULAR_COLOR_MAPS
// As ``bilinear``, of colors.
vec3 bilinear_of_srgb(MapPoint p) {
    if ((p.modes & MAP_NEAREST) != 0u) return linear_of_srgb(texel_of(p, ivec2(p.at)).rgb);
    vec2 low = floor(p.at - 0.5), f = p.at - 0.5 - low;
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; ++k) {
        ivec2 step = ivec2(k & 1, k >> 1);
        vec2 w = mix(1.0 - f, f, vec2(step));
        sum += w.x * w.y * linear_of_srgb(texel_of(p, ivec2(low) + step).rgb);
    }
    return sum;
}
#endif
#endif
