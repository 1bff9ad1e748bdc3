// Temporal accumulation of both lobes: the diffuse one along the motion of the surface, the specular one along the motion
// of what it reflects.
//
// Paper    Zhdanov 2021, ReBLUR, temporal accumulation: weight 1 / (1 + frames), frames limited; disocclusion by the distance
//          from the plane of the surface, tap by tap; virtual motion of reflections from the hit distance; Lagarde and de
//          Rousiers 2014: dominant direction of a rough lobe.  NRD documentation: a mean of the luminance over few frames.
// Reference references.reuse_methods.virtual_px, dominant_factor, Reblur
// Departs  The frames of a footprint are multiplied by its accepted weight.  The virtual point is found with one hit
//          distance for both lobes and without curvature.
#include "disk.glsl"

struct Found { vec4 light; float frames; float fast; };

vec3 modulated(ivec2 p, vec3 d, vec3 s) {
    return d * fetch_diffuse_albedo(p).rgb + s * fetch_specular_albedo(p).rgb + fetch_emitted(p).rgb;
}

// What is blended, as colors; the blurs come after the blend.
void report(ivec2 p, vec3 d, vec3 s, Found old_d, Found old_s) {
    bool found = old_d.frames + old_s.frames > 0.0;
    vec4 history = found ? vec4(modulated(p, old_d.light.rgb, old_s.light.rgb), 1.0) : vec4(0.0);
    write_reprojected_history(p, history);
    write_rectified_history(p, history);
    write_blend_input(p, vec4(modulated(p, d, s), 1.0));
}

bool on_plane(ivec2 q, vec3 n, vec3 then, float depth) {
    if (!in_image(q)) return false;
    vec4 there = fetch_history_position(q);
    return there.w > 0.0 && abs(dot(n, there.xyz - then)) <= disocclusion * frustum_size(depth);
}

Found history_of(ivec2 p, vec2 at, int lobe, float depth) {
    Found found = Found(vec4(0.0), 0.0, 0.0);
    if (frame.has_history == 0u || !inside(at)) return found;
    vec3 n = fetch_normal(p).xyz, then = fetch_prev_position(p).xyz;
    float total = 0.0;
    for (int i = 0; i < 4; ++i) {
        Tap tap = bilinear_tap(at, i);
        if (tap.weight <= 0.0 || !on_plane(tap.at, n, then, depth)) continue;
        found.light += tap.weight * (lobe == 0 ? fetch_prev_diffuse_light(tap.at) : fetch_prev_specular_light(tap.at));
        found.frames += tap.weight * fetch_prev_frames(tap.at)[lobe];
        found.fast += tap.weight * fetch_prev_fast(tap.at)[lobe];
        total += tap.weight;
    }
    if (total > 0.0) { // the sum of frames stays weighted by the accepted weight
        found.light /= total;
        found.fast /= total;
    }
    return found;
}

// Where the previous camera saw what pixel p reflects.
vec2 virtual_px(ivec2 p, float hit, float rough) {
    vec3 now = fetch_position(p).xyz, then = fetch_prev_position(p).xyz;
    float dominant = (1.0 - rough) * (sqrt(1.0 - rough) + rough);
    vec4 clip = frame.prev_clip_from_prev * vec4(then + normalize(now) * hit * dominant, 1.0);
    if (clip.w <= frame.prev_near) return vec2(-1.0e6);
    return (0.5 * clip.xy / clip.w + 0.5) * vec2(frame.size.xy) - 0.5;
}

void reuse(ivec2 p) {
    vec4 diffuse = fetch_diffuse_now(p), specular = fetch_specular_now(p);
    vec2 count = vec2(0.0), fast = vec2(0.0);
    float depth = fetch_position(p).w;
    Found d = Found(vec4(0.0), 0.0, 0.0), s = d;
    vec3 new_d = diffuse.rgb, new_s = specular.rgb;
    if (depth > 0.0) {
        d = history_of(p, previous_px(p), 0, depth);
        s = history_of(p, virtual_px(p, specular.a, fetch_material(p).y), 1, depth);
        count = min(vec2(d.frames, s.frames), max_frames) + 1.0;
        vec2 lit = vec2(luminance(diffuse.rgb), luminance(specular.rgb));
        fast = mix(vec2(d.fast, s.fast), lit, 1.0 / min(count, vec2(float(fast_frames) + 1.0)));
        diffuse = mix(d.light, diffuse, 1.0 / count.x);
        specular = mix(s.light, specular, 1.0 / count.y);
    }
    report(p, new_d, new_s, d, s);
    write_diffuse_now(p, diffuse);
    write_specular_now(p, specular);
    write_count(p, count);
    write_fast_now(p, fast);
}
