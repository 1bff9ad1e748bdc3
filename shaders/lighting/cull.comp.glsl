// Tile light lists with a bounded error: a light is left out of a tile only while the sum of the upper bounds of all lights
// left out there stays below P.light_error (radiance times exposure).
//
// Bound of one light in one tile: its irradiance at the tile's nearest point times the largest brdf * cos that any pixel of
// the tile can have for any direction of light (``largest_brdf``).
//
// Reads      position normal base_color material, light table.
// Writes     tile_counts, tile_lists: rows of the light table, ascending.
// Reference  references.light_culling
#include "common/brdf.glsl"
#include "common/lights.glsl"
#include "common/to_camera.glsl"

const int BINS = 40; // powers of two of the bound, the last one 2^7 and above
const int LOWEST = -32;

float bound(LightRecord light, vec3 low, vec3 high, float brdf) {
#if SHADOWED_UNROLLED // every pixel evaluates these
    if (light.color.w >= 0.0) return 0.0;
#endif
    float peak = max(light.color.r, max(light.color.g, light.color.b)) * brdf;
    if (light.direction.w == KIND_DIRECTIONAL) return peak;
    vec3 nearest = clamp(light.position.xyz, low, high) - light.position.xyz;
    float d2 = max(dot(nearest, nearest), MIN_LIGHT_DISTANCE * MIN_LIGHT_DISTANCE);
    float range = light.position.w;
    if (range > 0.0) {
        float x = d2 / (range * range);
        peak *= clamp(1.0 - x * x, 0.0, 1.0);
    }
    return light.spot.w == 0.0 ? peak / d2 : peak;
}

// Largest brdf * cos(theta_l), any channel, over all directions of light.  GGX: D <= 1 / (pi a^2), and the visibility term
// times cos(theta_l) <= 0.5 / sqrt(n_v^2 (1 - a^2) + a^2); Fresnel: v.h >= n_v / 2, for 2 v.h n.h = n_v + n_l.
float largest_brdf(ivec2 pixel, vec3 p) {
    vec4 base = base_color_at(pixel);
    vec4 m = material_at(pixel);
    if (m.w < 0.0) return 0.0; // unlit
    float color = max(base.r, max(base.g, base.b));
#if GLOSSY
    vec3 v = direction_to_camera(pixel, p);
    float n_v = max(dot(normal_at(pixel).xyz, v), 1e-4);
    float a = max(m.y * m.y, MIN_ALPHA), a2 = a * a;
    float peak = 1.0 / (2.0 * PI * a2 * sqrt(n_v * n_v * (1.0 - a2) + a2));
    float away = max(1.0 - 0.5 * n_v, 0.0), away2 = away * away, schlick = away2 * away2 * away;
    float fresnel = (1.0 - m.x) * m.w * (0.04 + 0.96 * schlick) + m.x * mix(max(color, 0.0), max(color, 1.0), schlick);
    return (1.0 - m.x) * color / PI + fresnel * peak;
#else
    return color / PI;
#endif
}

int bin_of(float b) { return clamp(int(ceil(log2(b))) - LOWEST, 0, BINS - 1); }

void main() {
    uint tile = gl_GlobalInvocationID.x;
    if (tile >= uint(P.tiles)) return;
    ivec2 first = ivec2(int(tile) % P.size.z, int(tile) / P.size.z) * TILE;
    ivec2 last = min(first + TILE, P.size.xy);
    vec3 low = vec3(3.0e38), high = vec3(-3.0e38);
    float brdf = 0.0;
    for (int y = first.y; y < last.y; ++y)
        for (int x = first.x; x < last.x; ++x) {
            vec4 p = position_at(ivec2(x, y));
            if (!(p.w > 0.0)) continue;
            low = min(low, p.xyz);
            high = max(high, p.xyz);
            brdf = max(brdf, largest_brdf(ivec2(x, y), p.xyz));
        }
    brdf *= 1.0001 * P.exposure; // 1.0001: rounding
    uint kept = 0u, base = tile * uint(P.size.w);
    if (low.x <= high.x) {
        float sums[BINS];
        for (int b = 0; b < BINS; ++b) sums[b] = 0.0;
        for (int i = 0; i < P.size.w; ++i) {
            float b = bound(light_record(i), low, high, brdf);
            if (b > 0.0) sums[bin_of(b)] += b;
        }
        int cut = 0; // bins below ``cut`` are left out
        float left_out = 0.0;
        while (cut < BINS && left_out + sums[cut] <= P.light_error) left_out += sums[cut++];
        for (int i = 0; i < P.size.w; ++i) {
            float b = bound(light_record(i), low, high, brdf);
            if (b > 0.0 && bin_of(b) >= cut) tile_lists[base + kept++] = uint(i);
        }
    }
    tile_counts[tile] = kept;
}
