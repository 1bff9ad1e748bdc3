// The surface that a ray hits: geometry and material, as the geometry pass writes them, but seen from both sides.
//
// Reads      tables of hits, hit_atlas, posed vertices.
// Reference  frame/raytracing/reference in tests; gbuffer/gbuffer.frag.glsl
// Departs    Textures are sampled at their largest size.  Base color and emission, which light is linear in, take one texel
//            by chance with its bilinear weight.  As in the geometry pass, shading normals turn with the triangle.
#include "raytracing/alpha.glsl"
#include "raytracing/ray.glsl"

#if HIT_DIELECTRICS
// The lobe of a material beside its base color (common/dielectric.glsl).
struct Dielectric {
    vec3 f0;
    float specular;
    float transmission;
    float eta;
    bool thick;
    float medium; // place of the material where the surface bounds a volume; < 0: the viewer is in it
};

// ``textured``: read its textures at ``texcoords``; ``back``: seen from behind.
Dielectric dielectric_at(uint material, bool textured, vec4 texcoords, bool back) {
    uint last = material + HIT_MATERIAL_TEXELS - 2u;
    vec4 reflectance = hit_floats(last), through = hit_floats(last + 1u);
    uint flags = hit_words(material + 1u).w;
    Dielectric d;
    d.specular = hit_floats(material + 2u).z;
    d.transmission = through.w;
    d.thick = (flags & MATERIAL_THICK) != 0u;
    d.eta = through.w > 0.0 ? (d.thick && back ? 1.0 / reflectance.w : reflectance.w) : 0.0;
    d.medium = d.thick && through.w > 0.0 ? (back ? -float(material) : float(material)) : 0.0;
    vec3 color = reflectance.rgb;
#if HIT_TEXTURES
    flags = textured ? flags : 0u;
#if HIT_SPECULAR_COLOR_MAPS
    if ((flags & MATERIAL_SPECULAR_COLOR_MAP) != 0u) color *= bilinear_of_srgb(map_point(material, SLOT_SPECULAR_COLOR, texcoords));
#endif
#if HIT_SPECULAR_MAPS
    if ((flags & MATERIAL_SPECULAR_MAP) != 0u) d.specular *= bilinear(map_point(material, SLOT_SPECULAR, texcoords)).a;
#endif
#if HIT_TRANSMISSION_MAPS
    if ((flags & MATERIAL_TRANSMISSION_MAP) != 0u)
        d.transmission *= bilinear(map_point(material, SLOT_TRANSMISSION, texcoords)).r;
#endif
#endif
    d.f0 = min(color, 1.0) * d.specular;
    return d;
}
#endif

struct HitSurface {
    vec3 position;         // camera-relative
    vec3 geometric_normal; // unit, faces the ray's origin
    vec3 normal;           // unit, of shading; on the side of the vertices' normals that faces the ray's origin
    vec3 base_color;
    float metallic;
    float roughness;
    float specular;
    vec3 emission; // linear radiance; 0 of unlit surfaces
    int emitter;   // row of the emitter table, or -1
    bool unlit;    // scatters and emits nothing
    float area;    // of the triangle in this frame, square meters
#if HIT_DIELECTRICS
    Dielectric dielectric;
#endif
};

#if HIT_EMISSION
vec3 hit_emission(uint material, vec4 texcoords, float u) {
    vec4 m = hit_floats(material + 1u);
    vec3 emission = m.xyz;
#if HIT_EMISSIVE_MAPS
    if ((floatBitsToUint(m.w) & MATERIAL_EMISSIVE_MAP) != 0u)
        emission *= linear_of_srgb(one_texel(map_point(material, SLOT_EMISSIVE, texcoords), u).rgb);
#endif
    return emission;
}
#endif

#if HIT_POSED
vec3 posed_normal(uint at) {
    return vec3(posed_normals[3u * at], posed_normals[3u * at + 1u], posed_normals[3u * at + 2u]);
}
#endif

// The interpolated normal of the vertices, unit each.
vec3 vertex_normal(int draw, HitDraw d, HitTriangle t) {
    vec3 r = vec3(0.0);
#if HIT_POSED
    if (draw_is(d, DRAW_POSED)) {
        uint first = posed_vertex(draw);
        for (int i = 0; i < 3; ++i) r += t.weights[i] * posed_normal(first + t.vertices[i]);
        return r;
    }
#endif
    Affine m = draw_transform(draw);
    for (int i = 0; i < 3; ++i) {
        vec3 n = vec3(vertex_place(d, t.vertices[i]).w, vertex_rest(d, t.vertices[i]).zw);
        r += t.weights[i] * safe_normalize(transform_normal(m, n));
    }
    return r;
}

#if HIT_NORMAL_MAPS
vec4 vertex_tangent(int draw, HitDraw d, HitTriangle t) {
    vec4 r = vec4(0.0);
#if HIT_POSED
    if (draw_is(d, DRAW_POSED)) {
        for (int i = 0; i < 3; ++i) {
            uint at = 4u * (posed_vertex(draw) + t.vertices[i]);
            vec3 tangent = vec3(posed_tangents[at], posed_tangents[at + 1u], posed_tangents[at + 2u]);
            r += t.weights[i] * vec4(tangent, posed_tangents[at + 3u]);
        }
        return r;
    }
#endif
    Affine m = draw_transform(draw);
    float mirror = draw_is(d, DRAW_MIRRORED) ? -1.0 : 1.0;
    for (int i = 0; i < 3; ++i) {
        vec4 tangent = hit_floats(d.places.y + t.vertices[i]);
        r += t.weights[i] * vec4(safe_normalize(transform_vector(m, tangent.xyz)), mirror * tangent.w);
    }
    return r;
}

vec3 mapped_normal(vec3 n, vec4 tangent, uint material, vec4 texcoords) {
    vec3 t = safe_normalize(tangent.xyz - n * dot(n, tangent.xyz));
    vec3 b = tangent.w * cross(n, t);
    vec3 texel = bilinear(map_point(material, SLOT_NORMAL, texcoords)).xyz * 2.0 - 1.0;
    texel.xy *= hit_floats(material + 3u).x;
    return safe_normalize(texel.x * t + texel.y * b + texel.z * n);
}
#endif

// ``u`` in [0, 1): which texels are taken.
HitSurface surface_at(Ray ray, Hit hit, float u) {
    HitSurface s;
    HitDraw d = hit_draw(hit.instance);
    HitTriangle t = hit_triangle(d, hit.triangle, hit.barycentrics);
    HitCorners c = hit_corners(hit.instance, d, t.vertices);
    uint material = d.words.z;
    vec4 base = hit_floats(material), glow = hit_floats(material + 1u), factors = hit_floats(material + 2u);
    uint flags = floatBitsToUint(glow.w);
    vec4 texcoords = vec4(0.0);
#if HIT_TEXTURES
    if ((flags & MATERIAL_MAPS) != 0u) texcoords = hit_texcoords(d, t);
#endif

    s.position = point_on(c, t.weights);
    vec3 n = safe_normalize(vertex_normal(hit.instance, d, t));
    vec3 across = cross(c.e1, c.e2);
    s.area = 0.5 * length(across);
    vec3 g = safe_normalize(draw_is(d, DRAW_MIRRORED) ? -across : across);
    if (g == vec3(0.0)) g = n == vec3(0.0) ? -ray.direction : n;
#if HIT_NORMAL_MAPS
    if ((flags & MATERIAL_NORMAL_MAP) != 0u) n = mapped_normal(n, vertex_tangent(hit.instance, d, t), material, texcoords);
#endif
    if (n == vec3(0.0)) n = g;
    float side = dot(g, ray.direction) > 0.0 ? -1.0 : 1.0;
    s.geometric_normal = side * g;
    s.normal = side * n;

    s.base_color = base.rgb;
    s.metallic = factors.x;
    s.roughness = factors.y;
    s.specular = factors.z;
#if HIT_TEXTURES
    if ((flags & MATERIAL_BASE_COLOR_MAP) != 0u)
        s.base_color *= linear_of_srgb(one_texel(map_point(material, SLOT_BASE_COLOR, texcoords), u).rgb);
#endif
#if HIT_COLORS
    s.base_color *= hit_color(d, t).rgb;
#endif
#if HIT_METALLIC_ROUGHNESS_MAPS
    if ((flags & MATERIAL_METALLIC_ROUGHNESS_MAP) != 0u) {
        vec2 texel = bilinear(map_point(material, SLOT_METALLIC_ROUGHNESS, texcoords)).bg;
        s.metallic *= texel.x;
        s.roughness *= texel.y;
    }
#endif
#if HIT_DIELECTRICS
    s.dielectric = dielectric_at(material, true, texcoords, side < 0.0);
    s.specular = s.dielectric.specular;
#endif
    s.unlit = (flags & MATERIAL_UNLIT) != 0u;
    s.emission = vec3(0.0);
    s.emitter = -1;
#if HIT_EMISSION
    s.emission = hit_emission(material, texcoords, u);
    if (d.words.w != 0u) s.emitter = int(d.words.w) - 1 + hit.triangle;
#endif
    return s;
}
