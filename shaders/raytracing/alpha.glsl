// Alpha test of hits, with the cutoff of the rasterizer: bilinear at the texture's largest size.
//
// Reads      tables of hits, hit_atlas
#include "raytracing/hit_textures.glsl"

bool alpha_passes(int instance, int triangle, vec2 barycentrics) {
#if HIT_ALPHA
    HitDraw d = hit_draw(instance);
    if (!draw_is(d, DRAW_ALPHA_TEST)) return true;
    uint material = d.words.z;
    float alpha = hit_floats(material).a, cutoff = hit_floats(material + 2u).w;
    HitTriangle t = hit_triangle(d, triangle, barycentrics);
#if HIT_TEXTURES
    if ((hit_words(material + 1u).w & MATERIAL_BASE_COLOR_MAP) != 0u)
        alpha *= bilinear(map_point(material, SLOT_BASE_COLOR, hit_texcoords(d, t))).a;
#endif
#if HIT_COLORS
    alpha *= hit_color(d, t).a;
#endif
    return alpha >= cutoff;
#else
    return true;
#endif
}
