// SVGF's temporal filter: direct and indirect light apart, divided by albedo, and the moments of their luminance, along
// the motion, tap by tap.
//
// Paper    Schied et al. 2017, section 4: demodulation; section 4.1: 2x2 taps with bilinear weights, each tested for
//          depth, normal and object; if none passes, a 3x3 neighborhood is used; exponential moving average with alpha.
// Reference references.reuse_methods.demodulated, reprojected, new_weight, luminance_moments
#include "albedo.glsl"
#include "consistent.glsl"
#include "light.glsl"
#include "moments.glsl"
#include "share.glsl"

struct History { vec4 direct; vec3 indirect; vec4 moments; float total; }; // sums; direct.a: frames

void add(inout History h, ivec2 q, float weight) {
    h.direct += weight * fetch_prev_direct_light(q);
    h.indirect += weight * fetch_prev_indirect_light(q).rgb;
    h.moments += weight * fetch_prev_moments(q);
    h.total += weight;
}

History history_of(ivec2 p, bool surface) {
    History h = History(vec4(0.0), vec3(0.0), vec4(0.0), 0.0);
    vec2 at = previous_px(p);
    if (frame.has_history == 0u || !inside(at)) return h;
    float expected = dot(frame.prev_forward.xyz, fetch_prev_position(p).xyz);
    vec3 normal = fetch_normal(p).xyz;
    uint id = fetch_ids(p).x;
    for (int i = 0; i < 4; ++i) {
        Tap t = bilinear_tap(at, i);
        if (t.weight > 0.0 && consistent(t.at, surface, expected, normal, id)) add(h, t.at, t.weight);
    }
    if (h.total <= 0.0) {
        ivec2 middle = ivec2(floor(at + 0.5));
        for (int i = 0; i < 9; ++i) {
            ivec2 q = middle + ivec2(i % 3 - 1, i / 3 - 1);
            if (consistent(q, surface, expected, normal, id)) add(h, q, 1.0);
        }
    }
    if (h.total > 0.0) {
        h.direct /= h.total;
        h.indirect /= h.total;
        h.moments /= h.total;
    }
    return h;
}

// The history of light as a color.  It is not rectified; filter and anti-aliasing come after the blend.
void report(ivec2 p, bool surface, History h) {
    vec3 color = h.direct.rgb + h.indirect;
    if (surface) color = color * albedo_of(fetch_base_color(p)) + frame.exposure * fetch_emission(p).rgb;
    vec4 history = h.total > 0.0 ? vec4(color, 1.0) : vec4(0.0);
    write_reprojected_history(p, history);
    write_rectified_history(p, history);
}

void reuse(ivec2 p) {
    bool surface = fetch_position(p).w > 0.0;
    vec3 direct = new_direct(p), indirect = vec3(0.0);
    if (surface) {
        vec3 albedo = albedo_of(fetch_base_color(p));
        indirect = (new_light(p) - direct) / albedo;
        direct /= albedo;
    }
    History h = history_of(p, surface);
    report(p, surface, h);
    report_input(p);
    float count = frames_left(p, h.direct.a) + 1.0;
    float share = temporal_filter && h.total > 0.0 ? new_weight(p, h.direct.a, alpha) : 1.0;
    float share_moments = h.total > 0.0 ? new_weight(p, h.direct.a, alpha_moments) : 1.0;
    float l_d = luminance(direct), l_i = luminance(indirect);
    vec4 moments = mix(h.moments, vec4(l_d, l_d * l_d, l_i, l_i * l_i), share_moments);
    write_moments(p, moments);
    write_frames(p, vec2(min(count, 256.0), share));
    vec2 variance = variance_of(moments.xz, moments.yw);
    write_direct_filtered(p, vec4(mix(h.direct.rgb, direct, share), variance.x));
    write_indirect_filtered(p, vec4(mix(h.indirect, indirect, share), variance.y));
}
