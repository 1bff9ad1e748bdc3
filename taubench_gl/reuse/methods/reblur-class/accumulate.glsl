// Temporal accumulation of both lobes: the diffuse one along the motion of the surface, the specular one also along the motion
// of what it reflects, as far as that history can be trusted.
//
// Paper    Zhdanov 2021, ReBLUR, temporal accumulation: weight 1 / (1 + frames), frames limited; disocclusion by the distance
//          from the plane of the surface, tap by tap; virtual motion of reflections from the hit distance; Lagarde and de
//          Rousiers 2014: dominant direction of a rough lobe.  NRD documentation: a mean of the luminance over few frames;
//          Catmull-Rom history; specular history along both motions, blended by the confidence in the virtual one.
// Reference references.reuse_methods.virtual_px, dominant_factor, Reblur
// Departs  The frames of a footprint are multiplied by its accepted weight.  The virtual point is found with one hit
//          distance for both lobes and without curvature.  Confidence = dominant factor x accepted weight x the blur's weights
//          of normal and hit distance; frames along the surface are divided by 1 + dominant factor x pixels between both
//          positions.  NRD's terms are others.  Catmull-Rom weights of 4x4 pixels, of which the corners are not tested.
#include "disk.glsl"

struct Found { vec4 light; float frames; float fast; float total; }; // total: accepted weight

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

// Whether 4x4 taps without the corners are on the plane.
bool wide_on_plane(vec2 at, vec3 n, vec3 then, float depth) {
    ivec2 base = ivec2(floor(at)) - 1;
    for (int i = 0; i < 16; ++i) {
        ivec2 o = ivec2(i % 4, i / 4);
        bool corner = (o.x == 0 || o.x == 3) && (o.y == 0 || o.y == 3);
        if (!corner && !on_plane(base + o, n, then, depth)) return false;
    }
    return true;
}

Found history_of(ivec2 p, vec2 at, int lobe, float depth) {
    Found found = Found(vec4(0.0), 0.0, 0.0, 0.0);
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
    found.total = total;
    if (catmull_rom && total > 0.0 && wide_on_plane(at, n, then, depth)) {
        vec4 sharp = lobe == 0 ? cubic_prev_diffuse_light(at) : cubic_prev_specular_light(at);
        found.light.rgb = max(sharp.rgb, 0.0); // the negative lobes can undershoot
    }
    return found;
}

// Lagarde and de Rousiers 2014: 1 for a mirror, 0 for a diffuse lobe.
float dominant_factor(float rough) { return (1.0 - rough) * (sqrt(1.0 - rough) + rough); }

// Where the previous camera saw what pixel p reflects.
vec2 virtual_px(ivec2 p, float hit, float rough) {
    vec3 now = fetch_position(p).xyz, then = fetch_prev_position(p).xyz;
    vec4 clip = frame.prev_clip_from_prev * vec4(then + normalize(now) * hit * dominant_factor(rough), 1.0);
    if (clip.w <= frame.prev_near) return vec2(-1.0e6);
    return (0.5 * clip.xy / clip.w + 0.5) * vec2(frame.size.xy) - 0.5;
}

// Specular history along both motions.
Found specular_history(ivec2 p, vec4 specular, float depth) {
    float rough = fetch_material(p).y, dominant = dominant_factor(rough);
    vec2 at = previous_px(p), virtual_at = virtual_px(p, specular.a, rough);
    Found surface = history_of(p, at, 1, depth), seen = history_of(p, virtual_at, 1, depth);
    float turn = 1.0 - dot(nearest_history_normal(virtual_at).xyz, fetch_normal(p).xyz);
    float confidence = dominant * seen.total * hit_weight(specular.a, seen.light.a)
        * max(1.0 - turn / (normal_limit * max(lobe_factor(rough), 0.05)), 0.0);
    if (!virtual_history || !(confidence > 0.0)) confidence = 0.0; // also where the normal is not finite
    surface.frames = min(surface.frames, float(max_frames)) / (1.0 + dominant * min(distance(at, virtual_at), 1.0e3));
    Found both = Found(vec4(0.0), mix(surface.frames, seen.frames, confidence), 0.0, 0.0);
    if (surface.total <= 0.0) confidence = confidence > 0.0 ? 1.0 : 0.0;
    both.light = mix(surface.light, seen.light, confidence);
    both.fast = mix(surface.fast, seen.fast, confidence);
    return both;
}

void reuse(ivec2 p) {
    vec4 diffuse = fetch_diffuse_now(p), specular = fetch_specular_now(p);
    vec2 count = vec2(0.0), fast = vec2(0.0);
    float depth = fetch_position(p).w;
    Found d = Found(vec4(0.0), 0.0, 0.0, 0.0), s = d;
    vec3 new_d = diffuse.rgb, new_s = specular.rgb;
    if (depth > 0.0) {
        d = history_of(p, previous_px(p), 0, depth);
        s = specular_history(p, specular, depth);
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
